"""What the files of a user are together: a log or ranges, poses, odometry; what is missing, and what will work."""

from __future__ import annotations

import re
import shlex
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

import numpy as np

from prf.readings.directions import guess_angles
from prf.readings.matrix import Ranges, beam_directions, looks_like_matrix, ranges_of, wide_arrays
from prf.readings.open import log_stem, recognise
from prf.readings.text import BYTE_ORDER_MARK, decompress
from prf.readings.units import unit_of
from prf.shell.cli.files import STREAM, open_input
from prf.shell.errors import InputError, PrfError
from prf.shell.poses.bag import HEAD, bag_suffix
from prf.shell.poses.files import PoseFile, read_pose_file
from prf.shell.poses.named import ODOMETRY, POSE_WIDTHS, is_named, named_arrays, poses_in

LOG_HEADER = re.compile(rb"(?im)^[^\d\n]*\b(range|value)\b")
"""A header that names ranges; or values at points, of which the reader of logs reports where they are given."""
WANTED_POSES = "a pose a scan: rows x y theta, TUM, KITTI, g2o, or CSV t,x,y,theta"


class Inputs(NamedTuple):
    """Files of a user by what they are; None where there is none."""

    rows: tuple[tuple[str, str], ...]  # each file, and what it is in words
    log: str | None = None
    poses: str | None = None
    odometry: str | None = None
    beam_angles: str | None = None
    missing: str = ""  # what is needed besides; empty: nothing

    def command(self, verb: str = "sample", kind: str = "laser", flags: str = "") -> str:
        """Return the command that reads them; capitals stand for what is missing."""
        log, poses = self.log or "LOG", self.poses or self.odometry
        words = ["prf", verb, *([f"--{kind}"] if verb == "sample" else []), log]
        if self.beam_angles is not None:
            words += ["--beam-angles", self.beam_angles]
        if poses is not None or "pose" in self.missing:
            words += ["--poses", poses or "POSES"]
        if self.odometry is not None and self.poses is not None and "--odometry" in flags:
            words += ["--set", f"trajectory.file={self.odometry}"]
        name = log_stem(log) or "map"
        name += "-map" if Path(name).resolve() == Path(log).resolve() else ""  # the folder of a bag has no suffix
        # A name for each way to map the same files: the commands can be given one after the other.
        if "--odometry" in flags and self.poses is None:
            name += "-odometry"
        elif "--odometry" in flags or "--pose-noise" in flags:
            name += "-poses"
        end = ["-o", name] if verb == "sample" else []
        return " ".join([shlex.join(words), *([flags] if flags else []), *map(shlex.quote, end)])


def sort_files(paths: list[str]) -> Inputs:
    """Return what files are; InputError if one is nothing that is read, or there are two of a kind."""
    rows: list[tuple[str, str]] = []
    roles: dict[str, str] = {}
    ranges: Ranges | None = None
    poses: dict[str, PoseFile] = {}
    for path in paths:
        for role, words, content in _parts_beside(path, paths):
            if role == "poses" and isinstance(content, PoseFile):
                role = _role_of_poses(path, words, roles)
                poses[role] = content
            if isinstance(content, Ranges):
                ranges = content
            if role in roles:
                raise InputError(f"{path}: {roles[role]} is {role} already. Give one of each at a time.")
            roles[role] = path
            rows.append((path, f"{role}: {words}" if role != "log" else words))
    if {"ranges", "log"} <= roles.keys():
        raise InputError(f"{roles['ranges']}: ranges beside a log, {roles['log']}. Give one of them.")
    found = Inputs(tuple(rows), roles.get("ranges", roles.get("log")), roles.get("poses"), roles.get("odometry"))
    if found.log is None:
        return found._replace(missing="readings: the log, or ranges a row a scan, that these poses belong to")
    return found if ranges is None else _with_directions(found, ranges, poses.get("poses", poses.get("odometry")))


