"""All points of all scans in arrays, in the frame of their scan, with what is known of each scan."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.cloud import PointCloud
from mapq.io.fields import common_fields
from mapq.perturb.cells import cell_keys
from mapq.posed import PosedScans
from prf.shell.errors import InputError

Floats = NDArray[np.float64]

AT_THE_SENSOR = 0.01
"""Metres: a return so close is none; many sensors write (0, 0, 0) for "no return"."""


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
    scans: PosedScans,
    voxel: float | None = None,
    reach: tuple[float, float] = (AT_THE_SENSOR, np.inf),
    progress: Callable[[int], None] = lambda done: None,
) -> Merged:
    """Read all scans: returns between two ranges, of which the first in each cube of side `voxel` is kept (metres)."""
    parts: list[PointCloud] = []
    counts = []
    for scan in range(len(scans)):
        cloud = scans.read(scan)
        counts.append(len(cloud))
        parts.append(_kept(cloud, voxel, reach))
        progress(scan + 1)
    if not any(len(part) for part in parts):
        raise InputError(
            f"{scans.source}: no point is left of {sum(counts)}. Check perturb.min_range and perturb.max_range."
        )
    of_scan = np.repeat(np.arange(len(parts), dtype=np.int32), [len(part) for part in parts])
    xyz = np.concatenate([part.metric_of(part.xyz) for part in parts])
    fields = common_fields([part.fields for part in parts], scans.source)
    return Merged(xyz, of_scan, fields, np.array(counts, np.int64))


def _kept(cloud: PointCloud, voxel: float | None, reach: tuple[float, float]) -> PointCloud:
    """Return the points of a scan that count."""
    distance = np.linalg.norm(cloud.metric_of(cloud.xyz), axis=1)
    with np.errstate(invalid="ignore"):
        cloud = cloud.take(cloud.finite() & (distance > reach[0]) & (distance <= reach[1]))
    if voxel is None or len(cloud) == 0:
        return cloud
    _, first = np.unique(cell_keys(cloud.xyz, voxel, cloud.source), return_index=True)
    return cloud.take(np.sort(first))
