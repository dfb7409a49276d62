"""Trees of boxes over the points of patches, and the distances between patches by their closest points."""

from typing import NamedTuple

import numpy as np

from mapq.kernels._jit import Floats, Ints, jit, part

LEAF = 16
"""Points of a leaf: below this the boxes cost more than the distances that they save."""


class BoxTrees(NamedTuple):
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
    low, high = np.full((root[n_patches], 3), np.inf), np.full((root[n_patches], 3), -np.inf)
    for i in range(n_patches):
        fill_boxes(points, start[i], start[i + 1], root[i], low, high)
    return low, high, root[:n_patches]


STACK = 256
"""Pairs of boxes that can wait: one a level of both trees, and 64 levels hold more points than memory does."""


@jit
def near_boxes(
    low: Floats, high: Floats, order: Ints, first: int, nearest: Floats, radius: float, limit: int
) -> tuple[Ints, int]:
    """Pairs (n, 2) of patches whose boxes may be close enough to matter, and the place in `order` from which to go on.

    `order` sorts the boxes (m, 3) by their lower x. Stops when `limit` pairs are found, so that memory stays bounded
    however the boxes overlap. See :func:`closest_patches` for what matters, and for `nearest`.
    """
    out = np.empty((limit + len(order), 2), np.int64)
    n_pairs, k = 0, nearest.shape[1] - 1
    while first < len(order) and n_pairs < limit:
        i = order[first]
        for place in range(first + 1, len(order)):
            j = order[place]
            if low[j, 0] > high[i, 0] + radius:
                break
            if box_gap(low, high, i, j) <= max(nearest[i, k], nearest[j, k]):
                out[n_pairs, 0], out[n_pairs, 1] = min(i, j), max(i, j)
                n_pairs += 1
        first += 1
    return out[:n_pairs], first


@part
def closest_in_leaves(points: Floats, a: int, a_end: int, b: int, b_end: int, best: Floats, bound: float) -> float:
    """Closest points of two runs; writes their middle to `best` where they are not farther apart than `bound`."""
    for p in range(a, a_end):
        for q in range(b, b_end):
            x, y, z = points[p, 0] - points[q, 0], points[p, 1] - points[q, 1], points[p, 2] - points[q, 2]
            squared = x * x + y * y + z * z
            if squared < bound or (squared == bound and best[0] != best[0]):
                bound = squared
                for axis in range(3):
                    best[axis] = 0.5 * (points[p, axis] + points[q, axis])
    return bound


@part
def box_size(low: Floats, high: Floats, node: int) -> float:
    """Longest side of a box."""
    return max(high[node, 0] - low[node, 0], max(high[node, 1] - low[node, 1], high[node, 2] - low[node, 2]))


@part
def closest_points(trees: BoxTrees, i: int, j: int, bound: float, best: Floats, stack: Ints) -> float:
    """Squared distance of the closest points of patches i and j if within `bound`, their middle in `best` (else nan).

    Walks both trees at once, nearer halves first, and leaves out what lies farther apart than the best so far.
    """
    points, start, low, high, root = trees
    best[0] = np.nan
    leaves_i, leaves_j = leaf_count(start[i + 1] - start[i]), leaf_count(start[j + 1] - start[j])
    stack[0, 0], stack[0, 1] = 1, 1
    height = 1
    while height > 0:
        height -= 1
        a, b = stack[height, 0], stack[height, 1]
        if box_gap(low, high, root[i] + a - 1, root[j] + b - 1) > bound:
            continue
        if a >= leaves_i and b >= leaves_j:
            p, q = start[i] + (a - leaves_i) * LEAF, start[j] + (b - leaves_j) * LEAF
            bound = closest_in_leaves(
                points, p, min(p + LEAF, start[i + 1]), q, min(q + LEAF, start[j + 1]), best, bound
            )
            continue
        halve_first = b >= leaves_j or (
            a < leaves_i and box_size(low, high, root[i] + a - 1) >= box_size(low, high, root[j] + b - 1)
        )
        a2, b2 = (2 * a, b) if halve_first else (a, 2 * b)
        a3, b3 = (2 * a + 1, b) if halve_first else (a, 2 * b + 1)
        gap2 = box_gap(low, high, root[i] + a2 - 1, root[j] + b2 - 1)
        gap3 = box_gap(low, high, root[i] + a3 - 1, root[j] + b3 - 1)
        if gap2 < gap3:
            a2, b2, a3, b3 = a3, b3, a2, b2
        stack[height, 0], stack[height, 1] = a2, b2
        stack[height + 1, 0], stack[height + 1, 1] = a3, b3
        height += 2
    return bound


@part
def insert(nearest: Floats, i: int, value: float) -> None:
    """Put a distance into row i of ascending distances, dropping the largest."""
    k = nearest.shape[1] - 1
    if value >= nearest[i, k]:
        return
    while k > 0 and nearest[i, k - 1] > value:
        nearest[i, k] = nearest[i, k - 1]
        k -= 1
    nearest[i, k] = value


@jit
def closest_patches(trees: BoxTrees, pairs: Ints, nearest: Floats) -> tuple[Floats, Floats]:
    """Distance (n,) and middle (n, 3) of the closest points of each pair, nan where it cannot matter.

    nearest: squared distances (m, k) of the k closest of each patch among all pairs so far, ascending, filled up with
    the squared radius; brought up to date. A pair matters if it is among these of one of its patches, ties included.
    `pairs` should be sorted by the distance of boxes: then the distances known so far rule out most of the rest.
    """
    distance, middle = np.empty(len(pairs)), np.empty((len(pairs), 3))
    stack = np.empty((STACK, 2), np.int64)
    best = np.empty(3)
    last = nearest.shape[1] - 1
    for k in range(len(pairs)):
        i, j = pairs[k, 0], pairs[k, 1]
        found = closest_points(trees, i, j, max(nearest[i, last], nearest[j, last]), best, stack)
        known = best[0] == best[0]
        distance[k] = np.sqrt(found) if known else np.nan
        for axis in range(3):
            middle[k, axis] = best[axis] if known else np.nan
        if known:
            insert(nearest, i, found)
            insert(nearest, j, found)
    return distance, middle
