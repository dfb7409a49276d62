"""Simulation-based calibration: worlds are drawn, their posteriors sampled, and the truth is one more draw.

So its rank among the draws is uniform whatever is compared (Talts, Betancourt, Simpson, Vehtari, Gelman 2018), the log
likelihood among it: a sampler that does not look at the readings has uniform ranks in all that does not (Modrák et al.
2023). And of all points that are black with posterior probability p, in all worlds, a share p is black in the truth.

``python -m tests.statistical.sbc WORLDS SEED`` prints the ranks of the laser's worlds, sampled plainly, as JSON.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

import prf
from prf.model.coloring import Draws
from prf.sampler.target import Target
from prf.shell.cli.console import progress
from tests.statistical.check import Check
from tests.statistical.problems import NAMES, PROBLEMS, DrawProblem, values
from tests.statistical.ranks import Verdict, make_band, rank_of
from tests.statistical.ways import N_DRAWS, WAYS, Way

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]
CONFIDENCE = 0.99
LEAST_AGREED = 0.9
"""Share of the worlds in which chains must agree: ranks of chains that do not mix say nothing about the ratios."""
BINS = np.linspace(0.0, 1.0, 6)


class World(NamedTuple):
    """What one world gave.

    Attributes
    ----------
    ranks : (k,) int array
        Of the truth among the draws.
    agreed : bool
        Whether the chains did.
    steps : int
        That each chain made.
    predicted, black : (m,) arrays
        Posterior probability of some points to be black, and whether they are.
    """

    ranks: Ints
    agreed: bool
    steps: int = 0
    predicted: Floats = np.empty(0)
    black: Bools = np.empty(0, np.bool_)


class Shares(NamedTuple):
    """By bin of the probability: points, mean prediction, share observed, z-score with worlds as the unit."""

    n: Ints
    predicted: Floats
    observed: Floats
    z: Floats


class Calibration(NamedTuple):
    """What came of all worlds.

    Attributes
    ----------
    names : tuple of str
        What was ranked, k.
    n_draws : int
        Among which: ranks are 0 ... ``n_draws``.
    worlds : list of World
    seconds : float
    """

    names: tuple[str, ...]
    n_draws: int
    worlds: list[World]
    seconds: float

    @property
    def ranks(self) -> Ints:
        """Ranks of the truth, (n_worlds, k)."""
        return np.array([world.ranks for world in self.worlds])

    @property
    def agreed(self) -> float:
        """Share of the worlds in which chains agree."""
        return float(np.mean([world.agreed for world in self.worlds]))

    def verdicts(self, confidence: float = CONFIDENCE) -> dict[str, Verdict]:
        """Return by name how uniform the ranks are."""
        band = make_band(len(self.worlds), self.n_draws, confidence)
        return {name: band.judge(self.ranks[:, k]) for k, name in enumerate(self.names)}

    def outside(self, confidence: float = CONFIDENCE) -> dict[str, Verdict]:
        """Return the verdicts of what leaves the band."""
        return {name: verdict for name, verdict in self.verdicts(confidence).items() if verdict.outside > 0}

    def shares(self) -> Shares:
        """Return how often points are black of which the posterior expects it so often.

        Points of one world hang together, so worlds are the unit.
        """
        predicted = np.array([world.predicted for world in self.worlds])
        black = np.array([world.black for world in self.worlds])
        which = np.minimum((predicted * (len(BINS) - 1)).astype(int), len(BINS) - 2)
        rows = []
        for k in range(len(BINS) - 1):
            inside = which == k
            surplus = np.where(inside, black - predicted, 0.0).sum(axis=1)
            error = np.sqrt((surplus**2).sum())
            n = inside.sum()
            rows.append(
                (n, predicted[inside].sum() / max(n, 1), black[inside].sum() / max(n, 1), surplus.sum() / error)
            )
        columns = np.array(rows).T
        return Shares(columns[0].astype(np.int64), *columns[1:])

    def words(self) -> str:
        """Return all of it, for a person."""
        lines = [f"{len(self.worlds)} worlds, chains agree in {self.agreed:.0%}"]
        if len(self.worlds[0].predicted):
            lines += [
                f"  {low:.1f}-{high:.1f}: {n:5d} points, predicted {predicted:.3f}, observed {observed:.3f}, z {z:+.2f}"
                for low, high, n, predicted, observed, z in zip(BINS, BINS[1:], *self.shares(), strict=False)
            ]
        lines += [f"  {name}: p {verdict.p:.4f}, {verdict.outside}" for name, verdict in self.verdicts().items()]
        return "\n".join(lines)


def calibrate(
    make: Callable[[int], World],
    n_worlds: int,
    names: tuple[str, ...] = (),
    n_draws: int = N_DRAWS,
    workers: int = 2,
    title: str = "calibration",
) -> Calibration:
    """Make worlds by their numbers, some at a time; threads change no result."""
    start, worlds = time.monotonic(), []
    with ThreadPoolExecutor(workers) as pool, progress(n_worlds, title) as reporter:
        for world in pool.map(make, range(n_worlds)):
            worlds.append(world)
            reporter(len(worlds), worlds=len(worlds))
    return Calibration(names, n_draws, worlds, time.monotonic() - start)


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
    names, values : tuple of str and callable
        What is ranked.
    """

    name: str
    draw: DrawProblem
    way: Way
    spoil: Callable[[Target], Target] = lambda target: target
    names: tuple[str, ...] = NAMES
    values: Callable[[Target, Draws], Floats] = values


