"""Plane patches of a point cloud by region growing.

Regions grow in the points of a tile; those of all tiles are united, what is too small or too tilted is dropped, and the
rest numbered. A map in memory is one tile.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.axes import GroundPlan, turn
from mapq.cloud import PointCloud
from mapq.configuration import SURFACES, SegmentSettings
from mapq.kernels.planes import MOMENTS
from mapq.kernels.regions import PLANE_BITS, number_plane_cells, sum_regions
from mapq.patches import FEW_FLAT, Patches, surface_kinds
from mapq.segmentation.curved import BEND, MSE, PLACE, find_cylinders, spread_cylinders
from mapq.segmentation.parameters import FARTHEST_APART, Parameters, choose_parameters
from mapq.segmentation.points import Points, sort_points
from mapq.segmentation.regions import MERGE_RMS, Core, Fits, find_regions, fit_sums, make_core, merge, spread_out
from prf.shell.cli.console import Report
from prf.shell.errors import InputError

STAGES = ("sorting", "estimating", "neighbours and normals", "growing", "finishing")
FEWEST_POINTS = 3
MANY_POINTS = 10_000
WIDTH_IN_THICKNESS = 4.0
"""Standard deviations along the short side by those across: less is a slab of points, not a surface."""
CELL_IN_SPACING = 2.0
"""Side of the cells by which areas are counted: a cell on a surface holds four points, so few stay empty."""
MANY_NARROW, MANY_REPEATED = 0.05, 0.2
"""Shares of the points of which there is a warning."""

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


def segment(
    cloud: PointCloud,
    settings: SegmentSettings | None = None,
    progress: Report | None = None,
) -> Patches:
    """Cut a cloud into plane patches.

    The same patches with the same numbers result for any order of the points, and turned by quarters about z.

    `cloud`: points without three finite coordinates belong to no patch. `settings`: what is None is estimated from the
    cloud; all values used are in the result's `parameters`. `progress`: receives the number of stages done and the name
    of the next (:data:`STAGES`). Raises InputError if fewer than three distinct points are finite, or all lie on one
    line; UsageError if a setting is outside its domain.

    Largest first, unlabelled. There may be none: then the report has a warning.
    """
    settings = settings or SegmentSettings()
    _report(progress, 0)
    quarter = GroundPlan.of(cloud.xyz).quarter()
    points = sort_points(replace(cloud, xyz=turn(cloud.xyz, quarter)))
    _refuse_lines(points, cloud)
    _report(progress, 1)
    chosen = choose_parameters(points, settings, quarter)
    region, curved, core = cut_points(points, chosen, lambda stage: _report(progress, stage))
    _report(progress, 4)
    regions = describe_regions(points, region, points.multiplicity(), curved, chosen)
    found = join_regions([regions], np.zeros((0, 2), np.int64), chosen)
    report = {
        "points": len(cloud),
        "points_not_finite": points.n_not_finite,
        "points_far_outside": points.n_far,
        "points_repeated": len(cloud) - points.n_not_finite - points.n_far - len(points.xyz),
        "points_looked_at": len(core.xyz),
        **found.report,
    }
    report["warnings"] = warnings_of(chosen, report)
    patch = np.where(points.number >= 0, found.number[0][region][points.number], -1).astype(np.int32)
    normal, centroid, bend = (turn(each, -quarter) for each in (found.normal, found.centroid, found.bend))
    return Patches.unlabelled(cloud, patch, normal, centroid, chosen.described(quarter), report, bend)


def cut_points(
    points: Points, chosen: Parameters, report: Callable[[int], None] = lambda _: None
) -> tuple[NDArray[np.int32], Floats, Core]:
    """Return the region (u,) of distinct points, -1 for none, how regions curve, and what was looked at first.

    How they curve is (r, 10), as :func:`spread_cylinders` returns it.
    """
    report(2)
    core = make_core(points, chosen)
    report(3)
    region = find_regions(core, chosen)
    if "curved" not in chosen.surfaces:
        return spread_out(points, core, chosen, region), np.zeros((int(region.max(initial=-1)) + 1, 10)), core
    of, cylinders = find_cylinders(core, chosen, region)
    flat = np.where(of > region.max(initial=-1), np.int32(-1), of)
    return (*spread_cylinders(points, chosen, of, spread_out(points, core, chosen, flat), cylinders), core)


def _report(progress: Report | None, done: int) -> None:
    if progress is not None:
        progress(done, stage=STAGES[done])


def _refuse_lines(points: Points, cloud: PointCloud) -> None:
    """Raise if the points cannot hold a plane."""
    name = cloud.source or "the cloud"
    if len(points.xyz) < FEWEST_POINTS:
        raise InputError(
            f"{name}: {len(points.xyz)} distinct finite points of {len(cloud)}; a plane needs {FEWEST_POINTS}."
        )
    if _on_one_line(points.xyz):
        raise InputError(f"{name}: all {len(points.xyz)} points lie on one line, so there are no planes.")


def _on_one_line(xyz: NDArray[np.float64]) -> bool:
    """Return whether all points lie on one line, within rounding; a few usually show that they do not."""
    if len(xyz) > MANY_POINTS and not _on_one_line(xyz[:: len(xyz) // MANY_POINTS + 1]):
        return False
    offset = xyz - xyz.mean(axis=0)
    spread = np.linalg.eigvalsh(offset.T @ offset / len(xyz))
    return bool(spread[1] <= 1e-12 * spread[2])


class Regions(NamedTuple):
    """The regions (r) of a tile, by the points that belong to it."""

    origin: Floats  # (r, 3) moments of the distinct points about an origin
    sums: Floats  # (r, 10)
    n_points: Ints  # (r,) repeated points included
    first: NDArray[np.uint64]  # (r,) smallest Morton code of the points
    area: Floats  # (r,) m²
    curved: Floats  # (r, 10) surfaces of curved ones, 0 for planes (:func:`mapq.segmentation.curved.spread_cylinders`)


class Joined(NamedTuple):
    """The patches (m) of a map, largest first (ties: by their first point)."""

    # (r + 1,) by tile, the patch of each of its regions, -1 for none; the last one is that of points
    # without a region
    number: list[NDArray[np.int32]]
    normal: Floats  # (m, 3)
    centroid: Floats  # (m, 3)
    bend: Floats  # (m, 3) as :class:`mapq.patches.Patches` has it
    mse: Floats  # (m,) mean squared distance from the plane, m²
    n_points: Ints  # (m,)
    report: dict[str, Any]  # the report's part on patches and on what was dropped


def describe_regions(
    points: Points, region: NDArray[np.int32], copies: Ints, curved: Floats, chosen: Parameters
) -> Regions:
    """Return the moments, counts and areas of regions, whose surfaces `curved` (r, 10) has.

    `region` (u,): of each distinct point. `copies` (u,): points of the tile at each distinct place; places with none
    count for other tiles.
    """
    n_regions = len(curved)
    own = region if copies.all() else np.where(copies > 0, region, np.int32(-1))
    origin, sums = np.zeros((n_regions, 3)), np.empty((n_regions, MOMENTS))
    sum_regions(points.xyz, own, origin, sums)
    members = np.flatnonzero(own >= 0)
    n_points = np.bincount(own[members], weights=copies[members], minlength=n_regions).astype(np.int64)
    first = np.full(n_regions, np.iinfo(np.uint64).max, np.uint64)
    first[own[members[::-1]]] = points.code[members[::-1]]
    planes = fit_sums(origin, sums).planes
    area = region_areas(points.xyz, own, planes, CELL_IN_SPACING * chosen.spacing)
    return Regions(origin, sums, n_points, first, area, curved)


def join_regions(tiles: Sequence[Regions], pairs: Ints, chosen: Parameters) -> Joined:
    """Return the patches of all tiles.

    `pairs` (k, 2): regions, numbered over all tiles, that share points across a border: they are united where one plane
    fits both. Curved ones are one surface, that of the first.
    """
    origin, sums, n_points, first, area, curved = (np.concatenate(values) for values in zip(*tiles, strict=True))
    is_curved = np.asarray(curved[:, BEND].any(axis=1))
    flat = np.ascontiguousarray(pairs[~is_curved[pairs].any(axis=1)], np.int32)
    parent = merge(fit_sums(origin, sums), flat, MERGE_RMS * chosen.max_distance)
    for one, other in pairs[is_curved[pairs].all(axis=1)]:
        parent[parent == max(parent[one], parent[other])] = min(parent[one], parent[other])
    roots, group = np.unique(parent, return_inverse=True)
    n_groups = len(roots)
    fits, curved, is_curved = add_up(roots.astype(np.int64), group, origin, sums), curved[roots], is_curved[roots]
    fits.planes[is_curved], fits.spread[is_curved, 0] = curved[is_curved, PLACE], curved[is_curved, MSE]
    n_points = np.bincount(group, n_points, n_groups).astype(np.int64)
    area = np.bincount(group, area, n_groups).astype(np.float64)
    earliest = np.full(n_groups, np.iinfo(np.uint64).max, np.uint64)
    np.minimum.at(earliest, group, first)
    large, kind = is_large(fits, chosen, is_curved), surface_kinds(fits.planes[:, :3], chosen.up, curved[:, BEND])
    kept = np.flatnonzero(large & np.isin(kind, [SURFACES.index(name) for name in chosen.surfaces]))
    order = kept[np.lexsort((earliest[kept], -n_points[kept]))]
    number = np.full(n_groups, -1, np.int32)
    number[order] = np.arange(len(order))
    ends = np.cumsum([len(tile.origin) for tile in tiles])[:-1]
    return Joined(
        [np.append(each, np.int32(-1)) for each in np.split(number[group], ends)],
        fits.planes[order, :3].copy(),
        fits.planes[order, 3:].copy(),
        curved[order, BEND].copy(),
        np.maximum(fits.spread[order, 0], 0.0),
        n_points[order],
        report_of(large, kind, chosen, n_points, area),
    )


def add_up(roots: Ints, group: Ints, origin: Floats, sums: Floats) -> Fits:
    """Return the planes of groups of regions: the moments (r, 10) of each added about the origin of its root (g,)."""
    to = np.ascontiguousarray(origin[roots])
    moved = translate(sums, origin - to[group])
    total = np.column_stack([np.bincount(group, column, len(roots)) for column in moved.T]).astype(np.float64)
    return fit_sums(to, total)


def translate(sums: Floats, by: Floats) -> Floats:
    """Return moments (m, 10) about origins that lie `by` (m, 3) farther back."""
    n, linear = sums[:, :1], sums[:, 1:4]
    out = np.empty_like(sums)
    out[:, :1], out[:, 1:4] = n, linear + n * by
    for place, (a, b) in enumerate(((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)), 4):
        mixed = by[:, a] * linear[:, b] + by[:, b] * linear[:, a]
        out[:, place] = sums[:, place] + mixed + sums[:, 0] * by[:, a] * by[:, b]
    return out


def report_of(
    large: NDArray[np.bool_], kind: NDArray[np.uint8], chosen: Parameters, n_points: Ints, areas: Floats
) -> dict[str, Any]:
    """Return the report's part on regions (m): which are patches, and what was dropped.

    Of curved surfaces that were not looked for nothing is known.
    """
    kept = large & np.isin(kind, [SURFACES.index(name) for name in chosen.surfaces])
    others = [name for name in SURFACES if name not in (*chosen.surfaces, "curved")]
    return {
        "patches": int(np.count_nonzero(kept)),
        "points_in_patches": int(n_points[kept].sum()),
        "not_judged": {name: _tally(large & (kind == SURFACES.index(name)), n_points, areas) for name in others},
        "dropped_as_small": _tally(~large & (n_points > 0), n_points, areas),
    }


def is_large(fits: Fits, chosen: Parameters, is_curved: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return which regions (m,) have points and width enough, and are not slabs; curved ones have."""
    thickness, side = np.sqrt(np.nan_to_num(fits.spread[:, 0])), np.sqrt(np.nan_to_num(fits.spread[:, 1]))
    wide = (np.sqrt(12.0) * side >= chosen.min_extent) & (side >= WIDTH_IN_THICKNESS * thickness)
    return np.asarray((wide | is_curved) & (fits.sums[:, 0] >= max(chosen.min_points, 3)))


