"""Chains driven round by round, and schedules with nothing to record on the way."""

from __future__ import annotations

import math
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from prf.kernels import constants as c
from prf.kernels.state.chain import Chain
from prf.sampler.chain import ChainRun
from prf.sampler.ensemble import Ensemble
from prf.sampler.schedules import Plain


def advance(ensemble: Ensemble, threads: int = 1) -> None:
    """Make one round in all chains."""
    ensemble.begin_round()
    with ThreadPoolExecutor(threads) as pool:
        ensemble.end_round(list(pool.map(ChainRun.advance, ensemble.chains)))


def advance_until_agreed(ensemble: Ensemble, steps: Sequence[int], most: float) -> float:
    """Run to the first of some steps at which R-hat of all that varies is below `most`, or to the last; return it."""
    rhat = math.inf
    for step in steps:
        while ensemble.step < step:
            advance(ensemble)
        rhat = max(found.rhat for found in ensemble.diagnose().values() if found.state == "varies")
        if rhat < most:
            break
    return rhat


def find_starts(ensemble: Ensemble) -> None:
    """Let all chains find where they start."""
    ensemble.chains = [chain.find_start(math.inf, lambda: False) for chain in ensemble.chains]


def step_to(run: ChainRun, step: int) -> None:
    """Run one chain up to `step` by its schedule, recording nothing."""
    run.chain = run_to(run.schedule, run.chain, run.rng, step)


def run_to(schedule: Plain, chain: Chain, rng: np.random.Generator, step: int) -> Chain:
    """Run a chain up to `step` by a schedule, with nothing to record on the way; return it."""
    while chain.graph.counts[c.STEP] < step:
        move, until = schedule.turn(int(chain.graph.counts[c.STEP]), step, step)
        chain = move(chain, rng, until)
    return chain
