"""Files of poses, as SLAM programs and tools of evaluation write them: one reader for both tools.

Read are rows of 12 numbers (3x4 matrix, KITTI), 16 (4x4), 7 (place and quaternion), 8 (time or name and these: TUM,
graph.txt), 3 (x, y, heading), 4 (time and these), g2o, JSON, CSV with a header, and such rows as an array (.npy, .npz,
.mat).
"""

from __future__ import annotations

import io
import json
import math
import re
from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

from prf.shell.cli.files import STREAM, gunzip, open_input
from prf.shell.errors import InputError
from prf.shell.poses.headings import added_up, in_radians, refuse_wide
from prf.shell.poses.named import is_named, poses_in

Floats = NDArray[np.float64]
Order = Literal["xyzw", "wxyz"]

FARTHEST = 1e9
"""Metres: a larger number is not a coordinate."""
ROTATION_TOLERANCE = 1e-2
"""Largest error of a rotation matrix or of the length of a quaternion: rounded numbers pass, other numbers do not."""
UPRIGHT = 0.9
"""Least upward component of the z axes of sensors that all stand upright, and ..."""
TILTED = 0.5
"""... the one below which a sensor does not."""
TICKS = ((9e17, 1e-9), (9e14, 1e-6), (9e11, 1e-3))
"""Times of this millennium are above these where they are nano-, micro- or milliseconds since 1970."""
LAYOUTS = (
    "Rows may be 12 numbers (3x4 matrix, KITTI), 16 (4x4), 7 (tx ty tz and a quaternion), 8 (time or name and "
    "these), 3 (x y theta), 4 (t x y theta), g2o, 4x4 matrices over four lines, JSON, CSV with a header such as "
    "t,x,y,theta, and .npy, .npz and .mat."
)

GZIP_MAGIC, BYTE_ORDER_MARK, NUMPY_MAGIC = b"\x1f\x8b\x08", b"\xef\xbb\xbf", b"\x93NUMPY"

G2O_VERTICES = ("VERTEX_SE3:QUAT", "VERTEX_SE2")
"""Rows of g2o with a number and a pose; ..."""
G2O_OTHERS = ("EDGE_", "FIX", "PARAMS_", "VERTEX_XY", "VERTEX_TRACKXYZ")
"""... rows of edges and landmarks are skipped."""

SLAM_STATES = {
    (0x7B1D1F7B5BF501DB).to_bytes(8, "little"): "this is the state of Cartographer (.pbstream). Make a bag of it by "
    "cartographer_ros's cartographer_dev_pbstream_trajectories_to_rosbag, of that a TUM file by evo_traj bag BAG TOPIC "
    "--save_as_tum, and give this as --poses",
    b"\x16\0\0\0\0\0\0\0serialization::archive": "this is the state of slam_toolbox (.posegraph, .data), which exports "
    "no poses. Record scans and /tf while it maps or localizes, and give that bag; or make a TUM file of its topic by "
    "evo_traj bag2 BAG /pose --save_as_tum, and give this as --poses",
}
"""How state files of SLAM programs begin, and what to take instead."""

_PLACE, _TURN = (
    r"(.*(position|translation)[./_]|p_rs_r_|[tp]_?|pos_?|pose[._])?",
    r"(.*(orientation|rotation)[./_]|q_rs_|q_?)",
)
NAMES = {
    **{"t": r".*stamp|_*(t|time|timestamps?|secs?|seconds)"},
    **{axis: _PLACE + axis for axis in "xyz"},
    **{f"q{axis}": _TURN + axis for axis in "xyzw"},
    **{"theta": r"(pose[._])?(theta|th|yaw|heading|orientation)", "roll": "roll", "pitch": "pitch"},
}
"""What columns are called: by hand, and by evo, rostopic, PlotJuggler and EuRoC."""
TUM = ["t", "x", "y", "z", "qx", "qy", "qz", "qw"]
UNITS = {"ns": 1e-9, "us": 1e-6, "ms": 1e-3, "deg": math.radians(1.0), "degrees": math.radians(1.0)}
"""Units other than seconds and radians behind a name: ``yaw_deg``, ``timestamp [ns]``."""


class PoseFile(NamedTuple):
    """Poses of a sensor or a robot, as a file has them."""

    poses: Floats  # (k, 4, 4) T_map_body, metres; those of the plane (x, y, theta) have z = 0
    names: tuple[str, ...] | None  # first column of graph.txt, such as v0; of g2o the number behind a v
    times: Floats | None  # (k,) seconds: first column of TUM, column t of CSV, or the last number of a 4x4 matrix
    layout: str  # for a person: KITTI (rows of 12 numbers), TUM, g2o, CSV and others


