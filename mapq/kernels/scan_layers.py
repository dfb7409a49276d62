"""Where each scan puts the surface of a patch, cell by cell.

A cell is a square of the patch's plane, wide enough for points of several scans. Scans may be moved first by what is
known of their displacement, so that a scan that lies off by a metre is looked for where it has the surface.
"""

from typing import NamedTuple

import numpy as np

from mapq.kernels._jit import Floats, Ints, jit, part
from mapq.kernels.order_statistics import quantile
from mapq.kernels.planes import Planes, dot, dot_from
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
SCANS = 1_000_000
"""Above every number of a moment: cells and moments share a key."""


class Motions(NamedTuple):
    """How scans lie displaced, window by window.

    Attributes
    ----------
    owner : (m,) int64
        Window of each patch.
    centre : (w, 3) float64
    first : (w + 1,) int64
        Number of each window's first scan.
    moment : (e,) int64
        Scans, window by window, ascending.
    motion : (e, 6) float64
        Displacement in metres and turn in radians about the centre of the window.
    """

    owner: Ints
    centre: Floats
    first: Ints
    moment: Ints
    motion: Floats


@part
def displacement(motions: Motions, entry: int, window: int, point: Floats, out: Floats) -> None:
    """By how much a scan has a place displaced: its shift, and its turn about the centre of the window."""
    motion, centre = motions.motion[entry], motions.centre[window]
    x, y, z = point[0] - centre[0], point[1] - centre[1], point[2] - centre[2]
    out[0] = motion[0] + motion[4] * z - motion[5] * y
    out[1] = motion[1] + motion[5] * x - motion[3] * z
    out[2] = motion[2] + motion[3] * y - motion[4] * x


@part
def own_frame(
    nearby: Nearby, planes: Planes, motions: Motions, entry: Ints, i: int, places: Ints, n_places: int, mean: Floats
) -> float:
    """Side from which most own points of patch i were seen; `mean` becomes their mean displacement."""
    side, n, moved = 0.0, 0, np.zeros(3)
    mean[:] = 0.0
    for p in range(n_places):
        for k in range(nearby.first[places[p]], nearby.first[places[p] + 1]):
            if nearby.patch[k] != i:
                continue
            side += np.sign(dot(planes.normal[i], nearby.to_sensor[k]))
            if entry[nearby.moment[k]] >= 0:
                displacement(motions, entry[nearby.moment[k]], motions.owner[i], nearby.points[k], moved)
                mean += moved
                n += 1
    if n > 0:
        mean /= n
    return side


@part
def points_over(
    nearby: Nearby,
    sheets: Sheets,
    planes: Planes,
    motions: Motions,
    entry: Ints,
    i: int,
    reach: float,
    places: Ints,
    n_places: int,
    rows: Ints,
    spot: Floats,
) -> int:
    """Write the points over patch i, not seen from behind, and their places (u, v, height), moved; how many."""
    mean, moved, at = np.zeros(3), np.zeros(3), np.zeros(3)
    side = own_frame(nearby, planes, motions, entry, i, places, n_places, mean)
    n = 0
    for p in range(n_places):
        for k in range(nearby.first[places[p]], nearby.first[places[p] + 1]):
            which = entry[nearby.moment[k]]
            if which == EMPTY or dot(planes.normal[i], nearby.to_sensor[k]) * side < 0.0:
                continue
            at[:] = nearby.points[k]
            if which >= 0:
                displacement(motions, which, motions.owner[i], nearby.points[k], moved)
                at += mean - moved
            height = dot_from(planes.normal[i], at, planes.centre[i])
            u = dot_from(planes.across[i], at, planes.centre[i])
            v = dot_from(planes.along[i], at, planes.centre[i])
            if abs(height) <= reach and (nearby.patch[k] == i or cell_over(sheets, i, u, v) != EMPTY):
                rows[n], spot[n, 0], spot[n, 1], spot[n, 2] = k, u, v, height
                n += 1
    return n


