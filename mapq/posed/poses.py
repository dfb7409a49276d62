"""Poses from text: rows of a matrix as in KITTI, of a place and a quaternion as in TUM, g2o and graph.txt, matrices."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.io.content import Content
from mapq.io.fields import LARGEST_COORDINATE
from mapq.posed.scans import driven
from prf.shell.errors import InputError

Floats = NDArray[np.float64]

ROTATION_TOLERANCE = 1e-2
"""Largest error of a rotation matrix or of the length of a quaternion: rounded numbers pass, other numbers do not."""

UPRIGHT = 0.9
"""Least upward component of the z axes of sensors that all stand upright, and ..."""
TILTED = 0.5
"""... the one below which a sensor does not."""

CALIBRATION_ROWS = ("Tr", "Tr_velo_to_cam", "Tr_velo_cam")
"""Rows of a calib.txt of KITTI that take points of the laser to the camera."""

G2O_VERTEX, G2O_OTHERS = "VERTEX_SE3:QUAT", ("EDGE_", "FIX", "PARAMS_")
"""Rows of g2o: those with a number and a pose are read as those of graph.txt, edges are skipped."""

AHEAD = 0.8
"""Share of the way along the z axis of the sensor above which that axis points ahead, as that of a camera does."""
WAY_NEEDED = 1.0
"""Metres: a shorter way has no direction."""

LAYOUTS = (
    "Read are rows of 12 numbers (3x4 matrix, KITTI), 16 (4x4), 7 (tx ty tz and a quaternion), 8 (time or name and "
    "these), g2o, and 4x4 matrices over four lines."
)


class PoseTable(NamedTuple):
    """Poses as a file has them.

    Attributes
    ----------
    poses : (k, 4, 4) float64
    names : tuple of str or None
        First column of graph.txt, such as ``v0``; of g2o the number behind a v.
    times : (k,) float64 or None
        First column of a TUM trajectory, or the last number of 16, seconds.
    is_matrix : bool
        Whether rows are matrices of 12 numbers, as KITTI has them.
    """

    poses: Floats
    names: tuple[str, ...] | None
    times: Floats | None
    is_matrix: bool


def read_poses(path: str, quaternion: str | None = None) -> PoseTable:
    """Read the poses of a file; the number of columns identifies the layout.

    Parameters
    ----------
    path : str
        Text of blanks or commas; lines that begin with ``#`` are skipped.
    quaternion : {"xyzw", "wxyz"}, optional
        Order of quaternions. Without it ``xyzw``, and refused where sensors then hang upside down that would all
        stand upright by the other order.

    Raises
    ------
    InputError
        If the file is missing, has another layout, or a row is no rigid motion.
    """
    where, rows = _rows(path)
    width, names, times = len(rows[0]), None, None
    if width == 8 and not all(_is_number(fields[0]) for fields in rows):
        names = tuple(fields[0] for fields in rows)
        rows = [fields[1:] for fields in rows]
    values = _numbers(rows, where)
    if width == 8 and names is None:
        times, values = values[:, 0], values[:, 1:]
    if width == 16 and (np.diff(values[:, 15]) > 0.0).all() and (values[:, 15] != 1.0).any():
        times, values = values[:, 15].copy(), np.column_stack([values[:, :15], np.ones(len(values))])
    far = np.flatnonzero((np.abs(values) > LARGEST_COORDINATE).any(axis=1))
    if len(far):
        raise InputError(f"{where[far[0]]}: a number is beyond {LARGEST_COORDINATE:g}. Remove this pose and its scan.")
    if width in (7, 8):
        return PoseTable(_of_quaternions(values, where, path, quaternion), names, times, is_matrix=False)
    return PoseTable(_of_matrices(values, where), None, times, is_matrix=width == 12)


def read_calibration(path: str) -> Floats:
    """Read ``T_camera_laser`` (4, 4) from the row ``Tr:`` of a calib.txt of KITTI."""
    for number, line in enumerate(Content(path).text().splitlines(), 1):
        name, _, rest = line.partition(":")
        if name.strip() in CALIBRATION_ROWS:
            where = [f"{path}:{number}"]
            values = _numbers([rest.split()], where)
            if values.shape != (1, 12) or np.abs(values).max() > LARGEST_COORDINATE:
                raise InputError(f"{where[0]}: not the 12 numbers of a 3x4 matrix. Give a calib.txt of KITTI.")
            return np.asarray(_of_matrices(values, where)[0])
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


def check_rotations(matrices: Floats, where: Sequence[str]) -> None:
    """Raise InputError for the first of the matrices (k, 3, 3) that is no rotation, naming its place."""
    error = np.abs(matrices @ matrices.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2))
    is_orthogonal = error < ROTATION_TOLERANCE
    wrong = np.flatnonzero(~is_orthogonal | (np.linalg.det(matrices) < 0.0))
    if len(wrong):
        what = "mirrors, as left-handed axes do" if is_orthogonal[wrong[0]] else "is no rotation"
        raise InputError(f"{where[wrong[0]]}: the matrix of this pose {what}. Check the layout of the file. {LAYOUTS}")


def quaternion_rotation(values: Floats) -> Floats:
    """Return the rotations (k, 3, 3) of unit quaternions (k, 4) in the order x, y, z, w."""
    x, y, z, w = values.T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), 2, 0)


def _rows(path: str) -> tuple[list[str], list[list[str]]]:
    """Return the places, for messages, and the fields of the lines with content, all of them alike long."""
    where, rows = [], []
    for number, line in enumerate(Content(path).text().splitlines(), 1):
        fields = [field for field in re.split(r"[\s,;]+", line.partition("#")[0]) if field]
        if fields and fields[0] == G2O_VERTEX:
            fields = ["v" + "".join(fields[1:2]), *fields[2:]]
        if fields and not fields[0].startswith(G2O_OTHERS):
            where.append(f"{path}:{number}")
            rows.append(fields)
    if not rows:
        raise InputError(f"{path}: no poses. {LAYOUTS}")
    for place, fields in zip(where, rows, strict=True):
        if len(fields) != len(rows[0]):
            raise InputError(f"{place}: {len(fields)} columns, but {len(rows[0])} before. Mend this line.")
    return where, rows


def _numbers(rows: list[list[str]], where: list[str]) -> Floats:
    """Return the numbers (k, w) in rows of text."""
    for fields, place in zip(rows, where, strict=True):
        for field in fields:
            if not (_is_number(field) and math.isfinite(float(field))):
                raise InputError(f"{place}: {field[:24]!r} is not a finite number. {LAYOUTS}")
    return np.array(rows, np.float64)


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _of_matrices(values: Floats, where: list[str]) -> Floats:
    """Return the poses of rows of 12 or 16 numbers, or of four rows of 4 each."""
    width = values.shape[1]
    if width == 4 and len(values) % 4 == 0:
        values, where, width = values.reshape(-1, 16), where[::4], 16
    if width not in (12, 16):
        raise InputError(f"{where[0]}: {width} columns are no pose. {LAYOUTS}")
    matrices = values.reshape(len(values), -1, 4)
    if width == 16:
        wrong = np.flatnonzero(np.abs(matrices[:, 3] - [0.0, 0.0, 0.0, 1.0]).max(axis=1) > ROTATION_TOLERANCE)
        if len(wrong):
            raise InputError(f"{where[wrong[0]]}: the last row of this 4x4 matrix is not 0 0 0 1. Give it by rows.")
    check_rotations(matrices[:, :3, :3], where)
    left, _, right = np.linalg.svd(matrices[:, :3, :3])  # rotations but for rounding: the nearest ones
    return _rigid(left @ right, matrices[:, :3, 3])


def _of_quaternions(values: Floats, where: list[str], path: str, order: str | None) -> Floats:
    """Return the poses of rows tx ty tz and a quaternion."""
    length = np.linalg.norm(values[:, 3:], axis=1)
    wrong = np.flatnonzero(np.abs(length - 1.0) > ROTATION_TOLERANCE)
    if len(wrong):
        found = f"(length {length[wrong[0]]:.3g})"
        raise InputError(f"{where[wrong[0]]}: the last four columns are no unit quaternion {found}. {LAYOUTS}")
    unit = values[:, 3:] / length[:, None]
    as_xyzw, as_wxyz = quaternion_rotation(unit), quaternion_rotation(unit[:, [1, 2, 3, 0]])
    if order is None and as_xyzw[:, 2, 2].min() < TILTED and as_wxyz[:, 2, 2].min() > UPRIGHT:
        raise InputError(
            f"{path}: read as tx ty tz qx qy qz qw sensors lie on their side or hang upside down; as tx ty tz qw qx qy "
            f"qz all stand upright. Choose with perturb.quaternion=wxyz or xyzw."
        )
    return _rigid(as_wxyz if order == "wxyz" else as_xyzw, values[:, :3])


def _rigid(rotation: Floats, translation: Floats) -> Floats:
    """Return poses (k, 4, 4) of rotations (k, 3, 3) and translations (k, 3)."""
    poses = np.tile(np.eye(4), (len(rotation), 1, 1))
    poses[:, :3, :3] = rotation
    poses[:, :3, 3] = translation
    return poses
