"""Simulation-based calibration: ranks of the truth among posterior draws, world by world.

Talts, Betancourt, Simpson, Vehtari, Gelman (2018). The log likelihood is among what is ranked, because a sampler that
does not look at the readings has uniform ranks in all that does not (Modrák et al. 2023).
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from prf.sampler.posterior import Settings
from prf.shell.cli.progress import progress
from tests.verify.check import Check
from tests.verify.problems import NAMES, PROBLEMS, DrawProblem, values
from tests.verify.ranks import Verdict, make_band, rank_of
from tests.verify.ways import N_DRAWS, WAYS, Way

Ints = NDArray[np.int64]
CONFIDENCE = 0.99
LEAST_AGREED = 0.9
"""Share of the worlds in which chains must agree: ranks of chains that do not mix say nothing about the ratios."""


class Arm(NamedTuple):
    """Worlds of one kind, sampled in one way.

    Attributes
    ----------
    name : str
    draw : callable
        Draws a world and its readings.
    way : callable
        Draws from the posterior.
    spoil : callable
        What the sampler is given in place of the right settings; the identity unless it is a control.
    """

    name: str
    draw: DrawProblem
    way: Way
    spoil: Callable[[Settings], Settings] = lambda settings: settings


class Ranks(NamedTuple):
    """Ranks of the truth, (n_worlds, len(NAMES)), on 0 ... ``N_DRAWS``, and what the chains came to.

    Attributes
    ----------
    ranks : (n_worlds, len(NAMES)) int array
    steps : (n_worlds,) int array
        That each chain made.
    agreed : (n_worlds,) bool array
    seconds : float
    """

    ranks: Ints
    steps: Ints
    agreed: NDArray[np.bool_]
    seconds: float

    def verdicts(self) -> dict[str, Verdict]:
        """Return by name how uniform the ranks are."""
        band = make_band(len(self.ranks), N_DRAWS, CONFIDENCE)
        return {name: band.judge(self.ranks[:, k]) for k, name in enumerate(NAMES)}


def standard_arm(kind: str, way: str) -> Arm:
    """Return the arm of readings of a kind, sampled in a way."""
    return Arm(f"{kind}, {way}", PROBLEMS[kind], WAYS[way])


def run_arm(arm: Arm, n_worlds: int, seed: int, threads: int) -> Ranks:
    """Draw worlds, sample the posterior of each, and rank the truth."""
    start = time.monotonic()
    rows, steps, agreed = [], [], []
    with progress(n_worlds, arm.name) as reporter:
        for number in range(n_worlds):
            rng = np.random.default_rng([seed, *arm.name.encode(), number])
            problem = arm.draw(rng)
            answer = arm.way(arm.spoil(problem.settings), rng, threads)
            truth = values(problem.settings, type(answer.draws).from_colorings([problem.truth]))
            rows.append(rank_of(truth[0], values(problem.settings, answer.draws), rng))
            steps.append(answer.steps)
            agreed.append(answer.agreed)
            reporter.update(number + 1, worlds=number + 1)
    return Ranks(np.array(rows), np.array(steps), np.array(agreed), time.monotonic() - start)


def uniform_checks(arm: Arm, found: Ranks) -> list[Check]:
    """Return a check for each quantity, and one for the chains."""
    share = float(found.agreed.mean())
    checks = [
        Check(
            f"calibration, {arm.name}: {name}",
            f"p {verdict.p:.3f}, {verdict.outside} of {N_DRAWS} places outside",
            f"band of {CONFIDENCE:.0%}, {len(found.ranks)} worlds",
            verdict.outside == 0,
            found.seconds / len(NAMES),
        )
        for name, verdict in found.verdicts().items()
    ]
    statistic = f"chains agree in {share:.0%} of the worlds, median {int(np.median(found.steps)):,} steps"
    return [
        *checks,
        Check(f"calibration, {arm.name}: mixing", statistic, f">= {LEAST_AGREED:.0%}", share >= LEAST_AGREED, 0.0),
    ]


def control_check(name: str, found: Ranks) -> Check:
    """Return the check of a mistake made on purpose: some quantity must leave the band, by much."""
    verdicts = found.verdicts()
    worst = min(verdicts, key=lambda quantity: (verdicts[quantity].p, -verdicts[quantity].outside))
    statistic = f"{worst}: p {verdicts[worst].p:.4f}, {verdicts[worst].outside} of {N_DRAWS} places outside"
    inside = all(verdict.outside == 0 for verdict in verdicts.values())
    return Check(
        f"control, {name}",
        statistic,
        f"band of {CONFIDENCE:.0%}, {len(found.ranks)} worlds",
        inside,
        found.seconds,
        True,
    )
