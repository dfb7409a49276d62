"""Potentials of patches by boosted trees: evidence for an error, of all that is measured on a patch and its pairs.

Pairs are evidence for each of their patches through the pair that is in the worst conflict. The trees' log-odds are one
more node feature, `EVIDENCE`, which the random field weighs against the labels of neighbours.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mapq.features import copies
from mapq.features.context import NODE_COLUMNS
from mapq.graph import PatchFeatures
from mapq.model import EVIDENCE, NOBODY, Columns, Potential

OVER, ACROSS = "worst_overlap", "worst_crossing"
SHARES = ("partly_covered", "unlike_height", "facing_away")
"""Of the pair with the largest weighted overlap, in times this, which they contain."""
LEFT_OUT = ("tilt",)
"""Node features that are no evidence of an error: of walls of other places something else would be learnt."""
RISING = {
    **dict.fromkeys(("disagreement", "disagreement_low", "disagreement_high"), 1),
    **dict.fromkeys(("fit", "thickness"), -1),
    **dict.fromkeys((OVER, ACROSS, "sum_of_conflicts"), 1),
    "over_facing_away": -1,
    **copies.COLUMNS,
}
"""Columns that can only speak for an error where they rise, 1, or against it, -1; the others may do either."""

OF_SCANS = (*NODE_COLUMNS["moments"], "over_facing_away")
"""Columns that are not known where it is not known when and from where a map was seen."""

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


def without_scans(columns: Columns) -> Columns:
    """Return the columns as a map has them of which it is not known when and from where it was seen."""
    return columns._replace(values=np.where(np.isin(columns.names, OF_SCANS), np.nan, columns.values))


def with_evidence(features: PatchFeatures, potential: Potential | None) -> PatchFeatures:
    """Return the features with the log-odds of the trees as one more node feature; as they are without trees."""
    if potential is None:
        return features
    return add_evidence(features, potential.log_odds(columns_of(features)))


def add_evidence(features: PatchFeatures, evidence: Floats) -> PatchFeatures:
    """Return the features with log-odds (m,) as one more node feature."""
    node = np.column_stack([features.node, evidence])
    return features._replace(node=node, node_names=(*features.node_names, EVIDENCE))


def columns_of(features: PatchFeatures) -> Columns:
    """Return what trees see of patches: node features, and those of the pairs in the worst conflict."""
    n_patches = len(features.node)
    edge = dict(zip(features.edge_names, features.edge.T, strict=True))
    over, across = edge["weight"] * edge["overlap"], edge["weight"] * edge["crossing"]
    nodes = [
        (name, column)
        for name, column in zip(features.node_names, features.node.T, strict=True)
        if name not in LEFT_OUT
    ]
    names, values = [name for name, _ in nodes], [column for _, column in nodes]
    other = [np.full(n_patches, NOBODY)] * len(names)
    for name, conflict in ((OVER, over), (ACROSS, across)):
        pair, partner = worst_pairs(features.pairs, conflict, n_patches)
        known = pair >= 0
        shown = {name: conflict}
        if name == OVER:
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
    total = np.bincount(features.pairs.ravel(), np.repeat(over + across, 2), n_patches)
    names.append("sum_of_conflicts")
    return Columns(
        tuple(names), np.column_stack([*values, total]), np.column_stack([*other, np.full(n_patches, NOBODY)])
    )


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
