"""The one best map: chains cooled from the posterior to its mode, the best map that any of them saw is kept.

The mode is that of the density over the lines that carry the edges, |E| log p - 2 p length + log likelihood. Over
vertices the same distribution has the factors 1/|e| and sin(phi), and no mode: ever shorter edges are ever denser. At
temperature T the chain samples exp(that / T) times these factors, at T = 1 the posterior itself. Of walls it is the
mode of their density (:mod:`prf.kernels.walls.law`), which needs no such choice.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from prf.configuration import Cooling, Start
from prf.kernels import constants as c
from prf.kernels.state.build import recompute_sums
from prf.model.coloring import Coloring
from prf.model.layout import read_coloring
from prf.model.walls import united, walls_of
from prf.sampler.chain import line_score
from prf.sampler.directions import redraw_directions
from prf.sampler.ensemble import Ensemble
from prf.sampler.session import StopRule, drive
from prf.sampler.target import Target, make_chain, run_chain
from prf.shell.scheduler import Workers

COOLING = Cooling()
FIRST_COST, N_COSTS = 0.3, 40
"""Nats that an edge costs in the first stage of simplifying; in the last it costs the budget."""
LOOKS = 10
"""At the map in each stage, whether it is still within the budget."""
SETTLING = 200
"""Times that sampled directions are drawn before, until they are the best for the map that is there."""
STEPS_PER_EDGE = 30
"""Between two looks: in a stage every vertex is asked some forty times whether it can go."""
FROZEN = 1e12
"""Inverse temperature at which no step that loses anything is taken, whatever its proposal ratio."""


def inverse_temperature(cooling: Cooling, share: float) -> float:
    """Return 1 / T when `share` of the work is done; between warm and polish the logarithm of T falls evenly."""
    if share >= 1.0 - cooling.polish:
        return FROZEN
    cooled = max(0.0, share - cooling.warm) / (1.0 - cooling.warm - cooling.polish)
    return float(cooling.coldest**-cooled)


class Annealed(NamedTuple):
    """The best map that any chain saw so far."""

    best: Coloring
    by_chain: tuple[float, ...]  # the best score of each chain: their spread shows how certain the best one is
    steps: int  # of each chain
    share: float  # of the schedule that is done
    temperature: float
    given_up: float = 0.0  # nats that simplifying has cost; below 0 where it found a better map
    walls: NDArray[np.float64] | None = None  # (n, 5) of a map of walls, which `best` is the region of

    @property
    def score(self) -> float:
        """|E| log p - 2 p length + log likelihood of the best map, in nats."""
        return max(self.by_chain) - self.given_up


def anneal(
    target: Target,
    generators: list[np.random.Generator],
    rule: StopRule,
    workers: Workers = map,
    cooling: Cooling = COOLING,
    starts_from: Start = "empty",
    on_progress: Callable[[Annealed], None] = lambda _: None,
    stop_requested: Callable[[], bool] = lambda: False,
) -> Annealed:
    """Cool one chain a generator for the steps or the time of `rule`, and return the best map."""
    plain = dataclasses.replace(target, seen=None).with_execution(resolution=None, tiles=0)
    ensemble = Ensemble(plain, generators, starts_from=starts_from, is_cooled=True)
    share, beta = 0.0, inverse_temperature(cooling, 0.0)
    for progress in drive(ensemble, rule, workers, stop_requested):
        share = progress.share
        on_progress(_best_so_far(ensemble, share, beta))
        if stop_requested():
            break
        beta = inverse_temperature(cooling, share)
        for chain in ensemble.chains:
            chain.chain.density[c.INVERSE_TEMPERATURE] = beta
    found = _best_so_far(ensemble, share, beta)
    return found if target.walls is None else found._replace(best=united(found.best), walls=walls_of(found.best))


def simplified(
    found: Annealed,
    target: Target,
    budget: float,
    rng: np.random.Generator,
    on_progress: Callable[[float, Annealed], None] = lambda *_: None,
    stop_requested: Callable[[], bool] = lambda: False,
) -> Annealed:
    """Return the best map with fewer vertices, its score at most `budget` nats below the best one found.

    Each edge costs something, more from stage to stage; at temperature 0 the chain gives up edges that explain less
    than that, and moves what remains. The last stage within the budget counts.
    """
    plain = dataclasses.replace(target, seen=None).with_execution(resolution=None, tiles=0)
    chain = make_chain(plain, found.best)
    chain.density[c.INVERSE_TEMPERATURE] = FROZEN
    for _ in range(SETTLING):
        redraw_directions(chain, plain.orientation, rng)
    recompute_sums(chain)
    highest, simplest = line_score(chain), found
    for look, cost in enumerate(np.repeat(np.geomspace(FIRST_COST, max(FIRST_COST, budget), N_COSTS), LOOKS)):
        if stop_requested():
            break
        chain.density[c.EDGE_COST] = cost
        step = int(chain.graph.counts[c.STEP])
        chain = run_chain(chain, rng, step + STEPS_PER_EDGE * int(chain.graph.counts[c.EDGES] + 1))
        recompute_sums(chain)
        score = line_score(chain)
        highest = max(highest, score)
        if score < highest - budget:
            break
        best = read_coloring(chain.graph)
        simplest = found._replace(best=best, given_up=max(found.by_chain) - score)
        on_progress((look + 1) / (N_COSTS * LOOKS), simplest)
    return simplest


def _best_so_far(ensemble: Ensemble, share: float, beta: float) -> Annealed:
    """Return the best map of all chains; the first counts where several are as good."""
    found = [chain.record.best for chain in ensemble.chains if chain.record.best is not None]
    best = max(found, key=lambda draw: draw.functionals[-1])
    scores = tuple(float(draw.functionals[-1]) for draw in found)
    return Annealed(best.coloring, scores, ensemble.step, share, 1.0 / beta)
