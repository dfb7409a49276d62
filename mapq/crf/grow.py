"""Training of boosted trees: scikit-learn grows them, this package evaluates them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from mapq.crf.evidence import RISING
from mapq.kernels.boosted_trees import LEAF, Trees, contributions
from mapq.model import Columns, Potential

N_TREES, LEARNING_RATE, N_LEAVES, LEAST_ROWS, RIDGE = 100, 0.06, 6, 60, 5.0
"""Small trees that learn slowly: later maps are of other places and sensors."""
SAME = 1e-9
"""Nats: by which scikit-learn and this package may differ for one patch, by rounding."""

Floats = NDArray[np.float64]


def grow(columns: Sequence[Columns], labels: Sequence[Floats], weights: Sequence[Floats]) -> Potential:
    """Return the trees that separate suspicious patches from plausible ones.

    `columns`: one a map, of the same names. `labels`: +1 suspicious, -1 plausible, 0 without.
    """
    # Heavy, and only training needs them.
    from sklearn.ensemble import HistGradientBoostingClassifier  # noqa: PLC0415
    from threadpoolctl import threadpool_limits  # noqa: PLC0415

    names = columns[0].names
    known = [label != 0.0 for label in labels]
    x = np.vstack([each.values[mask] for each, mask in zip(columns, known, strict=True)])
    y = np.concatenate([label[mask] > 0.0 for label, mask in zip(labels, known, strict=True)])
    # A column of which nothing is known cannot be binned; without a split it has no effect either.
    x[:, np.isnan(x).all(axis=0)] = 0.0
    weight = np.concatenate([each[mask] for each, mask in zip(weights, known, strict=True)])
    booster = HistGradientBoostingClassifier(
        max_iter=N_TREES,
        learning_rate=LEARNING_RATE,
        max_leaf_nodes=N_LEAVES,
        min_samples_leaf=min(LEAST_ROWS, max(2, len(y) // 20)),
        l2_regularization=RIDGE,
        monotonic_cst=[RISING.get(name, 0) for name in names],
        early_stopping=False,
        random_state=0,
    )
    # The threads' partial sums would make the last bits depend on their number, and waiting for each other on a busy
    # machine takes longer than the work.
    with threadpool_limits(1):
        booster.fit(x, y, sample_weight=weight)
    trees = _trees_of([stage[0].nodes for stage in booster._predictors])
    found = Potential(names, trees, float(np.ravel(booster._baseline_prediction)[0]))
    log_odds = found.base + contributions(trees, np.ascontiguousarray(x)).sum(axis=1)
    if not np.allclose(log_odds, booster.decision_function(x), rtol=SAME, atol=SAME):
        raise RuntimeError("this scikit-learn keeps its trees in another form than mapq reads")
    return found


def _trees_of(parts: Sequence[NDArray[np.void]]) -> Trees:
    """Return trees given as scikit-learn's tables of nodes as one table."""
    sizes = [len(part) for part in parts]
    root = np.cumsum([0, *sizes[:-1]]).astype(np.int64)
    nodes = np.concatenate(parts)
    leaf, begin = nodes["is_leaf"].astype(bool), np.repeat(root, sizes)
    left, right = (np.where(leaf, 0, nodes[name].astype(np.int64) + begin) for name in ("left", "right"))
    value, count = np.where(leaf, nodes["value"], 0.0), nodes["count"].astype(np.float64)
    # Children are after their parents, so that backwards their means are known.
    for node in np.flatnonzero(~leaf)[::-1]:
        a, b = left[node], right[node]
        value[node] = (count[a] * value[a] + count[b] * value[b]) / (count[a] + count[b])
    column = np.where(leaf, LEAF, nodes["feature_idx"].astype(np.int64))
    threshold = np.where(leaf, 0.0, nodes["num_threshold"])
    return Trees(root, column, threshold, left, right, nodes["missing_go_to_left"].astype(bool), value)
