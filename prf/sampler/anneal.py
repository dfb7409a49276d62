"""The one best map: chains cooled from the posterior to its mode, the best map that any of them saw is kept.

The mode is that of the density over the lines that carry the edges, |E| log p - 2 p length + log likelihood. Over
vertices the same distribution has the factors 1/|e| and sin(phi), and no mode: ever shorter edges are ever denser. At
temperature T the chain samples exp(that / T) times these factors, at T = 1 the posterior itself.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from prf.configuration import Cooling, Start
from prf.kernels import constants as c
from prf.model.coloring import Coloring
from prf.sampler.ensemble import Ensemble
from prf.sampler.session import StopRule, drive
from prf.sampler.target import Target
from prf.shell.scheduler import Workers

COOLING = Cooling()
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

    @property
    def score(self) -> float:
        """|E| log p - 2 p length + log likelihood of the best map, in nats."""
        return max(self.by_chain)


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
    return _best_so_far(ensemble, share, beta)


def _best_so_far(ensemble: Ensemble, share: float, beta: float) -> Annealed:
    """Return the best map of all chains; the first counts where several are as good."""
    found = [chain.record.best for chain in ensemble.chains if chain.record.best is not None]
    best = max(found, key=lambda draw: draw.functionals[-1])
    scores = tuple(float(draw.functionals[-1]) for draw in found)
    return Annealed(best.coloring, scores, ensemble.step, share, 1.0 / beta)
