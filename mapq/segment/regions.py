"""From grown regions to patches: pieces of one plane united, points given to the plane they lie nearest to."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.kernels.growing import grow_regions
from mapq.kernels.merging import pair_rms, resolve, unite
from mapq.kernels.planes import MOMENTS
from mapq.kernels.regions import change_sides, fit_regions, join_rest, sum_regions, walk_regions
from mapq.segment.core import Core
from mapq.segment.parameters import Parameters
from mapq.segment.points import Points

MIN_FRAGMENT = 12
"""Members of a region worth keeping until it is united with others."""
MERGE_RMS = 0.6
"""Times the distance limit: the root mean square of points spread evenly up to it is 0.58."""
LOOSE = 2.0
"""Times the angle limit, for points that a region reaches once it is whole: their normals may be mixed."""
SWEEPS = 3
ROUNDS = 4


class Fits(NamedTuple):
    """Planes (m, 6) of regions as normal and centroid, their variances (m, 3), and moments (m, 10) about origins."""

    planes: NDArray[np.float64]
    spread: NDArray[np.float64]
    origin: NDArray[np.float64]
    sums: NDArray[np.float64]


def find_regions(core: Core, chosen: Parameters) -> NDArray[np.int32]:
    """Return the region (c,) of each core point, -1 for none; regions in no particular order."""
    region = grow(core, chosen)
    for _ in range(ROUNDS):
        region = settle(core, chosen, region)
        region, n_united = merge(core, chosen, region)
        if n_united == 0:
            break
    return split(core, chosen, settle(core, chosen, region))


def grow(core: Core, chosen: Parameters) -> NDArray[np.int32]:
    """Return regions grown from the flattest points on."""
    region = np.full(len(core.xyz), -1, np.int32)
    usable = np.isfinite(core.normal[:, 0])
    seeds = np.flatnonzero(usable)
    seeds = seeds[np.argsort(core.variance[seeds], kind="stable")]
    cosine = float(np.cos(np.radians(chosen.max_angle)))
    grow_regions(
        core.xyz, core.neighbours, core.normal, usable, seeds, cosine, chosen.max_distance, MIN_FRAGMENT, region
    )
    return region


def fit(xyz: NDArray[np.float64], region: NDArray[np.int32]) -> Fits:
    """Return the planes of regions numbered from 0."""
    n_regions = int(region.max(initial=-1)) + 1
    origin, sums = np.zeros((n_regions, 3)), np.empty((n_regions, MOMENTS))
    sum_regions(xyz, region, origin, sums)
    planes, spread = np.empty((n_regions, 6)), np.empty((n_regions, 3))
    fit_regions(origin, sums, planes, spread)
    return Fits(planes, spread, origin, sums)


def settle(core: Core, chosen: Parameters, region: NDArray[np.int32]) -> NDArray[np.int32]:
    """Return the regions after points have gone to the nearest plane around them, a few times over."""
    for _ in range(SWEEPS):
        out = np.empty_like(region)
        planes = fit(core.xyz, region).planes
        n_changed = change_sides(
            core.xyz,
            core.neighbours,
            core.normal,
            planes,
            _loose_cosine(chosen),
            chosen.max_distance,
            region,
            out,
        )
        region = out
        if n_changed == 0:
            break
    return region


def merge(core: Core, chosen: Parameters, region: NDArray[np.int32]) -> tuple[NDArray[np.int32], int]:
    """Return the regions with pieces of one plane united, best fits first, and how many were."""
    fits = fit(core.xyz, region)
    _, pairs = walk(core, chosen, region, fits.planes)
    parent = np.arange(len(fits.planes), dtype=np.int32)
    limit = MERGE_RMS * chosen.max_distance
    n_united = 0
    while True:
        rms = pair_rms(pairs, parent, fits.origin, fits.sums)
        order = np.lexsort((pairs[:, 1], pairs[:, 0], rms))
        order = order[rms[order] <= limit]
        n_new = unite(pairs[order], parent, fits.origin, fits.sums, limit)
        n_united += n_new
        if n_new == 0:
            break
    resolve(parent)
    return np.where(region >= 0, parent[region], -1).astype(np.int32), n_united


def walk(
    core: Core, chosen: Parameters, region: NDArray[np.int32], planes: NDArray[np.float64]
) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Return the connected piece (c,) of each point, and the pairs (p, 2) of regions that meet, each pair once."""
    order = np.argsort(region, kind="stable")
    start = np.searchsorted(region[order], np.arange(len(planes) + 1))
    capacity = 16 * len(planes) + 1024
    while True:
        piece = np.full(len(region), -1, np.int32)
        pairs = np.empty((capacity, 2), np.int32)
        _, n_pairs = walk_regions(
            core.xyz,
            core.neighbours,
            core.normal,
            planes,
            _loose_cosine(chosen),
            chosen.max_distance,
            region,
            order,
            start,
            piece,
            pairs,
        )
        if n_pairs <= capacity:
            return piece, np.unique(np.sort(pairs[:n_pairs], axis=1), axis=0)
        capacity = n_pairs


def split(core: Core, chosen: Parameters, region: NDArray[np.int32]) -> NDArray[np.int32]:
    """Return the regions with their unconnected pieces apart."""
    piece, _ = walk(core, chosen, region, fit(core.xyz, region).planes)
    return piece


def spread_out(points: Points, core: Core, chosen: Parameters, region: NDArray[np.int32]) -> NDArray[np.int32]:
    """Return the region (u,) of every point, those of the core's included."""
    if len(core.index) == len(points.xyz):
        return region
    is_core = np.zeros(len(points.xyz), bool)
    is_core[core.index] = True
    cell = (np.cumsum(is_core) - 1).astype(np.int32)
    out = np.empty(len(points.xyz), np.int32)
    planes = fit(core.xyz, region).planes
    join_rest(points.xyz, cell, core.neighbours, planes, chosen.max_distance, region, out)
    return out


def _loose_cosine(chosen: Parameters) -> float:
    return float(np.cos(np.radians(min(LOOSE * chosen.max_angle, 90.0))))
