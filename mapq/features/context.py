"""Context of pairs and patches beyond the paper: what looks like an error of the map but is right.

Each group can be left out (`FeatureSettings.context`). What a map does not record (passes, sensors) is 0 in its column,
neither for nor against; what scans disagree by is nan there. Columns of pairs are conflicts, W A, times something
between 0 and 1 or -1 and 1: a pair without a conflict has nothing to be explained.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.configuration import FeatureSettings
from mapq.features.copies import COLUMNS, copy_columns, nearby_points
from mapq.features.disagreement import Known, joined, known_of, measure_disagreement, moments_of, ways_of
from mapq.features.pairs import EDGE_NAMES, PatchGraph, smaller_first
from mapq.features.scan_ranges import Disagreement
from mapq.features.shape import PatchShapes
from mapq.patches import Patches

DISAGREEMENT = ("disagreement", "disagreement_low", "disagreement_high")
"""Columns of what scans disagree by, and its bounds, in metres."""
NODE_COLUMNS = {
    "moments": (*DISAGREEMENT, "n_scans", "seen_by_several"),
    "copies": tuple(COLUMNS),
}
EDGE_COLUMNS = {
    "outlines": ("partly_covered", "unlike_height"),
    "rays": ("facing_away",),
}
"""Group to its columns, of patches and of pairs."""

GRAZING = 0.1
"""Cosine of the angle to a patch's normal below which a ray does not show a side: it runs along the patch."""

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


class Beyond(NamedTuple):
    """What is known of a whole map, where the patches that are measured are a part of it."""

    known: Known  # which of its fields count
    centres: Floats | None = None  # (w, 3) of the windows in which scans are compared; None where no moments are known


def measure_context(
    patches: Patches,
    shapes: PatchShapes,
    graph: PatchGraph,
    edge: Floats,
    settings: FeatureSettings,
    beyond: Beyond | None = None,
) -> tuple[dict[str, Floats], dict[str, Floats]]:
    """Return the columns of patches and of pairs, by name, of the groups that the settings name.

    `edge` (e, 7): edge features, named by `EDGE_NAMES`. `beyond`: None: the patches are all of the map.
    """
    wanted = settings.context
    known, centres = beyond or Beyond(known_of(patches.cloud))
    over = edge[:, EDGE_NAMES.index("weight")] * edge[:, EDGE_NAMES.index("overlap")]
    node: dict[str, Floats] = {}
    columns: dict[str, Floats] = {}
    if "outlines" in wanted:
        columns |= outlines(shapes, graph, over, edge[:, EDGE_NAMES.index("overlap_area")])
    if "moments" in wanted or "copies" in wanted:
        node |= _from_points(patches, shapes, settings, known, centres)
    if "rays" in wanted:
        side = seen_side(shapes, ways_of(patches.cloud, shapes.number, known))
        columns["facing_away"] = facing_away(shapes, smaller_first(shapes, graph), over, side)
    return node, columns


def _from_points(
    patches: Patches, shapes: PatchShapes, settings: FeatureSettings, known: Known, centres: Floats | None
) -> dict[str, Floats]:
    """Return the columns of patches that all points of the cloud are looked at for: disagreement, and copies."""
    number = np.flatnonzero(patches.cloud.finite())
    moments = moments_of(patches.cloud, number, known)
    moment = np.zeros(len(number), np.int64) if moments is None else joined(patches, number, moments)
    nearby = nearby_points(patches, number, moment, ways_of(patches.cloud, number, known))
    node: dict[str, Floats] = {}
    if "moments" in settings.context:
        found = Disagreement.unknown(len(shapes))
        if moments is not None:
            found = measure_disagreement(nearby, shapes, shapes.noise(settings), centres)
        node |= dict(zip(NODE_COLUMNS["moments"], found, strict=True))
    if "copies" in settings.context:
        node |= copy_columns(nearby, shapes, settings)
    return node


def outlines(shapes: PatchShapes, graph: PatchGraph, over: Floats, shared: Floats) -> dict[str, Floats]:
    """Return W A (1 - covered share of the larger patch), and W A (1 - ratio of their heights).

    A fence or a kerb covers all of itself and little of the facade behind; copies of a wall have one outline. `over`
    (n,) is W A, `shared` (n,) the area that is covered.
    """
    larger = shapes.area[graph.pairs].max(axis=1, initial=0.0)
    covered = np.clip(shared / np.maximum(larger, 1e-12), 0.0, 1.0)
    heights = np.sort(shapes.height[graph.pairs], axis=1)
    ratio = heights[:, 0] / np.maximum(heights[:, 1], 1e-12)
    return {"partly_covered": over * (1.0 - covered), "unlike_height": over * (1.0 - ratio)}


def facing_away(shapes: PatchShapes, ordered: Ints, over: Floats, side: Floats) -> Floats:
    """Return W A (2 f - 1), f how surely both patches were seen from outside, with the space between behind them.

    f is the share of pairs of points, one of each, of which this holds; 0 where it is not known from where either was
    seen. Both faces of a wall face away from each other; copies of a wall were seen from one side. Which side (m,) the
    sensors were on is given as +1 to -1, towards the normal and behind it, nan where that is not known. How they lie to
    one another is taken at the middle of the smaller one, the first of its pair (n, 2), which the larger one is over.
    """
    small, large = ordered.T
    normal = shapes.normals_at(large, shapes.centre[small])
    beyond = np.sign(shapes.chart(large, shapes.centre[small])[2])
    turned = np.sign(np.einsum("ij,ij->i", normal, shapes.normal[small]))
    outwards = np.stack([side[small] * turned * beyond, -side[large] * beyond])
    both = np.prod(0.5 * (1.0 + outwards), axis=0)
    return np.asarray(np.nan_to_num(over * (2.0 * both - 1.0)))


def seen_side(shapes: PatchShapes, to_sensor: Floats | None) -> Floats:
    """Return from which side (m,) each patch was seen: 1 where its normal points, -1 behind; nan unknown.

    The mean over its points, whose ways to the sensor (k, 3) may be nan; rays that graze the patch do not count.
    """
    if to_sensor is None:
        return np.full(len(shapes), np.nan)
    patch = np.repeat(np.arange(len(shapes)), shapes.counts)
    height = np.einsum("ij,ij->i", to_sensor, shapes.normals_at(patch, shapes.points))
    steep = np.abs(height) > GRAZING * np.linalg.norm(to_sensor, axis=1)
    sums, counts = (
        np.bincount(patch[steep], each, len(shapes)) for each in (np.sign(height[steep]), np.ones(steep.sum()))
    )
    return np.asarray(np.where(counts > 0.0, sums / np.maximum(counts, 1.0), np.nan))
