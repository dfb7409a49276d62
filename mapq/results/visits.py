"""When each point was seen, and when a surface that is seen again is seen on another visit.

A visit lasts as long as the sensor stays about: within one, what is wrong is local; from one to the next the drive has
been elsewhere, and errors have grown that closing the loop would have removed.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.cloud import PointCloud
from mapq.features.disagreement import PASS, SCAN, TIME, TO_SENSOR, Span, spans_of

TIMES, PASSES = (TIME, "gps_time"), (PASS, "point_source_id")
"""Fields of seconds, and of numbers of passes: the names of this package, then those of LAS."""
FIELDS = (SCAN, *TIMES, *PASSES, *TO_SENSOR)

MOMENT = 1.0
"""Seconds of a moment, where scans are not known."""
MOST_MOMENTS = 1_000_000
"""Values that span more are not times: a field of that name may hold anything."""
AWAY = 40.0
"""Metres driven since a surface was last seen from which on seeing it again is another visit; where it is not known
where the sensor was, metres that what it saw lies away from what it saw then."""
CHUNK = 256
"""Later places that are looked at together."""

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


class Visits(NamedTuple):
    """Moments of the points of a cloud, and how long one visit lasts."""

    # (n,) of each point, from 0 in the order of the drive: its scan, second or pass; -1 where it is not known
    moment: Ints
    # (k,) of each moment the first later one from which on a surface not seen in between is on another visit; k: none
    leaves: Ints
    way: Floats | None  # (k,) metres driven up to each moment; None where it is not known from where points were seen
    seconds: Floats | None  # (k,) time of each moment
    unit: str  # what moments are: ``scan``, ``second`` or ``pass``
    to_sensor: Floats | None = None  # (n, 3) from each point to its sensor, in metres; None where that is not known

    def new_visit(self, earlier: Ints, later: Ints) -> NDArray[np.bool_]:
        """Return whether a surface seen at moments (m,) and not again until `later` (m,) is then on another visit."""
        return np.asarray(later >= self.leaves[earlier])


class Clock(NamedTuple):
    """Which fields record when and from where points were seen; decided once for a map."""

    unit: str  # what moments are, as of :class:`Visits`
    field: str  # that holds them
    start: float  # its least value
    times: str | None  # field of seconds
    has_sensor: bool  # whether it is known where the sensor was

    @property
    def fields(self) -> tuple[str, ...]:
        """Names of the fields that count."""
        sensor = TO_SENSOR if self.has_sensor else ()
        return tuple(dict.fromkeys(name for name in (self.field, self.times, *sensor) if name is not None))

    def values(self, cloud: PointCloud) -> Floats:
        """Return a number (n,) of the moment of each point of a cloud, ascending along the drive; nan if unknown."""
        found = np.asarray(cloud.fields[self.field], np.float64)
        return np.floor((found - self.start) / MOMENT) if self.unit == "second" else found


class Stays(NamedTuple):
    """Where the sensor was at the moments (k) of a drive."""

    value: Floats  # (k,) of the clock, ascending
    n_points: Ints  # (k,)
    place: Floats  # (k, 3) of what was seen, and of the sensor; nan where it is not known
    sensor: Floats  # (k, 3)
    seconds: Floats  # (k,) time, nan where it is not known


def clock_of(spans: Mapping[str, Span]) -> Clock | None:
    """Return by what the points of a map were seen: its scans, else its times, else its passes; None if unknown.

    `spans`: what those of `FIELDS` hold that the map has.
    """
    times = next((name for name in TIMES if _is_clock(spans.get(name, Span()))), None)
    passes = next((name for name in PASSES if _are_numbers(spans.get(name, Span()))), None)
    scan = SCAN if _are_numbers(spans.get(SCAN, Span())) else None
    for unit, name in (("scan", scan), ("second", times), ("pass", passes)):
        if name is not None:
            return Clock(unit, name, spans[name].low, times, all(each in spans for each in TO_SENSOR))
    return None


def _is_clock(span: Span) -> bool:
    """Return whether a field holds the times of a drive: not those within a turn of the laser, nor anything else."""
    return MOMENT < span.high - span.low < MOST_MOMENTS * MOMENT


def _are_numbers(span: Span) -> bool:
    """Return whether a field numbers scans or passes, and has two different values at least."""
    return span.high > span.low and span.is_whole


def visits_of(cloud: PointCloud) -> Visits | None:
    """Return when the points of a cloud were seen; None if unknown."""
    clock = clock_of(spans_of(cloud, FIELDS))
    if clock is None:
        return None
    stays, moment = stays_of(cloud, clock)
    return visits_from(clock, stays, moment, to_sensor_of(cloud, clock))


def to_sensor_of(cloud: PointCloud, clock: Clock) -> Floats | None:
    """Return the way from each point to its sensor (n, 3) in metres; None where the cloud does not record it."""
    if not clock.has_sensor:
        return None
    return np.column_stack([np.asarray(cloud.fields[name], np.float64) for name in TO_SENSOR])


def stays_of(cloud: PointCloud, clock: Clock) -> tuple[Stays, Ints]:
    """Return where the sensor was at each moment, by medians over its points, and the moment (n,) of each point."""
    values = clock.values(cloud)
    rows = np.flatnonzero(cloud.finite() & np.isfinite(values))
    moment = np.full(len(cloud), -1, np.int64)
    value, moment[rows], n_points = np.unique(values[rows], return_inverse=True, return_counts=True)
    order = rows[np.argsort(moment[rows], kind="stable")]
    groups = np.split(order, np.cumsum(n_points)[:-1])
    away, unknown = to_sensor_of(cloud, clock), np.full((len(value), 3), np.nan)
    times = None if clock.times is None else np.asarray(cloud.fields[clock.times], np.float64)
    stays = Stays(
        value,
        n_points.astype(np.int64),
        np.array([np.median(cloud.xyz[group], axis=0) for group in groups]),
        unknown if away is None else np.array([_middle_place(cloud.xyz[g] + away[g]) for g in groups]),
        unknown[:, 0] if times is None else np.array([_middle(times[group]) for group in groups]),
    )
    return stays, moment


def join_stays(parts: list[Stays]) -> Stays:
    """Return where the sensor was, by means over the parts of a map: medians cannot be combined from those."""
    value, moment = np.unique(np.concatenate([part.value for part in parts]), return_inverse=True)
    weight = np.concatenate([part.n_points for part in parts])
    n_points = np.bincount(moment, weight, len(value))
    columns = np.concatenate([np.column_stack([part.place, part.sensor, part.seconds]) for part in parts]).T
    means = []
    for column in columns:
        counted = np.where(np.isfinite(column), weight, 0)
        with np.errstate(invalid="ignore"):
            mean = np.bincount(moment, counted * np.nan_to_num(column), len(value)) / np.bincount(
                moment, counted, len(value)
            )
        means.append(mean)
    place, sensor = np.column_stack(means[:3]), np.column_stack(means[3:6])
    return Stays(value, n_points.astype(np.int64), place, sensor, means[6])


def visits_from(clock: Clock, stays: Stays, moment: Ints, to_sensor: Floats | None) -> Visits:
    """Return how long visits last, and the moments (n,) of points, from where the sensor was.

    `moment` (n,). `to_sensor` (n, 3).
    """
    value, n_moments = stays.value, len(stays.value)
    seconds = None if clock.times is None else stays.seconds
    if clock.unit == "pass":
        return Visits(moment, np.arange(1, n_moments + 1), None, seconds, clock.unit, to_sensor)
    # Neighbours in the order of the drive are one visit, however sparse they are.
    after_next = np.searchsorted(value, value + 1.5 * np.median(np.diff(value)))
    if not np.isfinite(stays.sensor).all():
        leaves = np.maximum(_first_away(stays.place), after_next)
        return Visits(moment, leaves, None, seconds, clock.unit, to_sensor)
    steps = np.linalg.norm(np.diff(stays.sensor, axis=0), axis=1)
    way = np.concatenate([[0.0], np.cumsum(steps)])
    leaves = np.maximum(np.searchsorted(way, way + AWAY, side="right"), after_next)
    return Visits(moment, leaves, way, seconds, clock.unit, to_sensor)


def _middle_place(places: Floats) -> Floats:
    """Return the median of those of some places (k, 3) that are known; nan of none."""
    known = places[np.isfinite(places).all(axis=1)]
    return np.median(known, axis=0) if len(known) else np.full(3, np.nan)


def _middle(values: Floats) -> float:
    finite = values[np.isfinite(values)]
    return float(np.median(finite)) if len(finite) else float("nan")


def _first_away(place: Floats) -> Ints:
    """Return for each place (k, 3) the first later one that is `AWAY` from it; k where none is."""
    found = np.full(len(place), len(place), np.int64)
    # The box of all later places shows at once that nothing lies so far off, as where a sensor does not move.
    low, high = (each.accumulate(place[::-1])[::-1] for each in (np.minimum, np.maximum))
    for start in np.flatnonzero(np.linalg.norm(np.maximum(place - low, high - place), axis=1) > AWAY):
        for begin in range(start + 1, len(place), CHUNK):
            far = np.linalg.norm(place[begin : begin + CHUNK] - place[start], axis=1) > AWAY
            if far.any():
                found[start] = begin + int(np.argmax(far))
                break
    return found
