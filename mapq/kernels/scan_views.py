"""Which scans have points of their own on a patch once they are moved, and how far their motions then lie apart.

Points count over the whole patch, not cell by cell: a scan from far away has few in each cell, and many on the patch.
"""

import numpy as np

from mapq.kernels._jit import Bools, Floats, Ints, jit, part
from mapq.kernels.order_statistics import quantile
from mapq.kernels.planes import Planes, dot, facing
from mapq.kernels.scan_layers import (
    FARTHEST_SEEN,
    FEWEST,
    NEAR_WIDTHS,
    SCANS,
    Motions,
    Over,
    grown,
    moved_over,
    scratch_over,
    sort_by_cell,
)
from mapq.kernels.sheets import Sheets
from mapq.kernels.voxels import EMPTY, Nearby, voxels_about

ENOUGH = 10
"""Points on a patch of a scan that counts as seeing it."""
ACROSS = 0.7
"""Cosine of the angle between patches below which points of one are not on the other."""
OF_ERRORS = 0.25
"""Of the variance that motions have, what is taken for nothing between offsets of scans."""


@part
def level_cells(nearby: Nearby, over: Over, i: int, n: int, order: Ints, held: Floats) -> None:
    """Make the heights of the n points over patch i those over its surface: over the own points' median in the cell.

    Where a cell has few own points, it is the median of the whole patch.
    """
    n_own = 0
    for k in range(n):
        if nearby.patch[over.rows[k]] == i:
            held[n_own] = over.spot[k, 2]
            n_own += 1
    whole = quantile(held, n_own, 0.5) if n_own > 0 else 0.0
    begin = 0
    while begin < n:
        end, n_own, cell = begin, 0, over.key[order[begin]] // SCANS
        while end < n and over.key[order[end]] // SCANS == cell:
            if nearby.patch[over.rows[order[end]]] == i:
                held[n_own] = over.spot[order[end], 2]
                n_own += 1
            end += 1
        base = quantile(held, n_own, 0.5) if n_own >= FEWEST else whole
        for k in order[begin:end]:
            over.spot[k, 2] -= base
        begin = end


@part
def add_views(nearby: Nearby, planes: Planes, over: Over, i: int, n: int, near: float, sums: Floats) -> None:
    """Add points within `near` metres of the surface of patch i to what each scan sees of it (moments, 6).

    Sums of the places in the map as it is (3), of heights over the surface and of their squares; how many. Points of
    patches that stand across this one are not on it, where both meet.
    """
    for k in range(n):
        row, off = over.rows[k], over.spot[k, 2]
        of, point = nearby.patch[row], nearby.points[row]
        if of >= 0 and abs(dot(facing(planes, i, point), facing(planes, of, point))) < ACROSS:
            over.spot[k, 2] = np.inf
        elif abs(off) <= near:
            seen = sums[nearby.moment[row]]
            for axis in range(3):
                seen[axis] += nearby.points[row, axis]
            seen[3] += off
            seen[4] += off * off
            seen[5] += 1.0


@part
def share_of_several(nearby: Nearby, over: Over, i: int, n: int, order: Ints, near: float, sums: Floats) -> float:
    """Share of the points of patch i in cells in which two scans or more, of those that count, see the surface."""
    begin, n_several, n_all = 0, 0, 0
    while begin < n:
        end, n_own, n_scans, last, cell = begin, 0, 0, EMPTY, over.key[order[begin]] // SCANS
        while end < n and over.key[order[end]] // SCANS == cell:
            k = order[end]
            moment = nearby.moment[over.rows[k]]
            if nearby.patch[over.rows[k]] == i:
                n_own += 1
            if moment != last and abs(over.spot[k, 2]) <= near and sums[moment, 5] >= ENOUGH:
                n_scans += 1
                last = moment
            end += 1
        n_all += n_own
        n_several += n_own if n_scans >= 2 else 0
        begin = end
    return n_several / max(n_all, 1)


