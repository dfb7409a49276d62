"""Features and causes of the patches of a map in tiles, some patches that lie together at a time.

The points of these patches and of all that their measures depend on are loaded, whatever tiles they are in, and
measured by the functions that measure a map in memory. Only patches larger than `LARGEST_PATCH`, such as the ground,
are thinned. Such a wide patch is measured by itself, among the largest others; what is about the others ends some
metres from them, though the ground goes on.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from operator import call
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from mapq.axes import from_corner
from mapq.cloud import PointCloud
from mapq.configuration import FeatureSettings
from mapq.features.compute import measure
from mapq.features.context import Beyond
from mapq.features.copies import ABOUT, FARTHEST, TILE
from mapq.features.disagreement import OWNED, WINDOW, Known, window_centres
from mapq.features.shape import curve_places
from mapq.features.table import PatchFeatures
from mapq.kernels.voxels import voxel_keys
from mapq.labels import NO_PATCH
from mapq.patches import Patches
from mapq.results.causes import Cause, Spread, cause_of, copies_of, measure_spread, reach_of
from mapq.results.visits import Clock, Stays, Visits, to_sensor_of
from mapq.tiled.cut import Whole
from mapq.tiled.tiling import WorkFolder
from prf.shell.scheduler import Workers

LOOSE_REACH = 2.0 * FARTHEST
"""Metres from a patch within which points may lie over it, whether they are in a patch or in none."""
WINDOWS_REACH = 2.0 * WINDOW
"""Metres from the middle of a window up to which patches are loaded: it uses the motions of windows beside it."""
SLACK = 0.1
"""Metres by which the mean of a patch's distinct points may lie off that of all of them."""
LARGEST_PATCH = 1_000_000
"""Points of a patch that are looked at, in a map of several groups: of a larger one every n-th."""
CHUNK = 1_000_000
"""Loose points that are looked at together."""

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


class PatchGroup(NamedTuple):
    """Some patches (c) of a map whose points are in the work folder."""

    store: WorkFolder
    number: Ints  # (c,) the patches, ascending
    normal: Floats  # (c, 3)
    centroid: Floats  # (c, 3)
    bend: Floats  # (c, 3)
    slices: Ints  # (s, 4) of their points, as :class:`mapq.tiled.cut.Whole` has them
    owner: Ints  # (s,) of each slice, the place of its patch among these
    corner: Floats  # (3,) from which places are measured

    def load(self) -> Patches:
        """Return the patches as a map of their own."""
        found = self.store.points(self.slices)
        records = np.concatenate([np.zeros(0, self.store.record), *found])
        patch = np.repeat(self.owner, [len(each) for each in found]).astype(np.int32)
        patches = Patches.unlabelled(_cloud(records), patch, self.normal, self.centroid, {}, {}, self.bend)
        return from_corner(patches, self.corner)


def _cloud(records: NDArray[np.void]) -> PointCloud:
    fields = {name: records[name] for name in records.dtype.names or () if name not in ("xyz", "number")}
    return PointCloud(np.ascontiguousarray(records["xyz"]), np.zeros(3), fields)


def part_of(whole: Whole, store: WorkFolder, number: Ints, step: Ints) -> PatchGroup:
    """Return patches (c,), of each of which every `step`-th (c,) point is loaded."""
    spans = [np.arange(whole.first[patch], whole.first[patch + 1]) for patch in number.tolist()]
    owner = np.repeat(np.arange(len(number)), [len(span) for span in spans])
    slices = whole.slices[np.concatenate([np.zeros(0, np.int64), *spans])]
    slices[:, 3] = step[owner]
    surfaces = (whole.joined.normal[number], whole.joined.centroid[number], whole.joined.bend[number])
    return PatchGroup(store, number, *surfaces, slices, owner, whole.corner)


