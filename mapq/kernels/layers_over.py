"""Second layers over patches."""

from typing import NamedTuple

import numpy as np

from mapq.kernels._jit import Bytes, Codes, Floats, Ints, jit, part
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
def tiles_across(sheets: Sheets, tiles: Tiles, i: int, column: Ints, row: Ints) -> None:
    """Write what each column of the raster of patch i, rims included, and each row adds to the number of its tile."""
    for x in range(-RIM, sheets.size[i, 0] + RIM):
        column[x + RIM] = tile_of(sheets, tiles.first, tiles.size, i, x, 0)
    for y in range(-RIM, sheets.size[i, 1] + RIM):
        row[y + RIM] = tile_of(sheets, tiles.first, tiles.size, i, 0, y) - tiles.first[i]


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
def measure_raster(
    sheets: Sheets, i: int, column: Ints, row: Ints, raster: Bytes, n_cells: Floats, n_rim: Floats
) -> None:
    """Count the occupied cells of the tiles of patch i, and those of their rims; tiles as `tiles_across` has them."""
    width = sheets.size[i, 0] + 2 * RIM
    for y in range(sheets.size[i, 1] + 2 * RIM):
        for x in range(width):
            what = raster[y * width + x]
            if what != FREE:
                n_cells[column[x] + row[y]] += what == OCCUPIED
                n_rim[column[x] + row[y]] += what == ON_RIM


@part
def gather_over(
    near: Nearby,
    sheets: Sheets,
    planes: Planes,
    tiles: Tiles,
    i: int,
    farthest: float,
    places: Ints,
    column: Ints,
    row: Ints,
    raster: Bytes,
    out: PointsOver,
) -> int:
    """Write the points over patch i and its rim that are at most so far off it; how many."""
    n, columns, rows = 0, sheets.size[i, 0], sheets.size[i, 1]
    width = columns + 2 * RIM
    for place in places:
        for k in range(near.first[place], near.first[place + 1]):
            if near.patch[k] == i:
                continue
            u, v, height = chart(planes, i, near.points[k])
            if abs(height) >= farthest:
                continue
            x = int(np.floor((u - sheets.low[i, 0]) / sheets.cell[i])) + RIM
            y = int(np.floor((v - sheets.low[i, 1]) / sheets.cell[i])) + RIM
            if not (0 <= x < width and 0 <= y < rows + 2 * RIM):
                continue
            what = raster[y * width + x]
            if what != FREE:
                tile = column[x] + row[y]
                out.cell[n] = (y - RIM) * columns + x - RIM if what == OCCUPIED else EMPTY
                out.tile[n], out.height[n], out.aside[n] = tile, height, u - tiles.middle[tile]
                n += 1
    return n


class LayersOver(NamedTuple):
    """Layers over tiles of patches (rows, layers), from behind to before each; rows as `Tiles.row` has them."""

    cover: Floats  # share of the tile's occupied cells in which the layer has points
    n_points: Floats  # its points over these
    rim: Floats  # and over the rim
    n_cells: Floats  # (t,) occupied cells
    n_rim: Floats  # (t,) and those of the rim


@part
def cover_layers(cover: Floats, slice_: int, seen: Codes) -> None:
    """Add to the layers (n,) over a tile that begin or end with a slice the cell that is new to them.

    `seen`: a bit for each slice in which the cell had a point.
    """
    word, bit = slice_ >> 6, np.uint64(1) << np.uint64(slice_ & 63)
    if seen[word] & bit:
        return
    seen[word] |= bit
    after, before = slice_ + 1, slice_ - 1
    if slice_ < len(cover):
        cover[slice_] += (seen[after >> 6] >> np.uint64(after & 63)) & np.uint64(1) == 0
    if slice_ > 0:
        cover[before] += (seen[before >> 6] >> np.uint64(before & 63)) & np.uint64(1) == 0