def region_areas(xyz: Floats, region: NDArray[np.int32], planes: Floats, cell: float) -> Floats:
    """Return the area (m,) of each region in square metres: cells of its plane that hold a point."""
    key = np.empty(len(xyz), np.int64)
    number_plane_cells(xyz, region, planes, cell, key)
    cells = np.sort(key[key >= 0])
    new = np.ones(len(cells), bool)
    new[1:] = cells[1:] != cells[:-1]
    n_cells = np.bincount(cells[new] >> PLANE_BITS, minlength=len(planes))
    return np.asarray(n_cells * (cell * cell), np.float64)


def warnings_of(chosen: Parameters, found: dict[str, Any]) -> list[str]:
    """Return a sentence for each reason why patches of a cloud are few or doubtful, of the report on it."""
    warnings = []
    other = {name: each["patches"] for name, each in found["not_judged"].items() if each["patches"]}
    small = found["dropped_as_small"]["patches"]
    if found["patches"] == 0 and other:
        names = ",".join(other)
        warnings.append(
            f"no patches: all {sum(other.values())} planes found are {names}. Judge them by --surfaces {names}."
        )
    elif found["patches"] == 0 and small:
        warnings.append(
            f"no patches: all {small} regions found are too small. Lower segment.min_points or segment.min_extent."
        )
    elif found["patches"] == 0:
        warnings.append("no patches: no part of this cloud is a plane at its spacing and noise.")
    if chosen.spacing > FARTHEST_APART:
        warnings.append(f"points are {chosen.spacing:.3g} m apart. If they are in another unit: --unit mm, cm or ft.")
    if chosen.narrow_share > MANY_NARROW:
        warnings.append(
            f"{chosen.narrow_share:.0%} of the points have neighbours along one scan line only, or within the noise, "
            "and show no plane. A larger segment.resolution, or more segment.neighbours, may."
        )
    if chosen.flat_share < FEW_FLAT:
        warnings.append(
            f"only {chosen.flat_share:.0%} of the neighbourhoods show a plane at the best scale, as in vegetation, or "
            "in a map smeared as a whole: what its patches say is little. Set segment.noise and segment.resolution "
            "if you know them."
        )
    if found["points_repeated"] > MANY_REPEATED * found["points"]:
        warnings.append(
            f"{found['points_repeated']} of {found['points']} points repeat the coordinates of others, as where a scan "
            "is in a file twice; patches are cut from one point at each place."
        )
    if found["points_far_outside"]:
        warnings.append(f"{found['points_far_outside']} points lie very far from all others and were left out.")
    return warnings


def _tally(which: NDArray[np.bool_], n_points: Ints, areas: Floats) -> dict[str, int | float]:
    return {
        "patches": int(np.count_nonzero(which)),
        "points": int(n_points[which].sum()),
        "area": float(areas[which].sum()),
    }