def read_pose_file(
    path: str, quaternion: Order | None = None, key: str = "quaternion", is_odometry: bool = False
) -> PoseFile:
    """Read the poses of a text, gzipped or not; a header or the number of columns identifies the layout.

    `quaternion`: order without a header, which `key` states in messages. Without it xyzw, refused where sensors then
    hang upside down that would all stand upright by the other order. `is_odometry`: of several arrays of poses in a
    file the one that is called so is taken, else the other.
    """
    rows = _read_rows(path, is_odometry)
    values, times, where = rows.values, None, rows.where
    if rows.columns is not None:
        return _of_columns(rows)
    width = values.shape[1]
    if width == 4 and len(values) % 4 == 0 and not (values[3::4, :3] != 0.0).any():
        values, where, width = values.reshape(-1, 16), where[::4], 16
    if width == 16 and not values[:, 12:15].any() and (np.abs(values[:, 15] - 1.0) > ROTATION_TOLERANCE).any():
        times, values = values[:, 15].copy(), np.column_stack([values[:, :15], np.ones(len(values))])
    is_planar = width == 3 or (width == 4 and bool((np.diff(values[:, 0]) > 0.0).all()))
    if width == 8 or (width == 4 and is_planar):
        times, values = values[:, 0], values[:, 1:]
    if not is_planar and values.shape[1] not in (7, 12, 16):
        raise InputError(f"{where[0]}: {width} columns, expected a pose of 7, 8, 12 or 16 numbers. {LAYOUTS}")
    _refuse_far(values, where)
    names = {8: "TUM", 12: "KITTI", 3: "x y theta", 4: "t x y theta"}
    layout = "g2o" if rows.is_g2o else names.get(width, f"rows of {width}")
    layout = f"{rows.array}: {layout}" if rows.array else layout
    if is_planar:
        zero = np.zeros((len(values), 2))
        values, are_steps = added_up(values)
        heading, unit = in_radians(values[:, :2], values[:, 2], where)
        layout += are_steps + unit
        poses = _of_angles(np.column_stack([values[:, :2], zero[:, 0]]), np.column_stack([heading, zero]))
    elif values.shape[1] == 7:
        poses = _of_quaternions(values, where, path, quaternion, key)
    else:
        poses = _of_matrices(values, where)
    return PoseFile(poses, rows.names, None if times is None else in_seconds(times), layout)


def in_seconds(times: Floats) -> Floats:
    """Return times (k,), nan where unknown, in seconds: other units since 1970 are known by their size."""
    low, high = float(np.nanmin(times)), float(np.nanmax(times))
    if not low > 0.5 * high:  # counted from the start: of a unit that its size does not show
        return times
    return times * next((factor for least, factor in TICKS if high > least), 1.0)


def check_rotations(matrices: Floats, where: Sequence[str]) -> None:
    """Raise InputError for the first of the matrices (k, 3, 3) that is not a rotation, naming its place."""
    error = np.abs(matrices @ matrices.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2))
    is_orthogonal = error < ROTATION_TOLERANCE
    wrong = np.flatnonzero(~is_orthogonal | (np.linalg.det(matrices) < 0.0))
    if len(wrong):
        what = "mirrors, as left-handed axes do" if is_orthogonal[wrong[0]] else "is not a rotation"
        raise InputError(f"{where[wrong[0]]}: the matrix of this pose {what}. Check the layout of the file. {LAYOUTS}")


def matrix_poses(values: Floats, where: Sequence[str]) -> Floats:
    """Return the poses (k, 4, 4) of rows of 12 numbers, refused unless they are rigid motions."""
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


def _of_columns(rows: _Rows) -> PoseFile:
    """Return the poses of a table with a header."""
    assert rows.columns is not None
    column = dict(zip(rows.columns, rows.values.T, strict=True))
    times = column.pop("t", None)
    _refuse_far(np.column_stack(list(column.values())), rows.where)
    zero, unit = np.zeros(len(rows.where)), ""
    place = np.column_stack([column.get(name, zero) for name in "xyz"])
    if "theta" in column:
        heading, unit = in_radians(place[:, :2], column["theta"], rows.where)
        tilts = [column.get(name, zero) for name in ("pitch", "roll")]
        for tilt in tilts:
            refuse_wide(tilt, rows.where)
        poses = _of_angles(place, np.column_stack([heading, *tilts]))
    else:
        quaternions = [column[f"q{axis}"] for axis in "xyzw"]
        poses = _of_quaternions(np.column_stack([place, *quaternions]), rows.where, "", "xyzw", "")
    layout = ("TUM" if rows.is_tum else "CSV") + unit
    return PoseFile(poses, None, None if times is None else in_seconds(times), layout)


