"""A tree of boxes over the points of each patch, which lie along a space-filling curve."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.kernels._jit import jit, part

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

LEAF = 16
"""Points of a leaf: below this the boxes cost more than the distances that they save."""


class Trees(NamedTuple):
    """The points of all patches, patch after patch, and the boxes over them (see :func:`make_boxes`)."""

    points: Floats
    start: Ints
    low: Floats
    high: Floats
    root: Ints


@part
def leaf_count(n: int) -> int:
    """Leaves of a complete binary tree over n points: a power of two."""
    leaves = 1
    while leaves * LEAF < n:
        leaves *= 2
    return leaves


@part
def box_gap(low: Floats, high: Floats, a: int, b: int) -> float:
    """Squared distance between boxes a and b; infinite where one is empty."""
    total = 0.0
    for axis in range(3):
        gap = max(low[a, axis] - high[b, axis], low[b, axis] - high[a, axis])
        if gap > 0.0:
            total += gap * gap
    return total


@part
def fill_boxes(points: Floats, first: int, last: int, root: int, low: Floats, high: Floats) -> None:
    """Boxes of one patch's tree: node k (from 1) at ``root + k - 1``, its halves 2 k and 2 k + 1."""
    leaves = leaf_count(last - first)
    for leaf in range(leaves):
        node = root + leaves + leaf - 1
        for k in range(first + leaf * LEAF, min(first + (leaf + 1) * LEAF, last)):
            for axis in range(3):
                low[node, axis] = min(low[node, axis], points[k, axis])
                high[node, axis] = max(high[node, axis], points[k, axis])
    for k in range(leaves - 1, 0, -1):
        for axis in range(3):
            low[root + k - 1, axis] = min(low[root + 2 * k - 1, axis], low[root + 2 * k, axis])
            high[root + k - 1, axis] = max(high[root + 2 * k - 1, axis], high[root + 2 * k, axis])


@jit
def make_boxes(points: Floats, start: Ints) -> tuple[Floats, Floats, Ints]:
    """Lower and upper corners (n_nodes, 3) of all trees, and the root (m,) of each patch's."""
    n_patches = len(start) - 1
    root = np.zeros(n_patches + 1, np.int64)
    for i in range(n_patches):
        root[i + 1] = root[i] + 2 * leaf_count(start[i + 1] - start[i]) - 1
    low, high = np.empty((root[n_patches], 3)), np.empty((root[n_patches], 3))
    for node in range(root[n_patches]):
        for axis in range(3):
            low[node, axis], high[node, axis] = np.inf, -np.inf
    for i in range(n_patches):
        fill_boxes(points, start[i], start[i + 1], root[i], low, high)
    return low, high, root[:n_patches]
