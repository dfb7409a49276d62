"""From grown regions to patches: pieces of one plane united, points given to the plane they lie nearest to."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.kernels.growing import grow_regions
from mapq.kernels.merging import pair_rms, resolve, unite
from mapq.kernels.planes import MOMENTS
from mapq.kernels.regions import (
    change_sides,
    count_support,
    fit_regions,
    join_rest,
    list_members,
    sum_regions,
    walk_regions,
)
from mapq.segmentation.core import Core, sure_normals
from mapq.segmentation.parameters import Parameters
from mapq.segmentation.points import Points

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


class Grown(NamedTuple):
    """Regions as they grew, before pieces of one plane are united.

    Attributes
    ----------
    core : Core
        With normals where they are sure.
    region : (c,) int32
        -1 for none.
    fits : Fits
    piece : (c,) int32
        Connected pieces of the regions.
    pairs : (p, 2) int32
        Regions that meet.
    """

    core: Core
    region: NDArray[np.int32]
    fits: Fits
    piece: NDArray[np.int32]
    pairs: NDArray[np.int32]


class United(NamedTuple):
    """Connected piece (c,) of each core point, -1 for none; and of which united region (k,) each piece is."""

    piece: NDArray[np.int32]
    region: NDArray[np.int32]


def find_regions(core: Core, chosen: Parameters) -> NDArray[np.int32]:
    """Return the region (c,) of each core point, -1 for none; regions in no particular order."""
    grown = grow_pieces(core, chosen)
    return unite_pieces(grown, chosen, unions(grown, chosen)).piece


def grow_pieces(core: Core, chosen: Parameters) -> Grown:
    """Return regions of points that lie nearest to their planes, none of them united with another yet."""
    region = grow(core, chosen)
    core = core._replace(normal=sure_normals(core))
    region = drop_unsupported(core, settle(core, chosen, region))
    region = settle(core, chosen, region, sweeps=1)
    fits = fit(core.xyz, region)
    return Grown(core, region, fits, *walk(core, chosen, region, fits.planes))


def unions(grown: Grown, chosen: Parameters) -> NDArray[np.int32]:
    """Return into which region (m,) each goes, as far as these points tell."""
    return merge(grown.fits, grown.pairs, MERGE_RMS * chosen.max_distance)


def unite_pieces(
    grown: Grown, chosen: Parameters, parent: NDArray[np.int32], planes: NDArray[np.float64] | None = None
) -> United:
    """Return the connected pieces once regions have gone into others and points have settled anew.

    Parameters
    ----------
    grown : Grown
    chosen : Parameters
    parent : (m,) int32
        Into which region each goes.
    planes : (m, 6) float64, optional
        What is known of the planes of the united regions beyond these points; nan where nothing is.
    """
    if (parent == np.arange(len(parent))).all():
        return United(grown.piece, _regions_of(grown.piece, grown.region))
    region = np.append(parent, np.int32(-1))[grown.region]
    region = settle(grown.core, chosen, region, sweeps=1, planes=planes)
    found = _known_planes(fit(grown.core.xyz, region).planes, planes)
    piece = walk(grown.core, chosen, region, found)[0]
    return United(piece, _regions_of(piece, region))


def _regions_of(piece: NDArray[np.int32], region: NDArray[np.int32]) -> NDArray[np.int32]:
    """Return the region (k,) that each piece is of."""
    found = np.zeros(int(piece.max(initial=-1)) + 1, np.int32)
    held = np.flatnonzero(piece >= 0)
    found[piece[held]] = region[held]
    return found


def _known_planes(fitted: NDArray[np.float64], known: NDArray[np.float64] | None) -> NDArray[np.float64]:
    """Return planes as fitted, but those that are known as they are."""
    if known is None:
        return fitted
    some = known[: len(fitted)]
    return np.where(np.isfinite(some[:, :1]), some, fitted)


def grow(core: Core, chosen: Parameters) -> NDArray[np.int32]:
    """Return regions grown from the flattest points on."""
    region = np.full(len(core.xyz), -1, np.int32)
    seeds = np.flatnonzero(np.isfinite(core.normal[:, 0]))
    seeds = seeds[_flattest_first(core.variance[seeds])]
    cosine = float(np.cos(np.radians(chosen.max_angle)))
    grow_regions(core.xyz, core.neighbours, core.normal, seeds, cosine, chosen.max_distance, MIN_FRAGMENT, region)
    return region


def _flattest_first(variance: NDArray[np.float32]) -> NDArray[np.int64]:
    """Return the order of non-negative numbers (s,), ties by place.

    Bits of positive floats sort as they do: with the place below them in one number, a quick sort is a stable one.
    """
    key = (variance.view(np.uint32).astype(np.uint64) << np.uint64(32)) | np.arange(len(variance), dtype=np.uint64)
    key.sort()
    return (key & np.uint64(0xFFFFFFFF)).astype(np.int64)


def fit(xyz: NDArray[np.float64], region: NDArray[np.int32]) -> Fits:
    """Return the planes of regions numbered from 0."""
    n_regions = int(region.max(initial=-1)) + 1
    origin, sums = np.zeros((n_regions, 3)), np.empty((n_regions, MOMENTS))
    sum_regions(xyz, region, origin, sums)
    planes, spread = np.empty((n_regions, 6)), np.empty((n_regions, 3))
    fit_regions(origin, sums, planes, spread)
    return Fits(planes, spread, origin, sums)


def settle(
    core: Core,
    chosen: Parameters,
    region: NDArray[np.int32],
    sweeps: int = SWEEPS,
    planes: NDArray[np.float64] | None = None,
) -> NDArray[np.int32]:
    """Return the regions after points have gone to the nearest plane around them, a few times over.

    `planes` as for :func:`unite_pieces`.
    """
    for _ in range(sweeps):
        out = np.empty_like(region)
        n_changed = change_sides(
            core.xyz,
            core.neighbours,
            core.normal,
            _known_planes(fit(core.xyz, region).planes, planes),
            _loose_cosine(chosen),
            chosen.max_distance,
            region,
            out,
        )
        region = out
        if n_changed == 0:
            break
    return region


def drop_unsupported(core: Core, region: NDArray[np.int32]) -> NDArray[np.int32]:
    """Return the regions without those that are mere slices of a volume."""
    n_regions = int(region.max(initial=-1)) + 1
    own, free = np.empty(n_regions, np.int64), np.empty(n_regions, np.int64)
    count_support(core.neighbours, region, own, free)
    number = np.append(np.arange(n_regions, dtype=np.int32), np.int32(-1))
    number[:-1][own < MIN_SUPPORT * (own + free)] = -1
    return number[region]


def merge(fits: Fits, pairs: NDArray[np.int32], max_rms: float) -> NDArray[np.int32]:
    """Return into which region (m,) each goes when pieces of one plane are united, best fits first."""
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
    core: Core, chosen: Parameters, region: NDArray[np.int32], planes: NDArray[np.float64]
) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Return the connected piece (c,) of each point, and the pairs (p, 2) of regions that meet, each pair once."""
    members, start = np.empty(len(region), np.int32), np.empty(len(planes) + 1, np.int64)
    list_members(region, start, members)
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
            members,
            start,
            piece,
            pairs,
        )
        if n_pairs <= capacity:
            return piece, np.unique(np.sort(pairs[:n_pairs], axis=1), axis=0)
        capacity = n_pairs


def spread_out(points: Points, core: Core, chosen: Parameters, region: NDArray[np.int32]) -> NDArray[np.int32]:
    """Return the region (u,) of every point, those of the core's included."""
    if len(core.place) == len(points.xyz):
        return region
    cell = (np.cumsum(points.first_level <= chosen.level) - 1).astype(np.int32)
    out = np.empty(len(points.xyz), np.int32)
    planes = fit(core.xyz, region).planes
    join_rest(points.xyz, cell, core.neighbours, planes, chosen.max_distance, region, out)
    return out


def _loose_cosine(chosen: Parameters) -> float:
    return float(np.cos(np.radians(min(LOOSE * chosen.max_angle, 90.0))))
