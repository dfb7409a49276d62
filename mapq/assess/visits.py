"""When each point was seen, and when a surface that is seen again is seen on another visit.

A visit lasts as long as the sensor stays about: within one, what is wrong is local; from one to the next the drive has
been elsewhere, and errors have grown that closing the loop would have removed.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.cloud import PointCloud
from mapq.features.provenance import PASS, SCAN, TIME, TO_SENSOR

TIMES, PASSES = (TIME, "gps_time"), (PASS, "point_source_id")
"""Fields of seconds, and of numbers of passes: the names of this package, then those of LAS."""

MOMENT = 1.0
"""Seconds of a moment, where scans are not known."""
MOST_MOMENTS = 1_000_000
"""Times that span more are none: a field of that name may hold anything."""
AWAY = 40.0
"""Metres driven since a surface was last seen from which on seeing it again is another visit; where it is not known
where the sensor was, metres that what it saw lies away from what it saw then."""
CHUNK = 256
"""Later places that are looked at together."""

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


class Visits(NamedTuple):
    """Moments of the points of a cloud, and how long one visit lasts.

    Attributes
    ----------
    moment : (n,) int64
        Of each point, from 0 in the order of the drive: its scan, second or pass; -1 where it is not known.
    leaves : (k,) int64
        Of each moment the first later one from which on a surface not seen in between is on another visit; k: none.
    way : (k,) float64 or None
        Metres driven up to each moment; None where it is not known from where points were seen.
    seconds : (k,) float64 or None
        Time of each moment.
    unit : str
        What moments are: ``scan``, ``second`` or ``pass``.
    to_sensor : (n, 3) float64 or None
        From each point to its sensor, in metres; None where that is not known.
    """

    moment: Ints
    leaves: Ints
    way: Floats | None
    seconds: Floats | None
    unit: str
    to_sensor: Floats | None = None

    def new_visit(self, earlier: Ints, later: Ints) -> NDArray[np.bool_]:
        """Return whether a surface seen at moments (m,) and not again until `later` (m,) is then on another visit."""
        return np.asarray(later >= self.leaves[earlier])


def visits_of(cloud: PointCloud) -> Visits | None:
    """Return when the points of a cloud were seen: by its scans, else its times, else its passes; None if unknown."""
    known = cloud.finite()
    times = _column(cloud, TIMES)
    for unit, values in (("scan", _column(cloud, (SCAN,))), ("second", times), ("pass", _column(cloud, PASSES))):
        if values is None:
            continue
        usable = known & np.isfinite(values)
        found = _numbered(values[usable], unit)
        if found is not None:
            moment = np.full(len(cloud), -1, np.int64)
            moment[usable] = found[1]
            return _visits(cloud, moment, found[0], unit, times)._replace(to_sensor=_to_sensor(cloud))
    return None


def _column(cloud: PointCloud, names: tuple[str, ...]) -> Floats | None:
    for name in names:
        values = cloud.fields.get(name)
        if values is not None and values.ndim == 1 and values.dtype.kind in "fiub":
            return np.asarray(values, np.float64)
    return None


def _numbered(values: Floats, unit: str) -> tuple[Floats, Ints] | None:
    """Return the values of moments (k,), ascending, and the moment (n,) of each point; None if there is only one."""
    if len(values) == 0:
        return None
    if unit == "second":
        if not MOMENT < np.ptp(values) < MOST_MOMENTS * MOMENT:
            return None
        values = np.floor((values - values.min()) / MOMENT)
    elif (values != np.floor(values)).any():
        return None
    distinct, number = np.unique(values, return_inverse=True)
    return (distinct, number.astype(np.int64)) if len(distinct) > 1 else None


def _visits(cloud: PointCloud, moment: Ints, value: Floats, unit: str, times: Floats | None) -> Visits:
    rows = np.flatnonzero(moment >= 0)
    order = rows[np.argsort(moment[rows], kind="stable")]
    counts = np.bincount(moment[rows])
    groups = np.split(order, np.cumsum(counts)[:-1])
    seconds = None if times is None else np.array([_middle(times[group]) for group in groups])
    if unit == "pass":
        return Visits(moment, np.arange(1, len(counts) + 1), None, seconds, unit)
    sensor = _sensors(cloud, groups)
    place = sensor if sensor is not None else np.array([np.median(cloud.xyz[group], axis=0) for group in groups])
    # Neighbours in the order of the drive are one visit, however sparse they are.
    after_next = np.searchsorted(value, value + 1.5 * np.median(np.diff(value)))
    if sensor is None:
        return Visits(moment, np.maximum(_first_away(place), after_next), None, seconds, unit)
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(place, axis=0), axis=1))])
    return Visits(moment, np.maximum(np.searchsorted(way, way + AWAY, side="right"), after_next), way, seconds, unit)


def _middle(values: Floats) -> float:
    finite = values[np.isfinite(values)]
    return float(np.median(finite)) if len(finite) else float("nan")


def _to_sensor(cloud: PointCloud) -> Floats | None:
    """Return the way from each point to its sensor (n, 3) in metres; None where the cloud does not say."""
    columns = [_column(cloud, (name,)) for name in TO_SENSOR]
    known = [column for column in columns if column is not None]
    return np.column_stack(known) if len(known) == len(columns) else None


def _sensors(cloud: PointCloud, groups: list[NDArray[np.intp]]) -> Floats | None:
    """Return where the sensor was at each moment (k, 3); None unless that is known of all."""
    away = _to_sensor(cloud)
    if away is None:
        return None
    found = np.array([np.median(cloud.xyz[group] + away[group], axis=0) for group in groups])
    return found if np.isfinite(found).all() else None


def _first_away(place: Floats) -> Ints:
    """Return for each place (k, 3) the first later one that is `AWAY` from it; k where none is."""
    found = np.full(len(place), len(place), np.int64)
    # The box of all later places tells at once that nothing lies so far off, as where a sensor stands.
    low, high = (each.accumulate(place[::-1])[::-1] for each in (np.minimum, np.maximum))
    for start in np.flatnonzero(np.linalg.norm(np.maximum(place - low, high - place), axis=1) > AWAY):
        for begin in range(start + 1, len(place), CHUNK):
            far = np.linalg.norm(place[begin : begin + CHUNK] - place[start], axis=1) > AWAY
            if far.any():
                found[start] = begin + int(np.argmax(far))
                break
    return found
