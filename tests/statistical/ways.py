"""Ways to draw from a posterior: a plain chain that uses no accelerator, and the sampler with all that keep the law.

How long a way goes on is decided by its chains alone, never by the truth: chains double their steps until they agree
(R-hat) and are worth as many independent draws as are ranked (ESS). Half of the steps, at least, are burn-in.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple
from unittest import mock

import numpy as np
from numpy.typing import NDArray

from prf.kernels.state.chain import Chain
from prf.model.arak import exact_draws
from prf.model.coloring import Coloring, Draws
from prf.model.layout import read_coloring
from prf.results.convergence import diagnose
from prf.sampler import Ensemble
from prf.sampler.schedules import LadderPlan
from prf.sampler.target import Target, make_chain, run_chain, with_map
from prf.sampler.tiles import rounds, schedule
from prf.shell.cli.storage import spawn_generators
from tests.driving import advance
from tests.reference.free_way import is_free
from tests.statistical.problems import NAMES, from_map

Floats = NDArray[np.float64]

N_DRAWS = 40
"""Ranked draws of a posterior, L."""
N_CHAINS = 2
MOST_RHAT = 1.1
FIRST_STEPS, MOST_STEPS = 320_000, 5_120_000
"""Of a chain; the powers of temperatures move after the first for the last time."""
KEPT = 256
"""Maps that a plain chain keeps of the second half of its steps."""
UNREACHED = 1e6
"""Nats that any beam may gain: bounds so wide reject nothing."""
LEVELS = 3
LADDER = LadderPlan(3, lowest=0.0)
"""The lowest temperature has exact draws of the prior."""
TILES = 4
TILE_ROUND, PLAIN_SHARE = 16_000, 0.5
"""Steps of a round, and the share of them on the whole window: the sampler's own are for windows of many rooms. In one
that an edge may cross, few edges lie in one tile."""


class Answer(NamedTuple):
    """Draws of a posterior, as many from each chain, and what the chains came to.

    Attributes
    ----------
    draws : Draws
        ``N_DRAWS`` of them.
    steps : int
        That each chain made.
    agreed : bool
        Whether chains agreed in the end.
    """

    draws: Draws
    steps: int
    agreed: bool


Way = Callable[[Target, np.random.Generator, int], Answer]
"""Called with the posterior, a generator, and the number of threads."""


def prior_start(target: Target, rng: np.random.Generator) -> Coloring:
    """Return a draw of the prior in which every sensor stands in white and the way is free: it knows no more."""
    while True:
        draw = exact_draws(target.scale, target.window, 1, rng)[0]
        if is_free(target, draw):
            return draw


def unbounded(chain: Chain) -> Chain:
    """Return a fresh chain in which no bound ever rejects: all readings are asked before a decision."""
    return chain._replace(beams=chain.beams._replace(best=np.full_like(chain.beams.best, UNREACHED)))


def plain(target: Target, rng: np.random.Generator, threads: int) -> Answer:
    """One step after the other, in one thread, all readings asked; chains start from draws of the prior."""
    target = target.with_execution(levels=1, resolution=None)
    chains = []
    for generator in rng.spawn(N_CHAINS):
        chain = make_chain(target, Coloring.empty(target.window))
        chains.append((with_map(unbounded(chain), target, prior_start(target, generator)), generator))
    steps = FIRST_STEPS
    while True:
        kept = []
        for k, (chain, generator) in enumerate(chains):
            maps = []
            for step in np.linspace(steps // 2, steps, KEPT + 1).astype(int).tolist():
                chain = run_chain(chain, generator, step)
                maps.append(read_coloring(chain.graph))
            chains[k] = chain, generator
            kept.append(Draws.from_colorings(maps[1:]))
        agreed = agree(kept)
        if agreed or steps >= MOST_STEPS:
            return Answer(spread(kept), steps, agreed)
        steps *= 2


def by_sampler(target: Target, rng: np.random.Generator, threads: int, plan: LadderPlan | None) -> Answer:
    """As ``prf sample`` does it, from the white map."""
    return until_agreed(Ensemble(target, rng.spawn(N_CHAINS), plan=plan, threads=threads), threads)


def until_agreed(sampler: Ensemble, threads: int) -> Answer:
    """Double the steps of chains until they agree."""
    goal = FIRST_STEPS
    while True:
        while sampler.step < goal:
            advance(sampler, threads)
        sample = sampler.sample()
        kept = [
            Draws.from_colorings([sample.draws[int(i)] for i in np.flatnonzero(sample.chain == k)])
            for k in range(N_CHAINS)
        ]
        agreed = agree(kept)
        if agreed or goal >= MOST_STEPS:
            return Answer(spread(kept), sampler.step, agreed)
        goal *= 2


def with_tempering(target: Target, rng: np.random.Generator, threads: int) -> Answer:
    """Bounds, levels, hot chains below every chain, chains in threads."""
    return by_sampler(target.with_execution(levels=LEVELS), rng, threads, LADDER)


def with_tiles(target: Target, rng: np.random.Generator, threads: int) -> Answer:
    """Bounds, levels, tiles, tiles in threads. Temperatures and tiles cannot be combined."""
    with (
        mock.patch.object(rounds, "ROUND_LENGTHS", (TILE_ROUND, TILE_ROUND)),
        mock.patch.object(schedule, "PLAIN_SHARE", PLAIN_SHARE),
    ):
        return by_sampler(target.with_execution(levels=LEVELS, tiles=TILES), rng, threads, None)


Stages = tuple[tuple[int, float], ...]
"""Steps at which chains are asked whether they agree, and the R-hat (worst of all that is watched) that will do.

When to stop depends on the chains alone, never on the truth, so it cannot favour right answers.
"""


def in_stages(target: Target, seed: int, stages: Stages, rungs: int = 1) -> tuple[Draws, float]:
    """Return the draws of four chains in one thread, and how well the chains agree (R-hat)."""
    sampler = Ensemble(target, spawn_generators(seed, 4), plan=LadderPlan(rungs))
    for steps, enough in stages:
        while sampler.step < steps:
            advance(sampler)
        rhat = max((found.rhat for found in sampler.diagnose().values() if found.state != "constant"), default=1.0)
        if rhat < enough:
            break
    return sampler.sample().draws, rhat


WAYS: dict[str, Way] = {"plain": plain, "tempered": with_tempering, "tiles": with_tiles}


def agree(kept: list[Draws]) -> bool:
    """Return whether chains agree in what is compared, and are worth ``N_DRAWS`` independent draws together."""
    found = np.array([from_map(draws) for draws in kept])
    diagnoses = diagnose({name: found[:, :, k] for k, name in enumerate(NAMES[: found.shape[2]])})
    return all(
        one.state == "constant" or (one.state == "varies" and one.rhat < MOST_RHAT and one.ess > N_DRAWS)
        for one in diagnoses.values()
    )


def spread(kept: list[Draws]) -> Draws:
    """Return ``N_DRAWS`` draws, as many from each chain, as far from each other as can be."""
    each = N_DRAWS // len(kept)
    return Draws.from_colorings([draws[i * len(draws) // each - 1] for draws in kept for i in range(1, each + 1)])
