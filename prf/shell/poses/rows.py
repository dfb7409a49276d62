"""The rows of a file of poses: numbers, places for messages, and what a header or the first column says of them."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from prf.shell.cli.files import STREAM, gunzip, open_input
from prf.shell.errors import InputError

Floats = NDArray[np.float64]

GZIP_MAGIC, BYTE_ORDER_MARK = b"\x1f\x8b\x08", b"\xef\xbb\xbf"

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
UNITS = {"ns": 1e-9, "us": 1e-6, "ms": 1e-3, "deg": math.radians(1.0), "degrees": math.radians(1.0)}
"""Units other than seconds and radians behind a name: ``yaw_deg``, ``timestamp [ns]``."""


class PoseRows(NamedTuple):
    """The rows of a file."""

    where: list[str]  # place of each, for messages
    values: Floats  # (k, w)
    names: tuple[str, ...] | None = None  # first column where it is no number, such as v0; of g2o the number behind a v
    columns: tuple[str, ...] | None = None  # what the columns of `values` are by the header, keys of `NAMES`
    is_g2o: bool = False


def read_pose_rows(path: str, layouts: str) -> PoseRows:
    """Read the rows of a file of text, gzipped or not; `layouts` says in messages what is read."""
    source = "standard input" if path == STREAM else path
    text = _text(path, source)
    if text.lstrip()[:1] in ("[", "{"):
        return _of_json(text, source, layouts)
    lines = text.splitlines()
    table = _of_table(lines, source, layouts)
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
        raise InputError(f"{source}: no poses. {layouts}")
    names = None
    if is_g2o or (len(rows[0]) == 8 and not all(_is_number(fields[0]) for fields in rows)):
        names = tuple(fields[0] for fields in rows)
        rows = [fields[1:] for fields in rows]
    return PoseRows(where, numbers(rows, where, layouts), names, is_g2o=is_g2o)


def _of_json(text: str, source: str, layouts: str) -> PoseRows:
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
        raise InputError(f"{source}: not a JSON of poses, one matrix of 3x4 or 4x4 numbers each. {layouts}") from None
    where = [f"{source}: pose {name}" for name in names]
    is_numbered = names == [str(number) for number in range(len(names))]
    return PoseRows(where, values, None if is_numbered else tuple(names))


def numbers(rows: Sequence[Sequence[str]], where: Sequence[str], layouts: str) -> Floats:
    """Return the finite numbers (k, w) in rows of text, as many in each."""
    for fields, place in zip(rows, where, strict=True):
        for field in fields:
            if not (_is_number(field) and math.isfinite(float(field))):
                raise InputError(f"{place}: {field[:24]!r} is not a finite number. {layouts}")
        if len(fields) != len(rows[0]):
            raise InputError(f"{place}: {len(fields)} columns, but {len(rows[0])} before. Mend this line.")
    return np.array(rows, np.float64)


def slam_state(head: bytes) -> str | None:
    """Return what a state file of a SLAM program is, and what to take instead; None if it is none."""
    return next((words for magic, words in SLAM_STATES.items() if head.startswith(magic)), None)


def _text(path: str, source: str) -> str:
    """Return the content of a file as text."""
    with open_input(path) as stream:
        data = stream.read()
    if data.startswith(GZIP_MAGIC):
        data = gunzip(data, source)
    if (state := slam_state(data)) is not None:
        raise InputError(f"{source}: {state}.")
    if b"\0" in data[: 1 << 16]:
        raise InputError(f"{source}: this is binary data, not a text of poses. Bags: evo_traj bag --save_as_tum.")
    return data.removeprefix(BYTE_ORDER_MARK).decode("utf-8", "replace")


def _words(line: str) -> list[str]:
    return [field for field in re.split(r"[\s,;]+", line) if field]


def _cells(line: str) -> list[str]:
    """Return the fields of a row of a table, empty ones among them."""
    separator = next((mark for mark in ",;\t" if mark in line), None)
    return [field.strip().strip("\"'") for field in line.split(separator)]


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _columns(names: Sequence[str]) -> dict[str, tuple[int, float]]:
    """Return what the columns mean, by their names."""
    found: dict[str, tuple[int, float]] = {}
    for place, name in enumerate(names):
        match = re.fullmatch(r"(.*?)(?:[\s_]*[\[(_ ](ns|us|ms|deg|degrees|m|s|rad)?[\])]?)?", name.lower())
        stem, unit = match.groups() if match else (name.lower(), None)
        key = next((key for key, pattern in NAMES.items() if re.fullmatch(pattern, stem)), None)
        if key is not None and (key not in found or stem.endswith("stamp")):
            found[key] = (place, UNITS.get(unit or "", 1.0))
    return dict(sorted(found.items(), key=lambda item: item[1]))


def _of_table(lines: Sequence[str], source: str, layouts: str) -> PoseRows | None:
    """Return the known columns of rows below a header, which may be a comment, in seconds and radians; None without."""
    content = [(number, line.strip()) for number, line in enumerate(lines, 1) if line.strip()]
    data = [(number, _cells(line)) for number, line in content if not line.startswith("#")]
    for number, line in content:
        names, is_comment = _cells(line.lstrip("#% ")), line.startswith("#")
        columns = _columns(names)
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
            raise InputError(f"{place}: {len(cells)} columns below a header of {len(names)}. Mend this line.")
    if not rows:
        raise InputError(f"{source}: no poses. {layouts}")
    if "t" in columns and not any(cells[columns["t"][0]] for _, cells in rows):
        del columns["t"]  # unknown times of a trajectory.csv that prf sample wrote
    places, factors = zip(*columns.values(), strict=True)
    values = numbers([[cells[at] for at in places] for _, cells in rows], [place for place, _ in rows], layouts)
    return PoseRows([place for place, _ in rows], values * np.array(factors), columns=tuple(columns))
