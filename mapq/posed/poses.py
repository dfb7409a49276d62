"""Poses from text: rows of a matrix as in KITTI, of a place and a quaternion as in TUM and graph.txt, matrices."""

from __future__ import annotations

import re
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.io.content import read_bytes
from mapq.io.fields import LARGEST_COORDINATE
from prf.shell.errors import InputError, UsageError

QUATERNIONS = ("xyzw", "wxyz")

ROTATION_TOLERANCE = 1e-2
"""Largest error of a rotation matrix or of the length of a quaternion: rounded numbers pass, other numbers do not."""

UPRIGHT = 0.9
"""Least upward component of the z axes of sensors that all stand upright, and ..."""
TILTED = 0.5
"""... the one below which a sensor does not."""

UNSOUND = f"a number is not finite, or beyond {LARGEST_COORDINATE:g}"

LAYOUTS = (
    "Read are rows of 12 numbers (3x4 matrix, KITTI), 16 (4x4), 7 (tx ty tz and a quaternion), 8 (time or name and "
    "these), and 4x4 matrices over four lines."
)


class PoseTable(NamedTuple):
    """Poses as a file has them.

    Attributes
    ----------
    poses : (k, 4, 4) float64
    names : tuple of str or None
        What stands before each pose in graph.txt, such as ``v0``.
    times : (k,) float64 or None
        What stands before each pose in a TUM trajectory, seconds.
    is_matrix : bool
        Whether rows are matrices of 12 numbers, as KITTI has them.
    """

    poses: NDArray[np.float64]
    names: tuple[str, ...] | None
    times: NDArray[np.float64] | None
    is_matrix: bool


def read_poses(path: str, quaternion: str | None = None) -> PoseTable:
    """Read the poses of a file; the layout is told by the number of columns.

    Parameters
    ----------
    path : str
        Text of blanks or commas; lines that begin with ``#`` are passed over.
    quaternion : {"xyzw", "wxyz"}, optional
        Order of quaternions. Without it ``xyzw``, and refused where sensors then hang upside down that would all
        stand upright by the other order.

    Raises
    ------
    InputError
        If the file is missing, has another layout, or a row is no rigid motion; the line says which.
    UsageError
        If `quaternion` is none of the two orders.
    """
    if quaternion is not None and quaternion not in QUATERNIONS:
        raise UsageError(f"--quaternion {quaternion} is neither {QUATERNIONS[0]} nor {QUATERNIONS[1]}.")
    data = read_bytes(path)
    if data.lstrip()[:1] in (b"{", b"["):
        raise InputError(f"{path}: this is JSON, no table of poses. Write one pose a row. {LAYOUTS}")
    rows = _rows(data, path)
    widths = {len(fields) for _, fields in rows}
    if len(widths) > 1:
        line, fields = next(row for row in rows if len(row[1]) != len(rows[0][1]))
        raise InputError(f"{path}:{line}: {len(fields)} columns, but {len(rows[0][1])} before. Mend this line.")
    width = widths.pop()
    names, times = None, None
    if width == 8:
        first = [fields[0] for _, fields in rows]
        rows = [(line, fields[1:]) for line, fields in rows]
        names = tuple(first) if not all(_is_number(name) for name in first) else None
        times = None if names is not None else np.array(first, np.float64)
    values = _numbers(rows, path)
    lines = [line for line, _ in rows]
    if width in (7, 8):
        return PoseTable(_of_quaternions(values, lines, path, quaternion), names, times, is_matrix=False)
    return PoseTable(_of_matrices(values, lines, path), None, None, is_matrix=width == 12)


