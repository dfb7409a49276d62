"""3DTK's scans (its format `uos`): scan000.3d with points and scan000.pose with its pose.

The axes of 3DTK are x to the right, y upwards, z ahead, in centimetres. Here they become x ahead, y to the left, z
upwards, in metres.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from mapq.cloud import PointCloud
from mapq.configuration import ReadOptions
from mapq.io.content import Content
from mapq.io.fields import LARGEST_COORDINATE, cloud_of_world
from mapq.io.text import as_count, numbered_columns, parse_rows
from prf.shell.errors import InputError

AXES = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
"""Mirrors, since one side is left-handed and the other not."""
CENTIMETRE = 0.01


def read_uos(content: Content, options: ReadOptions) -> PointCloud:
    """Read a .3d file: x y z and perhaps further columns, with or without a count in the first line."""
    data, source = content.data(), content.source
    first, _, rest = data.partition(b"\n")
    has_count = len(first.split()) == 1
    body, line = (rest, 2) if has_count else (data, 1)
    width = len(body.partition(b"\n")[0].split())
    if width < 3:
        raise InputError(f"{source}:{line}: {width} columns; a .3d file of 3DTK has x y z.")
    names = [*"xyz", *numbered_columns(width)]
    rows = parse_rows(body, np.dtype([(name, np.float64) for name in names]), source, line)
    if has_count and as_count(first.decode("latin-1").strip()) != len(rows):
        raise InputError(f"{source}: its first line is not the number of points, {len(rows)}. Copy the file again.")
    unit = CENTIMETRE if options.unit is None else options.unit
    points = np.column_stack([rows[name] for name in "xyz"]) @ AXES.T * unit
    return cloud_of_world(points, {name: rows[name] for name in names[3:]}, source)


def read_uos_pose(path: str) -> NDArray[np.float64]:
    """Read the pose (4, 4) of a .pose file: place in centimetres, then Euler angles about x, y and z in degrees."""
    try:
        values = np.array(Content(path).text().split(), np.float64)
    except ValueError:
        values = np.empty(0)
    if len(values) != 6 or not (np.abs(values) <= LARGEST_COORDINATE).all():
        raise InputError(
            f"{path}: expected six numbers. A .pose file of 3DTK has x y z (cm) and three angles (degrees)."
        )
    pose = np.eye(4)
    pose[:3, :3] = AXES @ Rotation.from_euler("XYZ", values[3:], degrees=True).as_matrix() @ AXES.T
    pose[:3, 3] = AXES @ values[:3] * CENTIMETRE
    return pose
