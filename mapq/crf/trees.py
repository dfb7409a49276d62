"""Potentials of patches by boosted trees: evidence that a surface is farther apart than the tolerance.

Of all that is measured on a patch and its pairs, in metres and in tolerances: one model serves every tolerance, and no
column makes an error more likely at a larger one. Pairs are evidence for each of their patches through the pair that is
in the worst conflict. The trees' log-odds are one more node feature, `EVIDENCE`, which the random field weighs against
the labels of neighbours.

scikit-learn grows them, this package evaluates them.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapq.features import copies
from mapq.features.context import DISAGREEMENT, NODE_COLUMNS
from mapq.features.table import PatchFeatures
from mapq.kernels.boosted_trees import LEAF, Trees, contributions
from mapq.labels import LABEL_TOLERANCE
from mapq.model import EVIDENCE, NOBODY, Columns, Potential

OVER, ACROSS = "worst_overlap", "worst_crossing"
SHARES = ("partly_covered", "unlike_height", "facing_away")
"""Of the pair with the largest weighted overlap, in times this, which they contain."""
LEFT_OUT = ("tilt", *DISAGREEMENT, "shift_along", "shift_length")
"""Node features that trees do not see: of walls of other places something else would be learnt from their tilt, and
what scans disagree by, and copies are off, they see in tolerances."""
TOLERANCE, SURELY = "tolerance", "disagreement_beyond"
"""Metres, and by how many standard errors the measured disagreement is larger; at most `MOST_SURE`."""
LOW_RATIO = "low_ratio"
IN_TOLERANCES = {
    "disagreement_ratio": "disagreement",
    LOW_RATIO: "disagreement_low",
    "high_ratio": "disagreement_high",
    "along_ratio": "shift_along",
}
"""Columns in tolerances to those in metres."""
OFFSET_RATIO = "over_offset_ratio"
"""Distance in tolerances of the patch of the worst overlap."""
MOST_SURE = 10.0
DECISIVE = 2.0
"""Nats of evidence at least, where the lower bound of what scans disagree by is above the tolerance.

