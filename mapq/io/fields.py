"""From the columns of a file, by name, to a `PointCloud`; names and types of columns for writers."""

from __future__ import annotations

import logging
import re
from collections.abc import Collection, Container, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapq.axes import TO_SENSOR
from mapq.cloud import PointCloud
from prf.shell.errors import InputError

logger = logging.getLogger(__name__)

Array = NDArray[Any]

AXES = (("x", "y", "z"), ("X", "Y", "Z"))
"""Names of the coordinates, in the order in which they are looked for."""

LARGEST_COORDINATE = 1e9
"""Metres: beyond the planet, and small enough that double precision keeps a tenth of a micrometre."""

NUMBERS = "iuf"
"""Kinds of numpy type that can be coordinates: integers and floating point."""

SCAN, TIME = "scan", "time"
"""Fields that number the scans of a file with several, and have their times in seconds."""

COLOURS = ("red", "green", "blue")

ORIGINAL = "original_"
"""Prefix of a cloud's own fields whose names a result needs."""


def axes_of(names: Sequence[str], source: str) -> tuple[str, str, str]:
    """Return the names of the three coordinates among `names`; InputError if they are not there."""
    for axes in AXES:
        if set(axes) <= set(names):
            return axes
    if "range" in names:
        raise InputError(f"{source}: a table of 2D readings, of which prf makes maps: prf info FILE.")
    raise InputError(
        f"{source}: no fields x, y, z; there are {_listed(names) or 'none'}. Rename the coordinates to x, y, z."
    )


def _listed(names: Sequence[str], most: int = 20) -> str:
    rest = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(names[:most]) + rest


def make_cloud(fields: Mapping[str, Array], source: str, unit: float = 1.0) -> PointCloud:
    """Return the cloud of named columns, in native byte order; fields that are not numbers are dropped with a warning.

    Parameters
    ----------
    fields : mapping of str to (n, ...) array
        Coordinates x, y, z (or X, Y, Z), each (n,), and everything else, in the order of the file.
    source : str
        Name of the file, for messages.
    unit : float
        Metres in a unit of the coordinates.
    """
    axes = axes_of(list(fields), source)
    columns = [fields[name] for name in axes]
    if any(column.dtype.kind not in NUMBERS or column.ndim != 1 for column in columns):
        raise InputError(f"{source}: x, y, z must be one real number each per point. Save coordinates as float.")
    kind = np.float32 if all(column.dtype.newbyteorder("=") == np.float32 for column in columns) else np.float64
    world = np.empty((len(columns[0]), 3), kind)
    for axis, column in enumerate(columns):
        world[:, axis] = column
    return cloud_of_world(world, {name: fields[name] for name in fields if name not in axes}, source, unit)


def cloud_of_world(
    world: Array, fields: Mapping[str, Array], source: str, unit: NDArray[np.float64] | float = 1.0
) -> PointCloud:
    """Return the cloud of world coordinates (n, 3) and other fields; parameters and errors as :func:`make_cloud`."""
    if len(world) == 0:
        raise InputError(f"{source}: no points. Check how the file was written.")
    check_coordinates(world, source)
    kept = {
        name: np.require(values, values.dtype.newbyteorder("="), ["C", "W"])
        for name, values in fields.items()
        if values.dtype.kind in NUMBERS + "b"
    }
    warn_dropped([name for name in fields if name not in kept], source)
    return PointCloud.from_world(world, kept, source, unit)


def check_coordinates(world: Array, source: str) -> None:
    """Refuse coordinates (n, 3) without a finite point, or with one beyond `LARGEST_COORDINATE`."""
    finite = np.ones(len(world), bool)
    for axis, column in enumerate(world.T):  # one at a time: large clouds leave no memory to spare
        known = np.isfinite(column)
        finite &= known
        far = known & (np.abs(column) > LARGEST_COORDINATE)
        if far.any():
            point = int(far.argmax())
            raise InputError(
                f"{source}: {'xyz'[axis]} of point {point} is {column[point]:g}, beyond {LARGEST_COORDINATE:g} m. "
                f"Remove such points, or set them to nan."
            )
    if not finite.any():
        raise InputError(f"{source}: all {len(world)} points are nan or infinite. Check how the file was written.")