@part
def count_layers(
    found: LayersOver, over: PointsOver, n: int, tiles: Tiles, r: int, step: float, slope: float, seen: Codes
) -> None:
    """Add the n points over one patch to the layers of their tiles of the slope of number r; two slices make one.

    `seen` (cells, words): bits for the slices in which a cell of the patch has points, 0.
    """
    n_layers = found.cover.shape[1]
    for k in range(n):
        row = tiles.row[over.tile[k]] + r
        slice_ = int(np.floor((over.height[k] - slope * over.aside[k]) / step)) + (n_layers + 1) // 2
        if row >= tiles.row[over.tile[k] + 1] or slice_ < 0 or slice_ > n_layers:
            continue
        is_over = over.cell[k] != EMPTY
        points = found.n_points[row] if is_over else found.rim[row]
        for layer in range(max(slice_ - 1, 0), min(slice_ + 1, n_layers)):
            points[layer] += 1.0
        if is_over:
            cover_layers(found.cover[row], slice_, seen[over.cell[k]])


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
    n, longest = len(near.points), sheets.size.max() + 2 * RIM if len(sheets.size) > 0 else 0
    over = PointsOver(np.zeros(n, np.int64), np.zeros(n, np.int64), np.zeros(n), np.zeros(n))
    column, line = np.zeros(longest, np.int64), np.zeros(longest, np.int64)
    seen, raster = np.zeros((0, n_slices // 64 + 1), np.uint64), np.zeros(0, np.uint8)
    for i in range(len(start) - 1):
        size = (sheets.size[i, 0] + 2 * RIM) * (sheets.size[i, 1] + 2 * RIM)
        if size > len(raster):
            seen, raster = np.zeros((2 * size, n_slices // 64 + 1), np.uint64), np.zeros(2 * size, np.uint8)
        draw_raster(sheets, i, raster)
        tiles_across(sheets, tiles, i, column, line)
        measure_raster(sheets, i, column, line, raster, found.n_cells, found.n_rim)
        some = places[: voxels_about(near, points, start[i], start[i + 1], i, marks, places)]
        farthest = (0.5 * n_slices + 3.0) * step
        n = gather_over(near, sheets, planes, tiles, i, farthest, some, column, line, raster, over)
        for r in range(most_slopes(tiles, i)):
            seen[: sheets.base[i + 1] - sheets.base[i]] = 0
            count_layers(found, over, n, tiles, r, step, slope[r], seen)
    for tile in range(n_tiles):
        for row in range(tiles.row[tile], tiles.row[tile + 1]):
            for layer in range(shape[1]):
                cover[row, layer] /= max(found.n_cells[tile], 1.0)
    return found


@jit
def thinness(n_points: Floats) -> Floats:
    """Return by how much layers (r, k) of so many points are denser than those before and behind: 1 alone, 0 not."""
    out, n_layers = np.zeros(n_points.shape), n_points.shape[1]
    for row in range(len(n_points)):
        own = n_points[row]
        for layer in range(n_layers):
            before = own[layer - 2] if layer > 1 else 0.0
            behind = own[layer + 2] if layer + 2 < n_layers else 0.0
            share = 1.5 * own[layer] / max(before + own[layer] + behind, 1.0)
            out[row, layer] = min(max(share - 0.5, 0.0), 1.0)
    return out


@jit
def outline_match(found: LayersOver, tiles: Tiles) -> Floats:
    """Return how well layers (r, k) end where their tile ends: 1 as well, 0 they go on over its rim.

    Holes have rims too. Where the surface goes on in other patches, so may its copy. A point more is put on the rim, so
    that few points show little.
    """
    out, n_layers = np.zeros(found.rim.shape), found.rim.shape[1]
    for tile in range(len(tiles.counts)):
        n_cells, n_rim = max(found.n_cells[tile], 1.0), max(found.n_rim[tile], 1.0)
        for row in range(tiles.row[tile], tiles.row[tile + 1]):
            own = found.rim[tiles.row[tile], n_layers // 2] / n_rim / (tiles.counts[tile] / n_cells)
            for layer in range(n_layers):
                going_on = (found.rim[row, layer] + 1.0) / n_rim / max(found.n_points[row, layer] / n_cells, 1e-9)
                out[row, layer] = min(max(1.0 - (going_on - own), 0.0), 1.0)
    return out
