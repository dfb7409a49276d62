"""Clouds from files and arrays."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mapq.cloud import PointCloud
from mapq.io.clouds import read_cloud as read_file
from mapq.io.options import AS_IT_IS, ReadOptions
from prf.shell.errors import ArgumentError

Path = str | os.PathLike[str]


def read_cloud(path: Path, options: ReadOptions = AS_IT_IS) -> PointCloud:
    """Read a cloud of points; the format is recognised from the content.

    Parameters
    ----------
    path : path
        PLY, PCD, LAS, LAZ, E57, PTX, XYZ/TXT/CSV, VTK, .npy, .npz, 3DTK .3d, KITTI .bin or a ROS bag, gzipped or not.
    options : ReadOptions
        What the file does not say itself: its unit, the topic and frame of a bag.

    Raises
    ------
    InputError
        If the file is missing, damaged or of another format, or has no finite point.
    """
    return read_file(os.fspath(path), options)


def point_cloud(
    xyz: ArrayLike, fields: Mapping[str, ArrayLike] | None = None, *, unit: float = 1.0, source: str = "arrays"
) -> PointCloud:
    """Return the cloud of coordinates, with fields that go with them.

    Parameters
    ----------
    xyz : (n, 3) array
        World coordinates; a point that is nan has no place and belongs to no patch.
    fields : mapping of str to (n, ...) array, optional
        Such as `scan`, `time` or `pass_id`, which tell when a point was seen; kept as they are.
    unit : float
        Metres in a unit of the coordinates.
    source : str
        Name for messages.

    Raises
    ------
    ArgumentError
        If shapes do not agree, no point is finite, or the unit is no length.
    """
    world = _numbers("xyz", xyz)
    if world.ndim != 2 or world.shape[1] != 3:
        raise ArgumentError(f"xyz: has shape {world.shape}, must be (n, 3).")
    if not np.isfinite(world).all(axis=1).any():
        raise ArgumentError("xyz: no point is finite.")
    if not (np.isfinite(unit) and unit > 0.0):
        raise ArgumentError(f"unit {unit}: must be a length above 0, in metres.")
    columns = {name: np.asarray(values) for name, values in (fields or {}).items()}
    for name, values in columns.items():
        if values.shape[:1] != (len(world),):
            raise ArgumentError(f"fields[{name!r}]: has shape {values.shape}, must have {len(world)} rows.")
    return PointCloud.from_world(world, columns, source, unit)


def cloud_of(cloud: PointCloud | ArrayLike | Path) -> PointCloud:
    """Return a cloud, or that of coordinates (n, 3), or that in a file."""
    if isinstance(cloud, PointCloud):
        return cloud
    if isinstance(cloud, str | os.PathLike):
        return read_cloud(cloud)
    return point_cloud(cloud)


def _numbers(name: str, values: ArrayLike) -> NDArray[Any]:
    try:
        array = np.asarray(values)
        return array if array.dtype == np.float32 else array.astype(np.float64)
    except (TypeError, ValueError):
        raise ArgumentError(f"{name}: is no array of numbers.") from None