Of such patches 89 of 100 (training cities, 0.8 m) to 99 (training worlds) are wrong; a larger floor would put the few
that are not above others whose disagreement is larger."""
RISING = {
    TOLERANCE: -1,
    **dict.fromkeys((SURELY, OFFSET_RATIO, *IN_TOLERANCES), 1),
    **dict.fromkeys(("fit", "thickness"), -1),
    **dict.fromkeys((OVER, ACROSS), 1),
    "over_facing_away": -1,
    **copies.COLUMNS,
}
"""Columns of which a larger value makes an error only more likely, 1, or less, -1; the others may do either."""

KNOWS_SCANS = "knows_scans"
"""1 where the scans of a map are known, else nan: which trees count, and no evidence."""
OF_SCANS = (
    *(KNOWS_SCANS, SURELY, "disagreement_ratio", LOW_RATIO, "high_ratio"),
    *(*NODE_COLUMNS["moments"], "over_facing_away"),
)
"""Columns that are not known where it is not known when and from where a map was seen."""

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


def without_scans(columns: Columns) -> Columns:
    """Return the columns as a map has them of which it is not known when and from where it was seen."""
    return columns._replace(values=np.where(np.isin(columns.names, OF_SCANS), np.nan, columns.values))


def with_evidence(
    features: PatchFeatures, potential: Potential | None, tolerance: float = LABEL_TOLERANCE
) -> PatchFeatures:
    """Return the features with the log-odds of the trees as one more node feature; as they are without trees."""
    if potential is None:
        return features
    return add_evidence(features, evidence_of(columns_of(features, tolerance), potential))


def evidence_of(columns: Columns, potential: Potential) -> Floats:
    """Return the log-odds (m,) of the trees, and at least `DECISIVE` where scans are surely farther apart."""
    return decided(columns.take(potential.names), potential.log_odds(columns))


def decided(columns: Columns, evidence: Floats) -> Floats:
    """Return evidence (m,), at least `DECISIVE` where columns say that scans are surely farther apart."""
    if LOW_RATIO not in columns.names:
        return evidence
    low = columns.values[:, columns.names.index(LOW_RATIO)]
    return np.where(low > 1.0, np.maximum(evidence, DECISIVE), evidence)


def add_evidence(features: PatchFeatures, evidence: Floats) -> PatchFeatures:
    """Return the features with log-odds (m,) as one more node feature."""
    node = np.column_stack([features.node, evidence])
    return features._replace(node=node, node_names=(*features.node_names, EVIDENCE))


def columns_of(features: PatchFeatures, tolerance: float = LABEL_TOLERANCE) -> Columns:
    """Return what trees see of patches: node features, and those of the pairs in the worst conflict.

    `tolerance`: metres from which surfaces are wrong.
    """
    n_patches = len(features.node)
    edge = dict(zip(features.edge_names, features.edge.T, strict=True))
    over, across = edge["weight"] * edge["overlap"], edge["weight"] * edge["crossing"]
    nodes = [
        (name, column)
        for name, column in zip(features.node_names, features.node.T, strict=True)
        if name not in LEFT_OUT
    ]
    nodes += in_tolerances(features, tolerance).items()
    names, values = [name for name, _ in nodes], [column for _, column in nodes]
    other = [np.full(n_patches, NOBODY)] * len(names)
    for name, conflict in ((OVER, over), (ACROSS, across)):
        pair, partner = worst_pairs(features.pairs, conflict, n_patches)
        known = pair >= 0
        shown = {name: conflict}
        if name == OVER:
            shown[OFFSET_RATIO] = edge["offset"] / tolerance
            for each in SHARES:
                if each in features.context_names:
                    share = edge[each] / np.maximum(over, 1e-9)
                    unknown = (f"over_{each}" in OF_SCANS) & (share == 0.0)
                    shown[f"over_{each}"] = np.where(unknown, np.nan, share)
        for each, column in shown.items():
            names.append(each)
            missing = 0.0 if each == name else np.nan
            values.append(np.where(known, column[pair] if len(column) else np.nan, missing))
            other.append(np.where(known, partner, NOBODY))
    return Columns(tuple(names), np.column_stack(values), np.column_stack(other))


def in_tolerances(features: PatchFeatures, tolerance: float) -> dict[str, Floats]:
    """Return the columns (m,) of node features that depend on the tolerance in metres."""
    found = {TOLERANCE: np.full(len(features.node), tolerance)}
    if "n_scans" in features.node_names:
        is_known = np.isfinite(features.node[:, features.node_names.index("n_scans")]).any()
        found[KNOWS_SCANS] = np.full(len(features.node), 1.0 if is_known else np.nan)
    for name, metres in IN_TOLERANCES.items():
        if metres in features.node_names:
            found[name] = features.node[:, features.node_names.index(metres)] / tolerance
    low, metres_apart, high = features.disagreement.T
    if "disagreement_ratio" in found:
        error = np.maximum((high - low) / (2.0 * 1.96), 1e-6)
        found[SURELY] = np.clip((metres_apart - tolerance) / error, -MOST_SURE, MOST_SURE)
    return found


def worst_pairs(pairs: NDArray[np.int32], conflict: Floats, n_patches: int) -> tuple[Ints, Ints]:
    """Return of each patch the pair (m,) of largest conflict above 0, and the other patch of it; `NOBODY` if none."""
    some = np.flatnonzero(conflict > 0.0)
    one, two = pairs[some].astype(np.int64).T
    patch, partner, pair = np.concatenate([one, two]), np.concatenate([two, one]), np.tile(some, 2)
    order = np.lexsort((partner, -conflict[pair], patch))
    first = order[np.unique(patch[order], return_index=True)[1]]
    found, others = np.full(n_patches, NOBODY, np.int64), np.full(n_patches, NOBODY, np.int64)
    found[patch[first]], others[patch[first]] = pair[first], partner[first]
    return found, others


N_TREES, LEARNING_RATE, N_LEAVES, LEAST_ROWS, RIDGE = 100, 0.06, 6, 60, 5.0
"""Small trees that learn slowly: later maps are of other places and sensors."""
SAME = 1e-9
"""Nats: by which scikit-learn and this package may differ for one patch, by rounding."""


def grow(columns: Sequence[Columns], labels: Sequence[Floats], weights: Sequence[Floats]) -> Potential:
    """Return the trees that separate suspicious patches from plausible ones.

    `columns`: one a map, of the same names. `labels`: +1 suspicious, -1 plausible, 0 without. Where scans of some maps
    are known and of others not, each kind has trees of its own, behind a test of `KNOWS_SCANS`.
    """
    names = columns[0].names
    at = names.index(KNOWS_SCANS) if KNOWS_SCANS in names else None
    knows = [at is not None and bool(np.isfinite(each.values[:, at]).any()) for each in columns]
    found = []
    for kind, used in ((True, names), (False, tuple(name for name in names if name not in OF_SCANS))):
        rows = [number for number, known in enumerate(knows) if known == kind]
        mine = [labels[number] for number in rows]
        if len(np.unique(np.sign(np.concatenate([*mine, [0.0]])))) < 3:  # no labels of both kinds
            return _grown(columns, labels, weights, names)
        found.append(_grown([columns[number] for number in rows], mine, [weights[number] for number in rows], used))
    return behind_test(*found)


def behind_test(seen: Potential, bare: Potential) -> Potential:
    """Return trees that are those of `seen` where scans are known, and those of `bare` elsewhere.

    Each begins with a test whose other side is a leaf of 0. Columns are those of `seen`.
    """
    test, roots = seen.names.index(KNOWS_SCANS), list[int]()
    rows: list[tuple[float, ...]] = []
    for potential, knows in ((bare, False), (seen, True)):
        trees, at = potential.trees, [seen.names.index(name) for name in potential.names]
        for begin, end in pairwise([*trees.root.tolist(), len(trees.column)]):
            # What a tree starts from belongs to no column: its test has its value.
            first, here, base = trees.value[begin], len(rows), potential.base if begin == 0 else 0.0
            roots.append(here)
            side = (here + 1, here + 2) if knows else (here + 2, here + 1)
            rows += [(test, 0.0, *side, 1.0, first + base), (LEAF, 0.0, 0, 0, 0.0, 0.0)]
            for node in range(begin, end):
                is_leaf = trees.column[node] == LEAF
                tested = LEAF if is_leaf else at[trees.column[node]]
                ends = (0 if is_leaf else each[node] - begin + here + 2 for each in (trees.left, trees.right))
                rows.append((tested, trees.threshold[node], *ends, trees.nan_left[node], trees.value[node] + base))
    table = np.array(rows, np.float64).T
    column, left, right = (table[place].astype(np.int64) for place in (0, 2, 3))
    found = Trees(np.array(roots, np.int64), column, table[1].copy(), left, right, table[4] > 0.0, table[5].copy())
    return Potential(seen.names, found, 0.0)


def _grown(
    columns: Sequence[Columns], labels: Sequence[Floats], weights: Sequence[Floats], names: tuple[str, ...]
) -> Potential:
    """Return trees of some of the columns."""
    # Heavy, and only training needs them.
    from sklearn.ensemble import HistGradientBoostingClassifier  # noqa: PLC0415
    from threadpoolctl import threadpool_limits  # noqa: PLC0415

    known = [label != 0.0 for label in labels]
    x = np.vstack([each.take(names).values[mask] for each, mask in zip(columns, known, strict=True)])
    y = np.concatenate([label[mask] > 0.0 for label, mask in zip(labels, known, strict=True)])
    # A column of which nothing is known cannot be binned; without a split it has no effect either.
    x[:, np.isnan(x).all(axis=0)] = 0.0
    weight = np.concatenate([each[mask] for each, mask in zip(weights, known, strict=True)])
    # A patch has a row for each tolerance.
    n_tolerances = len(np.unique(x[:, names.index(TOLERANCE)])) if TOLERANCE in names else 1
    booster = HistGradientBoostingClassifier(
        max_iter=N_TREES,
        learning_rate=LEARNING_RATE,
        max_leaf_nodes=N_LEAVES,
        min_samples_leaf=min(LEAST_ROWS * n_tolerances, max(2, len(y) // 20)),
        l2_regularization=RIDGE,
        monotonic_cst=[RISING.get(name, 0) for name in names],
        early_stopping=False,
        random_state=0,
    )
    # The threads' partial sums would make the last bits depend on their number, and waiting for each other on a busy
    # machine takes longer than the work.
    with threadpool_limits(1):
        # Weights that are all alike change nothing, but with any scikit-learn takes six times as long to bin.
        booster.fit(x, y, sample_weight=None if np.ptp(weight) == 0.0 else weight)
    parts, base = tables_of(booster)
    trees = _trees_of(parts)
    found = Potential(names, trees, base)
    log_odds = found.base + contributions(trees, np.ascontiguousarray(x)).sum(axis=1)
    if not np.allclose(log_odds, booster.decision_function(x), rtol=SAME, atol=SAME):
        raise RuntimeError("this scikit-learn keeps its trees in another form than mapq reads")
    return found


def tables_of(booster: Any) -> tuple[list[NDArray[np.void]], float]:
    """Return the tables of nodes of scikit-learn's trees, and the log-odds to which they are added.

    Both are private, as scikit-learn has no public form of them: the extra `train` bounds its version, and
    :func:`grow` compares what it reads with scikit-learn's own answers.
    """
    return [stage[0].nodes for stage in booster._predictors], float(np.ravel(booster._baseline_prediction)[0])


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
