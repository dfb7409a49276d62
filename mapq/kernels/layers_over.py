"""Second layers over patches."""

from typing import NamedTuple

import numpy as np

from mapq.kernels._jit import Bytes, Floats, Ints, jit, part
from mapq.kernels.planes import Planes, chart
from mapq.kernels.sheets import Sheets
from mapq.kernels.voxels import EMPTY, Nearby, voxels_about

RIM = 3
"""Cells round the occupied ones of a patch, and in its holes, in which the copy of it has no points."""


FREE, ON_RIM, OCCUPIED = 0, 1, 2
"""What a place of the raster of a patch is, `RIM` cells wider on each side than the patch."""


class Tiles(NamedTuple):
    """Pieces of patches, patch after patch, row after row."""

    first: Ints  # (m + 1,) number of each patch's first tile
    size: Ints  # (m, 2) columns and rows of tiles
    centre: Floats  # (t, 3) mean of the points, metres
    middle: Floats  # (t,) of the points, across their patch, metres
    counts: Ints  # (t,) of points
    row: Ints  # (t + 1,) of its first layers: those of each slope, or of the first alone; of a tile without points none


class PointsOver(NamedTuple):
    """Points over a patch, room for all (n,)."""

    cell: Ints  # of the patch's raster; `EMPTY` over the rim
    tile: Ints
    height: Floats  # metres off the patch
    aside: Floats  # metres across from the middle of the tile


@part
def share_of(cell: int, n_cells: int, n_tiles: int) -> int:
    """Tile of a row of them that a cell of a row is in: the same from either end."""
    nearer = min(cell, n_cells - 1 - cell)
    tile = (2 * nearer + 1) * n_tiles // (2 * n_cells)
    return tile if cell == nearer else n_tiles - 1 - tile


@part
def tile_of(sheets: Sheets, first: Ints, size: Ints, i: int, column: int, row: int) -> int:
    """Tile of patch i that a cell of its raster is in; of a place beyond its rim, the nearest. As `Tiles` has them."""
    columns, rows = sheets.size[i, 0], sheets.size[i, 1]
    across = share_of(min(max(column, 0), columns - 1), columns, size[i, 0])
    return first[i] + share_of(min(max(row, 0), rows - 1), rows, size[i, 1]) * size[i, 0] + across


