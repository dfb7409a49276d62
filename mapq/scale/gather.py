"""Points of some patches of a large map, and what lies about them, as a small map of their own."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.axes import from_corner
from mapq.cloud import PointCloud
from mapq.features.voxels import FARTHEST
from mapq.kernels.voxels import voxel_keys
from mapq.patches import NO_PATCH, Patches
from mapq.scale.patches import Whole
from mapq.scale.tile_files import points_path

LOOKED_AT = 256
"""Boxes that are compared with all others at once."""
LOOSE_REACH = 2.0 * FARTHEST
"""Metres from a patch within which points may lie over it, whether they are of a patch or of none."""
CHUNK = 1_000_000
"""Loose points that are looked at together."""

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


class Part(NamedTuple):
    """How points of a part of a map are loaded.

    Attributes
    ----------
    fields : tuple of str
    largest : int or None
        Points of a patch that are looked at; None: all.
    folder : str
        The work folder.
    """

    fields: tuple[str, ...]
    largest: int | None
    folder: str

    def step_of(self, n_points: int) -> int:
        """Return of how many points of a patch one is loaded."""
        return 1 if self.largest is None else max(1, -(-n_points // self.largest))


def patches_near(whole: Whole, low: Floats, high: Floats, radius: float) -> Ints:
    """Return the patches, ascending, whose boxes come within `radius` of one of some boxes, by their corners (k, 3)."""
    if len(low) == 0:
        return np.zeros(0, np.int64)
    first, last = low.min(axis=0) - radius, high.max(axis=0) + radius
    some = np.flatnonzero((whole.low <= last).all(axis=1) & (whole.high >= first).all(axis=1))
    is_near = np.zeros(len(some), bool)
    for begin in range(0, len(some), LOOKED_AT):
        rows = some[begin : begin + LOOKED_AT]
        gap = np.zeros((len(rows), len(low)))
        for axis in range(3):
            below = whole.low[rows, axis][:, None] - high[:, axis]
            above = low[:, axis] - whole.high[rows, axis][:, None]
            gap += np.maximum(np.maximum(below, above), 0.0) ** 2
        is_near[begin : begin + LOOKED_AT] = (gap <= radius * radius).any(axis=1)
    return some[is_near]


def gather(whole: Whole, chosen: Ints, part: Part, least: Ints | None = None) -> Patches:
    """Return the patches with their points as a map of their own, patch after patch, from the corner of all patches.

    Of how many points of each (c,) one is loaded at least is given as `least`.
    """
    slices, owner = [], []
    steps = np.ones(len(chosen), np.int64) if least is None else least
    for place, (patch, step) in enumerate(zip(chosen.tolist(), steps.tolist(), strict=True)):
        step = max(step, part.step_of(int(whole.n_points[patch])))
        for tile, begin, end in whole.piece[whole.first_piece[patch] : whole.first_piece[patch + 1]].tolist():
            slices.append((tile, slice(begin, end, step)))
            owner.append(place)
    xyz = [np.zeros((0, 3)), *_read(part.folder, "xyz", slices)]
    fields = {name: np.concatenate(_read(part.folder, name, slices)) for name in part.fields if slices}
    number = np.repeat(np.array(owner, np.int32), [len(part) for part in xyz[1:]])
    cloud = PointCloud(np.concatenate(xyz), np.zeros(3), fields)
    patches = Patches.unlabelled(cloud, number, whole.normal[chosen], whole.centroid[chosen], {}, {})
    return from_corner(patches, whole.corner)


def _read(folder: str, name: str, slices: list[tuple[int, slice]]) -> list[NDArray[Any]]:
    """Return parts of the files of several tiles."""
    files = {tile: np.load(points_path(folder, tile, name), mmap_mode="r") for tile in {tile for tile, _ in slices}}
    return [files[tile][rows] for tile, rows in slices]


def with_loose(
    patches: Patches, is_near: NDArray[np.bool_], step: int, whole: Whole, boxes: Floats, part: Part
) -> Patches:
    """Return patches with the points of no patch that may lie over them.

    Parameters
    ----------
    patches : Patches
    is_near : (m,) bool
        Over which of them all such points are wanted; over the others one of `step`.
    step : int
    whole : Whole
    boxes : (t, 4) float64
        Corners of the tiles.
    part : Part
    """
    cloud = patches.cloud
    near, far = (_voxels_about(cloud.xyz[some[patches.patch]]) for some in (is_near, ~is_near))
    found = [{"xyz": cloud.xyz, **cloud.fields}]
    if len(cloud):
        low, high = cloud.xyz.min(axis=0) - LOOSE_REACH, cloud.xyz.max(axis=0) + LOOSE_REACH
        shifted = boxes - np.tile(whole.corner[:2], 2)
        is_met = ((shifted[:, :2] <= high[:2]) & (shifted[:, 2:] >= low[:2])).all(axis=1)
        for columns in _loose(whole, np.flatnonzero(is_met), part):
            columns["xyz"] = columns["xyz"] - whole.corner
            inside = np.flatnonzero(((columns["xyz"] >= low) & (columns["xyz"] <= high)).all(axis=1))
            key = voxel_keys(columns["xyz"][inside], FARTHEST)
            wanted = np.isin(key, near)
            wanted[np.flatnonzero(~wanted & np.isin(key, far))[::step]] = True
            found.append({name: values[inside[wanted]] for name, values in columns.items()})
    joined = {name: np.concatenate([each[name] for each in found]) for name in found[0]}
    xyz = joined.pop("xyz")
    number = np.concatenate([patches.patch, np.full(len(xyz) - len(cloud), NO_PATCH, np.int32)])
    return replace(patches, cloud=PointCloud(xyz, cloud.shift, joined), patch=number)


def _voxels_about(points: Floats) -> Ints:
    """Return the keys (v,) of the voxels in which points (k, 3) lie, and of those beside."""
    places = np.unique(np.floor(points / FARTHEST), axis=0)
    beside = np.stack(np.meshgrid(*[[-1.0, 0.0, 1.0]] * 3), axis=-1).reshape(-1, 1, 3)
    return np.unique(voxel_keys(((places + beside).reshape(-1, 3) + 0.5) * FARTHEST, FARTHEST))


def _loose(whole: Whole, tiles: Ints, part: Part) -> Iterator[dict[str, NDArray[Any]]]:
    """Yield the columns of points of no patch of some tiles, a part at a time."""
    for tile in tiles.tolist():
        files = {name: np.load(points_path(part.folder, tile, name), mmap_mode="r") for name in ("xyz", *part.fields)}
        rows = [np.arange(begin, end) for _, begin, end in whole.rest[whole.rest[:, 0] == tile].tolist()]
        row = np.concatenate(rows)
        for begin in range(0, len(row), CHUNK):
            yield {name: values[row[begin : begin + CHUNK]] for name, values in files.items()}