@part
def sort_by_cell(nearby: Nearby, rows: Ints, spot: Floats, n: int, spacing: float, key: Ints) -> Ints:
    """Order of the points by cell and moment; `key` becomes their cell times `SCANS` plus the moment."""
    side = min(max(CELL_SPACINGS * spacing, SMALLEST_CELL), LARGEST_CELL)
    low_u, high_u, low_v, high_v = np.inf, -np.inf, np.inf, -np.inf
    for k in range(n):
        low_u, high_u = min(low_u, spot[k, 0]), max(high_u, spot[k, 0])
        low_v, high_v = min(low_v, spot[k, 1]), max(high_v, spot[k, 1])
    low_u, low_v = first_corner(low_u, high_u, side), first_corner(low_v, high_v, side)
    n_rows = int((high_v - low_v) / side) + 1
    for k in range(n):
        cell = int((spot[k, 0] - low_u) / side) * n_rows + int((spot[k, 1] - low_v) / side)
        key[k] = cell * SCANS + nearby.moment[rows[k]]
    return np.argsort(key[:n], kind="mergesort")


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
    nearby: Nearby, sheets: Sheets, planes: Planes, points: Floats, start: Ints, spacing: Floats, reach: float
) -> Floats:
    """Layers (r, 8) of each scan in each cell: patch, cell, moment, place on the plane (3), height, share of points.

    Heights of up to `reach` metres off the plane, on either side of it; sorted by patch, cell and moment.
    """
    nothing = Motions(np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros(0, np.int64), start, np.zeros((0, 6)))
    # -2: a scan that is looked at where it lies.
    entry = np.full(nearby.moment.max() + 1, -2, np.int64)
    marks, places = np.full(len(nearby.key), EMPTY, np.int64), np.zeros(len(nearby.key), np.int64)
    rows, spot = np.zeros(len(nearby.points), np.int64), np.zeros((len(nearby.points), 3))
    key = np.zeros(len(nearby.points), np.int64)
    histogram, heights = np.zeros(int(2.0 * reach / BIN) + 3), np.zeros(len(nearby.points))
    out, n_out, row = np.empty((1024, 8)), 0, np.zeros(6)
    for i in range(len(start) - 1):
        n_places = voxels_about(nearby, points, start[i], start[i + 1], i, marks, places)
        n = points_over(nearby, sheets, planes, nothing, entry, i, reach, places, n_places, rows, spot)
        order = sort_by_cell(nearby, rows, spot, n, spacing[i], key)
        begin = 0
        while begin < n:
            end = begin
            row[:] = 0.0
            while end < n and key[order[end]] == key[order[begin]]:
                k = order[end]
                heights[end - begin] = spot[k, 2]
                for axis in range(3):
                    row[3 + axis] += nearby.points[rows[k], axis] - spot[k, 2] * planes.normal[i, axis]
                end += 1
            if end - begin >= FEWEST:
                row[0], row[1], row[2] = i, key[order[begin]] // SCANS, key[order[begin]] % SCANS
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
    """Sightings (r, 10) of patches by scans that were moved by their motions, sorted by patch, cell and moment.

    Patch, cell, moment, place in the map as it is (3), height over the plane once moved, number of points, sum of
    squares about their mean, and the number of own points of the patch in the cell. `width`: of a layer, metres.
    """
    entry = np.full(nearby.moment.max() + 1, EMPTY, np.int64)
    marks, places = np.full(len(nearby.key), EMPTY, np.int64), np.zeros(len(nearby.key), np.int64)
    rows, spot = np.zeros(len(nearby.points), np.int64), np.zeros((len(nearby.points), 3))
    key, held = np.zeros(len(nearby.points), np.int64), np.zeros(len(nearby.points) + 2)
    out, n_out = np.empty((1024, 10)), 0
    for i in range(len(start) - 1):
        window = motions.owner[i]
        for at in range(motions.first[window], motions.first[window + 1]):
            entry[motions.moment[at]] = at
        n_places = voxels_about(nearby, points, start[i], start[i + 1], i, marks, places)
        n = points_over(nearby, sheets, planes, motions, entry, i, FARTHEST_SEEN, places, n_places, rows, spot)
        order = sort_by_cell(nearby, rows, spot, n, spacing[i], key)
        begin = 0
        while begin < n:
            end, n_own = begin, 0
            while end < n and key[order[end]] // SCANS == key[order[begin]] // SCANS:
                if nearby.patch[rows[order[end]]] == i:
                    held[n_own] = spot[order[end], 2]
                    n_own += 1
                end += 1
            if n_own >= FEWEST:
                base = quantile(held, n_own, 0.5)
                out = grown(out, n_out + end - begin)
                n_out = write_sightings(
                    nearby, rows, spot, key, order, begin, end, base, width, held, i, n_own, out, n_out
                )
            begin = end
        for at in range(motions.first[window], motions.first[window + 1]):
            entry[motions.moment[at]] = EMPTY
    return out[:n_out].copy()


@part
def write_sightings(
    nearby: Nearby,
    rows: Ints,
    spot: Floats,
    key: Ints,
    order: Ints,
    begin: int,
    end: int,
    base: float,
    width: float,
    held: Floats,
    i: int,
    n_own: int,
    out: Floats,
    at: int,
) -> int:
    """Write the sightings of one cell, a row for each scan that sees the surface; the number of the next row."""
    first = begin
    while first < end:
        last = first
        while last < end and key[order[last]] == key[order[first]]:
            last += 1
        n = see_layer(spot, order, first, last, base, width, held)
        if n >= FEWEST:
            out[at, 0], out[at, 1] = i, key[order[first]] // SCANS
            out[at, 2], out[at, 9] = key[order[first]] % SCANS, n_own
            out[at, 6], out[at, 7], out[at, 8] = held[0], n, held[1]
            out[at, 3:6] = 0.0
            for k in range(first, last):
                out[at, 3:6] += nearby.points[rows[order[k]]]
            out[at, 3:6] /= last - first
            at += 1
        first = last
    return at
