"""Readings from arrays, checked, and answers' points and paths."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from prf.model.sensors import CONE
from prf.readings.points import PointTable
from prf.readings.readings import LogNotes, Readings
from prf.readings.text import DOMAINS
from prf.shell.errors import ArgumentError

Floats = NDArray[np.float64]

FARTHEST = 1e7  # metres: coordinates of a survey grid lie within
LONGEST = 1e4  # metres: a longer range is in another unit, or the number of a driver for "no return", which is inf here
WIDEST = 4.0 * np.pi  # radians: a beam's angle on its sensor beyond it is in degrees


def laser(pose: ArrayLike, angle: ArrayLike, ranges: ArrayLike, *, source: str = "laser arrays") -> Readings:
    """Return the readings of a laser range finder at known poses.

    Parameters
    ----------
    pose : (n_scans, 3) array
        x, y in metres and heading in radians of the sensor at each scan.
    angle : (n_beams,) or (n_scans, n_beams) array
        Direction of each beam on the sensor, radians counter-clockwise from its heading.
    ranges : (n_scans, n_beams) array
        Measured distances, metres; inf, or whatever is at least the maximum range: no return. nan and 0 are no
        readings, and are left out.
    source : str
        Name for messages.

    Raises
    ------
    ArgumentError
        If shapes do not agree, a number is not finite where it must be, or ranges or angles are in another unit.
    """
    return _readings(pose, angle, ranges, 0.0, source)


def sonar(
    pose: ArrayLike, angle: ArrayLike, ranges: ArrayLike, *, cone: float = CONE, source: str = "sonar arrays"
) -> Readings:
    """Return the readings of a ring of sonars at known poses.

    Parameters
    ----------
    pose : (n_scans, 3) or (n_scans, n_beams, 3) array
        As :func:`laser`; or of each transducer by itself, whose own direction `angle` is added to, so mostly 0.
    angle, ranges, source
        As :func:`laser`, a transducer for a beam.
    cone : float
        Full field of view, radians.

    Raises
    ------
    ArgumentError
        As :func:`laser`, and if the cone is not within (0, pi).
    """
    if not 0.0 < cone < np.pi:
        raise ArgumentError(f"cone {cone}: must lie between 0 and pi radians.")
    return _readings(pose, angle, ranges, cone, source)


def points(xy: ArrayLike, value: ArrayLike, *, source: str = "point arrays") -> PointTable:
    """Return values observed at points, such as a bitmap's (docs/sensor-models.md).

    Parameters
    ----------
    xy : (n, 2) array
        Places, metres.
    value : (n,) array
        What was observed there: 0 and 1, or any numbers.
    source : str
        Name for messages.

    Raises
    ------
    ArgumentError
        If shapes do not agree, or a number is not finite.
    """
    places = checked("xy", xy, (None, 2), FARTHEST)
    values = checked("value", value, (len(places),), DOMAINS["value"][1])
    return PointTable(places, values, np.arange(1, len(places) + 1), source)


def _readings(pose: ArrayLike, angle: ArrayLike, ranges: ArrayLike, cone: float, source: str) -> Readings:
    distance = _ranges(ranges)
    n_beams = distance.shape[1]
    poses = checked("pose", pose, (len(distance), n_beams, 3) if np.ndim(pose) == 3 else (len(distance), 3), FARTHEST)
    beams = np.asarray(angle)
    shape = (n_beams,) if beams.ndim == 1 else distance.shape
    on_sensor = np.broadcast_to(checked("angle", beams, shape, WIDEST, "radians"), distance.shape)
    row, beam = np.nonzero(distance > 0.0)
    if len(row) == 0:
        raise ArgumentError("ranges: all are nan or 0, so there is no reading. Give metres, and inf for no return.")
    of_beam = poses[row, beam] if poses.ndim == 3 else poses[row]
    notes = LogNotes("arrays", n_zero_ranges=int((distance == 0.0).sum()), n_invalid=int(np.isnan(distance).sum()))
    return Readings.from_arrays(
        of_beam[:, :2],
        of_beam[:, 2] + on_sensor[row, beam],
        distance[row, beam],
        scan=row,
        beam=beam,
        cone=cone,
        source=source,
        notes=notes,
    )


def _ranges(ranges: ArrayLike) -> Floats:
    """Return ranges (n_scans, n_beams) that may be inf, nan or 0, but neither negative nor in millimetres."""
    distance = _numbers("ranges", ranges)
    _require_shape("ranges", distance, (None, None))
    if (distance < 0.0).any():
        place = _first(distance < 0.0)
        raise ArgumentError(f"ranges{list(place)} is {distance[place]:g}: must be at least 0, or inf for no return.")
    far = np.isfinite(distance) & (distance > LONGEST)
    if far.any():
        place = _first(far)
        raise ArgumentError(
            f"ranges{list(place)} is {distance[place]:g} m: must be a distance in metres, or inf for no return."
        )
    return distance


def checked(
    name: str, values: ArrayLike, shape: tuple[int | None, ...], limit: float = sys.float_info.max, unit: str = "metres"
) -> Floats:
    """Return `values` as float64 if they have a shape (None: any length) and are all finite and within a limit."""
    array = _numbers(name, values)
    _require_shape(name, array, shape)
    bad = ~(np.abs(array) <= limit)
    if bad.any():
        place = _first(bad)
        value = array[place]
        why = f"must be finite and in {unit}" if np.isfinite(value) else "must be finite"
        raise ArgumentError(f"{name}{list(place)} is {value:g}: {why}.")
    return array


def as_paths(paths: ArrayLike | Sequence[ArrayLike]) -> list[Floats]:
    """Return each path as (k, 2) corners; an array (k, 2) is one path."""
    try:
        whole: Any = np.asarray(paths, dtype=np.float64)
    except (TypeError, ValueError):  # paths of several lengths
        whole = None
    if whole is not None and whole.ndim == 2:
        return [checked("path", whole, (None, 2))]
    return [checked(f"paths[{number}]", path, (None, 2)) for number, path in enumerate(paths)]  # type: ignore[arg-type]


def _numbers(name: str, values: ArrayLike) -> Floats:
    try:
        return np.ascontiguousarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise ArgumentError(f"{name}: must be an array of numbers.") from None


def _require_shape(name: str, array: NDArray[Any], shape: tuple[int | None, ...]) -> None:
    fits = array.ndim == len(shape) and all(n is None or n == m for n, m in zip(shape, array.shape, strict=True))
    if not fits:
        wanted = ", ".join("n" if n is None else str(n) for n in shape)
        raise ArgumentError(f"{name}: has shape {array.shape}, must be ({wanted}{',' if len(shape) == 1 else ''}).")


def _first(mask: NDArray[np.bool_]) -> tuple[int, ...]:
    return tuple(int(i) for i in np.argwhere(mask)[0])