def measure_part(
    part: PatchGroup,
    is_own: NDArray[np.bool_],
    is_about: NDArray[np.bool_],
    step: int,
    rest: Ints,
    reach: float,
    settings: FeatureSettings,
    beyond: Beyond,
) -> PatchFeatures:
    """Measure some patches of a group (o,), and the pairs that they are in, numbered as in the map.

    `is_own` (c,): which of the group; their measures depend on the others. `is_about` (c,): over which of the group all
    points of no patch are wanted; over the others one of `step`. `rest` (q, 4): slices of the points of no patch that
    may lie near. `reach`: metres from the patches wanted up to which these count.
    """
    found = measure(_with_loose(part, is_own, is_about, step, rest, reach), settings, beyond, is_own)
    return found._replace(
        node=found.node[is_own], shape=found.shape[is_own], pairs=part.number.astype(np.int32)[found.pairs]
    )


def _with_loose(
    part: PatchGroup, is_own: NDArray[np.bool_], is_about: NDArray[np.bool_], step: int, rest: Ints, reach: float
) -> Patches:
    """Return patches with the points of no patch that may lie over them."""
    patches, store = part.load(), part.store
    cloud = patches.cloud
    about, far = (_voxels_about(cloud.xyz[some[patches.patch]], FARTHEST) for some in (is_about, ~is_about))
    within = _voxels_about(cloud.xyz[is_own[patches.patch]], reach)
    found = []
    for read in _chunks(store, rest):
        records = read[np.isin(voxel_keys(read["xyz"] - part.corner, reach), within)]
        key = voxel_keys(records["xyz"] - part.corner, FARTHEST)
        wanted = np.isin(key, about)
        wanted[np.flatnonzero(~wanted & np.isin(key, far))[::step]] = True
        found.append(records[wanted])
    loose = _cloud(np.concatenate([np.zeros(0, store.record), *found]))
    xyz = np.concatenate([cloud.xyz, loose.xyz - part.corner])
    fields = {name: np.concatenate([cloud.fields[name], loose.fields[name]]) for name in cloud.fields}
    number = np.concatenate([patches.patch, np.full(len(loose), NO_PATCH, np.int32)])
    return replace(patches, cloud=PointCloud(xyz, cloud.shift, fields), patch=number)


def _chunks(store: WorkFolder, slices: Ints) -> Iterator[NDArray[np.void]]:
    """Yield the points of slices, some slices of about `CHUNK` points at a time."""
    group = np.cumsum(slices[:, 2] - slices[:, 1]) // CHUNK
    for some in np.split(slices, np.flatnonzero(np.diff(group)) + 1):
        yield np.concatenate([np.zeros(0, store.record), *store.points(some)])


def _voxels_about(points: Floats, side: float) -> Ints:
    """Return the keys (v,) of the voxels in which points (k, 3) lie, and of those beside."""
    places = np.unique(np.floor(points / side), axis=0)
    beside = np.stack(np.meshgrid(*[[-1.0, 0.0, 1.0]] * 3), axis=-1).reshape(-1, 1, 3)
    return np.unique(voxel_keys(((places + beside).reshape(-1, 3) + 0.5) * side, side))


