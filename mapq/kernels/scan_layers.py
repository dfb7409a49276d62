"""Where each scan puts the surface of a patch, cell by cell.

A cell is a square of the patch's plane, wide enough for points of several scans. Scans may be moved first by what is
known of their displacement, so that a scan that lies off by a metre is looked for where it has the surface.
"""

from typing import NamedTuple

import numpy as np

from mapq.kernels._jit import Bools, Floats, Ints, jit, part
from mapq.kernels.order_statistics import quantile
from mapq.kernels.planes import Planes, chart, dot, facing
from mapq.kernels.sheets import Sheets, first_corner
from mapq.kernels.voxels import EMPTY, Nearby, cell_over, voxels_about

FEWEST = 3
"""Points of a scan in a cell that make a layer."""
MOST_LAYERS = 3
"""Layers of a scan in a cell that are kept, the fullest ones."""
LAYER_SHARE = 0.15
"""Of the scan's points in the cell that a layer has at least."""
BIN = 0.05
"""Metres: bins of heights in which layers are looked for."""
CELL_SPACINGS, SMALLEST_CELL, LARGEST_CELL = 8.0, 0.4, 2.0
"""Side of a cell in spacings of the patch, between two lengths in metres."""
FARTHEST_SEEN = 0.5
"""Metres off the plane up to which points of scans that were moved are looked at."""
NEAR_WIDTHS, AROUND_WIDTHS = 2.0, 6.0
"""A scan sees the surface by its points within so many widths of it, if they are half of those within as many more."""
STILL = -2
"""Entry of a scan that is looked at where it lies."""
SCANS = 1_000_000
"""Above every number of a moment: cells and moments share a key."""


class Motions(NamedTuple):
    """How scans lie displaced, window by window."""

    owner: Ints  # (m,) window of each patch
    centre: Floats  # (w, 3)
    first: Ints  # (w + 1,) number of each window's first scan
    moment: Ints  # (e,) scans, window by window, ascending
    motion: Floats  # (e, 6) displacement in metres and turn in radians about the centre of the window


@part
def displacement(motions: Motions, entry: int, window: int, point: Floats, out: Floats) -> None:
    """By how much a scan has a place displaced: its shift, and its turn about the centre of the window."""
    motion, centre = motions.motion[entry], motions.centre[window]
    x, y, z = point[0] - centre[0], point[1] - centre[1], point[2] - centre[2]
    out[0] = motion[0] + motion[4] * z - motion[5] * y
    out[1] = motion[1] + motion[5] * x - motion[3] * z
    out[2] = motion[2] + motion[3] * y - motion[4] * x


class Over(NamedTuple):
    """Scratch for the points over one patch, with room for all points of the cloud."""

    entry: Ints  # (moments,) entry of each scan in the motions, `STILL` or `EMPTY`
    marks: Ints  # (v,) last patch about which a voxel was
    places: Ints  # (v,) voxels about the patch
    rows: Ints  # (n,) the points
    spot: Floats  # (n, 3) their places (u, v, height), moved
    key: Ints  # (n,) their cells, times `SCANS`, plus their moments


@part
def scratch_over(nearby: Nearby, entry: int) -> Over:
    """Return scratch in which every scan has this entry."""
    n, n_voxels = len(nearby.points), len(nearby.key)
    entries, marks = np.full(nearby.moment.max() + 1, entry, np.int64), np.full(n_voxels, EMPTY, np.int64)
    places, rows, key = np.zeros(n_voxels, np.int64), np.zeros(n, np.int64), np.zeros(n, np.int64)
    return Over(entries, marks, places, rows, np.zeros((n, 3)), key)