def standard_arm(kind: str, way: str) -> Arm:
    """Return the arm of readings of a kind, sampled in a way."""
    return Arm(f"{kind}, {way}", PROBLEMS[kind], WAYS[way])


def run_arm(arm: Arm, n_worlds: int, seed: int, threads: int) -> Calibration:
    """Draw worlds, sample the posterior of each, and rank the truth."""

    def make(number: int) -> World:
        rng = np.random.default_rng([seed, *arm.name.encode(), number])
        target, truth = arm.draw(rng)
        answer = arm.way(arm.spoil(target), rng, threads)
        own, drawn = (arm.values(target, each) for each in (Draws.from_colorings([truth]), answer.draws))
        return World(rank_of(own[0], drawn, rng), bool(answer.agreed), int(answer.steps))

    return calibrate(make, n_worlds, arm.names, workers=1, title=arm.name)


def uniform_checks(arm: Arm, found: Calibration) -> list[Check]:
    """Return a check for each quantity, and one for the chains."""
    checks = [
        Check(
            f"calibration, {arm.name}: {name}",
            f"p {verdict.p:.3f}, {verdict.outside} of {N_DRAWS} places outside",
            f"band of {CONFIDENCE:.0%}, {len(found.worlds)} worlds",
            verdict.outside == 0,
            found.seconds / len(NAMES),
        )
        for name, verdict in found.verdicts().items()
    ]
    steps = int(np.median([world.steps for world in found.worlds]))
    statistic = f"chains agree in {found.agreed:.0%} of the worlds, median {steps:,} steps"
    mixing = found.agreed >= LEAST_AGREED
    return [*checks, Check(f"calibration, {arm.name}: mixing", statistic, f">= {LEAST_AGREED:.0%}", mixing, 0.0)]


def control_check(name: str, found: Calibration) -> Check:
    """Return the check of a mistake made on purpose: some quantity must leave the band, by much."""
    verdicts = found.verdicts()
    worst = min(verdicts, key=lambda quantity: (verdicts[quantity].p, -verdicts[quantity].outside))
    statistic = f"{worst}: p {verdicts[worst].p:.4f}, {verdicts[worst].outside} of {N_DRAWS} places outside"
    band = f"band of {CONFIDENCE:.0%}, {len(found.worlds)} worlds"
    return Check(f"control, {name}", statistic, band, not found.outside(), found.seconds, is_control=True)


if __name__ == "__main__":
    found = run_arm(standard_arm("laser", "plain"), int(sys.argv[1]), int(sys.argv[2]), 1)
    lists = {name: [getattr(world, name) for world in found.worlds] for name in ("agreed", "steps")}
    print(json.dumps({"package": prf.__file__, "seconds": found.seconds, "ranks": found.ranks.tolist(), **lists}))
