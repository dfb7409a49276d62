"""Mistakes made on purpose: the checks must catch each of them, with as many worlds as they need to pass."""

from __future__ import annotations

import dataclasses
import tempfile
from pathlib import Path

import numpy as np

from prf.model.arak import exact_draws
from prf.model.coloring import Coloring, Draws
from prf.model.layout import read_coloring
from prf.sampler.target import Target, make_chain, run_chain
from tests.reference.free_way import is_free
from tests.statistical import mutants
from tests.statistical.problems import NAMES, PROBLEMS
from tests.statistical.sbc import Arm, Calibration, World
from tests.statistical.ways import N_CHAINS, N_DRAWS, Answer, plain

SHARPER, BLUNTER = 0.4, 2.5
"""Noise that the sampler is told, as a share of the right one."""
SHORT = 1000
"""Steps of chains that are looked at too early."""
MUTANT = mutants.BIRTH
"""A ratio that is wrong by a number of permutations."""


def sharper(target: Target) -> Target:
    """Return settings in which the noise of all readings is taken for less than half of what it is."""
    return with_noise(target, SHARPER)


def blunter(target: Target) -> Target:
    """Return settings in which it is taken for more than twice of what it is: maps are explored as quickly as ever."""
    return with_noise(target, BLUNTER)


def rougher(target: Target) -> Target:
    """Return settings whose prior expects walls of half their length."""
    return dataclasses.replace(target, scale=2.0 * target.scale)


def with_noise(target: Target, factor: float) -> Target:
    """Return settings whose sensors have so many times their noise."""
    changes = {}
    for name in ("laser", "sonar"):
        data = getattr(target, name)
        if data is not None:
            model = data.model.replace(noise=factor * data.model.noise)
            changes[name] = dataclasses.replace(data, model=model)
    return dataclasses.replace(target, **changes)


def from_prior(target: Target, rng: np.random.Generator, threads: int) -> Answer:
    """Draws of the prior, whatever the readings: their ranks are uniform in all that does not look at these."""
    draws: list[Coloring] = []
    while len(draws) < N_DRAWS:
        some = exact_draws(target.scale, target.window, N_DRAWS, rng)
        draws += [draw for draw in some if is_free(target, draw)]
    return Answer(Draws.from_colorings(draws[:N_DRAWS]), 0, True)


def too_early(target: Target, rng: np.random.Generator, threads: int) -> Answer:
    """Draws of chains that have not left their start, the white map."""
    maps = []
    for generator in rng.spawn(N_CHAINS):
        chain = make_chain(target.with_execution(resolution=None), Coloring.empty(target.window))
        for step in np.linspace(SHORT // 2, SHORT, N_DRAWS // N_CHAINS).astype(int).tolist():
            chain = run_chain(chain, generator, step)
            maps.append(read_coloring(chain.graph))
    return Answer(Draws.from_colorings(maps), SHORT, True)


def control_arms() -> list[Arm]:
    """Return the arms that must leave the band, in this process."""
    laser = PROBLEMS["laser"]
    return [
        Arm("laser, noise taken for more than twice", laser, plain, blunter),
        Arm("laser, draws of the prior for those of the posterior", laser, from_prior),
        Arm("laser, chains stopped too early", laser, too_early),
    ]


def run_mutant(n_worlds: int, seed: int) -> Calibration:
    """Return ranks by a copy of the sampler with a mistake in a ratio, compiled in a process of its own."""
    with tempfile.TemporaryDirectory() as folder:
        arguments = ("tests.statistical.sbc", str(n_worlds), str(seed))
        found = mutants.run_check(Path(folder), MUTANT, *arguments, compiled=True)
    rows = zip(*(found[name] for name in ("ranks", "agreed", "steps")), strict=True)
    worlds = [World(np.array(ranks), agreed, steps) for ranks, agreed, steps in rows]
    return Calibration(NAMES, N_DRAWS, worlds, found["seconds"])
