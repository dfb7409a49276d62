"""3DTK: scan000.3d with scan000.pose beside it, in centimetres, left-handed, y upwards.

The axes of 3DTK are x to the right, y upwards, z ahead. Here they become x ahead, y to the left, z upwards, in metres.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mapq.cloud import PointCloud
from mapq.io.clouds import read_bytes
from mapq.io.fields import cloud_of_world
from mapq.io.rows import Layout, parse_rows
from prf.shell.errors import InputError

AXES = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
"""Takes x right, y up, z ahead to x ahead, y left, z up; it mirrors, since one is left-handed and the other not."""
CENTIMETRE = 0.01


def read_uos_scan(path: str) -> PointCloud:
    """Read the points of a .3d file: x y z and perhaps further columns, with or without a count in the first line.

    Raises
    ------
    InputError
        If the file is missing or a row cannot be read.
    """
    data = read_bytes(path)
    first, _, rest = data.partition(b"\n")
    has_count = len(first.split()) == 1
    body, line = (rest, 2) if has_count else (data, 1)
    width = len(body.partition(b"\n")[0].split())
    if width < 3:
        raise InputError(f"{path}:{line}: {width} columns; a .3d file of 3DTK has x y z.")
    names = ["x", "y", "z", *(f"column_{number}" for number in range(4, width + 1))]
    layout = Layout(np.dtype([(name, np.float64) for name in names]), width, tuple(range(width)))
    rows = parse_rows(body, layout, path, line)
    points = np.column_stack([rows[name] for name in "xyz"]) @ AXES.T * CENTIMETRE
    return cloud_of_world(points, {name: rows[name] for name in names[3:]}, path)


def read_uos_pose(path: str) -> NDArray[np.float64]:
    """Read the pose (4, 4) of a .pose file: place in centimetres, then Euler angles in degrees.

    The rotation is that about x times that about y times that about z.

    Raises
    ------
    InputError
        If the file is missing or does not hold six finite numbers.
    """
    fields = read_bytes(path).decode("utf-8", "replace").split()
    try:
        values = np.array(fields, np.float64)
    except ValueError:
        values = np.empty(0)
    if len(values) != 6 or not np.isfinite(values).all():
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
