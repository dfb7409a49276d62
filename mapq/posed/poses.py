"""Poses of a camera as KITTI has them, and how they become those of the laser."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mapq.io.content import Content
from mapq.posed.scans import driven
from prf.shell.errors import InputError
from prf.shell.poses.files import matrix_poses, numbers

Floats = NDArray[np.float64]

CALIBRATION_ROWS = ("Tr", "Tr_velo_to_cam", "Tr_velo_cam")
"""Rows of a calib.txt of KITTI that take points of the laser to the camera."""

AHEAD = 0.8
"""Share of the way along the z axis of the sensor above which that axis points ahead, as that of a camera does."""
WAY_NEEDED = 1.0
"""Metres: a shorter way has no direction."""


def read_calibration(path: str) -> Floats:
    """Read ``T_camera_laser`` (4, 4) from the row ``Tr:`` of a calib.txt of KITTI."""
    for number, line in enumerate(Content(path).text().splitlines(), 1):
        name, _, rest = line.partition(":")
        if name.strip() in CALIBRATION_ROWS:
            where = [f"{path}:{number}"]
            values = numbers([rest.split()], where)
            if values.shape != (1, 12):
                raise InputError(f"{where[0]}: expected the 12 numbers of a 3x4 matrix. Give a calib.txt of KITTI.")
            return np.asarray(matrix_poses(values, where)[0])
    raise InputError(f"{path}: no row Tr: with the 12 numbers of the motion from laser to camera. Give a calib.txt.")


def laser_poses(camera: Floats, calibration: Floats) -> Floats:
    """Return poses (k, 4, 4) of the laser in the frame of its first pose's laser, from those of the camera.

    With ``Tr`` = ``T_camera_laser`` this is ``inv(Tr) @ pose @ Tr``: the map then has the laser's axes too, z upwards.
    """
    return np.asarray(np.linalg.inv(calibration) @ camera @ calibration)


def looks_ahead(poses: Floats) -> bool | None:
    """Return whether the z axis of poses (k, 4, 4) points along the way, as that of a camera does; None: too short.

    KITTI's trap: its poses are those of the left camera, its points those of the laser.
    """
    steps = np.diff(poses[:, :3, 3], axis=0)
    way = driven(poses)[-1]
    if way <= WAY_NEEDED:
        return None
    ahead = np.einsum("kji,kj->ki", poses[:-1, :3, :3], steps).sum(axis=0)
    return bool(abs(ahead[2]) > AHEAD * way)
