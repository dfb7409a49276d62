"""From the columns of a file, by name, to a `PointCloud`; the checks that every reader shares."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapq.cloud import PointCloud
from prf.shell.errors import InputError

logger = logging.getLogger(__name__)

Array = NDArray[Any]

SHOWN = 20
"""Names told in a line; a damaged header may have thousands."""

AXES = (("x", "y", "z"), ("X", "Y", "Z"))
"""Names of the coordinates, in the order in which they are looked for; a file uses one row."""

LARGEST_COORDINATE = 1e9
"""Metres. Beyond the planet, and small enough that a tenth of a micrometre survives in double precision."""

NUMBERS = "iuf"
"""Kinds of numpy type that can be coordinates: integers and floating point."""


def axes_of(names: Sequence[str], source: str) -> tuple[str, str, str]:
    """Return the names of the three coordinates among `names`.

    Raises
    ------
    InputError
        If there are none; the line says which fields there are.
    """
    for axes in AXES:
        if set(axes) <= set(names):
            return axes
    shown = ", ".join(names[:SHOWN]) + (", ..." if len(names) > SHOWN else "")
    raise InputError(f"{source}: no fields x, y, z; there are {shown or 'none'}. Rename the coordinates to x, y, z.")


def make_cloud(fields: Mapping[str, Array], source: str, unit: float = 1.0) -> PointCloud:
    """Return the cloud of named columns.

    Parameters
    ----------
    fields : mapping of str to (n, ...) array
        Coordinates x, y, z (or X, Y, Z), each (n,), and everything else, in the order of the file.
    source : str
        Name of the file, for messages.
    unit : float
        Metres in a unit of the coordinates.

    Returns
    -------
    PointCloud
        In native byte order, arrays of its own. Fields that are not numbers are dropped with a warning.

    Raises
    ------
    InputError
        Without coordinates or finite points, or if a coordinate lies beyond `LARGEST_COORDINATE`.
    """
    axes = axes_of(list(fields), source)
    columns = [fields[name] for name in axes]
    for name, column in zip(axes, columns, strict=True):
        if column.dtype.kind not in NUMBERS or column.ndim != 1:
            raise InputError(f"{source}: field {name} is not one real number a point. Save coordinates as float.")
    kind = np.float32 if all(column.dtype.newbyteorder("=") == np.float32 for column in columns) else np.float64
    world = np.empty((len(columns[0]), 3), kind)
    for axis, column in enumerate(columns):
        world[:, axis] = column
    rest = {name: values for name, values in fields.items() if name not in axes}
    return cloud_of_world(world, rest, source, unit)


def cloud_of_world(
    world: Array, fields: Mapping[str, Array], source: str, unit: NDArray[np.float64] | float = 1.0
) -> PointCloud:
    """Return the cloud of world coordinates (n, 3) and other fields; parameters and errors as :func:`make_cloud`."""
    if len(world) == 0:
        raise InputError(f"{source}: no points. Check how the file was written.")
    check_coordinates(world, source)
    return PointCloud.from_world(world, keep_numbers(fields, source), source, unit)


def check_coordinates(world: Array, source: str) -> None:
    """Refuse coordinates (n, 3) without a finite point, or with one beyond `LARGEST_COORDINATE`."""
    finite = np.ones(len(world), bool)
    far = np.zeros(len(world), bool)
    for column in world.T:  # one at a time: large clouds have no memory to spare
        known = np.isfinite(column)
        finite &= known
        far |= known & (np.abs(column) > LARGEST_COORDINATE)
    if not finite.any():
        raise InputError(f"{source}: all {len(world)} points are nan or infinite. Check how the file was written.")
    if far.any():
        point = int(far.argmax())
        axis = int((np.isfinite(world[point]) & (np.abs(world[point]) > LARGEST_COORDINATE)).argmax())
        raise InputError(
            f"{source}: {'xyz'[axis]} of point {point} is {world[point, axis]:g}, beyond {LARGEST_COORDINATE:g} m. "
            f"Remove such points, or set them to nan."
        )


def keep_numbers(fields: Mapping[str, Array], source: str) -> dict[str, Array]:
    """Return the fields that are numbers or truth values, contiguous and in native byte order; warn of the others."""
    kept, dropped = {}, []
    for name, values in fields.items():
        if values.dtype.kind in NUMBERS + "b":
            is_ready = values.flags.c_contiguous and values.flags.writeable and values.dtype.isnative
            kept[name] = values if is_ready else np.array(values, dtype=values.dtype.newbyteorder("="), order="C")
        else:
            dropped.append(name)
    warn_dropped(dropped, source)
    return kept


def warn_dropped(names: Sequence[str], source: str, why: str = "not numbers", kind: str = "field") -> None:
    """Warn, in one line however many there are, of fields that are left out."""
    if not names:
        return
    shown = ", ".join(names[:SHOWN]) + (f" and {len(names) - SHOWN} more" if len(names) > SHOWN else "")
    told = f"{kind} {shown} is" if len(names) == 1 else f"{kind}s {shown} are"
    logger.warning("%s: %s dropped: %s", source, told, why)


def columns_of(table: Array) -> dict[str, Array]:
    """Return the columns of a structured array (n,), views of it."""
    return {name: table[name] for name in table.dtype.names or ()}


def refuse_doubles(names: Sequence[str], source: str) -> None:
    """Refuse a name that stands for two fields."""
    doubled = sorted({name for name in names if names.count(name) > 1})
    if doubled:
        raise InputError(f"{source}: field {doubled[0]} stands twice. Rename one of the two.")
