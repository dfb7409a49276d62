"""E57: scans, each with its pose, with pye57 (the extra `e57`)."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapq.cloud import PointCloud
from mapq.configuration import ReadOptions
from mapq.io.content import Content
from mapq.io.fields import LARGEST_COORDINATE, Array, cloud_of_world, fields_of_scans, joined_fields, warn_dropped
from prf.shell.errors import InputError, require

CARTESIAN = ("cartesianX", "cartesianY", "cartesianZ")
SPHERICAL = ("sphericalRange", "sphericalAzimuth", "sphericalElevation")
INVALID = ("cartesianInvalidState", "sphericalInvalidState")
FIELD_NAMES = {"colorRed": "red", "colorGreen": "green", "colorBlue": "blue", "timeStamp": "time_stamp"}
"""Names of fields that our files spell otherwise."""

CHUNK = 200_000
"""Points that are decoded at once."""

INTEGERS = "bBhHq"
"""Types of whole numbers that pye57 can fill, the narrow ones first."""


def read_e57(content: Content, options: ReadOptions) -> PointCloud:
    """Return all scans of an E57 file in its frame: poses applied, points that are marked invalid dropped.

    Where there are several scans the field `scan` numbers them, and `to_sensor_x/y/z` lead to their places.
    """
    source = content.source
    with content.file() as path:
        file = open_e57(str(path), source)
        poses = e57_poses(file, source)
        parts = [_scan_columns(file, scan, source) for scan in range(len(poses))]
        file.close()
    world = np.concatenate(
        [points @ pose[:3, :3].T + pose[:3, 3] for pose, (points, _) in zip(poses, parts, strict=True)]
    )
    counts = [len(points) for points, _ in parts]
    fields = joined_fields([columns for _, columns in parts], counts, source)
    fields |= fields_of_scans(world, poses[:, :3, 3], counts)
    return cloud_of_world(world, fields, source, options.unit or 1.0)


def open_e57(path: str, source: str) -> Any:
    """Open the E57 file `path`, which messages call `source`; InputError if it cannot be opened, or without pye57."""
    pye57 = require("pye57", "e57", f"{source}: E57")
    with _reported(f"{source}: cannot be opened as E57"):
        return pye57.E57(path)


@contextmanager
def _reported(what: str) -> Iterator[None]:
    """Turn the errors of libE57Format, whose type pye57 does not export, into an InputError of one line."""
    try:
        yield
    except Exception as error:
        words = " ".join(str(error).split()).partition(" **** ")[0][:120] or type(error).__name__
        raise InputError(f"{what} ({words}). Copy or download the file again.") from error


def e57_poses(file: Any, source: str) -> NDArray[np.float64]:
    """Return the poses (k, 4, 4) of the scans; a scan without one is at the origin of the file."""
    if file.scan_count == 0:
        raise InputError(f"{source}: no scan in this file. Give an E57 that has points.")
    poses = np.tile(np.eye(4), (file.scan_count, 1, 1))
    with _reported(f"{source}: the pose of a scan is damaged"):
        for scan in range(file.scan_count):
            header = file.get_header(scan)
            if header.has_pose():
                poses[scan, :3, :3] = header.rotation_matrix
                poses[scan, :3, 3] = header.translation
    if not (np.abs(poses) <= LARGEST_COORDINATE).all():
        raise InputError(
            f"{source}: the pose of a scan is not finite, or beyond {LARGEST_COORDINATE:g} m. Export the file anew."
        )
    return poses


def has_points(file: Any, scan: int) -> bool:
    """Return whether a scan has points, be they valid or not."""
    return int(file.get_header(scan).point_count) > 0


def read_e57_scan(file: Any, scan: int, source: str, unit: float = 1.0) -> PointCloud:
    """Return a scan in its own frame; `unit`: metres in that of the file."""
    points, fields = _scan_columns(file, scan, source)
    return cloud_of_world(points, fields, f"{source} scan {scan}", unit)


def _scan_columns(file: Any, scan: int, source: str) -> tuple[NDArray[np.float64], dict[str, Array]]:
    """Return the points (n, 3) of a scan in its own frame and their other fields, without those marked invalid."""
    where = f"{source} scan {scan}"
    with _reported(f"{where}: the points are damaged"):
        columns = _raw_columns(file, scan, where)
    points = take_points(columns, where)
    good = np.ones(len(points), bool)
    for name in INVALID:
        good &= columns.pop(name, np.zeros(len(points), np.int8)) == 0
    return points[good], {FIELD_NAMES.get(name, name): values[good] for name, values in columns.items()}


def _raw_columns(file: Any, scan: int, where: str) -> dict[str, Array]:
    """Return all fields of a scan that are numbers.

    pye57's own `read_scan_raw` takes colours and rows for narrower than they may be, and knows the standard fields
    alone.
    """
    from pye57 import libe57  # noqa: PLC0415

    header = file.get_header(scan)
    prototype = libe57.StructureNode(header.points.prototype())
    types = {name: code for name in header.point_fields if (code := _code(prototype[name], name, libe57))}
    warn_dropped([name for name in header.point_fields if name not in types], where)
    size, n_points = min(CHUNK, header.point_count), 0
    buffers = {name: np.empty(size, code) for name, code in types.items()}
    columns = {name: np.empty(header.point_count, code) for name, code in types.items()}
    targets = libe57.VectorSourceDestBuffer()
    for name, values in buffers.items():
        targets.append(libe57.SourceDestBuffer(file.image_file, name, values, size, True, True))
    reader = header.points.reader(targets)
    while n_read := reader.read():
        for name, values in buffers.items():
            columns[name][n_points : n_points + n_read] = values[:n_read]
        n_points += n_read
    reader.close()
    if n_points != header.point_count:
        raise ValueError(f"{header.point_count} points are promised, {n_points} follow")
    return columns


def _code(node: Any, name: str, libe57: Any) -> str:
    """Return the type code in which pye57 gives a field, empty for text."""
    if isinstance(node, libe57.IntegerNode):
        low, high = node.minimum(), node.maximum()
        return next((code for code in INTEGERS if np.iinfo(code).min <= low and high <= np.iinfo(code).max), "q")
    if isinstance(node, libe57.ScaledIntegerNode):
        return "d"
    if isinstance(node, libe57.FloatNode):
        is_single = node.precision() == libe57.FloatPrecision.E57_SINGLE
        return "f" if is_single and name not in (*CARTESIAN, *SPHERICAL) else "d"
    return ""


def take_points(columns: dict[str, NDArray[Any]], where: str) -> NDArray[np.float64]:
    """Return the coordinates (n, 3), and remove their columns: cartesian, or spherical in metres and radians."""
    if set(CARTESIAN) <= set(columns):
        return np.column_stack([columns.pop(name).astype(np.float64) for name in CARTESIAN])
    if set(SPHERICAL) <= set(columns):
        distance, azimuth, elevation = (columns.pop(name).astype(np.float64) for name in SPHERICAL)
        level = distance * np.cos(elevation)
        return np.column_stack([level * np.cos(azimuth), level * np.sin(azimuth), distance * np.sin(elevation)])
    raise InputError(f"{where}: neither cartesian nor spherical coordinates. Export the scan anew.")
