"""KITTI's trap: its poses are those of the left camera, its points those of the laser."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mapq.io.content import read_bytes
from mapq.posed.poses import UNSOUND, check_rotations, is_sound, nearest_rotation, rigid
from mapq.posed.scans import driven
from prf.shell.errors import InputError

NAMES = ("Tr", "Tr_velo_to_cam", "Tr_velo_cam")
"""Rows of a calibration file that take points of the laser to the camera."""

AHEAD = 0.8
"""Share of the way along the z axis of the sensor above which that axis points ahead, as that of a camera does."""
WAY_NEEDED = 1.0
"""Metres: on a shorter way the direction says nothing."""


def read_calibration(path: str) -> NDArray[np.float64]:
    """Read ``T_camera_laser`` (4, 4) from the row ``Tr:`` of a calib.txt of KITTI.

    Raises
    ------
    InputError
        If the file is missing, has no such row, or the row is no rigid motion.
    """
    for number, line in enumerate(read_bytes(path).decode("utf-8", "replace").splitlines(), 1):
        name, _, rest = line.partition(":")
        if name.strip() in NAMES:
            return _matrix(rest.split(), f"{path}:{number}")
    raise InputError(f"{path}: no row Tr: with the 12 numbers of the motion from laser to camera. Give a calib.txt.")


def laser_poses(camera: NDArray[np.float64], calibration: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return poses (k, 4, 4) of the laser in the frame of its first pose's laser, from those of the camera.

    With ``Tr`` = ``T_camera_laser`` this is ``inv(Tr) @ pose @ Tr``: the map then has the laser's axes too, z upwards.
    """
    return np.asarray(np.linalg.inv(calibration) @ camera @ calibration)


def looks_ahead(poses: NDArray[np.float64]) -> bool | None:
    """Return whether the z axis of poses (k, 4, 4) points along the way, as that of a camera does; None: too short.

    A map made with poses of a camera as they are has its walls lying flat and its ground upright.
    """
    steps = np.diff(poses[:, :3, 3], axis=0)
    way = driven(poses)[-1]
    if way <= WAY_NEEDED:
        return None
    ahead = np.einsum("kji,kj->ki", poses[:-1, :3, :3], steps).sum(axis=0)
    return bool(abs(ahead[2]) > AHEAD * way)


def _matrix(fields: list[str], where: str) -> NDArray[np.float64]:
    try:
        rows = np.array(fields, np.float64).reshape(3, 4)
    except ValueError:
        raise InputError(f"{where}: not the 12 numbers of a 3x4 matrix. Give a calib.txt of KITTI.") from None
    if not is_sound(rows).all():
        raise InputError(f"{where}: {UNSOUND}. Give a calib.txt of KITTI.")
    check_rotations(rows[None, :, :3], [where])
    return np.asarray(rigid(nearest_rotation(rows[None, :, :3]), rows[None, :, 3])[0])