def is_sound(values: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return whether all numbers of each pose (k, m) are finite and such as coordinates may be."""
    return np.asarray((np.abs(values) <= LARGEST_COORDINATE).all(axis=1))


def rigid(rotation: NDArray[np.float64], translation: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return poses (k, 4, 4) of rotations (k, 3, 3) and translations (k, 3)."""
    poses = np.tile(np.eye(4), (len(rotation), 1, 1))
    poses[:, :3, :3] = rotation
    poses[:, :3, 3] = translation
    return poses


def nearest_rotation(matrices: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the rotations (k, 3, 3) nearest to matrices (k, 3, 3) that are rotations but for rounding."""
    left, _, right = np.linalg.svd(matrices)
    return np.asarray(left @ right)


def check_rotations(matrices: NDArray[np.float64], where: list[str]) -> None:
    """Raise InputError for the first of the matrices (k, 3, 3) that is no rotation, naming its place."""
    error = np.abs(matrices @ matrices.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2))
    with np.errstate(all="ignore"):  # it goes by logarithms, which overflow for numbers next to 0
        is_mirror = np.linalg.det(matrices) < 0.0
    wrong = np.flatnonzero(~(error < ROTATION_TOLERANCE) | is_mirror)
    if len(wrong) == 0:
        return
    mirrored = error[wrong[0]] < ROTATION_TOLERANCE
    what = "mirrors, as left-handed axes do" if mirrored else "is no rotation"
    raise InputError(f"{where[wrong[0]]}: the matrix of this pose {what}. Check the layout of the file. {LAYOUTS}")


def quaternion_rotation(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the rotations (k, 3, 3) of unit quaternions (k, 4) in the order x, y, z, w."""
    x, y, z, w = values.T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), 2, 0)


def _rows(data: bytes, path: str) -> list[tuple[int, list[str]]]:
    """Return number (from 1) and fields of the lines that say something."""
    rows = []
    for number, line in enumerate(data.decode("utf-8", "replace").splitlines(), 1):
        fields = [field for field in re.split(r"[\s,;]+", line.partition("#")[0].strip()) if field]
        if fields:
            rows.append((number, fields))
    if not rows:
        raise InputError(f"{path}: no poses. {LAYOUTS}")
    return rows


def _numbers(rows: list[tuple[int, list[str]]], path: str) -> NDArray[np.float64]:
    for line, fields in rows:
        for field in fields:
            if not _is_number(field):
                raise InputError(f"{path}:{line}: {field[:24]!r} is not a number. {LAYOUTS}")
    values = np.array([fields for _, fields in rows], np.float64)
    wrong = np.flatnonzero(~is_sound(values))
    if len(wrong):
        raise InputError(f"{path}:{rows[wrong[0]][0]}: {UNSOUND}. Remove this pose and its scan.")
    return values


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _of_matrices(values: NDArray[np.float64], lines: list[int], path: str) -> NDArray[np.float64]:
    """Return the poses of rows of 12 or 16 numbers, or of four rows of 4 each."""
    width = values.shape[1]
    if width == 4 and len(values) % 4 == 0:
        values, lines, width = values.reshape(-1, 16), lines[::4], 16
    if width not in (12, 16):
        raise InputError(f"{path}:{lines[0]}: {width} columns are no pose. {LAYOUTS}")
    matrices = values.reshape(len(values), -1, 4)
    where = [f"{path}:{line}" for line in lines]
    if width == 16:
        wrong = np.flatnonzero(np.abs(matrices[:, 3] - [0.0, 0.0, 0.0, 1.0]).max(axis=1) > ROTATION_TOLERANCE)
        if len(wrong):
            raise InputError(f"{where[wrong[0]]}: the last row of this 4x4 matrix is not 0 0 0 1. Give it by rows.")
    check_rotations(matrices[:, :3, :3], where)
    return rigid(nearest_rotation(matrices[:, :3, :3]), matrices[:, :3, 3])


def _of_quaternions(values: NDArray[np.float64], lines: list[int], path: str, order: str | None) -> NDArray[np.float64]:
    """Return the poses of rows tx ty tz and a quaternion."""
    length = np.linalg.norm(values[:, 3:], axis=1)
    wrong = np.flatnonzero(np.abs(length - 1.0) > ROTATION_TOLERANCE)
    if len(wrong):
        raise InputError(
            f"{path}:{lines[wrong[0]]}: the last four columns are no unit quaternion (length "
            f"{length[wrong[0]]:.3g}). {LAYOUTS}"
        )
    unit = values[:, 3:] / length[:, None]
    as_xyzw, as_wxyz = quaternion_rotation(unit), quaternion_rotation(unit[:, [1, 2, 3, 0]])
    if order is None and as_xyzw[:, 2, 2].min() < TILTED and as_wxyz[:, 2, 2].min() > UPRIGHT:
        raise InputError(
            f"{path}: read as tx ty tz qx qy qz qw sensors lie on their side or hang upside down; as tx ty tz qw qx qy "
            f"qz all stand upright. Say which with --quaternion wxyz or --quaternion xyzw."
        )
    return rigid(as_wxyz if order == "wxyz" else as_xyzw, values[:, :3])
