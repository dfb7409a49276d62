"""Features of some patches of a large map: all of their points are loaded, and those of their neighbours.

Patches are measured whole, by the functions that measure maps in memory. Only what is larger than `LARGEST_PATCH`, such
as the ground, is thinned for it: all measures follow the spacing of a patch's own points.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.cloud import PointCloud
from mapq.features.compute import CONFLICT
from mapq.features.context import measure_context
from mapq.features.edge import EDGE_NAMES, edge_features
from mapq.features.neighbours import measure_candidates, take_pairs
from mapq.features.node import NODE_NAMES, node_features, shape_table
from mapq.features.settings import FeatureSettings
from mapq.features.shape import PatchShapes, curve_places, measure_shapes
from mapq.graph import PatchGraph
from mapq.patches import Patches
from mapq.scale.cut import points_path
from mapq.scale.patches import Whole, load_whole

LARGEST_PATCH = 1_000_000
"""Points of a patch that are looked at, where a map has several parts: of a larger one every so manieth."""
LOOKED_AT = 256
"""Boxes that are compared with all others at once."""

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
    up : list of float
        Direction of the segmentation.
    fields : tuple of str
        Fields of the points that are known.
    largest : int or None
        Points of a patch that are looked at; None: all.
    folder : str
        The work folder.
    """

    patches: Ints
    settings: FeatureSettings
    up: list[float]
    fields: tuple[str, ...]
    largest: int | None
    folder: str


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
    whole = load_whole(task.folder)
    chosen = patches_near(whole, task.patches, task.settings.radius)
    patches = _gather(whole, chosen, task)
    is_own = np.isin(chosen, task.patches, assume_unique=True)
    shapes = measure_shapes(patches, task.settings)
    graph = _watched(shapes, is_own, task.settings)
    edge, plausibility = edge_features(shapes, graph, task.settings)
    conflict = edge[:, EDGE_NAMES.index("overlap")] + edge[:, EDGE_NAMES.index("crossing")] > CONFLICT
    joined = graph.close | conflict
    graph, edge, plausibility = take_pairs(graph, joined), edge[joined], plausibility[joined]
    context = measure_context(patches, shapes, graph, edge, task.settings)
    shape = shape_table(shapes)[is_own]
    shape[:, 0] = whole.n_points[task.patches]
    return Measured(
        patches=task.patches,
        node=np.hstack([node_features(shapes, task.settings), context.node])[is_own],
        shape=shape,
        pairs=chosen[graph.pairs],
        edge=np.hstack([edge, context.edge]),
        plausibility=plausibility,
        node_names=(*NODE_NAMES, *context.node_names),
        edge_names=(*EDGE_NAMES, *context.edge_names),
    )


def patches_near(whole: Whole, own: Ints, radius: float) -> Ints:
    """Return the patches, ascending, whose boxes come within `radius` of one of some patches; these themselves too."""
    if len(own) == 0:
        return own
    low, high = whole.low[own].min(axis=0) - radius, whole.high[own].max(axis=0) + radius
    rest = np.flatnonzero((whole.low <= high).all(axis=1) & (whole.high >= low).all(axis=1))
    rest = rest[~np.isin(rest, own, assume_unique=True)]
    is_near = np.zeros(len(rest), bool)
    for begin in range(0, len(rest), LOOKED_AT):
        some = rest[begin : begin + LOOKED_AT]
        gap = np.zeros((len(some), len(own)))
        for axis in range(3):
            below = whole.low[some, axis][:, None] - whole.high[own, axis]
            above = whole.low[own, axis] - whole.high[some, axis][:, None]
            gap += np.maximum(np.maximum(below, above), 0.0) ** 2
        is_near[begin : begin + LOOKED_AT] = (gap <= radius * radius).any(axis=1)
    return np.sort(np.concatenate([own, rest[is_near]]))


def _gather(whole: Whole, chosen: Ints, task: MeasureTask) -> Patches:
    """Return the patches with their points as a map of their own, patch after patch."""
    slices, owner = [], []
    for place, patch in enumerate(chosen.tolist()):
        step = 1 if task.largest is None else max(1, -(-int(whole.n_points[patch]) // task.largest))
        for tile, begin, end in whole.piece[whole.first_piece[patch] : whole.first_piece[patch + 1]].tolist():
            slices.append((tile, slice(begin, end, step)))
            owner.append(place)
    xyz = [np.zeros((0, 3)), *_read(task.folder, "xyz", slices)]
    fields = {name: np.concatenate(_read(task.folder, name, slices)) for name in task.fields if slices}
    number = np.repeat(np.array(owner, np.int32), [len(part) for part in xyz[1:]])
    cloud = PointCloud(np.concatenate(xyz), np.zeros(3), fields)
    return Patches.unlabelled(cloud, number, whole.normal[chosen], whole.centroid[chosen], {"up": task.up}, {})


def _read(folder: str, name: str, slices: list[tuple[int, slice]]) -> list[NDArray[Any]]:
    """Return parts of the files of several tiles."""
    files = {tile: np.load(points_path(folder, tile, name), mmap_mode="r") for tile in {tile for tile, _ in slices}}
    return [files[tile][rows] for tile, rows in slices]


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
