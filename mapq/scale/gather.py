"""Points of some patches of a large map, and what lies about them, as a small map of their own."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.axes import from_corner
from mapq.cloud import PointCloud
from mapq.features.disagreement import FARTHEST
from mapq.kernels.voxels import voxel_keys
from mapq.patches import NO_PATCH, Patches
from mapq.scale.patches import Whole
from mapq.scale.tile_files import loose_path, points_path

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


def gather(whole: Whole, chosen: Ints, part: Part) -> Patches:
    """Return the patches with their points as a map of their own, patch after patch, from the corner of all patches."""
    slices, owner = [], []
    for place, patch in enumerate(chosen.tolist()):
        step = part.step_of(int(whole.n_points[patch]))
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
    patches: Patches, is_own: NDArray[np.bool_], whole: Whole, moment: str, tiles: tuple[int, ...], folder: str
) -> Patches:
    """Return patches with the points of no patch that may lie over some of them, with the field of their moments.

    Parameters
    ----------
    patches : Patches
    is_own : (m,) bool
        Which of them count.
    whole : Whole
    moment : str
    tiles : tuple of int
        Where such points may be.
    folder : str
        The work folder.
    """
    keys = _voxels_about(patches.cloud.xyz[is_own[patches.patch]])
    cloud = patches.cloud
    found, moments = [cloud.xyz], [cloud.fields[moment]] if len(cloud) else []
    for tile in tiles:
        for places, values in _loose(whole, moment, tile, folder):
            xyz = places - whole.corner
            some = np.isin(voxel_keys(xyz, FARTHEST), keys)
            found.append(xyz[some])
            moments.append(values[some])
    xyz = np.concatenate(found)
    more = len(xyz) - len(cloud)
    fields = {name: np.concatenate([values, np.zeros(more, values.dtype)]) for name, values in cloud.fields.items()}
    if moments:
        fields[moment] = np.concatenate(moments)
    number = np.concatenate([patches.patch, np.full(more, NO_PATCH, np.int32)])
    return replace(patches, cloud=PointCloud(xyz, cloud.shift, fields), patch=number)


def _voxels_about(points: Floats) -> Ints:
    """Return the keys (v,) of the voxels in which points (k, 3) lie, and of those beside."""
    places = np.unique(np.floor(points / FARTHEST), axis=0)
    beside = np.stack(np.meshgrid(*[[-1.0, 0.0, 1.0]] * 3), axis=-1).reshape(-1, 1, 3)
    around = np.unique((places + beside).reshape(-1, 3), axis=0)
    return np.asarray(voxel_keys((around + 0.5) * FARTHEST, FARTHEST))


def _loose(whole: Whole, moment: str, tile: int, folder: str) -> Iterator[tuple[Floats, NDArray[Any]]]:
    """Yield points of no patch of a tile, and their moments, a part at a time."""
    for path, spans in ((loose_path, None), (points_path, whole.rest[whole.rest[:, 0] == tile, 1:])):
        xyz, values = (np.load(path(folder, tile, name), mmap_mode="r") for name in ("xyz", moment))
        if spans is None:
            for begin in range(0, len(xyz), CHUNK):
                yield np.asarray(xyz[begin : begin + CHUNK]), np.asarray(values[begin : begin + CHUNK])
        elif len(spans):
            rows = [slice(*span) for span in spans.tolist()]
            yield np.concatenate([xyz[row] for row in rows]), np.concatenate([values[row] for row in rows])
