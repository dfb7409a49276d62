"""Features of some patches of a large map: all of their points are loaded, and those of their neighbours.

Patches are measured whole, by the functions that measure maps in memory. Only what is larger than `LARGEST_PATCH`, such
as the ground, is thinned for it: all measures follow the spacing of a patch's own points.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from mapq.features.compute import safe_features
from mapq.features.context import Beyond
from mapq.features.copies import ABOUT
from mapq.features.disagreement import WINDOW
from mapq.features.neighbours import measure_candidates
from mapq.features.node import shape_table
from mapq.features.provenance import Known
from mapq.features.settings import FeatureSettings
from mapq.features.shape import PatchShapes, curve_places, measure_shapes
from mapq.graph import PatchGraph
from mapq.scale.gather import LOOSE_REACH, Part, gather, patches_near, with_loose
from mapq.scale.patches import Whole, load_whole

SLACK = 0.1
"""Metres by which the middle of a patch may lie elsewhere once points that repeat others count as well."""
LARGEST_PATCH = 1_000_000
"""Points of a patch that are looked at, where a map has several parts: of a larger one every n-th."""

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


class MeasureTask(NamedTuple):
    """What the measuring of some patches is given.

    Attributes
    ----------
    patches : (c,) int64
        The patches, ascending.
    settings : FeatureSettings
        With the noise of the whole map.
    part : Part
        How points are loaded.
    known : Known
        Which fields of the map count.
    boxes : (t, 4) float64
        Corners of the tiles.
    centres : (w, 3) float64
        Of the windows that answer for patches which those windows reach that answer for these.
    most_far : int
        Points of patches that only these windows reach, about: of more every n-th is looked at.
    """

    patches: Ints
    settings: FeatureSettings
    part: Part
    known: Known
    boxes: Floats
    centres: Floats
    most_far: int


class Measured(NamedTuple):
    """What was measured.

    Attributes
    ----------
    patches : (c,) int64
    node : (c, p) float64
    shape : (c, s) float64
    pairs : (e, 2) int64
        Those with a patch of the task, joined as :func:`mapq.features.patch_features` joins them, seen from that patch.
    edge : (e, q) float64
    plausibility : (e,) float64
    node_names, edge_names : tuple of str
    """

    patches: Ints
    node: Floats
    shape: Floats
    pairs: Ints
    edge: Floats
    plausibility: Floats
    node_names: tuple[str, ...]
    edge_names: tuple[str, ...]


def share_out(whole: Whole, most_points: int, largest: int | None) -> list[Ints]:
    """Return the patches in groups that lie together, each of about `most_points` points."""
    sizes = np.minimum(whole.n_points, largest or whole.n_points)
    order = np.argsort(curve_places(whole.centroid), kind="stable")
    group = (np.cumsum(sizes[order]) - 1) // max(most_points, 1)
    return [np.sort(each) for each in np.split(order, np.flatnonzero(np.diff(group)) + 1) if len(each)]


def measure_patches(task: MeasureTask) -> Measured:
    """Measure some patches, and the pairs that they are in."""
    whole, settings = load_whole(task.part.folder), task.settings
    reached = task.centres[np.unique(cKDTree(task.centres).query(whole.centroid[task.patches])[1])]
    if task.known.moment is None or "moments" not in settings.context:
        reached = reached[:0]
    about = _about(whole, task.patches) if "copies" in settings.context else task.patches
    near = patches_near(whole, whole.low[about], whole.high[about], max(settings.radius, LOOSE_REACH))
    chosen = np.union1d(near, patches_near(whole, reached, reached, WINDOW + LOOSE_REACH))
    is_own, is_near = (np.isin(chosen, some, assume_unique=True) for some in (task.patches, near))
    step = max(1, -(-int(whole.n_points[chosen[~is_near]].sum()) // task.most_far))
    patches = gather(whole, chosen, task.part, np.where(is_near, 1, step))
    if len(reached) or "copies" in settings.context:
        is_about = np.isin(chosen, about, assume_unique=True)
        patches = with_loose(patches, is_about, step, whole, task.boxes, task.part)
    shapes = measure_shapes(patches, settings)
    graph = _watched(shapes, is_own, settings)
    found = safe_features(patches, shapes, graph, settings, Beyond(task.known, task.centres - whole.corner))
    shape = shape_table(shapes)[is_own]
    shape[:, 0] = whole.n_points[task.patches]
    return Measured(
        patches=task.patches,
        node=found.node[is_own],
        shape=shape,
        pairs=chosen[found.graph.pairs],
        edge=found.edge,
        plausibility=found.plausibility,
        node_names=found.node_names,
        edge_names=found.edge_names,
    )


def _about(whole: Whole, own: Ints) -> Ints:
    """Return the patches, ascending, whose layers say something of some patches; these themselves too."""
    found = cKDTree(whole.centroid[own]).query(whole.centroid, distance_upper_bound=ABOUT + SLACK)[0]
    return np.flatnonzero(np.isfinite(found))


def _watched(shapes: PatchShapes, is_own: NDArray[np.bool_], settings: FeatureSettings) -> PatchGraph:
    """Return the pairs of own patches with the closest ones that each watches; `close` as the own patch sees it."""
    n_watched = max(settings.n_neighbours, settings.n_watched)
    pairs, distance, middle = measure_candidates(shapes, settings, n_watched)
    one, other = pairs.ravel(order="F"), pairs[:, ::-1].ravel(order="F")
    order = np.lexsort((shapes.size_rank[other], np.tile(distance, 2), one))
    order = order[is_own[one[order]]]
    place = np.arange(len(order)) - np.searchsorted(one[order], one[order])
    close, watched = np.zeros(len(pairs), bool), np.zeros(len(pairs), bool)
    close[order[place < settings.n_neighbours] % max(len(pairs), 1)] = True
    watched[order[place < n_watched] % max(len(pairs), 1)] = True
    kept = np.flatnonzero(watched)
    kept = kept[np.lexsort((pairs[kept, 1], pairs[kept, 0]))]
    return PatchGraph(len(shapes), pairs[kept].astype(np.int32), distance[kept], middle[kept], close[kept])


def with_noise(settings: FeatureSettings, whole: Whole) -> FeatureSettings:
    """Return the settings with the noise of the whole map: the median over its patches, unless one is given."""
    if settings.noise is not None or len(whole.mse) == 0:
        return settings
    return replace(settings, noise=max(float(np.median(np.sqrt(whole.mse))), settings.eps))
