"""What looks wrong with scans and their poses: in one line each, with what to do about it."""

from __future__ import annotations

import logging

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from mapq.posed.scans import PosedScans

logger = logging.getLogger(__name__)

Floats = NDArray[np.float64]

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


def warn_of_poses(scans: PosedScans, xyz: Floats, scan: NDArray[np.int32]) -> None:
    """Warn where poses do not fit the points (n, 3) in the frames of their scans (n,), as far as these show it."""
    some = slice(None, None, max(1, len(xyz) // LOOKED_AT))
    xyz, scan, source = xyz[some], scan[some], scans.source
    distance = np.linalg.norm(xyz, axis=1)
    middle = float(np.median(distance))
    if middle > FARTHEST:
        logger.warning(
            "%s: half of the points lie beyond %.0f m from the sensor. Give their unit: --unit", source, middle
        )
        return
    if len(scans) < 2:
        return
    place, rotation = scans.poses[:, :3, 3], scans.poses[:, :3, :3]
    if np.abs(scans.poses - scans.poses[0]).max() < STANDING:
        logger.warning("%s: all %d scans have one pose; were they to move?", source, len(scans))
        return
    if np.median(np.linalg.norm(xyz - place[scan], axis=1)) < FOLLOWS * middle:
        logger.warning(
            "%s: the points follow the poses, so they are in the frame of the map already. --set scans.frame=map "
            "leaves them there",
            source,
        )
        return
    if np.median(rotation[:, 2, 2]) < UPRIGHT:
        logger.warning(
            "%s: the sensors lie on their side, so floors stand on edge. --calibration takes poses of a camera to the "
            "laser; --set segment.up says which way is up",
            source,
        )
    apart = cKDTree(place).query(place, k=2)[0][:, 1]
    reach = float(np.quantile(distance, 0.95))
    if np.median(apart) > 2.0 * reach:
        logger.warning(
            "%s: scans are %.3g m apart and see %.3g m far, so none meets another. Are poses in metres, and points "
            "(--unit)?",
            source,
            float(np.median(apart)),
            reach,
        )