@part
def own_frame(
    nearby: Nearby, planes: Planes, motions: Motions, over: Over, i: int, n_places: int, mean: Floats
) -> float:
    """Side from which most own points of patch i were seen; `mean` becomes their mean displacement."""
    side, n, moved = 0.0, 0, np.zeros(3)
    mean[:] = 0.0
    for place in over.places[:n_places]:
        for k in range(nearby.first[place], nearby.first[place + 1]):
            if nearby.patch[k] != i:
                continue
            side += np.sign(dot(facing(planes, i, nearby.points[k]), nearby.to_sensor[k]))
            which = over.entry[nearby.moment[k]]
            if which >= 0:
                displacement(motions, which, motions.owner[i], nearby.points[k], moved)
                mean += moved
                n += 1
    if n > 0:
        mean /= n
    return side


@part
def farthest_moved(nearby: Nearby, sheets: Sheets, planes: Planes, motions: Motions, over: Over, i: int) -> float:
    """Metres by which no point near patch i is moved farther; 0 where scans are looked at where they lie."""
    if over.entry.min() == STILL:
        return 0.0
    window, farthest = motions.owner[i], 0.0
    away = np.sqrt(((planes.centre[i] - motions.centre[window]) ** 2).sum())
    away += sheets.cell[i] * (sheets.size[i, 0] + sheets.size[i, 1]) + 4.0 * nearby.side
    for entry in range(motions.first[window], motions.first[window + 1]):
        shift, turn = (motions.motion[entry, :3] ** 2).sum(), (motions.motion[entry, 3:] ** 2).sum()
        farthest = max(farthest, np.sqrt(shift) + np.sqrt(turn) * away)
    return 2.0 * farthest  # the scan's own, and the mean that is left


@part
def points_over(
    nearby: Nearby, sheets: Sheets, planes: Planes, motions: Motions, over: Over, i: int, reach: float, n_places: int
) -> int:
    """Write the points over patch i, not seen from behind, and their places (u, v, height), moved; how many."""
    mean, moved, at = np.zeros(3), np.zeros(3), np.zeros(3)
    side = own_frame(nearby, planes, motions, over, i, n_places, mean)
    n, farthest = 0, reach + farthest_moved(nearby, sheets, planes, motions, over, i)
    for place in over.places[:n_places]:
        for k in range(nearby.first[place], nearby.first[place + 1]):
            which = over.entry[nearby.moment[k]]
            if which == EMPTY or abs(chart(planes, i, nearby.points[k])[2]) > farthest:
                continue
            if dot(facing(planes, i, nearby.points[k]), nearby.to_sensor[k]) * side < 0.0:
                continue
            at[:] = nearby.points[k]
            if which >= 0:
                displacement(motions, which, motions.owner[i], nearby.points[k], moved)
                at += mean - moved
            u, v, height = chart(planes, i, at)
            if abs(height) > reach:
                continue
            if nearby.patch[k] == i or cell_over(sheets, i, u, v) != EMPTY:
                over.rows[n], over.spot[n, 0], over.spot[n, 1], over.spot[n, 2] = k, u, v, height
                n += 1
    return n


@part
def moved_over(
    nearby: Nearby, sheets: Sheets, planes: Planes, motions: Motions, over: Over, i: int, reach: float, n_places: int
) -> int:
    """Write the points over patch i, up to `reach`, of the scans of its window, moved by their motions; how many."""
    begin, end = motions.first[motions.owner[i]], motions.first[motions.owner[i] + 1]
    for entry in range(begin, end):
        over.entry[motions.moment[entry]] = entry
    n = points_over(nearby, sheets, planes, motions, over, i, reach, n_places)
    for scan in motions.moment[begin:end]:
        over.entry[scan] = EMPTY
    return n


