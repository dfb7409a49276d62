"""Normals of points from their neighbours, and planes through points that not all of their neighbours lie on.

Robust planes are for places beside a crossing, or between two copies of a wall. Candidates are the planes through the
point and two of its neighbours, taken by a fixed pattern; the best is fitted once more to the points near it. No
random numbers, so that a point's plane depends on nothing but its neighbours.
"""

from typing import NamedTuple

import numpy as np

from mapq.kernels._jit import Bools, Floats, Floats32, Ints, Ints32, core, jit, part
from mapq.kernels.block_search import padded
from mapq.kernels.order_statistics import select
from mapq.kernels.planes import MOMENTS, Fit, fit_plane, write_moments


@core
def add_up(xyz: Floats, i: int, neighbours: Ints32, s: int, sums: Floats) -> float:
    """Write the moments of a point and of its neighbours, in row `s`, about the point; return how many they are."""
    n = 1.0
    sx = sy = sz = xx = xy = xz = yy = yz = zz = 0.0
    for rank in range(neighbours.shape[1]):
        j = neighbours[s, rank]
        if j < 0:
            break
        x, y, z = xyz[j, 0] - xyz[i, 0], xyz[j, 1] - xyz[i, 1], xyz[j, 2] - xyz[i, 2]
        n, sx, sy, sz = n + 1.0, sx + x, sy + y, sz + z
        xx, xy, xz = xx + x * x, xy + x * y, xz + x * z
        yy, yz, zz = yy + y * y, yz + y * z, zz + z * z
    write_moments(sums, n, sx, sy, sz, xx, xy, xz, yy, yz, zz)
    return n


@jit
def estimate_normals(xyz: Floats, points: Ints, neighbours: Ints32, normal: Floats32, spread: Floats32) -> None:
    """Write the normal (s, 3) of the plane through each of some points and its neighbours, and their variances (s, 3).

    Variances are biased and ascend: across the plane, and along its short and its long side. Neighbours end at the
    first -1; a point with fewer than two gets a normal of nan.
    """
    sums, plane, variance = np.empty(MOMENTS), np.empty(4), np.empty(3)
    for s in range(len(points)):
        if add_up(xyz, points[s], neighbours, s, sums) < 3.0:
            for axis in range(3):
                normal[s, axis] = np.nan
                spread[s, axis] = np.nan
            continue
        fit_plane(sums, plane, variance)
        for axis in range(3):
            normal[s, axis] = plane[axis]
            spread[s, axis] = variance[axis]


WIDTH = 4
"""Lists are padded to multiples of it."""
REFITS = 2
CLEAN_SHARE = 0.9
"""Score by point, about 1.7 where all lie on the plane, from which on a clean neighbour's plane is taken."""
NARROW = 0.25
"""Squared sine of the angle at the point below which two neighbours determine a plane too badly (30 degrees)."""


@core
def local_points(xyz: Floats, i: int, neighbours: Ints32, row: int, local: Floats) -> int:
    """Copy a point and its neighbours, in a row of many, relative to the point; return how many.

    What pads them to a multiple of `WIDTH` lies near no plane.
    """
    local[:, 0] = 0.0
    n_local = 1
    for rank in range(neighbours.shape[1]):
        j = neighbours[row, rank]
        if j < 0:
            break
        for axis in range(3):
            local[axis, n_local] = xyz[j, axis] - xyz[i, axis]
        n_local += 1
    local[:, n_local : padded(n_local, WIDTH)] = np.nan
    return n_local