@jit
def find_views(
    nearby: Nearby,
    sheets: Sheets,
    planes: Planes,
    points: Floats,
    start: Ints,
    spacing: Floats,
    motions: Motions,
    width: float,
) -> tuple[Floats, Floats]:
    """Views (r, 8) of patches by scans that were moved by their motions, by patch and scan; what several see (m,).

    Patch, moment, place in the map as it is (3), height over the surface once moved, its variance, number of points.
    Last is the share of each patch's points in cells that several scans with `ENOUGH` points see. `width`: of a layer.
    """
    over, held, near = scratch_over(nearby, EMPTY), np.zeros(len(nearby.points) + 2), NEAR_WIDTHS * width
    sums, several = np.zeros((len(over.entry), 6)), np.zeros(len(start) - 1)
    out, n_out = np.empty((1024, 8)), 0
    for i in range(len(start) - 1):
        scans = motions.moment[motions.first[motions.owner[i]] : motions.first[motions.owner[i] + 1]]
        n_places = voxels_about(nearby, points, start[i], start[i + 1], i, over.marks, over.places)
        n = moved_over(nearby, sheets, planes, motions, over, i, FARTHEST_SEEN, n_places)
        order = sort_by_cell(nearby, over, n, spacing[i])
        level_cells(nearby, over, i, n, order, held)
        add_views(nearby, planes, over, i, n, near, sums)
        several[i] = share_of_several(nearby, over, i, n, order, near, sums)
        out = grown(out, n_out + len(scans))
        for scan in scans:
            count = sums[scan, 5]
            if count > 0.0:
                out[n_out, 0], out[n_out, 1], out[n_out, 7] = i, scan, count
                out[n_out, 2:7] = sums[scan, :5] / count
                out[n_out, 6] -= out[n_out, 5] ** 2
                n_out += 1
            sums[scan] = 0.0
    return out[:n_out].copy(), several


@part
def covariance_of(jacobian: Floats, scan: Ints, covariance: Floats) -> Floats:
    """Covariance (n, n) of the offsets of scans, by their rows of the Jacobian (n, 6)."""
    n = len(scan)
    found = np.zeros((n, n))
    for p in range(n):
        for q in range(p + 1):
            total = 0.0
            for a in range(6):
                for b in range(6):
                    total += jacobian[p, a] * covariance[6 * scan[p] + a, 6 * scan[q] + b] * jacobian[q, b]
            found[p, q] = found[q, p] = total
    return found


@part
def range_of(offset: Floats, spread: Floats, some: Bools, alike: float, out: Floats) -> None:
    """Write the range of the offsets of some scans, its variance, and how many they are.

    Offsets that their errors do not part, nor `alike` metres, are drawn together first (one step of mean shift):
    of many that are equal but for noise the range is else that of the noise. One that lies apart stays where it is.
    """
    rows = np.flatnonzero(some)
    n = len(rows)
    out[2] = n
    if n < 2:
        return
    mean, own = np.zeros(n), np.zeros(n)
    for p in range(n):
        for q in rows:
            mean[p] += spread[rows[p], q] / n
    for p in range(n):
        own[p] = max(spread[rows[p], rows[p]] - 2.0 * mean[p] + mean.mean(), 0.0) * n / (n - 1)
    scale, drawn = alike**2 + OF_ERRORS * quantile(own, n, 0.5), np.zeros(n)
    for p in range(n):
        weight = np.exp(-0.5 * (offset[rows] - offset[rows[p]]) ** 2 / scale)
        drawn[p] = (weight * offset[rows]).sum() / weight.sum()
    one, other = rows[np.argmin(drawn)], rows[np.argmax(drawn)]
    out[0] = drawn.max() - drawn.min()
    out[1] = max(spread[one, one] + spread[other, other] - 2.0 * spread[one, other], 0.0)


@jit
def ranges_of_patches(
    first: Ints,
    scan: Ints,
    n_points: Floats,
    jacobian: Floats,
    motion: Floats,
    covariance: Floats,
    least: Floats,
    alike: float,
) -> Floats:
    """Range of the offsets of scans on each patch, its variance, and how many scans these are (p, k, 3).

    Of views (r), ``first`` (p + 1,) is where each patch begins: `scan`, `n_points`, and rows of the `jacobian` (r, 6)
    of motions (s, 6) of that `covariance` (6s, 6s). `least` (k,): points from which a scan counts. `alike`: metres.
    """
    out = np.zeros((len(first) - 1, len(least), 3))
    for i in range(len(first) - 1):
        rows = first[i] + np.flatnonzero(n_points[first[i] : first[i + 1]] >= least.min())
        offset = np.zeros(len(rows))
        for p in range(len(rows)):
            offset[p] = (jacobian[rows[p]] * motion[scan[rows[p]]]).sum()
        spread = covariance_of(jacobian[rows], scan[rows], covariance)
        for k in range(len(least)):
            range_of(offset, spread, n_points[rows] >= least[k], alike, out[i, k])
    return out