@part
def sort_by_cell(nearby: Nearby, over: Over, n: int, spacing: float) -> Ints:
    """Order of the n points by cell and moment; their keys are written."""
    side, spot = min(max(CELL_SPACINGS * spacing, SMALLEST_CELL), LARGEST_CELL), over.spot
    low_u, high_u, low_v, high_v = np.inf, -np.inf, np.inf, -np.inf
    for k in range(n):
        low_u, high_u = min(low_u, spot[k, 0]), max(high_u, spot[k, 0])
        low_v, high_v = min(low_v, spot[k, 1]), max(high_v, spot[k, 1])
    low_u, low_v = first_corner(low_u, high_u, side), first_corner(low_v, high_v, side)
    n_rows = int((high_v - low_v) / side) + 1
    for k in range(n):
        cell = int((spot[k, 0] - low_u) / side) * n_rows + int((spot[k, 1] - low_v) / side)
        over.key[k] = cell * SCANS + nearby.moment[over.rows[k]]
    return np.argsort(over.key[:n], kind="mergesort")


@part
def grown(values: Floats, n: int) -> Floats:
    """The array (k, c) with room for n rows and more."""
    if n <= len(values):
        return values
    wider = np.empty((2 * n, values.shape[1]))
    wider[: len(values)] = values
    return wider


@part
def write_layers(heights: Floats, n: int, histogram: Floats, reach: float, row: Floats, out: Floats, at: int) -> int:
    """Write the fullest layers of n heights behind the columns of `row`; the number of the next row."""
    histogram[:] = 0.0
    for k in range(n):
        histogram[int((heights[k] + reach) / BIN) + 1] += 1.0
    for _ in range(MOST_LAYERS):
        best, place = 0.0, 0
        for b in range(1, len(histogram) - 1):
            count = histogram[b] + max(histogram[b - 1], histogram[b + 1])
            # Of the two bins that make one layer the fuller one, whichever side the normal points to.
            if histogram[b] > 0.0 and (count > best or (count == best and histogram[b] > histogram[place])):
                best, place = count, b
        if best < max(FEWEST, LAYER_SHARE * n):
            break
        beside = place - 1 if histogram[place - 1] >= histogram[place + 1] else place + 1
        middle = (histogram[place] * (place - 0.5) + histogram[beside] * (beside - 0.5)) / best
        out[at, :6] = row[:6]
        out[at, 6], out[at, 7] = middle * BIN - reach, best / n
        at += 1
        histogram[place - 1 : place + 2] = 0.0
    return at


@jit
def find_layers(
    nearby: Nearby,
    sheets: Sheets,
    planes: Planes,
    points: Floats,
    start: Ints,
    spacing: Floats,
    motions: Motions,
    wanted: Bools,
    reach: float,
) -> Floats:
    """Layers (r, 8) of each scan in each cell: patch, cell, moment, place in the map (3), height, share of points.

    Of `wanted` patches (m,). Scans are moved by their motions; without any (w = 0) they are looked at where they lie.
    Heights of up to `reach` metres off the plane, on either side of it; sorted by patch, cell and moment.
    """
    over = scratch_over(nearby, EMPTY if len(motions.centre) else STILL)
    histogram, heights = np.zeros(int(2.0 * reach / BIN) + 3), np.zeros(len(nearby.points))
    out, n_out, row = np.empty((1024, 8)), 0, np.zeros(6)
    for i in range(len(start) - 1):
        if not wanted[i]:
            continue
        n_places = voxels_about(nearby, points, start[i], start[i + 1], i, over.marks, over.places)
        if len(motions.centre):
            n = moved_over(nearby, sheets, planes, motions, over, i, reach, n_places)
        else:
            n = points_over(nearby, sheets, planes, motions, over, i, reach, n_places)
        order = sort_by_cell(nearby, over, n, spacing[i])
        begin = 0
        while begin < n:
            end, key = begin, over.key[order[begin]]
            row[:] = 0.0
            while end < n and over.key[order[end]] == key:
                k = order[end]
                point = nearby.points[over.rows[k]]
                normal, heights[end - begin] = facing(planes, i, point), over.spot[k, 2]
                for axis in range(3):
                    row[3 + axis] += point[axis] - over.spot[k, 2] * normal[axis]
                end += 1
            if end - begin >= FEWEST:
                row[0], row[1], row[2] = i, key // SCANS, key % SCANS
                row[3:] /= end - begin
                out = grown(out, n_out + MOST_LAYERS)
                n_out = write_layers(heights, end - begin, histogram, reach, row, out, n_out)
            begin = end
    return out[:n_out].copy()