def warn_dropped(names: Sequence[str], source: str, why: str = "not numbers") -> None:
    """Warn, in one line, of fields that are left out."""
    if names:
        what = f"field {names[0]} is" if len(names) == 1 else f"fields {_listed(names)} are"
        logger.warning("%s: %s dropped: %s", source, what, why)


def refuse_doubles(names: Sequence[str], source: str) -> None:
    """Refuse a name of two fields."""
    doubled = [name for number, name in enumerate(names) if name in names[:number]]
    if doubled:
        raise InputError(f"{source}: there are two fields {doubled[0]}. Rename one of them.")


def columns_of(table: Array) -> dict[str, Array]:
    """Return the columns of a structured array (n,), views of it."""
    return {name: table[name] for name in table.dtype.names or ()}


def joined_fields(parts: Sequence[Mapping[str, Array]], counts: Sequence[int], source: str) -> dict[str, Array]:
    """Return the fields of scans with this many points, and `scan` if several have no such field."""
    fields = common_fields(parts, source)
    if len(parts) > 1 and SCAN not in fields:
        fields[SCAN] = np.repeat(np.arange(len(parts), dtype=np.int32), counts)
    return fields


def common_fields(parts: Sequence[Mapping[str, Array]], source: str) -> dict[str, Array]:
    """Return the fields (n, ...) that all scans have in one shape, scan after scan; a warning names the others."""
    fields, dropped = {}, []
    for name in dict.fromkeys(name for part in parts for name in part):
        values = [part[name] for part in parts if name in part]
        if len(values) == len(parts) and len({each.shape[1:] for each in values}) == 1:
            fields[name] = np.concatenate(values)
        else:
            dropped.append(name)
    warn_dropped(dropped, source, "not alike in every scan")
    return fields


def to_sensor_fields(world: Array, sensor: Array, unit: float = 1.0) -> dict[str, Array]:
    """Return the way from places (n, 3) to their sensors (n, 3), both in units of this many metres, as point fields.

    A difference in metres, so that large coordinates lose nothing in single precision.
    """
    return dict(zip(TO_SENSOR, ((sensor - world) * unit).astype(np.float32).T, strict=True))


def fields_of_scans(world: Array, places: Array, counts: Sequence[int], unit: float = 1.0) -> dict[str, Array]:
    """Return the way to the sensor of points (n, 3) of scans, taken at places (k, 3), if these differ."""
    if not np.ptp(places, axis=0).any():
        return {}
    return to_sensor_fields(world, np.repeat(places, counts, axis=0), unit)


def original_names(fields: Mapping[str, Array], needed: Collection[str]) -> dict[str, Array]:
    """Return the fields; those with a `needed` name get the prefix `ORIGINAL`, as often as it takes."""
    renamed: dict[str, Array] = {}
    for name, values in fields.items():
        free = name
        while free in needed or (free != name and (free in fields or free in renamed)):
            free = ORIGINAL + free
        renamed[free] = values
    return renamed


def scalar_columns(name: str, values: Array) -> Iterator[tuple[str, Array]]:
    """Yield the columns (n,) of a field (n, ...) by name: `name_0` and so on where there are several."""
    if values.ndim == 1:
        yield name, values
        return
    for number, column in enumerate(values.reshape(len(values), -1).T):
        yield f"{name}_{number}", column


def free_name(name: str, taken: Container[str], longest: int | None = None) -> str:
    """Return a name of printable ASCII without blanks, at most `longest` long and not taken, close to `name`."""
    valid = re.sub(r"[^!-~]", "_", name)[:longest] or "field"
    free, number = valid, 2
    while free in taken:
        end = f"_{number}"
        free = (valid if longest is None else valid[: longest - len(end)]) + end
        number += 1
    if free != name:
        logger.info("field %r is written as %s", name, free)
    return free
