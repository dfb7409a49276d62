"""Copies of surfaces by points alone: second layers over a patch, and the small motion that explains a neighbourhood's.

Without scans, times or rays it is unknown when a point was seen. Geometry is left: whether a layer over a patch is like
a copy of it, and whether one motion explains the layers of many patches about it. Layers are as thick as the tolerance,
which holds what noise explains, and cells as large as the patch's own points need, so that density does not matter.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d
from scipy.spatial import cKDTree

from mapq.configuration import FeatureSettings
from mapq.features.shape import PatchShapes, horizontal_directions
from mapq.kernels.copies import LayersOver, layers_over, self_shifts
from mapq.kernels.voxels import Nearby, fill_table, voxel_keys
from mapq.patches import Patches

FARTHEST = 1.5
"""Metres off its plane up to which points lie over a patch."""

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


def table_of(key: Ints) -> Ints:
    """Return the hash table of the places of distinct keys (v,)."""
    table = np.empty(1 << int(2 * len(key)).bit_length(), np.int64)
    fill_table(key, table)
    return table


def nearby_points(patches: Patches, number: Ints, moment: Ints, to_sensor: Floats | None) -> Nearby:
    """Return points of a cloud in voxels as wide as anything over a patch may be off it, there by place and moment.

    `number` (n,): which points of the cloud: all finite ones. `moment` (n,): from 0. `to_sensor` (n, 3).
    """
    points = np.asarray(patches.cloud.xyz[number], np.float64)
    key = voxel_keys(points, FARTHEST)
    order = np.lexsort((points[:, 0], key))
    # The other coordinates decide where this leaves a tie: sorting all by all of them takes three times as long.
    same = (np.diff(key[order]) == 0) & (np.diff(points[order, 0]) == 0.0)
    tied = np.append(same, False) | np.append(False, same) if len(order) else np.zeros(0, bool)
    some = order[tied]
    order[tied] = some[np.lexsort((moment[some], *points[some].T, key[some]))]
    distinct, first = np.unique(key[order], return_index=True)
    towards = np.zeros_like(points) if to_sensor is None else np.nan_to_num(to_sensor[order])
    first = np.append(first, len(order)).astype(np.int64)
    numbers = patches.patch[number[order]].astype(np.int64)
    return Nearby(points[order], moment[order], numbers, towards, distinct, first, table_of(distinct), FARTHEST)


COLUMNS = {
    "shift_support": 1,
    "shift_others": 1,
    "shift_clear": 1,
    "shift_own": 1,
    "shift_along": 1,
    "shift_length": 0,
}
"""Columns, and whether a larger value makes an error more likely."""

NEAREST = 2.0
"""Tolerances off a patch from which layers are second ones: less is noise, or a rough surface in several patches."""
ABOUT = 8.0
"""Metres between the middles of patches that witness the same motion."""
LATTICE = 0.1
"""Metres between the motions that are tried."""
OWN = 0.1
"""Likeness from which a layer shows by itself how far off the copy of a patch lies."""
UPRIGHT = 0.5
"""|up . n| up to which patches witness horizontal motions; the others witness vertical ones."""


def copy_columns(nearby: Nearby, shapes: PatchShapes, settings: FeatureSettings) -> dict[str, Floats]:
    """Return what points alone show about copies of each patch, each (m,), by the names of `COLUMNS`; nan: nothing.

    `nearby`: all finite points of the cloud.

    Of the motion that moves the patches about onto layers like copies best, a horizontal one of upright planes or a
    vertical one of other planes: the likeness of what it moves (support), that without this very patch (others), what
    it has more than the median motion (clear), the likeness of this patch's own layer there (own), how far it moves
    along the normal of the patch (along) and its length, metres.
    """
    step = 0.5 * shapes.tolerance(settings)
    half = int(np.ceil(FARTHEST / step))
    if not len(shapes.points) or half <= 2 * NEAREST + 2:
        return {name: np.full(len(shapes), np.nan) for name in COLUMNS}
    found = layers_over(nearby, shapes.sheets, shapes.planes, shapes.points, shapes.start, step, 2 * half)
    likeness = found.cover * thinness(found) * (0.5 + 0.5 * outline_match(found, shapes.counts))
    return _shifts(likeness, shapes, step, *_about(shapes))


def thinness(found: LayersOver) -> Floats:
    """Return by how much layers (m, k) are denser than what lies before and behind them: 1 alone, 0 no more."""
    wide = np.pad(found.n_points, ((0, 0), (2, 2)))
    around = wide[:, :-4] + found.n_points + wide[:, 4:]
    return np.clip(1.5 * found.n_points / np.maximum(around, 1.0) - 0.5, 0.0, 1.0)


def outline_match(found: LayersOver, n_own: Ints) -> Floats:
    """Return how well layers (m, k) end where a patch ends: 1 as well, 0 they go on over its rim and its holes.

    Where the surface of the patch (of `n_own` points) goes on in other patches, so may its copy. A point more is put on
    the rim, so that few points show little.
    """
    cells, rim = np.maximum(found.n_cells, 1.0)[:, None], np.maximum(found.n_rim, 1.0)[:, None]
    own = found.rim[:, [found.rim.shape[1] // 2]] / rim / (np.maximum(n_own, 1)[:, None] / cells)
    going_on = (found.rim + 1.0) / rim / np.maximum(found.n_points / cells, 1e-9)
    return np.clip(1.0 - (going_on - own), 0.0, 1.0)


def _about(shapes: PatchShapes) -> tuple[Ints, Ints]:
    """Return where the patches about each begin (m + 1,), and their numbers (p,), large ones first; itself too."""
    pairs = cKDTree(shapes.centre).query_pairs(ABOUT, output_type="ndarray").astype(np.int64)
    itself = np.arange(len(shapes))
    one = np.concatenate([pairs[:, 0], pairs[:, 1], itself])
    other = np.concatenate([pairs[:, 1], pairs[:, 0], itself])
    order = np.lexsort((shapes.size_rank[other], one))
    begin = np.zeros(len(shapes) + 1, np.int64)
    np.cumsum(np.bincount(one, minlength=len(shapes)), out=begin[1:])
    return begin, other[order]


def _shifts(likeness: Floats, shapes: PatchShapes, step: float, begin: Ints, other: Ints) -> dict[str, Floats]:
    """Return the columns of the motion that explains most of what lies over the patches about each."""
    middle = likeness.shape[1] // 2
    plane, upright = shapes.bend == 0.0, shapes.up_cosine < UPRIGHT
    profile = np.maximum(likeness[:, middle:], likeness[:, middle::-1])
    profile[:, : int(2 * NEAREST)] = 0.0
    near = max(1, int(np.ceil(0.5 * LATTICE / step)))
    wide = maximum_filter1d(profile, 2 * near + 1, axis=1, mode="constant")
    east = horizontal_directions(shapes.up[None], np.eye(3)[[np.argmin(np.abs(shapes.up))]], shapes.up)[0]
    flat = np.column_stack([shapes.normal @ east, shapes.normal @ np.cross(shapes.up, east)])
    flat /= np.maximum(np.linalg.norm(flat, axis=1), 1e-12)[:, None]
    least, size = NEAREST * 2 * step, np.sqrt(shapes.area)
    rises = np.arange(least, FARTHEST, step)
    about = (begin, other, least)
    sideways = self_shifts(wide, step, _motions(least), flat, np.where(plane & upright, size, 0.0), *about)
    # Along the vertical all level patches face alike.
    upwards = np.column_stack([np.ones(len(shapes)), np.zeros(len(shapes))])
    vertical = np.column_stack([rises, np.zeros(len(rises))])
    upwards = self_shifts(wide, step, vertical, upwards, np.where(plane & ~upright, size, 0.0), *about)
    found = np.where(upright[:, None], sideways, upwards)
    found[~plane] = np.nan
    support, length, along, others, clear, own = found.T
    along = _refined(along, profile, own, step, near)
    return {
        "shift_support": support,
        "shift_others": others,
        "shift_clear": clear,
        "shift_own": own,
        "shift_along": np.where(support > 0.0, along, np.nan),
        "shift_length": np.where(support > 0.0, length, np.nan),
    }


def _refined(along: Floats, profile: Floats, own: Floats, step: float, near: int) -> Floats:
    """Return how far off copies lie (m,), by each patch's own layer about where the motion puts it, if it has one."""
    place = np.nan_to_num(along / step + 0.5).astype(np.int64)[:, None] + np.arange(-near, near + 1)
    place = np.clip(place, 0, profile.shape[1] - 1)
    layer = np.take_along_axis(profile, place, axis=1)
    middle = step * (layer * place).sum(axis=1) / np.maximum(layer.sum(axis=1), 1e-9)
    return np.where(own > OWN, middle, along)


def _motions(least: float) -> Floats:
    """Return horizontal motions (k, 2) that are tried, one of each two that are opposite, the shortest first."""
    n = int(np.ceil(FARTHEST / LATTICE))
    x, y = (part.ravel() for part in np.meshgrid(np.arange(-n, n + 1), np.arange(n + 1), indexing="ij"))
    square = x * x + y * y
    kept = ((y > 0) | (x > 0)) & (square * LATTICE**2 >= least**2) & (square <= n * n)
    x, y, square = x[kept], y[kept], square[kept]
    order = np.lexsort((x, y, square))
    return np.ascontiguousarray(LATTICE * np.column_stack([x, y])[order])