@jit
def find_tiles(sheets: Sheets, first: Ints, size: Ints, tile: Ints) -> None:
    """Write the tile of each point (k,) of the patches; `first` and `size` as `Tiles` has them."""
    for i in range(len(sheets.size)):
        for cell in range(sheets.base[i], sheets.base[i + 1]):
            at = cell - sheets.base[i]
            mine = tile_of(sheets, first, size, i, at % sheets.size[i, 0], at // sheets.size[i, 0])
            tile[sheets.first[cell] : sheets.first[cell + 1]] = mine


@part
def draw_raster(sheets: Sheets, i: int, raster: Bytes) -> None:
    """Write what each place of the raster of patch i is, row after row."""
    columns, rows = sheets.size[i, 0], sheets.size[i, 1]
    width = columns + 2 * RIM
    raster[: width * (rows + 2 * RIM)] = FREE
    for row in range(rows):
        marked = -1
        for column in range(columns):
            at = sheets.base[i] + row * columns + column
            if sheets.first[at + 1] == sheets.first[at]:
                continue
            # All about it that the occupied cell before it in its row has not marked.
            for c in range(max(column, marked + 1), column + 2 * RIM + 1):
                for r in range(row, row + 2 * RIM + 1):
                    raster[r * width + c] = max(raster[r * width + c], ON_RIM)
            marked = column + 2 * RIM
            raster[(row + RIM) * width + column + RIM] = OCCUPIED


@part
def measure_raster(sheets: Sheets, tiles: Tiles, i: int, raster: Bytes, n_cells: Floats, n_rim: Floats) -> None:
    """Count the occupied cells of the tiles of patch i, and those of their rims."""
    width = sheets.size[i, 0] + 2 * RIM
    for at in range(width * (sheets.size[i, 1] + 2 * RIM)):
        if raster[at] != FREE:
            tile = tile_of(sheets, tiles.first, tiles.size, i, at % width - RIM, at // width - RIM)
            n_cells[tile] += raster[at] == OCCUPIED
            n_rim[tile] += raster[at] == ON_RIM


@part
def gather_over(
    near: Nearby,
    sheets: Sheets,
    planes: Planes,
    tiles: Tiles,
    i: int,
    farthest: float,
    places: Ints,
    raster: Bytes,
    out: PointsOver,
) -> int:
    """Write the points over patch i and its rim that are at most so far off it; how many."""
    n, columns, rows = 0, sheets.size[i, 0], sheets.size[i, 1]
    for place in places:
        for k in range(near.first[place], near.first[place + 1]):
            if near.patch[k] == i:
                continue
            u, v, height = chart(planes, i, near.points[k])
            if abs(height) >= farthest:
                continue
            column = int(np.floor((u - sheets.low[i, 0]) / sheets.cell[i]))
            row = int(np.floor((v - sheets.low[i, 1]) / sheets.cell[i]))
            if not (-RIM <= column < columns + RIM and -RIM <= row < rows + RIM):
                continue
            what = raster[(row + RIM) * (columns + 2 * RIM) + column + RIM]
            if what != FREE:
                tile = tile_of(sheets, tiles.first, tiles.size, i, column, row)
                out.cell[n] = row * columns + column if what == OCCUPIED else EMPTY
                out.tile[n], out.height[n], out.aside[n] = tile, height, u - tiles.middle[tile]
                n += 1
    return n


@part
def sort_slices(over: PointsOver, n: int, step: float, slope: float, first: Ints, slice_: Ints, order: Ints) -> None:
    """Write the order of n points by slices of a slope; where each begins to `first` (slices + 1,)."""
    n_slices = len(first) - 1
    first[:] = 0
    for k in range(n):
        at = int(np.floor((over.height[k] - slope * over.aside[k]) / step)) + n_slices // 2
        slice_[k] = at if 0 <= at < n_slices else EMPTY
        if slice_[k] != EMPTY:
            first[at + 1] += 1
    for at in range(n_slices):
        first[at + 1] += first[at]
    for k in range(n):
        if slice_[k] != EMPTY:
            order[first[slice_[k]]] = k
            first[slice_[k]] += 1
    for at in range(n_slices, 0, -1):
        first[at] = first[at - 1]
    first[0] = 0


class LayersOver(NamedTuple):
    """Layers over tiles of patches (rows, layers), from behind to before each; rows as `Tiles.row` has them."""

    cover: Floats  # share of the tile's occupied cells in which the layer has points
    n_points: Floats  # its points over these
    rim: Floats  # and over the rim
    n_cells: Floats  # (t,) occupied cells
    n_rim: Floats  # (t,) and those of the rim


@part
def count_layers(
    found: LayersOver, over: PointsOver, tiles: Tiles, r: int, first: Ints, order: Ints, seen: Ints
) -> None:
    """Add the points of one patch, sorted by the slope of number r, to the layers of their tiles; two slices make one.

    `seen`: by cell of the patch, filled with -2.
    """
    n_layers = found.cover.shape[1]
    for slice_ in range(n_layers + 1):
        for place in range(first[slice_], first[slice_ + 1]):
            k = order[place]
            cell, row = over.cell[k], tiles.row[over.tile[k]] + r
            if row >= tiles.row[over.tile[k] + 1]:
                continue
            if cell == EMPTY:
                for layer in range(max(slice_ - 1, 0), min(slice_ + 1, n_layers)):
                    found.rim[row, layer] += 1.0
                continue
            last = seen[cell]
            seen[cell] = slice_
            # New to the layer that begins here, and to the one that ends here unless the slice before had it.
            if slice_ < n_layers:
                found.cover[row, slice_] += last != slice_
                found.n_points[row, slice_] += 1.0
            if slice_ > 0:
                found.cover[row, slice_ - 1] += last < slice_ - 1
                found.n_points[row, slice_ - 1] += 1.0


@part
def most_slopes(tiles: Tiles, i: int) -> int:
    """Slopes of layers over a tile of patch i at most."""
    most = 0
    for tile in range(tiles.first[i], tiles.first[i + 1]):
        most = max(most, tiles.row[tile + 1] - tiles.row[tile])
    return most


@jit
def layers_over(
    near: Nearby,
    sheets: Sheets,
    planes: Planes,
    points: Floats,
    start: Ints,
    tiles: Tiles,
    step: float,
    n_slices: int,
    slope: Floats,
) -> LayersOver:
    """Return the layers over tiles of patches, of points of other patches or of none.

    A layer is two slices, each `step` metres thick; n_slices is even, and half of them lie on either side of the plane.
    `slope` (r,): how much layers rise across a tile, 0 first.
    """
    shape, n_tiles = (tiles.row[-1], n_slices - 1), len(tiles.counts)
    cover, n_points, rim = np.zeros(shape), np.zeros(shape), np.zeros(shape)
    found = LayersOver(cover, n_points, rim, np.zeros(n_tiles), np.zeros(n_tiles))
    marks, places = np.full(len(near.key), EMPTY, np.int64), np.zeros(len(near.key), np.int64)
    n = len(near.points)
    over = PointsOver(np.zeros(n, np.int64), np.zeros(n, np.int64), np.zeros(n), np.zeros(n))
    slice_, order, first = np.zeros(n, np.int64), np.zeros(n, np.int64), np.zeros(n_slices + 1, np.int64)
    seen, raster = np.zeros(0, np.int64), np.zeros(0, np.uint8)
    for i in range(len(start) - 1):
        size = (sheets.size[i, 0] + 2 * RIM) * (sheets.size[i, 1] + 2 * RIM)
        if size > len(seen):
            seen, raster = np.zeros(2 * size, np.int64), np.zeros(2 * size, np.uint8)
        draw_raster(sheets, i, raster)
        measure_raster(sheets, tiles, i, raster, found.n_cells, found.n_rim)
        n_places = voxels_about(near, points, start[i], start[i + 1], i, marks, places)
        n = gather_over(near, sheets, planes, tiles, i, (0.5 * n_slices + 3.0) * step, places[:n_places], raster, over)
        for r in range(most_slopes(tiles, i)):
            seen[:size] = -2
            sort_slices(over, n, step, slope[r], first, slice_, order)
            count_layers(found, over, tiles, r, first, order, seen)
    for tile in range(n_tiles):
        for row in range(tiles.row[tile], tiles.row[tile + 1]):
            for layer in range(shape[1]):
                cover[row, layer] /= max(found.n_cells[tile], 1.0)
    return found