@core
def widen(i: int, neighbours: Ints32, size: int, stamp: Ints32, wide: Ints32, n_inner: int) -> int:
    """List the neighbours of point i and then theirs, each once, the farthest neighbours' first; return how many.

    ``stamp[j]`` is i for what is listed: no search whether a point is.
    """
    n_wide = 0
    stamp[i] = i
    for rank in range(neighbours.shape[1]):
        j = neighbours[i, rank]
        if j < 0:
            break
        wide[0, n_wide] = j
        stamp[j] = i
        n_wide += 1
    n_own = n_wide
    for c in range(n_own - 1, -1, -1):
        for rank in range(n_inner):
            j = neighbours[wide[0, c], rank]
            if n_wide == size:
                return n_wide
            if j < 0:
                break
            # Without a branch, which would be guessed wrong for every second one.
            wide[0, n_wide] = j
            n_wide += stamp[j] != i
            stamp[j] = i
    for c in range(n_wide, size):
        wide[0, c] = -1
    return n_wide


@part
def list_pairs(size: int, turns: int) -> Ints:
    """Which two of n neighbours, for n up to `size`, make each candidate: pairs (size + 1, 2, turns)."""
    pairs = np.zeros((size + 1, 2, turns), np.int64)
    for n in range(1, size + 1):
        for turn in range(turns):
            pairs[n, 0, turn] = turn % n
            pairs[n, 1, turn] = (turn % n + n // 3 + (turn // n) * (1 + n // 5)) % n
    return pairs


@core
def list_candidates(local: Floats, pairs: Ints, turns: int, planes: Floats) -> None:
    """Write the planes (4, turns) through the point and two neighbours: normals of their own length, and that squared.

    0 for the square where the three lie nearly on a line.
    """
    for turn in range(turns):
        a, b = np.uint64(1 + pairs[0, turn]), np.uint64(1 + pairs[1, turn])
        ux, uy, uz = local[0, a], local[1, a], local[2, a]
        vx, vy, vz = local[0, b], local[1, b], local[2, b]
        nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        squared = nx * nx + ny * ny + nz * nz
        lengths = (ux * ux + uy * uy + uz * uz) * (vx * vx + vy * vy + vz * vz)
        planes[0, turn], planes[1, turn], planes[2, turn] = nx, ny, nz
        planes[3, turn] = squared if squared > NARROW * lengths else 0.0


@core
def take(planes: Floats, turn: int, plane: Floats) -> None:
    """Copy a candidate that is one, its normal made a unit vector."""
    length = np.sqrt(planes[3, turn])
    plane[0], plane[1], plane[2] = planes[0, turn] / length, planes[1, turn] / length, planes[2, turn] / length
    plane[3] = 0.0


@core
def residuals(local: Floats, n_local: int, plane: Floats, out: Floats) -> None:
    """Write the distances of the local points to a plane."""
    nx, ny, nz, d = plane[0], plane[1], plane[2], plane[3]
    for c in range(n_local):
        out[c] = abs(nx * local[0, c] + ny * local[1, c] + nz * local[2, c] - d)


@core
def count_near(local: Floats, n_local: int, nx: float, ny: float, nz: float, near: float) -> int:
    """Return how many points lie near a plane through the point, those within half that distance counted twice.

    `near` is the square of the distance, times that of the normal's length. Whole numbers, because their sums need no
    order: the loop becomes vector instructions.
    """
    half = 0.25 * near
    score = 0
    for c in range(padded(n_local, WIDTH)):
        r = nx * local[0, c] + ny * local[1, c] + nz * local[2, c]
        score += int(r * r <= near) + int(r * r <= half)
    return score


@core
def fit_within(local: Floats, residual: Floats, n_local: int, limit: float, fit: Fit) -> int:
    """Fit the plane to the points within `limit` of the last one; return how many they are."""
    n = sx = sy = sz = xx = xy = xz = yy = yz = zz = 0.0
    # Sums in registers, and a factor where a branch would be guessed wrong: thrice as fast.
    for c in range(n_local):
        counts = 1.0 if residual[c] <= limit else 0.0
        x, y, z = counts * local[0, c], counts * local[1, c], counts * local[2, c]
        n, sx, sy, sz = n + counts, sx + x, sy + y, sz + z
        xx, xy, xz = xx + x * x, xy + x * y, xz + x * z
        yy, yz, zz = yy + y * y, yz + y * z, zz + z * z
    write_moments(fit.sums, n, sx, sy, sz, xx, xy, xz, yy, yz, zz)
    if n >= 3.0:
        fit_plane(fit.sums, fit.plane, fit.spread)
    return int(n)


@core
def value_of_rank(values: Floats, n: int, rank: int, scratch: Floats) -> float:
    """Return the value of a rank, from 0, among the first n, which stay in their order."""
    for c in range(n):
        scratch[c] = values[c]
    return select(scratch, n, rank)


@core
def smallest(values: Floats, n: int, kept: int, sorted_: Floats) -> float:
    """Return the number `kept` in the order of size of the first n values."""
    n_sorted = 0
    for c in range(n):
        if n_sorted == kept and values[c] >= sorted_[kept - 1]:
            continue
        at = min(n_sorted, kept - 1)
        while at > 0 and values[c] < sorted_[at - 1]:
            sorted_[at] = sorted_[at - 1]
            at -= 1
        sorted_[at] = values[c]
        n_sorted = min(n_sorted + 1, kept)
    return sorted_[n_sorted - 1]


@core
def count_below(values: Floats, n: int, limit: float) -> int:
    """Return how many of the first n values are below a limit."""
    n_below = 0
    for c in range(n):
        n_below += values[c] < limit
    return n_below


@jit
def trimmed_residuals(
    xyz: Floats, points: Ints, neighbours: Ints32, turns: int, scale: Floats, thickness: Floats, residual: Floats
) -> None:
    """Write each point's distances (s, k + 1) to the plane that holds half of its neighbourhood best, and their scale.

    Least quantile of squares (Rousseeuw 1984) over the candidates, then refits to the nearest half. The scale is the
    root mean square of that half, its thickness the variance across by that along the short side; both are nan where
    there is no plane. It needs no noise to be known, so noise can be estimated by it, and half of the points may belong
    to another surface.
    """
    k = neighbours.shape[1]
    pairs = list_pairs(k, turns)
    local, values, order = np.empty((3, k + WIDTH)), np.empty(k + 1), np.empty(k + 1)
    planes, fit = np.empty((4, turns)), Fit(np.empty(MOMENTS), np.empty(4), np.empty(3))
    for s in range(len(points)):
        n_local = local_points(xyz, points[s], neighbours, s, local)
        scale[s] = np.nan
        thickness[s] = np.nan
        for c in range(k + 1):
            residual[s, c] = np.nan
        kept, lowest, best = n_local // 2, np.inf, 0
        if kept < 4:
            continue
        list_candidates(local, pairs[n_local - 1], turns, planes)
        for turn in range(turns):
            if planes[3, turn] > 0.0:
                take(planes, turn, fit.plane)
                residuals(local, n_local, fit.plane, values)
                # Finds most bad planes without sorting.
                if count_below(values, n_local, lowest) >= kept:
                    lowest, best = value_of_rank(values, n_local, kept - 1, order), turn
        if lowest == np.inf:
            continue
        take(planes, best, fit.plane)
        for _ in range(REFITS):
            residuals(local, n_local, fit.plane, values)
            fit_within(local, values, n_local, value_of_rank(values, n_local, kept - 1, order), fit)
        residuals(local, n_local, fit.plane, values)
        smallest(values, n_local, kept, order)
        total = 0.0
        for c in range(kept):
            total += order[c] * order[c]
        scale[s] = np.sqrt(total / kept)
        thickness[s] = fit.spread[0] / fit.spread[1]
        for c in range(n_local):
            residual[s, c] = values[c]


@core
def try_clean(
    local: Floats, n_local: int, i: int, neighbours: Ints32, thick: Bools, normal: Floats32, band: float, best: Floats
) -> int:
    """Write the best of the planes through point i that face as neighbours with one surface do; return its score."""
    highest = 0
    for rank in range(neighbours.shape[1]):
        j = neighbours[i, rank]
        if j < 0:
            break
        if not thick[j]:
            nx, ny, nz = np.float64(normal[j, 0]), np.float64(normal[j, 1]), np.float64(normal[j, 2])
            score = count_near(local, n_local, nx, ny, nz, band * band)
            if score > highest:
                highest = score
                best[0], best[1], best[2], best[3] = nx, ny, nz, 0.0
                if score >= n_local:
                    break
    return highest


@core
def try_turns(
    local: Floats, n_local: int, pairs: Ints, planes: Floats, fewest: float, band: float, best: Floats
) -> int:
    """Write the best of the planes through the point and two others; return its score, 0 if half of them show none."""
    highest, turns = 0, planes.shape[1]
    if n_local <= 4:
        return 0
    list_candidates(local, pairs[n_local - 1], turns, planes)
    for turn in range(turns):
        if turn == turns // 2 and highest < fewest:
            return 0
        squared = planes[3, turn]
        if squared > 0.0:
            score = count_near(local, n_local, planes[0, turn], planes[1, turn], planes[2, turn], band * band * squared)
            if score > highest:
                highest = score
                take(planes, turn, best)
    return highest


class Room(NamedTuple):
    """Scratch for robust normals."""

    local: Floats  # (3, size + WIDTH) points relative to one of them
    values: Floats  # (size + 1,) their distances from a plane
    wide: Ints32  # (1, size) their numbers
    stamp: Ints32  # (n,) of points that are listed
    pairs: Ints  # (size + 1, 2, turns)
    planes: Floats  # (4, turns) candidates
    fit: Fit


@core
def fit_robustly(
    xyz: Floats,
    i: int,
    thick: Bools,
    neighbours: Ints32,
    band: float,
    min_share: float,
    room: Room,
    normal: Floats32,
) -> None:
    """Fit the plane of point i; nan if there is none."""
    local, values, wide, stamp, pairs, planes, fit = room
    n_local = local_points(xyz, i, neighbours, i, local)
    fewest = max(min_share * n_local, 4.0)
    score = try_clean(local, n_local, i, neighbours, thick, normal, band, fit.plane)
    if score < CLEAN_SHARE * n_local:
        widen(i, neighbours, wide.shape[1], stamp, wide, neighbours.shape[1] // 2)
        n_local = local_points(xyz, i, wide, 0, local)
        fewest = max(min_share * n_local, 4.0)
        score = try_turns(local, n_local, pairs, planes, fewest, band, fit.plane)
    n_near = 0
    if score >= fewest:
        residuals(local, n_local, fit.plane, values)
        n_near = fit_within(local, values, n_local, band, fit)
    if n_near < fewest or abs(fit.plane[3]) > band:
        fit.plane[:3] = fit.spread[0] = np.nan


@jit
def robust_normals(
    xyz: Floats,
    points: Ints,
    thick: Bools,
    neighbours: Ints32,
    size: int,
    turns: int,
    band: float,
    min_share: float,
    normal: Floats32,
    variance: Floats32,
) -> None:
    """Write the normals (n, 3) of some points anew, from those points that lie near one plane with the point.

    The neighbourhoods of all of them are thick; what is written for one depends on none of the others.

    A plane that half of the neighbours lie on is taken if one of them, whose own neighbourhood is not thick, faces so.
    Else the best candidate among the neighbours and, up to `size`, theirs has the most points within `band`, those
    within half of it counted twice. A point of which less than `min_share` of those around lies on its plane gets nan:
    there is none. `variance` gets the variance across the plane.
    """
    room = Room(
        np.empty((3, size + WIDTH)),
        np.empty(size + 1),
        np.empty((1, size), np.int32),
        np.full(len(xyz), -1, np.int32),
        list_pairs(size, turns),
        np.empty((4, turns)),
        Fit(np.empty(MOMENTS), np.empty(4), np.empty(3)),
    )
    for i in points:
        fit_robustly(xyz, i, thick, neighbours, band, min_share, room, normal)
        variance[i] = room.fit.spread[0]
        for axis in range(3):
            normal[i, axis] = room.fit.plane[axis]
