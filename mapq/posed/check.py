"""What looks wrong with scans and their poses: in one line, with what to do about it."""

from __future__ import annotations

import logging

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from mapq.posed.scans import PosedScans

logger = logging.getLogger(__name__)

STANDING = 1e-6
"""Poses that differ by less, in metres and in entries of the rotation, are one."""
UPRIGHT = 0.5
"""Upward component of the z axis of a sensor below which it lies on its side."""
FARTHEST = 500.0
"""Metres: no laser on the ground sees half of its points so far off."""
FOLLOWS = 0.5
"""Of the distance of points from the origin: closer to their poses, they are in the frame of the map already."""
LOOKED_AT = 200_000
"""Points of all scans by which these are judged, about."""


def warn_of_poses(scans: PosedScans, xyz: NDArray[np.float64], scan: NDArray[np.int32], submaps: bool = False) -> None:
    """Warn, of the worst alone, where poses do not fit the points (n, 3) in the frames of their scans (n,).

    Of sub-maps only where these are too far from each other to meet.
    """
    some = slice(None, None, max(1, len(xyz) // LOOKED_AT))
    place, distance = scans.poses[:, :3, 3], np.linalg.norm(xyz[some], axis=1)
    middle, reach = np.quantile(distance, (0.5, 0.95)).tolist()
    apart = float(np.median(cKDTree(place).query(place, k=2)[0][:, 1])) if len(scans) > 1 else 0.0
    far = f"are {apart:.3g} m apart and see {reach:.3g} m far. Are poses in metres, and points (--unit)?"
    if submaps:  # have no sensor that their points are seen from
        if apart > 2.0 * reach:
            logger.warning("%s: sub-maps %s", scans.source, far)
        return
    words = ""
    if middle > FARTHEST:
        words = f"half of the points lie {middle:.0f} m from the sensor and more. Give their unit: --unit"
    elif len(scans) > 1 and np.abs(scans.poses - scans.poses[0]).max() < STANDING:
        words = f"all {len(scans)} scans have one pose; did the sensor not move?"
    elif np.median(np.linalg.norm(xyz[some] - place[scan[some]], axis=1)) < FOLLOWS * middle:
        words = "the points follow the poses, so they are in the frame of the map already: --set scans.frame=map"
    elif np.median(np.abs(scans.poses[:, 2, 2])) < UPRIGHT:
        words = "the sensors lie on their side, so floors would be vertical. --calibration turns poses of a camera"
    elif apart > 2.0 * reach:
        words = f"scans {far}"
    if words:
        logger.warning("%s: %s", scans.source, words)
