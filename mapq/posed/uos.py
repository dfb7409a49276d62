"""Poses of 3DTK (its format `uos`): scan000.pose beside scan000.3d, in the same centimetres and left-handed axes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mapq.io.content import read_bytes
from mapq.io.uos import AXES, CENTIMETRE
from mapq.posed.poses import is_sound
from prf.shell.errors import InputError


def read_uos_pose(path: str) -> NDArray[np.float64]:
    """Read the pose (4, 4) of a .pose file: place in centimetres, then Euler angles in degrees.

    The rotation is that about x times that about y times that about z.

    Raises
    ------
    InputError
        If the file is missing or does not hold six numbers that a pose may have.
    """
    fields = read_bytes(path).decode("utf-8", "replace").split()
    try:
        values = np.array(fields, np.float64)
    except ValueError:
        values = np.empty(0)
    if len(values) != 6 or not is_sound(values[None]).all():
        raise InputError(f"{path}: not six numbers. A .pose file of 3DTK has x y z (cm) and three angles (degrees).")
    pose = np.eye(4)
    pose[:3, :3] = AXES @ _euler(*np.radians(values[3:])) @ AXES.T
    pose[:3, 3] = AXES @ values[:3] * CENTIMETRE
    return pose


def _euler(about_x: float, about_y: float, about_z: float) -> NDArray[np.float64]:
    """Return the rotation (3, 3) about x times that about y times that about z."""
    rotation = np.eye(3)
    for axis, angle in enumerate((about_x, about_y, about_z)):
        one, other = (axis + 1) % 3, (axis + 2) % 3
        turn = np.eye(3)
        turn[one, one] = turn[other, other] = np.cos(angle)
        turn[one, other], turn[other, one] = -np.sin(angle), np.sin(angle)
        rotation = rotation @ turn
    return rotation
