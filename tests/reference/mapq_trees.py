"""Boosted trees by their definition: one walk for each row and tree, in plain Python."""

from __future__ import annotations

import itertools
import math

import numpy as np

from mapq.kernels.boosted_trees import LEAF, Trees
from mapq.model import Columns, Potential


def draw_potential(rng: np.random.Generator, names: tuple[str, ...], n_trees: int = 6, depth: int = 3) -> Potential:
    """Return trees of random questions, some branches shorter than others; means are those of equally many rows."""
    rows: list[list[float]] = []
    roots = [_grow(rng, len(names), depth, rows) for _ in range(n_trees)]
    table = np.array(rows).T
    column, left, right = (table[place].astype(np.int64) for place in (0, 2, 3))
    trees = Trees(np.array(roots), column, table[1].copy(), left, right, table[4] > 0.0, table[5].copy())
    return Potential(names, trees, float(rng.normal()))


def _grow(rng: np.random.Generator, n_columns: int, depth: int, rows: list[list[float]], level: int = 0) -> int:
    """Append a node and all that hangs on it; its number."""
    at = len(rows)
    rows.append([LEAF, 0.0, 0, 0, 0.0, rng.normal()])
    if level < depth and (level == 0 or rng.random() < 0.8):
        left, right = (_grow(rng, n_columns, depth, rows, level + 1) for _ in range(2))
        mean = 0.5 * (rows[left][5] + rows[right][5])
        rows[at] = [rng.integers(n_columns), rng.normal(), left, right, rng.integers(2), mean]
    return at


def slow_walk(trees: Trees, root: int, row: list[float]) -> list[int]:
    """Return the nodes by which a row goes through a tree, the leaf last."""
    way = [root]
    while trees.column[way[-1]] != LEAF:
        node = way[-1]
        value = row[trees.column[node]]
        to_left = bool(trees.nan_left[node]) if math.isnan(value) else value <= trees.threshold[node]
        way.append(int((trees.left if to_left else trees.right)[node]))
    return way


def slow_contributions(trees: Trees, row: list[float]) -> list[float]:
    """Return what each column adds to the sum of the trees, and last what they say before any question."""
    out = [0.0] * (len(row) + 1)
    for root in trees.root.tolist():
        way = slow_walk(trees, root, row)
        out[-1] += float(trees.value[root])
        for node, following in itertools.pairwise(way):
            out[trees.column[node]] += float(trees.value[following] - trees.value[node])
    return out


def slow_log_odds(potential: Potential, columns: Columns) -> list[float]:
    """Return the log-odds of each patch: the base and the leaves that it comes to."""
    places = [columns.names.index(name) for name in potential.names]
    rows = columns.values[:, places].tolist()
    leaves = [[slow_walk(potential.trees, root, row)[-1] for root in potential.trees.root.tolist()] for row in rows]
    return [potential.base + sum(float(potential.trees.value[leaf]) for leaf in each) for each in leaves]
