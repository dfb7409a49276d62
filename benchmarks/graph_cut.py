"""CPU seconds of labelling a map of many patches: the cut, and min-marginals beside cuts made anew.

Run it from the repository's root::

    python -m benchmarks.graph_cut [--json FILE] [--seed N]

A table goes to stdout, then the same figures as one line of JSON. Graphs are those of maps: patches at random in the
plane, each joined to its four nearest, 2.4 pairs a patch; theta about 1, coupling about 0.3.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from mapq.crf.energy import Field
from mapq.crf.graph_cut import solve

SIZES = (10_000, 100_000, 1_000_000)
N_NEIGHBOURS = 4
N_FRESH = 20
"""Min-marginals that are computed by cuts made anew too."""
FORCE = 1e3
"""More than any patch's terms: forces its label."""


def draw_field(n_patches: int, seed: int) -> Field:
    """Return a field on a graph of nearest neighbours."""
    rng = np.random.default_rng(seed)
    xy = rng.random((n_patches, 2))
    nearest = cKDTree(xy).query(xy, k=N_NEIGHBOURS + 1)[1][:, 1:]
    both = np.column_stack([np.repeat(np.arange(n_patches), N_NEIGHBOURS), nearest.ravel()])
    pairs = np.unique(np.sort(both, axis=1), axis=0).astype(np.int64)
    return Field(rng.normal(size=n_patches), pairs, rng.exponential(0.3, len(pairs)))


def cpu(call: Callable[[], Any]) -> tuple[float, Any]:
    """Return the CPU seconds of a call, and its result."""
    start = time.process_time()
    result = call()
    return time.process_time() - start, result


def measure(n_patches: int, seed: int) -> dict[str, Any]:
    """Return the figures of one size."""
    field = draw_field(n_patches, seed)
    nobody = np.zeros(n_patches, np.bool_)
    cut_seconds, _ = cpu(lambda: solve(field, nobody))
    all_seconds, cut = cpu(lambda: solve(field))
    best = field.score(np.where(cut.label, 1.0, -1.0))
    chosen = np.random.default_rng(seed).choice(n_patches, N_FRESH, replace=False)

    def fresh(patch: int) -> float:
        theta = field.theta.copy()
        theta[patch] -= FORCE if cut.label[patch] else -FORCE
        other = field._replace(theta=theta)
        return best - field.score(np.where(solve(other, nobody).label, 1.0, -1.0))

    fresh_seconds, anew = cpu(lambda: [fresh(int(patch)) for patch in chosen])
    return {
        "patches": n_patches,
        "pairs": len(field.pairs),
        "cut_seconds": cut_seconds,
        "microseconds_per_min_marginal": (all_seconds - cut_seconds) / n_patches * 1e6,
        "fresh_microseconds_per_min_marginal": fresh_seconds / N_FRESH * 1e6,
        "largest_difference": float(np.abs(np.abs(cut.difference[chosen]) - anew).max()),
    }


def main() -> None:
    """Measure all sizes."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--json", metavar="FILE", help="where the JSON goes besides standard output")
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    solve(draw_field(100, 1))
    print(f"{'patches':>9}{'pairs':>9}{'cut, s':>9}{'us a min-marginal':>19}{'anew, us':>12}{'difference':>12}")
    rows = []
    for n_patches in SIZES:
        row = measure(n_patches, args.seed)
        rows.append(row)
        print(
            f"{row['patches']:>9}{row['pairs']:>9}{row['cut_seconds']:>9.3f}"
            f"{row['microseconds_per_min_marginal']:>19.2f}{row['fresh_microseconds_per_min_marginal']:>12.0f}"
            f"{row['largest_difference']:>12.1e}"
        )
    line = json.dumps({"schema": "mapq.benchmark.graph_cut/1", "seed": args.seed, "sizes": rows})
    print(line)
    if args.json:
        with open(args.json, "w", encoding="utf-8") as stream:
            stream.write(line + "\n")


if __name__ == "__main__":
    main()
