"""`PosedScans`: scans that are read one at a time, with the pose of each."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from mapq.cloud import PointCloud

NEAR_AGAIN = 10.0
"""Metres: a drive that is so close to where it was is at that place again ..."""
WAY_BETWEEN = 40.0
"""... if it has driven so far since."""


@dataclass(frozen=True)
class PosedScans:
    """Scans and their poses, in the order in which they were taken.

    Attributes
    ----------
    names : tuple of str
        Of each scan, for messages and reports.
    poses : (k, 4, 4) float64
        ``T_map_scan``: takes the points of a scan to the map, in metres.
    times : (k,) float64 or None
        Seconds, where the files have them.
    load : callable
        Returns the cloud of a scan by its number in the files, in the frame of the scan.
    numbers : (k,) int64
        Those numbers.
    source : str
        Name of the input, for messages.
    poses_from : str
        Name of the file of the poses; "" where scans carry them themselves.
    """

    names: tuple[str, ...]
    poses: NDArray[np.float64]
    times: NDArray[np.float64] | None
    load: Callable[[int], PointCloud]
    numbers: NDArray[np.int64]
    source: str
    poses_from: str = ""

    def __len__(self) -> int:
        """Return the number of scans."""
        return len(self.names)

    @property
    def are_apart(self) -> bool:
        """Whether the scans were taken from several places; where no poses are known all are at the origin."""
        return bool(np.ptp(self.poses[:, :3, 3], axis=0).any())

    def read(self, scan: int) -> PointCloud:
        """Return the cloud of a scan in its own frame."""
        return self.load(int(self.numbers[scan]))

    def every(self, step: int) -> PosedScans:
        """Return scans 0, step, 2 step and so on."""
        times = None if self.times is None else self.times[::step]
        return replace(
            self, names=self.names[::step], poses=self.poses[::step], times=times, numbers=self.numbers[::step]
        )

    def with_poses(self, poses: NDArray[np.float64], source: str) -> PosedScans:
        """Return the same scans with other poses (k, 4, 4), read from `source`."""
        return replace(self, poses=poses, poses_from=source)


def drive_passes(poses: NDArray[np.float64]) -> NDArray[np.int16]:
    """Return the pass (k,) in which each scan was taken, from 0: a new one begins where the drive returns.

    To return is to be within `NEAR_AGAIN` of a place of the same pass after `WAY_BETWEEN` of driving. Sensors that
    stand, or turn on the spot, make one pass.

    Parameters
    ----------
    poses : (k, 4, 4) float64
        In the order of time.
    """
    place = poses[:, :3, 3]
    way = driven(poses)
    passes = np.zeros(len(poses), np.int16)
    pairs = cKDTree(place).query_pairs(NEAR_AGAIN, output_type="ndarray")
    apart = pairs[way[pairs[:, 1]] - way[pairs[:, 0]] > WAY_BETWEEN]
    latest = np.full(len(poses), -1, np.int64)
    np.maximum.at(latest, apart[:, 1], apart[:, 0])
    begin, number = 0, 0
    for scan in range(len(poses)):
        if latest[scan] >= begin:
            begin, number = scan, number + 1
        passes[scan] = number
    return passes


def driven(poses: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the way (k,) in metres to each of the poses (k, 4, 4) from the first, straight from one to the next."""
    steps = np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(steps)])[: len(poses)]
