"""Plane patches of a point cloud by region growing."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from mapq.axes import GroundPlan, turn
from mapq.cloud import PointCloud
from mapq.configuration import SegmentSettings
from mapq.patches import Patches
from mapq.segmentation.join import describe_regions, join_regions, warnings_of
from mapq.segmentation.parameters import Parameters, choose_parameters
from mapq.segmentation.points import Points, sort_points
from mapq.segmentation.regions import Core, find_regions, make_core, spread_out
from prf.shell.cli.console import Report
from prf.shell.errors import InputError

STAGES = ("sorting", "estimating", "neighbours and normals", "growing", "finishing")
FEWEST_POINTS = 3
MANY_POINTS = 10_000


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
    region, core = cut_points(points, chosen, lambda stage: _report(progress, stage))
    _report(progress, 4)
    regions = describe_regions(points, region, points.multiplicity(), chosen)
    found = join_regions([regions], np.zeros((0, 2), np.int64), chosen)
    report = {
        "points": len(cloud),
        "points_not_finite": points.n_not_finite,
        "points_far_outside": points.n_far,
        "points_repeated": len(cloud) - points.n_not_finite - points.n_far - len(points.xyz),
        "points_looked_at": len(core.xyz),
        **found.report,
        "warnings": warnings_of(chosen, points.n_far, found.report),
    }
    patch = np.where(points.number >= 0, found.number[0][region][points.number], -1).astype(np.int32)
    normal, centroid = (turn(each, -quarter) for each in (found.normal, found.centroid))
    return Patches.unlabelled(cloud, patch, normal, centroid, chosen.described(quarter), report)


def cut_points(
    points: Points, chosen: Parameters, report: Callable[[int], None] = lambda _: None
) -> tuple[NDArray[np.int32], Core]:
    """Return the region (u,) of distinct points, -1 for none, and those that were looked at first."""
    report(2)
    core = make_core(points, chosen)
    report(3)
    return spread_out(points, core, chosen, find_regions(core, chosen)), core


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
