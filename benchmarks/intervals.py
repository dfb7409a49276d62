"""Whether the intervals of `prf query` hold: many short runs of a log beside one long pooled answer.

Run it from the repository's root::

    python -m benchmarks.intervals LOG [--window X0 Y0 X1 Y1] [--scale P] [--steps N] [--runs R] [--cache FOLDER]

Points and paths are drawn at random in the window, half of them with a pooled probability in [.05, .95]. Printed are,
by class of the pooled probability, the share of intervals that hold it, beside that of the naive binomial interval, and
the median width. The colours that each run drew are kept in the cache, so a second call only judges.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy import stats

import prf
from prf.model.window import Window
from prf.results.estimate import (
    NEAR,
    by_chain,
    estimates,
    nearby_ess,
    occupied_in_draws,
    path_free_in_draws,
    probe_ess,
    smallest_ess,
)

RADIUS = 0.25
DRAWN = {"points": 1500, "paths": 300}
CHOSEN = {"points": 200, "paths": 30}
CLASSES = {"p in [.05, .95]": (0.05, 0.5), "else": (0.0, 0.05), "all": (0.0, 0.5)}
"""Bounds of min(p, 1 - p)."""


class Answers(NamedTuple):
    """What one run said, by draw: of points, paths, the colours it follows and its functionals; and draws' chains.

    Also its window, and where the colours are that it follows.
    """

    points: NDArray[np.bool_]
    paths: NDArray[np.bool_]
    colours: NDArray[np.bool_]
    functionals: NDArray[np.float64]
    chain: NDArray[np.int32]
    window: NDArray[np.float64]
    probe_xy: NDArray[np.float64]

    def least(self, kind: str, places: NDArray[np.int64]) -> tuple[float, NDArray[np.float64]]:
        """Return the smallest effective sample size of the run, and those near some of the questions."""
        window, colours = Window(*self.window.tolist()), by_chain(self.colours, self.chain)
        asked = shapely.points(random_points(window)) if kind == "points" else lines(window)
        reach = NEAR + (RADIUS if kind == "paths" else 0.0)
        least = smallest_ess(colours, by_chain(self.functionals, self.chain))
        return least, nearby_ess(asked[places], reach, self.probe_xy, probe_ess(colours), least)


def random_points(window: Window) -> NDArray[np.float64]:
    """Return points (n, 2) of a window."""
    return np.random.default_rng(1).uniform(window[:2], window[2:], (DRAWN["points"], 2))


def lines(window: Window) -> NDArray[np.object_]:
    """Return the paths that are asked as geometries."""
    return np.array([shapely.LineString(path) for path in random_paths(window, DRAWN["paths"])], object)


def random_paths(window: Window, n: int) -> list[NDArray[np.float64]]:
    """Return n paths of three corners, about a metre apart."""
    rng = np.random.default_rng(2)
    steps = rng.normal(0.0, 0.7, (n, 3, 2))
    steps[:, 0] = rng.uniform(window[:2], window[2:], (n, 2))
    return list(np.clip(np.cumsum(steps, axis=1), np.array(window[:2]) + 1e-6, np.array(window[2:]) - 1e-6))


def ask(run: prf.Run) -> Answers:
    """Return what a run says of points and paths that are drawn anew, the same for every run."""
    window = run.draws.window
    points = random_points(window)
    paths = [path_free_in_draws(run.draws, path, RADIUS) for path in random_paths(window, DRAWN["paths"])]
    functionals = np.column_stack(list(run.functionals.values()))
    said = occupied_in_draws(run.draws, points), np.stack(paths, 1), run.probe_black, functionals
    return Answers(*said, run.chain, np.array(window), run.probe_xy)


def answers(options: argparse.Namespace, steps: int, seed: int) -> Answers:
    """Return the answers of one run, from the cache if it was made."""
    log = options.log
    file = options.cache / f"{log.parent.name}-{log.name}-{steps}-{seed}.npz"
    if not file.exists():
        prior = prf.Prior(scale=options.scale, window=None if options.window is None else tuple(options.window))
        found = ask(prf.sample(log, prior, steps=steps, seed=seed, threads=options.threads, progress=False))
        np.savez_compressed(file, **found._asdict())
    with np.load(file) as data:
        return Answers(**data)


def chosen(pooled: NDArray[np.float64], n: int) -> NDArray[np.int64]:
    """Return n places, half of them with a pooled probability in [.05, .95] if so many have."""
    unsure = np.abs(pooled - 0.5) <= 0.45
    return np.concatenate([np.flatnonzero(unsure)[: n // 2], np.flatnonzero(~unsure)[: n // 2]])


def naive(black: NDArray[np.bool_]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the Jeffreys interval that takes all draws (n_chains, n_draws, n) for independent."""
    n, k = black.shape[0] * black.shape[1], black.sum(axis=(0, 1))
    low, high = (stats.beta.ppf(level, k + 0.5, n - k + 0.5) for level in (0.025, 0.975))
    return np.where(k == 0, 0.0, low), np.where(k == n, 1.0, high)


def judge(kind: str, short: list[Answers], pooled: NDArray[np.float64]) -> None:
    """Print coverage and width of the intervals of one kind of question."""
    places = chosen(pooled, CHOSEN[kind])
    truth = pooled[places]
    holds, naive_holds, width = [], [], []
    for run in short:
        black = by_chain(getattr(run, kind)[:, places], run.chain)
        found = estimates(black, *run.least(kind, places))
        holds.append((found.low <= truth) & (truth <= found.high))
        width.append(found.high - found.low)
        low, high = naive(black)
        naive_holds.append((low <= truth) & (truth <= high))
    for name, (least, most) in CLASSES.items():
        of = (np.minimum(truth, 1.0 - truth) >= least) & (np.minimum(truth, 1.0 - truth) <= most)
        shares = (np.mean(np.array(rows)[:, of]) for rows in (holds, naive_holds))
        print(f"{kind:7} {name:16} {of.sum():4}", *(f"{share:9.3f}" for share in shares), end=" ")
        print(f"{np.median(np.array(width)[:, of]):9.3f}")


def main() -> None:
    """Print how often intervals of short runs hold the answer of a long one."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("log", type=Path)
    parser.add_argument("--window", type=float, nargs=4)
    parser.add_argument("--scale", type=float, default=0.1)
    parser.add_argument("--steps", type=int, default=1_500_000, help="a chain of a short run: 15 s on a quiet machine")
    parser.add_argument("--runs", type=int, default=20)
    parser.add_argument("--long-steps", type=int, default=6_000_000)
    parser.add_argument("--long-runs", type=int, default=6)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--cache", type=Path, default=Path("/tmp/intervals"))
    options = parser.parse_args()
    options.cache.mkdir(exist_ok=True)
    long = [answers(options, options.long_steps, 1001 + number) for number in range(options.long_runs)]
    short = [answers(options, options.steps, 1 + number) for number in range(options.runs)]
    print(f"{'':7} {'class':16} {'n':>4} {'coverage':>9} {'naive':>9} {'width':>9}")
    for kind in DRAWN:
        judge(kind, short, np.mean([getattr(run, kind).mean(axis=0) for run in long], axis=0))


if __name__ == "__main__":
    main()