def _with_directions(found: Inputs, ranges: Ranges, poses: PoseFile | None) -> Inputs:
    """Return files of ranges with where their beams point, and what is missing."""
    rows = list(found.rows)
    n = len(ranges.ranges)
    if poses is not None and len(poses.poses) != n and poses.times is None:
        counts = f"{found.log} has {n} scans, {found.poses or found.odometry} {len(poses.poses)} poses"
        missing = f"poses: {counts}, which is not one each; is a file cut off? Give {WANTED_POSES}"
        return found._replace(missing=missing, poses=None, odometry=None)
    if ranges.direction is None:
        plane = None
        if poses is not None and len(poses.poses) == n:
            heading = np.arctan2(poses.poses[:, 1, 0], poses.poses[:, 0, 0])
            plane = np.column_stack([poses.poses[:, :2, 3], heading])
        unit = unit_of(ranges.ranges, plane, lambda metres: beam_directions(guess_angles(metres, plane)[0]))
        angles, why = guess_angles(ranges.ranges * (1.0 if unit is None else unit.metres), plane)
        rows.append(("directions", f"taken for {angles} degrees, {why}. Give your own by --beam-angles"))
        found = found._replace(beam_angles=angles)
    return found._replace(rows=tuple(rows), missing="" if poses is not None else f"poses: {WANTED_POSES}")


def _role_of_poses(path: str, words: str, roles: dict[str, str]) -> str:
    """Return whether poses are such, or odometry, as the name, or what is there already, says."""
    is_odometry = ODOMETRY.search(Path(path).name) or ODOMETRY.search(words) or "poses" in roles
    return "odometry" if is_odometry else "poses"


def _parts(path: str) -> list[tuple[str, str, Ranges | PoseFile | None]]:
    """Return role, words and content of each thing in a file: ranges, poses, odometry, or a log."""
    if path == STREAM or Path(path).is_dir():
        return [("log", "a log", None)]
    with open_input(path) as stream:
        head = stream.read(HEAD)
        if bag_suffix(head):
            return [("log", "a ROS bag", None)]
        data = decompress(head + stream.read(), path).removeprefix(BYTE_ORDER_MARK)
    if is_named(data):
        return _named_parts(path, data)
    if looks_like_matrix(data):
        ranges = ranges_of(data, path)
        if ranges.ranges.shape[1] not in POSE_WIDTHS or not (found := _poses(path)):
            return [("ranges", _of_ranges(ranges), ranges)]
        return [("poses", _of_poses(found), found)]
    try:
        kind = recognise(data, path, raw=True)
        if kind != "table" or LOG_HEADER.search(data[:4096]):
            return [("log", {"carmen": "a CARMEN log", "player": "a Player log"}.get(kind, "a table"), None)]
    except InputError:
        if (found := _poses(path)) is None and not _is_pose_like(data):
            raise
    found = read_pose_file(path)
    return [("poses", _of_poses(found), found)]


def _parts_beside(path: str, paths: list[str]) -> list[tuple[str, str, Ranges | PoseFile | None]]:
    """Return the parts of a file; where it has none, the error says what the others are too."""
    try:
        return _parts(path)
    except InputError as error:
        others = list[str]()
        for other in dict.fromkeys(paths):
            with suppress(InputError):
                others += [f"{other} is {role}, {words}" for role, words, _ in _parts(other) if other != path]
        raise InputError(f"{error} {'; '.join(others)}{'.' * bool(others)}".strip()) from error


def _is_pose_like(data: bytes) -> bool:
    """Return whether the first row is a few numbers, so that what a reader of poses says helps."""
    first = next((line for line in data.splitlines() if line.strip() and not line.lstrip().startswith(b"#")), b"")
    return re.fullmatch(rb"[-+\d.eE\s,;]+", first) is not None


def _poses(path: str) -> PoseFile | None:
    """Return the poses in a file, None if it has none."""
    try:
        return read_pose_file(path)
    except PrfError:
        return None


def _named_parts(path: str, data: bytes) -> list[tuple[str, str, Ranges | PoseFile | None]]:
    """Return what the arrays of a file are."""
    parts: list[tuple[str, str, Ranges | PoseFile | None]] = []
    names = set()
    for is_odometry in (False, True):
        try:
            name = poses_in(data, path, is_odometry)[0]
        except InputError:
            continue
        if name not in names:
            names.add(name)
            found = read_pose_file(path, is_odometry=is_odometry)
            parts.append(("poses", _of_poses(found), found))
    if not parts or wide_arrays(named_arrays(data, path)):
        ranges = ranges_of(data, path)
        parts.insert(0, ("ranges", _of_ranges(ranges), ranges))
    return parts


def _of_ranges(found: Ranges) -> str:
    n, width = found.ranges.shape
    largest = np.max(found.ranges, initial=0.0, where=np.isfinite(found.ranges))
    return f"{n:,} scans of {width} beams, up to {largest:.6g}" + (f"; {found.words}" if found.words else "")


def _of_poses(found: PoseFile) -> str:
    return f"{len(found.poses):,} rows ({found.layout})"