def _of_angles(place: Floats, turns: Floats) -> Floats:
    """Return the poses of places (k, 3) and turns (k, 3) about z, then y, then x."""
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
        raise InputError(f"{where[wrong[0]]}: the last four columns must be a unit quaternion {found}. {LAYOUTS}")
    as_xyzw, as_wxyz = (Rotation.from_quat(values[:, columns]).as_matrix() for columns in ([3, 4, 5, 6], [4, 5, 6, 3]))
    if order is None and as_xyzw[:, 2, 2].min() < TILTED and as_wxyz[:, 2, 2].min() > UPRIGHT:
        raise InputError(
            f"{path}: read as tx ty tz qx qy qz qw sensors lie on their side or hang upside down; as tx ty tz qw qx qy "
            f"qz all stand upright. Choose with --set {key}=wxyz or xyzw."
        )
    return rigid(as_wxyz if order == "wxyz" else as_xyzw, values[:, :3])


class _Rows(NamedTuple):
    """The rows of a file."""

    where: list[str]  # place of each, for messages
    values: Floats  # (k, w)
    names: tuple[str, ...] | None = None  # first column where it is not numeric, such as v0; of g2o the vertex number
    is_tum: bool = False  # whether columns of a header are those of TUM
    columns: tuple[str, ...] | None = None  # what the columns of `values` are by the header, keys of `NAMES`
    is_g2o: bool = False
    array: str = ""  # name of the array in a file of several


def _read_rows(path: str, is_odometry: bool) -> _Rows:
    """Read the rows of a file of text, gzipped or not."""
    source = "standard input" if path == STREAM else path
    data = _content(path, source)
    if data.startswith(NUMPY_MAGIC) or is_named(data):
        name, values = poses_in(data, source, is_odometry) if is_named(data) else ("", array_of(data, source))
        values = values.T if len(values) == 3 != values.shape[1] else values
        if not np.isfinite(values).all():
            row = int(np.flatnonzero(~np.isfinite(values).all(axis=1))[0])
            raise InputError(f"{source}: row {row} has a number that is not finite. Remove this pose and its scan.")
        return _Rows([f"{source}: row {number}" for number in range(len(values))], values, array=name)
    text = _text(data, source)
    if text.lstrip()[:1] in ("[", "{"):
        return _of_json(text, source)
    lines = text.splitlines()
    table = _of_table(lines, source)
    if table is not None:
        return table
    where, rows, is_g2o = [], [], False
    for number, line in enumerate(lines, 1):
        fields = _words(line.partition("#")[0])
        if fields and fields[0] in G2O_VERTICES:
            is_g2o, fields = True, ["v" + "".join(fields[1:2]), *fields[2:]]
        if fields and not fields[0].startswith(G2O_OTHERS):
            where.append(f"{source}:{number}")
            rows.append(fields)
    if not rows:
        raise InputError(f"{source}: no poses. {LAYOUTS}")
    names = None
    if is_g2o or (len(rows[0]) == 8 and not all(_is_number(fields[0]) for fields in rows)):
        names = tuple(fields[0] for fields in rows)
        rows = [fields[1:] for fields in rows]
    return _Rows(where, numbers(rows, where), names, is_g2o=is_g2o)


def _of_json(text: str, source: str) -> _Rows:
    """Return the poses of a JSON: a list or an object of matrices or quaternion rows, or transforms.json."""
    names, rows = [], []
    try:
        content = json.loads(text)
        content = content.get("frames", content) if isinstance(content, dict) else content
        for key, item in content.items() if isinstance(content, dict) else enumerate(content):
            if isinstance(item, dict):
                key, item = item["file_path"], item["transform_matrix"]
            names.append(str(key))
            rows.append(np.array(item, np.float64).ravel())
        values = np.array(rows).reshape(len(rows), -1)
        if not (np.isfinite(values).all() and values.shape[1] in (7, 12, 16)):
            raise ValueError
    except (ValueError, TypeError, KeyError):
        raise InputError(f"{source}: not a JSON of poses, one matrix of 3x4 or 4x4 numbers each. {LAYOUTS}") from None
    where = [f"{source}: pose {name}" for name in names]
    is_numbered = names == [str(number) for number in range(len(names))]
    return _Rows(where, values, None if is_numbered else tuple(names))


def numbers(rows: Sequence[Sequence[str]], where: Sequence[str]) -> Floats:
    """Return the finite numbers (k, w) in rows of text, as many in each."""
    for fields, place in zip(rows, where, strict=True):
        for field in fields:
            if not (_is_number(field) and math.isfinite(float(field))):
                raise InputError(f"{place}: {field[:24]!r} is not a finite number. {LAYOUTS}")
        if len(fields) != len(rows[0]):
            raise InputError(f"{place}: {len(fields)} columns, but {len(rows[0])} before. Correct this line.")
    return np.array(rows, np.float64)


