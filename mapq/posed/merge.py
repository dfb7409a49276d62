"""Posed scans to one map: their points where their poses put them, with what is known of scan, time and sensor."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.axes import TO_SENSOR
from mapq.cloud import SHIFT_ABOVE, PointCloud
from mapq.configuration import MergeSettings
from mapq.io.fields import SCAN, TIME, common_fields, original_names, to_sensor_fields
from mapq.posed.check import warn_of_poses
from mapq.posed.scans import PosedScans, drive_passes
from prf.shell.errors import InputError

logger = logging.getLogger(__name__)

Floats = NDArray[np.float64]

AT_THE_SENSOR = 0.01
"""Metres: closer returns are not returns; many sensors write (0, 0, 0) for "no return"."""
SHELL, FEWEST, LEAST_SHARE, DENSER = 0.01, 20, 0.002, 20
"""Beams without a return, for which sensors write one number, lie in a shell so many metres thick at the largest range
of a scan: they are more than so many, a larger share of the scan, and so many times what lies in the metre before.
"""
FINEST, COARSEST = 0.05, 100.0
"""Metres: side of the cubes by which too many points are thinned first; it is doubled until they are few enough."""
PASS = "pass_id"
"""Field that numbers the passes of the drive."""
BITS = 21
"""Of the number of a cell along each axis."""


class Merged(NamedTuple):
    """The points (n, 3) of all scans, each in the frame of its scan (n,), with the fields that every scan has.

    `counts` (k,) are the points read of each scan.
    """

    xyz: Floats
    scan: NDArray[np.int32]
    fields: dict[str, NDArray[Any]]
    counts: NDArray[np.int64]

    def placed(self, poses: Floats) -> Floats:
        """Return the points (n, 3) where poses (k, 4, 4) put them."""
        world = np.empty_like(self.xyz)
        starts = np.searchsorted(self.scan, np.arange(len(poses) + 1))
        for scan, pose in enumerate(poses):
            rows = slice(int(starts[scan]), int(starts[scan + 1]))
            world[rows] = self.xyz[rows] @ pose[:3, :3].T + pose[:3, 3]
        return world


def merge(
    scans: PosedScans, settings: MergeSettings | None = None, progress: Callable[[int], None] = lambda done: None
) -> Merged:
    """Read all scans, thinned while they are read: what is held never outgrows the map by more than a scan."""
    settings = settings or MergeSettings()
    parts: list[PointCloud] = []
    counts, voxel = [], settings.voxel
    empty: list[float] = []  # ranges of beams without a return
    for scan in range(len(scans)):
        cloud = scans.read(scan)
        counts.append(len(cloud))
        cloud, ranges = _in_reach(cloud, range_of(settings))
        empty.extend(ranges)
        parts.append(thinned(cloud, voxel))
        while settings.voxel is None and (voxel or 0.0) < COARSEST and sum(map(len, parts)) > settings.max_points:
            # The first point of a cube is the first of one of its eighths, so that steps leave what one step would.
            voxel = FINEST if voxel is None else 2.0 * voxel
            parts = [thinned(part, voxel) for part in parts]
        progress(scan + 1)
    if not any(len(part) for part in parts):
        raise InputError(
            f"{scans.source}: no point is left of {sum(counts)}. Check scans.min_range and scans.max_range."
        )
    if empty:
        words = "%s: %d points at %.2f m, the largest range, are beams without a return and left out"
        logger.warning(words, scans.source, len(empty), max(empty))
    if voxel != settings.voxel:
        words = "%s: %d points are too many for memory: one of each scan in %g m is kept; --every K takes fewer scans"
        logger.info(words, scans.source, sum(counts), voxel)
    of_scan = np.repeat(np.arange(len(parts), dtype=np.int32), [len(part) for part in parts])
    xyz = np.concatenate([part.metric_of(part.xyz) for part in parts])
    fields = common_fields([part.fields for part in parts], scans.source)
    return Merged(xyz, of_scan, fields, np.array(counts, np.int64))


def merge_scans(
    scans: PosedScans, settings: MergeSettings | None = None, progress: Callable[[int], None] = lambda done: None
) -> PointCloud:
    """Return the map of scans where their poses put them, with fields `scan`, `time`, `pass_id` and `to_sensor_x/y/z`.

    Warns where poses and points hardly belong together.
    """
    settings = settings or MergeSettings()
    merged = merge(scans, settings, progress)
    words = "%s: %d scans at the poses of %s: %s points"
    logger.info(words, scans.source, len(scans), scans.poses_from or "these files", f"{len(merged.xyz):,}")
    warn_of_poses(scans, merged.xyz, merged.scan, settings.submaps)
    return map_of(merged, scans.poses, scans, settings)


def map_of(
    merged: Merged,
    poses: Floats,
    scans: PosedScans,
    settings: MergeSettings,
    labels: Mapping[str, NDArray[Any]] | None = None,
) -> PointCloud:
    """Return merged points where poses (k, 4, 4) put them; fields of the scans with names that are needed are renamed.

    `labels`: further fields (n,) of the map.
    """
    world = merged.placed(poses)
    added: dict[str, NDArray[Any]] = {SCAN: merged.scan, **(labels or {})}
    if scans.times is not None:
        added[TIME] = scans.times[merged.scan]
    if not settings.submaps:
        added[PASS] = drive_passes(scans.poses)[merged.scan]
        added |= to_sensor_fields(world, poses[merged.scan, :3, 3])
    narrow = np.abs(world).max() < SHIFT_ABOVE
    fields = original_names(merged.fields, {*added, PASS, *TO_SENSOR}) | added
    return PointCloud.from_world(world.astype(np.float32) if narrow else world, fields, scans.source)


def thinned(cloud: PointCloud, voxel: float | None) -> PointCloud:
    """Return the first point of a scan in each cube of side `voxel` metres, in their order; None: all."""
    if voxel is None or len(cloud) == 0:
        return cloud
    _, first = np.unique(cell_keys(cloud.xyz, voxel, cloud.source), return_index=True)
    return cloud.take(np.sort(first))


def range_of(settings: MergeSettings) -> tuple[float, float]:
    """Return the least and largest range of a return that counts, in metres."""
    return settings.min_range or (0.0 if settings.submaps else AT_THE_SENSOR), settings.max_range or np.inf


def _in_reach(cloud: PointCloud, reach: tuple[float, float]) -> tuple[PointCloud, Floats]:
    """Return the points of a scan between two ranges, and the ranges (b,) of its beams without a return, left out."""
    distance = np.linalg.norm(cloud.metric_of(cloud.xyz), axis=1)
    with np.errstate(invalid="ignore"):
        is_kept = cloud.finite() & (distance > reach[0]) & (distance <= reach[1])
    farthest = distance[is_kept].max(initial=0.0)
    is_shell = is_kept & (distance > farthest - SHELL)
    n = int(np.count_nonzero(is_shell))
    before = int(np.count_nonzero(is_kept & (distance > farthest - 1.0))) - n
    if n <= max(FEWEST, LEAST_SHARE * len(cloud), DENSER * before):
        is_shell[:] = False
    return cloud.take(is_kept & ~is_shell), distance[is_shell]


def cell_keys(xyz: Floats, side: float, source: str = "the map") -> NDArray[np.int64]:
    """Return a number (n,) for the cube of this side in which each point (n, 3) lies; equal for points of one cube."""
    if len(xyz) == 0:
        return np.zeros(0, np.int64)
    index = np.floor(xyz / side).astype(np.int64)
    index -= index.min(axis=0)
    if index.max() >= 1 << BITS:
        raise InputError(f"{source}: {np.ptp(xyz, axis=0).max():.3g} m wide, too much for cells of {side:g} m.")
    return np.asarray((index[:, 0] << 2 * BITS) | (index[:, 1] << BITS) | index[:, 2])
