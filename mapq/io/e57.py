"""E57: scans, each with its pose. Needs pye57, the extra `e57`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapq.cloud import PointCloud
from mapq.io.content import Content
from mapq.io.fields import LARGEST_COORDINATE, Array, cloud_of_world, warn_dropped
from mapq.io.joined import joined_fields
from mapq.io.options import ReadOptions
from prf.shell.errors import InputError

CARTESIAN = ("cartesianX", "cartesianY", "cartesianZ")
SPHERICAL = ("sphericalRange", "sphericalAzimuth", "sphericalElevation")
INVALID = ("cartesianInvalidState", "sphericalInvalidState")
FIELD_NAMES = {"colorRed": "red", "colorGreen": "green", "colorBlue": "blue", "timeStamp": "time_stamp"}
"""Names of fields that our files spell otherwise."""

CHUNK = 200_000
"""Points that are decoded at once."""

WHOLE = tuple((code, np.iinfo(code)) for code in "bBhHq")
"""Types of whole numbers that pye57 can fill, the narrow ones first."""


def read_e57(content: Content, options: ReadOptions) -> PointCloud:
    """Return all scans of an E57 file in its frame: poses applied, points that are marked invalid dropped.

    Where there are several scans the field `scan` numbers them.

    Raises
    ------
    InputError
        If pye57 is not installed, the file is damaged, or no valid point is in it.
    """
    with content.file() as path:
        file = open_e57(str(path), content.source)
        poses = e57_poses(file, content.source)
        parts = [read_e57_columns(file, scan, content.source) for scan in range(len(poses))]
        file.close()
    world = np.concatenate(
        [points @ pose[:3, :3].T + pose[:3, 3] for pose, (points, _) in zip(poses, parts, strict=True)]
    )
    fields = joined_fields([columns for _, columns in parts], [len(points) for points, _ in parts], content.source)
    return cloud_of_world(world, fields, content.source, options.unit or 1.0)


def open_e57(path: str, source: str) -> Any:
    """Open the E57 file `path`, which messages call `source`.

    Raises
    ------
    InputError
        If pye57 is not installed, or the file cannot be opened.
    """
    try:
        import pye57  # noqa: PLC0415 - an extra of 58 MB
    except ImportError:
        raise InputError(
            f"{source}: E57 is read with pye57, which is not installed. Install prf-mapq[e57] and try again."
        ) from None
    try:
        return pye57.E57(path)
    except Exception as error:  # libE57Format raises its own type, which pye57 does not export
        raise InputError(f"{source}: no E57 file that can be opened. Copy or download it again.") from error


def e57_poses(file: Any, source: str) -> NDArray[np.float64]:
    """Return the poses (k, 4, 4) of the scans; a scan without one stands at the origin of the file.

    Raises
    ------
    InputError
        If the file has no scan, or a pose is no rigid motion.
    """
    if file.scan_count == 0:
        raise InputError(f"{source}: no scan in this file. Give an E57 that has points.")
    poses = np.tile(np.eye(4), (file.scan_count, 1, 1))
    try:
        for scan in range(file.scan_count):
            header = file.get_header(scan)
            if header.has_pose():
                poses[scan, :3, :3] = header.rotation_matrix
                poses[scan, :3, 3] = header.translation
    except Exception as error:  # as above, and what pye57 makes of a tree that lacks a part
        raise InputError(f"{source}: the pose of a scan is damaged. Copy or download the file again.") from error
    if not (np.abs(poses) <= LARGEST_COORDINATE).all():
        raise InputError(
            f"{source}: the pose of a scan is not finite, or beyond {LARGEST_COORDINATE:g} m. Export the file anew."
        )
    return poses


def read_e57_scan(file: Any, scan: int, source: str) -> PointCloud:
    """Return a scan in its own frame; errors as :func:`read_e57_columns`."""
    points, fields = read_e57_columns(file, scan, source)
    return cloud_of_world(points, fields, f"{source} scan {scan}")


def read_e57_columns(file: Any, scan: int, source: str) -> tuple[NDArray[np.float64], dict[str, Array]]:
    """Return the points (n, 3) of a scan in its own frame and their other fields, without those marked invalid.

    Raises
    ------
    InputError
        If it has no coordinates, or its points are damaged or cut off.
    """
    where = f"{source} scan {scan}"
    columns = _raw_columns(file, scan, where)
    points = take_points(columns, where)
    good = np.ones(len(points), bool)
    for name in INVALID:
        good &= columns.pop(name, np.zeros(len(points), np.int8)) == 0
    fields = {FIELD_NAMES.get(name, name): values[good] for name, values in columns.items()}
    return points[good], fields


def _raw_columns(file: Any, scan: int, where: str) -> dict[str, Array]:
    """Return all fields of a scan that are numbers, decoded piece by piece: the count is not believed before."""
    try:
        header = file.get_header(scan)
        if header.point_count > 8 * Path(file.path).stat().st_size:
            raise InputError(f"{where}: damaged: {header.point_count} points are more than the file can hold.")
        types = {name: code for name in header.point_fields if (code := _code(header, name))}
        warn_dropped([name for name in header.point_fields if name not in types], where)
        # pye57 itself takes colours and rows for narrower than they may be, and knows the standard fields alone.
        buffers, pieces = _buffers(file, types, min(CHUNK, header.point_count)), []
        reader = header.points.reader(buffers[1])
        while n_read := reader.read():
            pieces.append({name: values[:n_read].copy() for name, values in buffers[0].items()})
        reader.close()
        columns = {name: np.concatenate([piece[name] for piece in pieces] or [buffers[0][name][:0]]) for name in types}
    except (InputError, MemoryError):
        raise
    except Exception as error:
        words = " ".join(str(error).split()).partition(" **** ")[0][:120] or type(error).__name__
        raise InputError(f"{where}: the points are damaged ({words}). Copy or download the file again.") from error
    n_points = sum(len(next(iter(piece.values()))) for piece in pieces)
    if n_points != header.point_count:
        raise InputError(f"{where}: cut off: {header.point_count} points are promised, {n_points} follow.")
    return columns


def _code(header: Any, name: str) -> str:
    """Return the type code in which pye57 gives a field, empty for text."""
    from pye57 import libe57  # noqa: PLC0415

    node = libe57.StructureNode(header.points.prototype())[name]
    if isinstance(node, libe57.IntegerNode):
        low, high = node.minimum(), node.maximum()
        return next((code for code, limits in WHOLE if limits.min <= low and high <= limits.max), "q")
    if isinstance(node, libe57.ScaledIntegerNode):
        return "d"
    if isinstance(node, libe57.FloatNode):
        is_single = node.precision() == libe57.FloatPrecision.E57_SINGLE
        return "f" if is_single and name not in (*CARTESIAN, *SPHERICAL) else "d"
    return ""


def _buffers(file: Any, types: dict[str, str], size: int) -> tuple[dict[str, Array], Any]:
    """Return arrays (size,) by name, and what pye57 needs to fill them."""
    from pye57 import libe57  # noqa: PLC0415

    arrays = {name: np.empty(size, code) for name, code in types.items()}
    targets = libe57.VectorSourceDestBuffer()
    for name, values in arrays.items():
        targets.append(libe57.SourceDestBuffer(file.image_file, name, values, size, True, True))
    return arrays, targets


def take_points(columns: dict[str, NDArray[Any]], where: str) -> NDArray[np.float64]:
    """Return the coordinates (n, 3), and take their columns away: cartesian, or spherical in metres and radians."""
    if set(CARTESIAN) <= set(columns):
        return np.column_stack([columns.pop(name).astype(np.float64) for name in CARTESIAN])
    if set(SPHERICAL) <= set(columns):
        distance, azimuth, elevation = (columns.pop(name).astype(np.float64) for name in SPHERICAL)
        level = distance * np.cos(elevation)
        return np.column_stack([level * np.cos(azimuth), level * np.sin(azimuth), distance * np.sin(elevation)])
    raise InputError(f"{where}: neither cartesian nor spherical coordinates. Export the scan anew.")
