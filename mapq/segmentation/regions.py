"""From grown regions to patches: pieces of one plane united, points given to the plane they lie nearest to."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.kernels.growing import grow_regions, pair_rms, resolve, unite
from mapq.kernels.normals import estimate_normals, robust_normals
from mapq.kernels.planes import MOMENTS, Surface, Tolerance
from mapq.kernels.regions import (
    change_sides,
    count_support,
    fit_regions,
    join_rest,
    list_members,
    number_along,
    sum_regions,
    walk_regions,
)
from mapq.segmentation.parameters import Parameters, representatives
from mapq.segmentation.points import TURNS, Points, in_parts, neighbours_of

THICK = 1.5
"""Times the noise: a thicker neighbourhood holds more than one surface. One plane looks so in 1 place of 500."""
BAND = 2.5
"""Times the noise: what a robust plane counts as near."""
WIDE = 28
"""Points about a point when half of them may belong to another surface."""
MIN_SHARE = 0.3
"""Of a wide neighbourhood that must lie on a robust plane. Two copies of a wall have half each; in the crown of a tree
the best plane reaches a third by luck."""


class Core(NamedTuple):
    """Points with what region growing needs to know of them."""

    xyz: NDArray[np.float64]  # (c, 3)
    place: NDArray[np.int64]  # (c,) their places among all points
    neighbours: NDArray[np.int32]  # (c, k) nearest first, none farther than the gap; -1 fills up
    normal: NDArray[np.float32]  # (c, 3) nan where the neighbourhood shows no plane
    variance: NDArray[np.float32]  # (c,) across that plane, in square metres
    # (c,) whose neighbourhood holds more than one surface, so that the normal is that of the best one or of none
    thick: NDArray[np.bool_]

    @property
    def surface(self) -> Surface:
        """The points as the kernels take them."""
        return Surface(self.xyz, self.neighbours, self.normal)


def make_core(points: Points, chosen: Parameters) -> Core:
    """Return the representatives at the chosen level with their neighbours and normals."""
    place, xyz, code = representatives(points, chosen.level)
    everyone = np.ones(len(xyz), bool)
    neighbours = neighbours_of(xyz, code, points.frame, everyone, chosen.neighbours, chosen.max_gap)
    normal, spread = np.empty((len(xyz), 3), np.float32), np.empty((len(xyz), 3), np.float32)

    def fit_all(begin: int, end: int) -> None:
        rows = slice(begin, end)
        estimate_normals(xyz, np.arange(begin, end), neighbours[rows], normal[rows], spread[rows])

    in_parts(len(xyz), fit_all)
    thick = _is_thick(spread, chosen)
    variance = spread[:, 0].copy()
    band, size = BAND / 3.0 * chosen.max_distance, max(WIDE, 2 * chosen.neighbours)

    def fit_thick(begin: int, end: int) -> None:
        points = begin + np.flatnonzero(thick[begin:end])
        robust_normals(xyz, points, thick, neighbours, size, TURNS, band, MIN_SHARE, normal, variance)

    in_parts(len(xyz), fit_thick)
    rough = variance > chosen.max_variation * (variance + spread[:, 1] + spread[:, 2])
    normal[rough] = np.nan
    return Core(xyz, place, neighbours, normal, variance, thick)


def _is_thick(spread: NDArray[np.float32], chosen: Parameters) -> NDArray[np.bool_]:
    """Return whose neighbourhoods (c,) are thicker than noise alone makes them."""
    unbiased = (chosen.neighbours + 1) / max(chosen.neighbours - 2, 1)
    limit = THICK * max(chosen.noise, chosen.max_distance / 6.0)
    return np.asarray(spread[:, 0] * unbiased > limit * limit)


def sure_normals(core: Core) -> NDArray[np.float32]:
    """Return the normals (c, 3) without those of thick neighbourhoods: nan."""
    return np.where(core.thick[:, None], np.float32(np.nan), core.normal)


MANTISSA = 23
"""Bits of a 32-bit float below its power of two, which sort as the floats do."""
MIN_FRAGMENT = 12
"""Members of a region worth keeping until it is united with others."""
MERGE_RMS = 0.6
"""Times the distance limit: the root mean square of points spread evenly up to it is 0.58."""
LOOSE = 2.0
"""Times the angle limit, for points that a region reaches once it is whole: their normals may be mixed."""
MIN_SUPPORT = 0.4
"""Share of its points' neighbours that a region holds, of those that no other holds. A wall has 0.9, in clutter 0.6, a
slice through the crown of a tree 0.2 to 0.3."""
SWEEPS = 2


class Fits(NamedTuple):
    """Planes (m, 6) of regions as normal and centroid, their variances (m, 3), and moments (m, 10) about origins."""

    planes: NDArray[np.float64]
    spread: NDArray[np.float64]
    origin: NDArray[np.float64]
    sums: NDArray[np.float64]


def find_regions(core: Core, chosen: Parameters) -> NDArray[np.int32]:
    """Return the region (c,) of each core point, -1 for none; regions in no particular order."""
    region = grow(core, chosen)
    core = core._replace(normal=sure_normals(core))
    region = drop_unsupported(core, settle(core, chosen, region))
    region = settle(core, chosen, region, sweeps=1)
    fits = fit(core.xyz, region)
    piece, pairs = walk(core, chosen, region, fits.planes, wants_pairs=True)
    parent = merge(fits, pairs, MERGE_RMS * chosen.max_distance)
    if (parent == np.arange(len(parent))).all():
        return piece
    region = settle(core, chosen, np.append(parent, np.int32(-1))[region], sweeps=1)
    return walk(core, chosen, region, fit(core.xyz, region).planes, wants_pairs=False)[0]


def grow(core: Core, chosen: Parameters) -> NDArray[np.int32]:
    """Return regions grown from the flattest points on."""
    region = np.full(len(core.xyz), -1, np.int32)
    seeds = np.flatnonzero(np.isfinite(core.normal[:, 0]))
    seeds = seeds[_flattest_first(core.variance[seeds])]
    n_regions = grow_regions(core.surface, seeds, _tolerance(chosen, 1.0), MIN_FRAGMENT, region)
    number_along(region, n_regions)
    return region


def _flattest_first(variance: NDArray[np.float32]) -> NDArray[np.int64]:
    """Return the order of non-negative numbers (s,) by their power of two, and of those of one by place.

    Seeds of nearly one flatness follow each other along the curve, so what regions look at is in fast memory.
    """
    return np.argsort((variance.view(np.uint32) >> MANTISSA).astype(np.uint8), kind="stable")


def fit(xyz: NDArray[np.float64], region: NDArray[np.int32]) -> Fits:
    """Return the planes of regions numbered from 0."""
    n_regions = int(region.max(initial=-1)) + 1
    origin, sums = np.zeros((n_regions, 3)), np.empty((n_regions, MOMENTS))
    sum_regions(xyz, region, origin, sums)
    return fit_sums(origin, sums)


def fit_sums(origin: NDArray[np.float64], sums: NDArray[np.float64]) -> Fits:
    """Return the planes of moments (m, 10) about origins (m, 3)."""
    planes, spread = np.empty((len(sums), 6)), np.empty((len(sums), 3))
    fit_regions(origin, sums, planes, spread)
    return Fits(planes, spread, origin, sums)


def settle(core: Core, chosen: Parameters, region: NDArray[np.int32], sweeps: int = SWEEPS) -> NDArray[np.int32]:
    """Return the regions after points have moved to the nearest plane around them, a few times over."""
    for _ in range(sweeps):
        before, region = region, _change(core, chosen, region)
        if np.array_equal(region, before):
            break
    return region


def _change(core: Core, chosen: Parameters, region: NDArray[np.int32]) -> NDArray[np.int32]:
    """Return the regions after every point has moved once."""
    planes, out = fit(core.xyz, region).planes, np.empty_like(region)

    def change(begin: int, end: int) -> None:
        change_sides(core.surface, planes, _tolerance(chosen, LOOSE), region, begin, out[begin:end])

    in_parts(len(region), change)
    return out


def drop_unsupported(core: Core, region: NDArray[np.int32]) -> NDArray[np.int32]:
    """Return the regions without those that are mere slices of a volume."""
    n_regions = int(region.max(initial=-1)) + 1
    own, free = np.empty(n_regions, np.int64), np.empty(n_regions, np.int64)
    count_support(core.neighbours, region, own, free)
    number = np.append(np.arange(n_regions, dtype=np.int32), np.int32(-1))
    number[:-1][own < MIN_SUPPORT * (own + free)] = -1
    return number[region]


def merge(fits: Fits, pairs: NDArray[np.int32], max_rms: float) -> NDArray[np.int32]:
    """Return into which region (m,) each is merged when pieces of one plane are united, best fits first."""
    parent = np.arange(len(fits.planes), dtype=np.int32)
    sums = fits.sums.copy()
    while True:
        rms = pair_rms(pairs, parent, fits.origin, sums)
        order = np.lexsort((pairs[:, 1], pairs[:, 0], rms))
        order = order[rms[order] <= max_rms]
        if unite(pairs[order], parent, fits.origin, sums, max_rms) == 0:
            break
    resolve(parent)
    return parent


def walk(
    core: Core, chosen: Parameters, region: NDArray[np.int32], planes: NDArray[np.float64], wants_pairs: bool
) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Return the connected piece (c,) of each point, and the pairs (p, 2) of regions that meet, if they are wanted."""
    members, start = np.empty(len(region), np.int32), np.empty(len(planes) + 1, np.int64)
    list_members(region, start, members)
    piece = np.full(len(region), -1, np.int32)
    among = (region, members, start)
    pairs = walk_regions(core.surface, planes, _tolerance(chosen, LOOSE), *among, piece, wants_pairs)
    return piece, _distinct(pairs)


def _distinct(pairs: NDArray[np.int32]) -> NDArray[np.int32]:
    """Return the distinct ones of pairs (p, 2) of numbers from 0, the smaller number of each first, ascending."""
    low, high = pairs.min(axis=1).astype(np.int64), pairs.max(axis=1).astype(np.int64)
    key = np.unique((low << 32) | high)
    return np.column_stack([key >> 32, key & 0xFFFFFFFF]).astype(np.int32)


def spread_out(points: Points, core: Core, chosen: Parameters, region: NDArray[np.int32]) -> NDArray[np.int32]:
    """Return the region (u,) of every point, those of the core's included."""
    if len(core.place) == len(points.xyz):
        return region
    cell = (np.cumsum(points.first_level <= chosen.level) - 1).astype(np.int32)
    out = np.empty(len(points.xyz), np.int32)
    planes = fit(core.xyz, region).planes
    join_rest(points.xyz, cell, core.neighbours, planes, chosen.max_distance, region, out)
    return out


def _tolerance(chosen: Parameters, factor: float) -> Tolerance:
    """Return what fits a plane, at this multiple of the angle."""
    return Tolerance(float(np.cos(np.radians(min(factor * chosen.max_angle, 90.0)))), chosen.max_distance)