@part
def see_layer(spot: Floats, order: Ints, begin: int, end: int, base: float, width: float, held: Floats) -> int:
    """Points of a scan on the surface at the height `base`: `held` becomes their mean and sum of squares; how many."""
    n_near, n_around = 0, 0
    for k in range(begin, end):
        off = abs(spot[order[k], 2] - base)
        if off <= NEAR_WIDTHS * width:
            held[n_near] = spot[order[k], 2]
            n_near += 1
        if off <= AROUND_WIDTHS * width:
            n_around += 1
    if n_near < FEWEST or 2 * n_near < n_around:
        return 0
    middle, total, n = quantile(held, n_near, 0.5), 0.0, 0
    for k in range(n_near):
        if abs(held[k] - middle) <= width:
            total += held[k]
            n += 1
    mean, square = total / max(n, 1), 0.0
    for k in range(n_near):
        if abs(held[k] - middle) <= width:
            square += (held[k] - mean) ** 2
    held[0], held[1] = mean, square
    return n


@jit
def find_sightings(
    nearby: Nearby,
    sheets: Sheets,
    planes: Planes,
    points: Floats,
    start: Ints,
    spacing: Floats,
    motions: Motions,
    width: float,
) -> Floats:
    """Sightings (r, 9) of patches by scans that were moved by their motions, sorted by patch, cell and moment.

    Patch, cell, moment, place in the map as it is (3), height over the plane once moved, number of points, and sum of
    squares about their mean. `width`: of a layer, metres.
    """
    over, held = scratch_over(nearby, EMPTY), np.zeros(len(nearby.points) + 2)
    out, n_out = np.empty((1024, 9)), 0
    for i in range(len(start) - 1):
        n_places = voxels_about(nearby, points, start[i], start[i + 1], i, over.marks, over.places)
        n = moved_over(nearby, sheets, planes, motions, over, i, FARTHEST_SEEN, n_places)
        order = sort_by_cell(nearby, over, n, spacing[i])
        begin = 0
        while begin < n:
            end, n_own, cell = begin, 0, over.key[order[begin]] // SCANS
            while end < n and over.key[order[end]] // SCANS == cell:
                if nearby.patch[over.rows[order[end]]] == i:
                    held[n_own] = over.spot[order[end], 2]
                    n_own += 1
                end += 1
            if n_own >= FEWEST:
                base = quantile(held, n_own, 0.5)
                out = grown(out, n_out + end - begin)
                first = n_out
                n_out = write_sightings(nearby, over, order[begin:end], base, width, held, out, n_out)
                out[first:n_out, 0] = i
            begin = end
    return out[:n_out].copy()


@part
def write_sightings(
    nearby: Nearby, over: Over, order: Ints, base: float, width: float, held: Floats, out: Floats, at: int
) -> int:
    """Write the sightings of one cell, a row for each scan that sees the surface; the number of the next row.

    The patch is left out.
    """
    first = 0
    while first < len(order):
        last, key = first, over.key[order[first]]
        while last < len(order) and over.key[order[last]] == key:
            last += 1
        n = see_layer(over.spot, order, first, last, base, width, held)
        if n >= FEWEST:
            out[at, 1], out[at, 2] = key // SCANS, key % SCANS
            out[at, 6], out[at, 7], out[at, 8] = held[0], n, held[1]
            out[at, 3:6] = 0.0
            for k in range(first, last):
                out[at, 3:6] += nearby.points[over.rows[order[k]]]
            out[at, 3:6] /= last - first
            at += 1
        first = last
    return at
