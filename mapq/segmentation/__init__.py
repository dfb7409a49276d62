"""Plane patches of a point cloud by region growing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from mapq.axes import GroundPlan, turn
from mapq.cloud import PointCloud
from mapq.patches import Patches
from mapq.segmentation.core import make_core
from mapq.segmentation.finish import keep_patches
from mapq.segmentation.parameters import choose_parameters
from mapq.segmentation.points import Points, sort_points
from mapq.segmentation.regions import find_regions, spread_out
from mapq.segmentation.score import SegmentationScore as SegmentationScore
from mapq.segmentation.score import score_segmentation as score_segmentation
from mapq.segmentation.score import truth_of as truth_of
from mapq.segmentation.settings import SegmentSettings as SegmentSettings
from mapq.segmentation.warnings import warnings_of
from prf.shell.errors import InputError
from prf.shell.progress import Reporter

STAGES = ("sorting", "estimating", "neighbours and normals", "growing", "finishing")
FEWEST_POINTS = 3
MANY_POINTS = 10_000


def segment(
    cloud: PointCloud,
    settings: SegmentSettings | None = None,
    progress: Reporter | None = None,
) -> Patches:
    """Cut a cloud into plane patches.

    The same patches with the same numbers come out for any order of the points, and turned by quarters about z.

    Parameters
    ----------
    cloud : PointCloud
        Points without three finite coordinates belong to no patch.
    settings : SegmentSettings, optional
        What is None is estimated from the cloud; all values used are in the result's `parameters`.
    progress : Reporter, optional
        Told the number of stages done and the name of the next (:data:`STAGES`).

    Returns
    -------
    Patches
        Largest first, unlabelled. There may be none: then the report has a warning.

    Raises
    ------
    InputError
        If fewer than three distinct points are finite, or all lie on one line.
    UsageError
        If a setting is outside its domain.
    """
    settings = settings or SegmentSettings()
    settings.check()
    _tell(progress, 0)
    quarter = GroundPlan.of(cloud.xyz).quarter()
    points = sort_points(replace(cloud, xyz=turn(cloud.xyz, quarter)))
    _refuse_lines(points, cloud)
    _tell(progress, 1)
    chosen = choose_parameters(points, settings.turned(quarter))
    _tell(progress, 2)
    core = make_core(points, chosen)
    _tell(progress, 3)
    region = find_regions(core, chosen)
    _tell(progress, 4)
    kept = keep_patches(points, spread_out(points, core, chosen, region), chosen)
    report = {
        "points": len(cloud),
        "points_not_finite": points.n_not_finite,
        "points_far_outside": points.n_far,
        "points_repeated": len(cloud) - points.n_not_finite - points.n_far - len(points.xyz),
        "points_looked_at": len(core.xyz),
        **kept.report,
        "warnings": warnings_of(chosen, points.n_far, kept.report),
    }
    patch = np.where(points.number >= 0, kept.patch[points.number], -1).astype(np.int32)
    normal, centroid = (turn(each.copy(), -quarter) for each in (kept.planes[:, :3], kept.planes[:, 3:]))
    return Patches.unlabelled(cloud, patch, normal, centroid, chosen.described(quarter), report)


def _tell(progress: Reporter | None, done: int) -> None:
    if progress is not None:
        progress.update(done, stage=STAGES[done])


def _refuse_lines(points: Points, cloud: PointCloud) -> None:
    """Raise if there is no plane to be had."""
    name = cloud.source or "the cloud"
    if len(points.xyz) < FEWEST_POINTS:
        raise InputError(
            f"{name}: {len(points.xyz)} distinct finite points of {len(cloud)}; a plane needs {FEWEST_POINTS}."
        )
    if _on_one_line(points.xyz):
        raise InputError(f"{name}: all {len(points.xyz)} points lie on one line; there is no plane in it.")


def _on_one_line(xyz: NDArray[np.float64]) -> bool:
    """Return whether all points lie on one line, as far as their numbers can tell; a few usually show that not."""
    if len(xyz) > MANY_POINTS and not _on_one_line(xyz[:: len(xyz) // MANY_POINTS + 1]):
        return False
    offset = xyz - xyz.mean(axis=0)
    spread = np.linalg.eigvalsh(offset.T @ offset / len(xyz))
    return bool(spread[1] <= 1e-12 * spread[2])
