"""Sums of regression trees, and what each column adds to them."""

from typing import NamedTuple

import numpy as np

from mapq.kernels._jit import Bools, Floats, Ints, jit

LEAF = -1


class Trees(NamedTuple):
    """Trees, node after node; numbers of nodes count over all trees."""

    root: Ints  # (t,)
    column: Ints  # (k,) that a node tests; `LEAF` for leaves
    threshold: Floats  # (k,) values up to it go left
    left: Ints  # (k,)
    right: Ints  # (k,)
    nan_left: Bools  # (k,) whether unknown values go left
    value: Floats  # (k,) of leaves what they add, nats of log-odds; else the mean of their leaves by training rows


@jit
def contributions(trees: Trees, rows: Floats) -> Floats:
    """What each column adds to the sum of the trees (n, c + 1), the last one their mean over all rows.

    A step from a node to the next changes the mean, and the change belongs to the column that was tested (Saabas
    2014); the sum over all is the value of the trees.
    """
    n_columns = rows.shape[1]
    out = np.zeros((len(rows), n_columns + 1))
    for row in range(len(rows)):
        for root in trees.root:
            node = root
            out[row, n_columns] += trees.value[node]
            while trees.column[node] != LEAF:
                value = rows[row, trees.column[node]]
                goes_left = trees.nan_left[node] if np.isnan(value) else value <= trees.threshold[node]
                following = trees.left[node] if goes_left else trees.right[node]
                out[row, trees.column[node]] += trees.value[following] - trees.value[node]
                node = following
    return out