class Measuring:
    """The measuring of the patches of a map.

    Parameters
    ----------
    whole : Whole
    store : Store
    boxes : (t, 4) float64
        Of the tiles.
    settings : FeatureSettings
        With the vertical in the map's own axes.
    workers : Workers
    most : int
        Points, about, that a task measures, with those of no patch about them.
    """

    def __init__(
        self, whole: Whole, store: WorkFolder, boxes: Floats, settings: FeatureSettings, workers: Workers, most: int
    ) -> None:
        mse = whole.joined.mse
        if settings.noise is None and len(mse):
            settings = settings.replace(noise=max(float(np.median(np.sqrt(mse))), settings.eps))
        self._whole, self._store, self._boxes, self._settings, self._workers = whole, store, boxes, settings, workers
        in_patches, others = (int((each[:, 2] - each[:, 1]).sum()) for each in (whole.slices, whole.rest))
        self._most = max(1, most * in_patches // max(in_patches + others, 1))
        n_points = whole.joined.n_points
        self._step = np.ones(len(whole), np.int64)
        if n_points.sum() > self._most:
            self._step = -(-n_points // LARGEST_PATCH)
        is_wide: NDArray[np.bool_] = self._step > 1
        order = np.lexsort((curve_places(whole.joined.centroid), is_wide))
        group = (np.cumsum(np.where(is_wide, 0, n_points)[order]) - 1) // self._most
        ends = np.flatnonzero((np.diff(group) > 0) | is_wide[order][1:]) + 1
        self.groups = [np.sort(each) for each in np.split(order, ends)]
        self._plan = shapely.STRtree(shapely.box(*whole.low[:, :2].T, *whole.high[:, :2].T))

    def features(self, known: Known) -> Iterator[PatchFeatures]:
        """Yield what is measured of each group of patches."""
        middle, n_points = self._whole.joined.centroid, self._whole.joined.n_points
        centres = window_centres(middle, np.argsort(np.lexsort((*middle.T[::-1], -n_points))))
        has_windows = known.moment is not None and "moments" in self._settings.context and len(centres)
        owner = cKDTree(centres).query(middle)[1] if len(centres) else np.zeros(0, np.int64)
        tasks = []
        for group in self.groups:
            own = centres[np.unique(owner[group])]
            reached = centres[cKDTree(own).query(centres)[0] <= WINDOW + OWNED] if len(own) else centres
            tasks.append(self._task(group, own if has_windows else centres[:0], Beyond(known, reached)))
        yield from self._workers(call, tasks)

    def _task(self, group: Ints, windows: Floats, beyond: Beyond) -> Callable[[], PatchFeatures]:
        whole = self._whole
        own = whole.low[group], whole.high[group]
        has_copies = "copies" in self._settings.context
        # Of evidence of these, which is in tiles of patches about them; what lies over it may be as far off again.
        reach = ABOUT + SLACK + TILE if has_copies else 0.0
        about = np.union1d(group, self._patches_near(*own, ABOUT + SLACK if has_copies else 0.0))
        near = self._patches_near(*own, reach + max(self._settings.radius, LOOSE_REACH))
        is_wide = bool((self._step[group] > 1).any())
        if is_wide:  # what is about it may be the whole map
            about, near = group[:0], np.union1d(group, self._largest(np.setdiff1d(near, group)))
        number = np.union1d(near, self._patches_near(windows, windows, WINDOWS_REACH + LOOSE_REACH))
        is_own, is_about, is_near = (np.isin(number, some, assume_unique=True) for some in (group, about, near))
        reach = LOOSE_REACH + (WINDOWS_REACH + OWNED if len(windows) else reach)
        rest = whole.rest[:0]
        if len(number) and (len(windows) or has_copies):
            rest = whole.rest[np.isin(whole.rest[:, 0], self._tiles_near(*own, reach))]
        n_thinned = int(whole.joined.n_points[number[~is_near]].sum())
        if is_wide:
            n_thinned += int((rest[:, 2] - rest[:, 1]).sum())
        step = max(1, -(-n_thinned // self._most))
        part = part_of(whole, self._store, number, np.maximum(self._step[number], np.where(is_near, 1, step)))
        centres = None if beyond.centres is None else beyond.centres - whole.corner
        beyond = beyond._replace(centres=centres)
        return partial(measure_part, part, is_own, is_about, step, rest, reach, self._settings, beyond)

    def _largest(self, number: Ints) -> Ints:
        """Return the largest of some patches (c,), as many as a task has points for."""
        n_points = (self._whole.joined.n_points // self._step)[number]
        order = np.argsort(-n_points, kind="stable")
        return number[order[np.cumsum(n_points[order]) <= self._most]]

    def _patches_near(self, low: Floats, high: Floats, radius: float) -> Ints:
        """Return the patches, ascending, whose boxes lie within `radius` of some boxes, by their corners (k, 3)."""
        whole = self._whole
        box, patch = self._plan.query(shapely.box(*(low[:, :2] - radius).T, *(high[:, :2] + radius).T))
        gap = np.maximum(np.maximum(whole.low[patch] - high[box], low[box] - whole.high[patch]), 0.0)
        return np.unique(patch[(gap * gap).sum(axis=1) <= radius * radius])

    def _tiles_near(self, low: Floats, high: Floats, radius: float) -> Ints:
        """Return the tiles whose boxes in the ground plan lie within `radius` of some boxes, along either axis."""
        first, last = self._boxes[:, None, :2] - radius, self._boxes[:, None, 2:] + radius
        return np.flatnonzero(np.any(np.all((low[:, :2] <= last) & (high[:, :2] >= first), axis=2), axis=1))

    def join(self, parts: list[PatchFeatures], up: list[float]) -> PatchFeatures:
        """Return the features of all patches and pairs; pairs that two groups measured are taken once."""
        order = np.argsort(np.concatenate(self.groups))
        node, shape, pairs, edge, plausibility = (
            np.concatenate([getattr(part, name) for part in parts])
            for name in ("node", "shape", "pairs", "edge", "plausibility")
        )
        shape = shape[order]
        shape[:, 0] = self._whole.joined.n_points
        rows = np.unique(pairs[:, 0].astype(np.int64) * max(len(order), 1) + pairs[:, 1], return_index=True)[1]
        return parts[0]._replace(
            node=node[order],
            pairs=pairs[rows].astype(np.int32),
            edge=edge[rows],
            plausibility=plausibility[rows],
            shape=shape,
            parameters=self._settings.described(max(self._settings.noise or 0.0, self._settings.eps), up),
        )

    def causes(
        self, features: PatchFeatures, suspicious: NDArray[np.bool_], clock: Clock, stays: Stays, visits: Visits
    ) -> dict[int, Cause]:
        """Return the cause of each suspicious patch (a mask) by its number, ascending."""
        copies, reach = copies_of(features, len(suspicious)), reach_of(features)
        tasks, own = [], []
        for group in self.groups:
            some = group[suspicious[group]]
            if len(some):
                several = [copies[patch] for patch in some.tolist()]
                number = np.unique(np.concatenate([some, *(np.array(each, np.int64) for each in several)]))
                part = part_of(self._whole, self._store, number, self._step[number])
                tasks.append(partial(measure_spreads, part, some, several, reach[some], clock, stays.value, visits))
                own.append(some.tolist())
        found = {
            patch: cause_of(spread, visits, features.disagreement[patch])
            for some, spreads in zip(own, self._workers(call, tasks), strict=True)
            for patch, spread in zip(some, spreads, strict=True)
        }
        return dict(sorted(found.items()))


def measure_spreads(
    part: PatchGroup, wanted: Ints, copies: list[list[int]], reach: Floats, clock: Clock, value: Floats, visits: Visits
) -> list[Spread]:
    """Return how the points of the patches wanted (c,) and of their copies differ in height by visits and scans.

    `copies`: patches that may be copies of each. `reach` (c,): how far off points count. `value` (k,): the clock's at
    all moments of the map.
    """
    patches = part.load()
    values = clock.values(patches.cloud)
    moment = np.where(np.isfinite(values), np.searchsorted(value, values), -1).astype(np.int64)
    visits = visits._replace(moment=moment, to_sensor=to_sensor_of(patches.cloud, clock))
    return [
        measure_spread(patches, place, np.searchsorted(part.number, several).tolist(), visits, far)
        for place, several, far in zip(
            np.searchsorted(part.number, wanted).tolist(), copies, reach.tolist(), strict=True
        )
    ]