def slam_state(head: bytes) -> str | None:
    """Return what a state file of a SLAM program is, and what to take instead; None for other files."""
    return next((words for magic, words in SLAM_STATES.items() if head.startswith(magic)), None)


def _content(path: str, source: str) -> bytes:
    """Return the content of a file, decompressed."""
    with open_input(path) as stream:
        data = stream.read()
    return gunzip(data, source) if data.startswith(GZIP_MAGIC) else data


def array_of(data: bytes, source: str) -> Floats:
    """Return the numbers (k, w) of a .npy file."""
    try:
        values = np.load(io.BytesIO(data), allow_pickle=False)
        if values.ndim != 2 or not len(values):
            raise ValueError(f"its shape is {values.shape}")
        return np.asarray(values, np.float64)
    except (ValueError, TypeError, EOFError) as error:
        raise InputError(
            f"{source}: not an array of numbers, a row a scan ({error}). Save it with numpy.save."
        ) from None


def _text(data: bytes, source: str) -> str:
    """Return the content of a file as text."""
    if (state := slam_state(data)) is not None:
        raise InputError(f"{source}: {state}.")
    if b"\0" in data[: 1 << 16]:
        raise InputError(f"{source}: this is binary data, not a text of poses. Bags: evo_traj bag --save_as_tum.")
    return data.removeprefix(BYTE_ORDER_MARK).decode("utf-8", "replace")


def _words(line: str) -> list[str]:
    return [field for field in re.split(r"[\s,;]+", line) if field]


def table_cells(line: str) -> list[str]:
    """Return the fields of a row of a table, empty ones among them."""
    separator = next((mark for mark in ",;\t" if mark in line), None)
    return [field.strip().strip("\"'") for field in line.split(separator)]


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def pose_columns(names: Sequence[str]) -> dict[str, tuple[int, float]]:
    """Return what the columns mean, by their names."""
    found: dict[str, tuple[int, float]] = {}
    for place, name in enumerate(names):
        match = re.fullmatch(r"(.*?)(?:[\s_]*[\[(_ ](ns|us|ms|deg|degrees|m|s|rad)?[\])]?)?", name.lower())
        stem, unit = match.groups() if match else (name.lower(), None)
        key = next((key for key, pattern in NAMES.items() if re.fullmatch(pattern, stem)), None)
        if key is not None and (key not in found or stem.endswith("stamp")):
            found[key] = (place, UNITS.get(unit or "", 1.0))
    return dict(sorted(found.items(), key=lambda item: item[1]))


def _of_table(lines: Sequence[str], source: str) -> _Rows | None:
    """Return the known columns of rows below a header, which may be a comment, in seconds and radians; None without."""
    content = [(number, line.strip()) for number, line in enumerate(lines, 1) if line.strip()]
    data = [(number, table_cells(line)) for number, line in content if not line.startswith("#")]
    for number, line in content:
        names, is_comment = table_cells(line.lstrip("#% ")), line.startswith("#")
        columns = pose_columns(names)
        if {"x", "y"} <= columns.keys() and ("theta" in columns or {"qx", "qy", "qz", "qw"} <= columns.keys()):
            if not is_comment or (data and len(data[0][1]) == len(names)):
                break
        elif not is_comment and not any(map(_is_number, names)):
            wanted = "Name the columns t,x,y,theta or t,x,y,z,qx,qy,qz,qw (t and z may be missing)."
            raise InputError(f"{source}:{number}: the header does not name the columns of poses. {wanted}")
        if not is_comment:
            return None
    else:
        return None
    rows = [(f"{source}:{at}", cells) for at, cells in data if at > number]
    for place, cells in rows:
        if len(cells) != len(names):
            raise InputError(f"{place}: {len(cells)} columns below a header of {len(names)}. Correct this line.")
    if not rows:
        raise InputError(f"{source}: no poses. {LAYOUTS}")
    if "t" in columns and not any(cells[columns["t"][0]] for _, cells in rows):
        del columns["t"]  # unknown times of a trajectory.csv that prf sample wrote
    places, factors = zip(*columns.values(), strict=True)
    values = numbers([[cells[at] for at in places] for _, cells in rows], [place for place, _ in rows])
    is_tum = list(columns) == TUM and len(names) == len(TUM) and "," not in line
    return _Rows([place for place, _ in rows], values * np.array(factors), columns=tuple(columns), is_tum=is_tum)
