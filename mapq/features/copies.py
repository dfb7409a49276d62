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
from mapq.features.shape import PatchShapes, group_means, horizontal_directions
from mapq.kernels.copies import self_shifts
from mapq.kernels.layers_over import Tiles, find_tiles, layers_over, outline_match, thinness
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

    Where neither moments nor ways to the sensor are known, points of a voxel are only counted, and in any order.

    `number` (n,): which points of the cloud: all finite ones. `moment` (n,): from 0. `to_sensor` (n, 3).
    """
    points = np.asarray(patches.cloud.xyz[number], np.float64)
    key = voxel_keys(points, FARTHEST)
    order = np.argsort(key) if to_sensor is None and not moment.any() else _by_place(key, points, moment)
    distinct, first = np.unique(key[order], return_index=True)
    towards = np.zeros_like(points) if to_sensor is None else np.nan_to_num(to_sensor[order])
    first = np.append(first, len(order)).astype(np.int64)
    numbers = patches.patch[number[order]].astype(np.int64)
    return Nearby(points[order], moment[order], numbers, towards, distinct, first, table_of(distinct), FARTHEST)


def _by_place(key: Ints, points: Floats, moment: Ints) -> Ints:
    """Return the order of points (n, 3) by key, then by place, then by moment."""
    order = np.lexsort((points[:, 0], key))
    # The other coordinates decide where this leaves a tie: sorting all by all of them takes three times as long.
    same = (np.diff(key[order]) == 0) & (np.diff(points[order, 0]) == 0.0)
    tied = np.append(same, False) | np.append(False, same) if len(order) else np.zeros(0, bool)
    some = order[tied]
    order[tied] = some[np.lexsort((moment[some], *points[some].T, key[some]))]
    return order


COLUMNS = {
    "shift_support": 1,
    "shift_clear": 1,
    "shift_others": 1,
    "shift_own": 1,
    "shift_along": 1,
    "shift_length": 0,
}
"""Columns, and whether a larger value makes an error more likely."""

NEAREST = 2.0
"""Tolerances off a patch from which layers are second ones: less is noise, or a rough surface in several patches."""
TILE, ARC = 3.0, 0.5
"""Metres that a tile of a patch is long, and radians by which it turns, at most."""
ABOUT = 8.0
"""Metres between the middles of tiles that witness the same motion."""
TURNS = np.radians([0.0, -2.5, 2.5, -5.0, 5.0])
"""Of motions, radians."""
OPPOSITE = np.array([0, 2, 1, 4, 3])
"""Places of the opposite turns."""
LATTICE = 0.1
"""Metres between the motions that are tried."""
OWN = 0.1
"""Likeness from which a layer shows by itself how far off the copy of a patch lies."""
UPRIGHT = 0.5
"""|up . n| up to which patches witness horizontal motions; the others witness vertical ones."""


def copy_columns(nearby: Nearby, shapes: PatchShapes, settings: FeatureSettings) -> dict[str, Floats]:
    """Return what points alone show about copies of each patch, each (m,), by the names of `COLUMNS`; nan: nothing.

    `nearby`: all finite points of the cloud.

    Patches are looked at in tiles of at most `TILE`, so that of a wall that is a copy in part, or turned, each piece is
    like its copy. Of the motion that moves the tiles about onto layers like copies best, a horizontal one that may turn
    of upright planes or a vertical one of other planes: the likeness of what it moves (support), what that is above
    the likeness by the median motion (clear), the support by what is no second side of the same wall or slab (others),
    the likeness of the tile's own layer there (own), how far the motion moves along the normal of the tile (along) and
    its length, metres. A patch has the mean over its points.
    """
    step = 0.5 * shapes.tolerance(settings)
    half = int(np.ceil(FARTHEST / step))
    if not len(shapes.points) or half <= 2 * NEAREST + 2:
        return {name: np.full(len(shapes), np.nan) for name in COLUMNS}
    tiles = tiles_of(shapes, step)
    given = shapes.sheets, shapes.planes, shapes.points, shapes.start, tiles
    found = layers_over(nearby, *given, step, 2 * half, np.tan(TURNS))
    likeness = found.cover * thinness(found.n_points) * (0.5 + 0.5 * outline_match(found, tiles))
    patch = np.repeat(np.arange(len(shapes)), np.diff(tiles.first))
    size = np.sqrt(found.n_cells) * shapes.sheets.cell[patch]
    columns = _shifts(likeness, tiles, shapes.normals_at(patch, tiles.centre), shapes.up, size, step)
    return dict(zip(COLUMNS, _means(patch, tiles.counts, columns, len(shapes)).T, strict=True))


def tiles_of(shapes: PatchShapes, step: float) -> Tiles:
    """Return pieces of patches, no side longer than `TILE`, nor so long that a curved one turns by more than `ARC`.

    `step`: half the thickness of layers, metres.
    """
    sheets = shapes.sheets
    sides = sheets.size * sheets.cell[:, None]
    most = np.full_like(sides, TILE)
    most[:, 0] = np.minimum(TILE, ARC / np.maximum(shapes.bend, ARC / TILE))
    size = np.maximum(np.ceil(sides / most - 1e-9), 1.0).astype(np.int64)
    # No edge of a tile in the middle of a cell that is in the middle, so that a patch has the same ones from behind.
    size = np.minimum(size + ((size + 1) % 2) * (sheets.size % 2), np.maximum(sheets.size, 1))
    first = np.zeros(len(shapes) + 1, np.int64)
    np.cumsum(size.prod(axis=1), out=first[1:])
    n_tiles, tile = int(first[-1]), np.zeros(len(shapes.points), np.int64)
    find_tiles(sheets, first, size, tile)
    counts = np.bincount(tile, minlength=n_tiles)
    centre = group_means(shapes.points[sheets.number], tile, n_tiles)
    middle = np.bincount(tile, sheets.u, n_tiles) / np.maximum(counts, 1)
    # A turn moves the ends of wide ones by more than layers are thick.
    sloped = sides[:, 0] / size[:, 0] * np.tan(TURNS.max()) > 2.0 * step
    sloped &= (shapes.bend == 0.0) & (shapes.up_cosine < UPRIGHT)
    row = np.zeros(len(counts) + 1, np.int64)
    n_rows = np.repeat(np.where(sloped, len(TURNS), 1), np.diff(first))
    np.cumsum(np.where(counts > 0, n_rows, 0), out=row[1:])
    return Tiles(first, size, centre, middle, counts, row)


def _means(group: Ints, weight: Ints, values: Floats, n_groups: int) -> Floats:
    """Return the weighted means of the known values (t, k) of each group; nan where none is known."""
    found = np.full((n_groups, values.shape[1]), np.nan)
    for column, each in enumerate(values.T):
        known = np.isfinite(each)
        total = np.bincount(group[known], weight[known], n_groups)
        sums = np.bincount(group[known], weight[known] * each[known], n_groups)
        found[total > 0.0, column] = sums[total > 0.0] / total[total > 0.0]
    return found


def _about(place: Floats) -> tuple[Ints, Ints]:
    """Return where the tiles about each (t, 3) begin (t + 1,), and their numbers (p,), by place; itself too."""
    pairs = cKDTree(place).query_pairs(ABOUT, output_type="ndarray").astype(np.int64)
    itself = np.arange(len(place))
    one = np.concatenate([pairs[:, 0], pairs[:, 1], itself])
    other = np.concatenate([pairs[:, 1], pairs[:, 0], itself])
    order = np.lexsort((*place[other].T, one))
    begin = np.zeros(len(place) + 1, np.int64)
    np.cumsum(np.bincount(one, minlength=len(place)), out=begin[1:])
    return begin, other[order]


def _shifts(likeness: Floats, tiles: Tiles, normal: Floats, up: Floats, size: Floats, step: float) -> Floats:
    """Return the columns (t, 6) of the motion that explains most of what lies over the tiles about each; nan: none.

    `normal` (t, 3), and `size` (t,): the root of its area in metres.
    """
    middle, close = likeness.shape[1] // 2, int(2 * NEAREST)
    tile = np.repeat(np.arange(len(size)), np.diff(tiles.row))
    # A copy that is turned leans over its original to one side, and the original over it to the other.
    other = tiles.row[tile] + OPPOSITE[np.arange(len(tile)) - tiles.row[tile]]
    profile = np.maximum(likeness[other], likeness[:, ::-1])
    profile[:, middle - close + 1 : middle + close] = 0.0
    near = max(1, int(np.ceil(0.5 * LATTICE / step)))
    wide = maximum_filter1d(profile, 2 * near + 1, axis=1, mode="constant")
    east = horizontal_directions(up[None], np.eye(3)[[np.argmin(np.abs(up))]], up)[0]
    ground = np.column_stack([east, np.cross(up, east)])
    flat = normal @ ground
    flat /= np.maximum(np.linalg.norm(flat, axis=1), 1e-12)[:, None]
    least = NEAREST * 2 * step
    rises = np.arange(least, FARTHEST, step)
    height = np.column_stack([tiles.centre @ up, np.zeros(len(size))])
    sideways = (_motions(least), TURNS, flat, tiles.centre @ ground)
    # Along the vertical all level tiles face alike.
    upwards = (np.column_stack([rises, np.zeros(len(rises))]), TURNS[:1], np.tile([1.0, 0.0], (len(size), 1)), height)
    found = np.full((len(size), len(COLUMNS)), np.nan)
    upright = np.abs(normal @ up) < UPRIGHT
    for some, (motion, turn, face, place) in ((upright, sideways), (~upright, upwards)):
        mine = np.flatnonzero(some & (tiles.counts > 0))
        rows = np.append(0, np.cumsum(np.diff(tiles.row)[mine]))
        layers = wide[np.isin(tile, mine)]
        given = face[mine], place[mine], size[mine], *_about(tiles.centre[mine])
        found[mine] = self_shifts(layers, rows, step, motion, turn, *given, least, FARTHEST)
    some = tiles.counts > 0
    found[some, 4] = _refined(found[some, 4], profile[tiles.row[:-1][some], middle:], found[some, 3], step, near)
    found[~(found[:, 0] > 0.0), 4:] = np.nan
    return found


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
