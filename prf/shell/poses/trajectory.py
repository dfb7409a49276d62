"""Trajectories: poses from text, as SLAM programs and tools of evaluation write them. One reader for both tools."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

from prf.shell.errors import InputError
from prf.shell.poses.rows import PoseRows, read_pose_rows

Floats = NDArray[np.float64]
Order = Literal["xyzw", "wxyz"]

FARTHEST = 1e9
"""Metres, as far as a coordinate may be; a larger number is none."""
ROTATION_TOLERANCE = 1e-2
"""Largest error of a rotation matrix or of the length of a quaternion: rounded numbers pass, other numbers do not."""
UPRIGHT = 0.9
"""Least upward component of the z axes of sensors that all stand upright, and ..."""
TILTED = 0.5
"""... the one below which a sensor does not."""
WIDEST = 4.0 * np.pi
"""Radians: a larger heading is in degrees."""
TICKS = ((9e17, 1e-9), (9e14, 1e-6), (9e11, 1e-3))
"""Times of this millennium are above these where they are nano-, micro- or milliseconds since 1970."""

LAYOUTS = (
    "Read are rows of 12 numbers (3x4 matrix, KITTI), 16 (4x4), 7 (tx ty tz and a quaternion), 8 (time or name and "
    "these), g2o, 4x4 matrices over four lines, JSON, and CSV with a header such as t,x,y,theta."
)


class Trajectory(NamedTuple):
    """Poses of a sensor or a robot, as a file has them."""

    poses: Floats  # (k, 4, 4) T_map_body, metres; those of the plane (x, y, theta) have z = 0
    names: tuple[str, ...] | None  # first column of graph.txt, such as v0; of g2o the number behind a v
    times: Floats | None  # (k,) seconds: first column of TUM, column t of CSV, or the last number of a 4x4 matrix
    layout: str  # for a person: KITTI (rows of 12 numbers), TUM, g2o, CSV and others


def read_trajectory(path: str, quaternion: Order | None = None, key: str = "quaternion") -> Trajectory:
    """Read the poses of a text, gzipped or not; a header or the number of columns identifies the layout.

    `quaternion`: order without a header, which `key` states in messages. Without it xyzw, refused where sensors then
    hang upside down that would all stand upright by the other order.
    """
    rows = read_pose_rows(path, LAYOUTS)
    values, times, where = rows.values, None, rows.where
    if rows.columns is not None:
        return _of_columns(rows)
    width = values.shape[1]
    if width == 4 and len(values) % 4 == 0 and not (values[3::4, :3] != 0.0).any():
        values, where, width = values.reshape(-1, 16), where[::4], 16
    if width == 16 and not values[:, 12:15].any() and (np.abs(values[:, 15] - 1.0) > ROTATION_TOLERANCE).any():
        times, values = values[:, 15].copy(), np.column_stack([values[:, :15], np.ones(len(values))])
    is_planar = width == 3 + (not rows.is_g2o) and (rows.is_g2o or bool((np.diff(values[:, 0]) > 0.0).all()))
    if width == 8 or (width == 4 and is_planar):
        times, values = values[:, 0], values[:, 1:]
    if not is_planar and values.shape[1] not in (7, 12, 16):
        raise InputError(f"{where[0]}: {width} columns are no pose. {LAYOUTS}")
    _refuse_far(values, where)
    layout = "g2o" if rows.is_g2o else {8: "TUM", 12: "KITTI", 4: "t x y theta"}.get(width, f"rows of {width}")
    if is_planar:
        zero = np.zeros((len(values), 2))
        poses = _of_angles(np.column_stack([values[:, :2], zero[:, 0]]), np.column_stack([values[:, 2], zero]), where)
    elif values.shape[1] == 7:
        poses = _of_quaternions(values, where, path, quaternion, key)
    else:
        poses = _of_matrices(values, where)
    return Trajectory(poses, rows.names, None if times is None else in_seconds(times), layout)


def in_seconds(times: Floats) -> Floats:
    """Return times (k,), nan where unknown, in seconds: other units since 1970 are known by their size."""
    low, high = float(np.nanmin(times)), float(np.nanmax(times))
    if not low > 0.5 * high:  # counted from the start: of a unit that its size does not tell
        return times
    return times * next((factor for least, factor in TICKS if high > least), 1.0)


def check_rotations(matrices: Floats, where: Sequence[str]) -> None:
    """Raise InputError for the first of the matrices (k, 3, 3) that is no rotation, naming its place."""
    error = np.abs(matrices @ matrices.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2))
    is_orthogonal = error < ROTATION_TOLERANCE
    wrong = np.flatnonzero(~is_orthogonal | (np.linalg.det(matrices) < 0.0))
    if len(wrong):
        what = "mirrors, as left-handed axes do" if is_orthogonal[wrong[0]] else "is no rotation"
        raise InputError(f"{where[wrong[0]]}: the matrix of this pose {what}. Check the layout of the file. {LAYOUTS}")


def matrix_poses(values: Floats, where: Sequence[str]) -> Floats:
    """Return the poses (k, 4, 4) of rows of 12 numbers, refused where they are no rigid motions."""
    _refuse_far(values, where)
    return _of_matrices(values, where)


def rigid(rotation: Floats, translation: Floats) -> Floats:
    """Return poses (k, 4, 4) of rotations (k, 3, 3) and translations (k, 3)."""
    poses = np.tile(np.eye(4), (len(rotation), 1, 1))
    poses[:, :3, :3] = rotation
    poses[:, :3, 3] = translation
    return poses


def interpolate(stamps: Floats, places: Floats, turns: Rotation, at: Floats) -> tuple[Floats, Rotation]:
    """Return places (n, 3) and turns at times `at` (n,), from those (k, 3) and (k,) at `stamps` (k,), which rise.

    Metres and seconds; linear between stamps and along the shorter arc, held before the first and after the last.
    """
    when = np.clip(at, stamps[0], stamps[-1])
    moved = np.column_stack([np.interp(when, stamps, column) for column in places.T])
    return moved, Slerp(stamps, turns)(when) if len(stamps) > 1 else turns[np.zeros(len(when), np.int64)]


def _refuse_far(values: Floats, where: Sequence[str]) -> None:
    far = np.flatnonzero((np.abs(values) > FARTHEST).any(axis=1))
    if len(far):
        raise InputError(f"{where[far[0]]}: a number is beyond {FARTHEST:g}. Remove this pose and its scan.")


def _of_columns(rows: PoseRows) -> Trajectory:
    """Return the poses of a table with a header."""
    assert rows.columns is not None
    column = dict(zip(rows.columns, rows.values.T, strict=True))
    times = column.pop("t", None)
    _refuse_far(np.column_stack(list(column.values())), rows.where)
    zero = np.zeros(len(rows.where))
    place = np.column_stack([column.get(name, zero) for name in "xyz"])
    if "theta" in column:
        turns = np.column_stack([column.get(name, zero) for name in ("theta", "pitch", "roll")])
        poses = _of_angles(place, turns, rows.where)
    else:
        quaternions = [column[f"q{axis}"] for axis in "xyzw"]
        poses = _of_quaternions(np.column_stack([place, *quaternions]), rows.where, "", "xyzw", "")
    return Trajectory(poses, None, None if times is None else in_seconds(times), "CSV")


def _of_angles(place: Floats, turns: Floats, where: Sequence[str]) -> Floats:
    """Return the poses of places (k, 3) and turns (k, 3) about z, then y, then x."""
    wide = np.flatnonzero(np.abs(turns).max(axis=1) > WIDEST)
    if len(wide):
        found = f"an angle is {np.abs(turns[wide[0]]).max():g} rad"
        raise InputError(f"{where[wide[0]]}: {found}. If these are degrees, name the column so in a header: yaw_deg.")
    return rigid(Rotation.from_euler("ZYX", turns).as_matrix(), place)


def _of_matrices(values: Floats, where: Sequence[str]) -> Floats:
    """Return the poses of rows of 12 or 16 numbers."""
    matrices = values.reshape(len(values), -1, 4)
    if values.shape[1] == 16:
        wrong = np.flatnonzero(np.abs(matrices[:, 3] - [0.0, 0.0, 0.0, 1.0]).max(axis=1) > ROTATION_TOLERANCE)
        if len(wrong):
            raise InputError(f"{where[wrong[0]]}: the last row of this 4x4 matrix is not 0 0 0 1. Give it by rows.")
    check_rotations(matrices[:, :3, :3], where)
    left, _, right = np.linalg.svd(matrices[:, :3, :3])  # rotations but for rounding: the nearest ones
    return rigid(left @ right, matrices[:, :3, 3])


def _of_quaternions(values: Floats, where: Sequence[str], path: str, order: Order | None, key: str) -> Floats:
    """Return the poses of rows tx ty tz and a quaternion."""
    length = np.linalg.norm(values[:, 3:], axis=1)
    wrong = np.flatnonzero(np.abs(length - 1.0) > ROTATION_TOLERANCE)
    if len(wrong):
        found = f"(length {length[wrong[0]]:.3g})"
        raise InputError(f"{where[wrong[0]]}: the last four columns are no unit quaternion {found}. {LAYOUTS}")
    as_xyzw, as_wxyz = (Rotation.from_quat(values[:, columns]).as_matrix() for columns in ([3, 4, 5, 6], [4, 5, 6, 3]))
    if order is None and as_xyzw[:, 2, 2].min() < TILTED and as_wxyz[:, 2, 2].min() > UPRIGHT:
        raise InputError(
            f"{path}: read as tx ty tz qx qy qz qw sensors lie on their side or hang upside down; as tx ty tz qw qx qy "
            f"qz all stand upright. Choose with {key}=wxyz or xyzw."
        )
    return rigid(as_wxyz if order == "wxyz" else as_xyzw, values[:, :3])
