"""Context of pairs and patches beyond the paper: what looks like an error of the map, and is none.

Each group can be left out (`FeatureSettings.context`). What a map does not tell (passes, sensors) is 0 in its column,
neither for nor against; what scans disagree by is nan there. Columns of pairs are conflicts, W (A + R) or a part of it,
times something between 0 and 1 or -1 and 1: a pair without a conflict has nothing to be explained.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.features.copies import COLUMNS, copy_columns
from mapq.features.disagreement import measure_disagreement
from mapq.features.edge import EDGE_NAMES, smaller_first
from mapq.features.provenance import Known, Moments, known_of, moments_of, views_of, ways_of
from mapq.features.rays import Rays, seen_side, seen_through
from mapq.features.settings import FeatureSettings
from mapq.features.shape import PatchShapes
from mapq.graph import PatchGraph
from mapq.kernels.together import seen_together
from mapq.patches import Patches

DISAGREEMENT = ("disagreement", "disagreement_low", "disagreement_high")
"""Columns of what scans disagree by, and its bounds, in metres."""
NODE_COLUMNS = {
    "moments": (*DISAGREEMENT, "n_scans", "seen_by_several"),
    "rays": ("seen_through",),
    "copies": tuple(COLUMNS),
}
EDGE_COLUMNS = {
    "outlines": ("partly_covered", "unlike_height"),
    "moments": ("seen_together",),
    "rays": ("through_conflict", "facing_away"),
}
"""Group to its columns, of patches and of pairs."""

LEAST_OVERLAP = 1e-3
"""Weighted overlap below which a pair is not looked at: there is nothing to be explained."""
Floats = NDArray[np.float64]


class Context(NamedTuple):
    """Columns of patches (m, p) and of pairs (e, q), by name."""

    node: Floats
    node_names: tuple[str, ...]
    edge: Floats
    edge_names: tuple[str, ...]


class Beyond(NamedTuple):
    """What is known of a whole map, where the patches that are measured are a part of it.

    Attributes
    ----------
    known : Known
        Which of its fields count.
    rays : Rays or None
        Those that are followed and come near the patches; None where no rays are known.
    side : float or None
        Of the voxels that rays go through, in metres.
    centres : (w, 3) float64 or None
        Of the windows in which scans are compared; None where no moments are known.
    """

    known: Known
    rays: Rays | None = None
    side: float | None = None
    centres: Floats | None = None


def measure_context(
    patches: Patches,
    shapes: PatchShapes,
    graph: PatchGraph,
    edge: Floats,
    settings: FeatureSettings,
    beyond: Beyond | None = None,
) -> Context:
    """Return the columns of the groups that the settings name.

    Parameters
    ----------
    patches : Patches
    shapes : PatchShapes
    graph : PatchGraph
    edge : (e, 7) float64
        Edge features, named by `EDGE_NAMES`.
    settings : FeatureSettings
    beyond : Beyond, optional
        None: the patches are all of the map.
    """
    wanted = settings.context
    known, rays, side, centres = beyond or Beyond(known_of(patches.cloud))
    pairs = _Pairs(shapes, graph, edge)
    node: dict[str, Floats] = {}
    columns: dict[str, Floats] = {}
    if "outlines" in wanted:
        columns |= outlines(pairs)
    if "moments" in wanted:
        number = np.flatnonzero(patches.cloud.finite())
        moments = moments_of(patches.cloud, number, known)
        columns["seen_together"] = together(pairs, moments, number)
        away = ways_of(patches.cloud, number, known)
        found = measure_disagreement(patches, shapes, number, moments, away, shapes.noise(settings), centres)
        node |= dict(zip(NODE_COLUMNS["moments"], found, strict=True))
    if "rays" in wanted:
        through = seen_through(shapes, views_of(patches.cloud, shapes.number, known), settings, rays, side)
        node["seen_through"] = through
        columns["through_conflict"] = pairs.conflict * through[graph.pairs].max(axis=1, initial=-np.inf)
        columns["facing_away"] = facing_away(pairs, seen_side(shapes, ways_of(patches.cloud, shapes.number, known)))
    if "copies" in wanted:
        node |= copy_columns(patches, shapes, settings)
    return Context(_stack(node, len(shapes)), tuple(node), _stack(columns, len(graph.pairs)), tuple(columns))


class _Pairs:
    """Pairs with their conflicts: W A, and W (A + R)."""

    def __init__(self, shapes: PatchShapes, graph: PatchGraph, edge: Floats) -> None:
        self.shapes, self.graph = shapes, graph
        weight, overlap, crossing = (edge[:, EDGE_NAMES.index(name)] for name in ("weight", "overlap", "crossing"))
        self.over, self.conflict = weight * overlap, weight * (overlap + crossing)
        self.shared = edge[:, EDGE_NAMES.index("overlap_area")]
        self.ordered = smaller_first(shapes, graph)


def outlines(pairs: _Pairs) -> dict[str, Floats]:
    """Return W A (1 - covered share of the larger patch), and W A (1 - ratio of their heights).

    A fence or a kerb covers all of itself and little of the facade behind; copies of a wall have one outline.
    """
    one, other = pairs.graph.pairs.T
    larger = np.maximum(pairs.shapes.area[one], pairs.shapes.area[other])
    covered = np.clip(pairs.shared / np.maximum(larger, 1e-12), 0.0, 1.0)
    heights = np.sort(pairs.shapes.height[pairs.graph.pairs], axis=1)
    ratio = heights[:, 0] / np.maximum(heights[:, 1], 1e-12)
    return {"partly_covered": pairs.over * (1.0 - covered), "unlike_height": pairs.over * (1.0 - ratio)}


def facing_away(pairs: _Pairs, side: Floats) -> Floats:
    """Return W A (2 f - 1), f how surely both patches were seen from outside, with the space between behind them.

    f is the share of pairs of points, one of each, of which this holds; 0 where it is not known from where either was
    seen. Both faces of a wall face away from each other; copies of a wall were seen from one side. Which side (m,) the
    sensors stood on is given as +1 to -1, towards the normal and behind it, nan where that is not known. How
    they lie to one another is taken at the middle of the smaller one, which the larger one is over.
    """
    shapes, (small, large) = pairs.shapes, pairs.ordered.T
    beyond = np.sign(np.einsum("ij,ij->i", shapes.normal[large], shapes.centre[small] - shapes.centre[large]))
    turned = np.sign(np.einsum("ij,ij->i", shapes.normal[large], shapes.normal[small]))
    outwards = np.stack([side[small] * turned * beyond, -side[large] * beyond])
    both = np.prod(0.5 * (1.0 + outwards), axis=0)
    return np.asarray(np.nan_to_num(pairs.over * (2.0 * both - 1.0)))


def together(pairs: _Pairs, moments: Moments | None, number: NDArray[np.int64]) -> Floats:
    """Return W A (2 s - 1), s how far both were seen at the same moments where they lie over one another; 0 unknown.

    What one scan sees twice is twice there; copies of a wall come from different visits. The moments are those of
    points `number` (n,) of the cloud, ascending.
    """
    out, shapes = np.zeros(len(pairs.over)), pairs.shapes
    some = np.flatnonzero(pairs.over > LEAST_OVERLAP)
    if moments is not None and len(some):
        own = moments.moment[np.searchsorted(number, shapes.number)]
        share = seen_together(
            shapes.sheets, shapes.planes, shapes.points, shapes.start, pairs.ordered[some], own, moments.reach
        )
        out[some] = np.where(np.isnan(share), 0.0, pairs.over[some] * (2.0 * share - 1.0))
    return out


def _stack(columns: dict[str, Floats], n_rows: int) -> Floats:
    return np.column_stack(list(columns.values())) if columns else np.zeros((n_rows, 0))
