"""E57 with several scans: each has its pose in the file. Needs pye57, the extra `e57`."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapq.cloud import PointCloud
from mapq.io.fields import cloud_of_world
from prf.shell.errors import InputError

CARTESIAN = ("cartesianX", "cartesianY", "cartesianZ")
SPHERICAL = ("sphericalRange", "sphericalAzimuth", "sphericalElevation")
INVALID = ("cartesianInvalidState", "sphericalInvalidState")
FIELD_NAMES = {"colorRed": "red", "colorGreen": "green", "colorBlue": "blue", "timeStamp": "time_stamp"}
"""Names of fields that our files spell otherwise."""


def open_e57(path: str) -> Any:
    """Open an E57 file.

    Raises
    ------
    InputError
        If pye57 is not installed, or the file cannot be opened.
    """
    try:
        import pye57  # noqa: PLC0415 - an extra of 58 MB
    except ImportError:
        raise InputError(
            f"{path}: E57 is read with pye57, which is not installed. Install prf-mapq[e57] and try again."
        ) from None
    try:
        return pye57.E57(path)
    except Exception as error:  # libE57Format raises its own type, which pye57 does not export
        raise InputError(f"{path}: no E57 file that can be opened. Copy or download it again.") from error


def e57_poses(file: Any, path: str) -> NDArray[np.float64]:
    """Return the poses (k, 4, 4) of the scans; a scan without one stands at the origin of the file.

    Raises
    ------
    InputError
        If the file has no scan.
    """
    if file.scan_count == 0:
        raise InputError(f"{path}: no scan in this file. Give an E57 that has points.")
    poses = np.tile(np.eye(4), (file.scan_count, 1, 1))
    for scan in range(file.scan_count):
        header = file.get_header(scan)
        if header.has_pose():
            poses[scan, :3, :3] = header.rotation_matrix
            poses[scan, :3, 3] = header.translation
    return poses


def read_e57_scan(file: Any, scan: int, path: str) -> PointCloud:
    """Return a scan in its own frame, without the points whose state says that they are invalid.

    Raises
    ------
    InputError
        If it has no coordinates or no valid point.
    """
    where = f"{path} scan {scan}"
    columns = file.read_scan_raw(scan)
    points = _points(columns, where)
    good = np.ones(len(points), bool)
    for name in INVALID:
        good &= columns.pop(name, np.zeros(len(points), np.int8)) == 0
    fields = {FIELD_NAMES.get(name, name): values[good] for name, values in columns.items()}
    return cloud_of_world(points[good], fields, where)


def _points(columns: dict[str, NDArray[Any]], where: str) -> NDArray[np.float64]:
    """Return the coordinates (n, 3), and take their columns away."""
    if set(CARTESIAN) <= set(columns):
        return np.column_stack([columns.pop(name).astype(np.float64) for name in CARTESIAN])
    if set(SPHERICAL) <= set(columns):
        distance, azimuth, elevation = (columns.pop(name).astype(np.float64) for name in SPHERICAL)
        level = distance * np.cos(elevation)
        return np.column_stack([level * np.cos(azimuth), level * np.sin(azimuth), distance * np.sin(elevation)])
    raise InputError(f"{where}: neither cartesian nor spherical coordinates. Export the scan anew.")
