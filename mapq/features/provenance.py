"""Where and when the points of a map were seen, as far as its fields record it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.axes import TO_SENSOR as TO_SENSOR
from mapq.cloud import PointCloud

SCAN, TIME, PASS = "scan", "time", "pass_id"
"""Point fields that are read, besides the way to the sensor: number of the scan, seconds, number of the pass."""
FIELDS = (SCAN, TIME, PASS, *TO_SENSOR)

MOMENT = 10.0
"""Seconds of a moment, where times are known but scans are not."""
MOST_MOMENTS = 1_000_000
"""Values that span more are not times: a field of that name may hold anything."""


class Span(NamedTuple):
    """What a field of a map holds, as far as it matters for what the field may be; of parts it can be added up."""

    low: float = np.inf  # of its finite values; inf and -inf where there are none
    high: float = -np.inf
    is_known: bool = True  # whether all values are finite
    is_whole: bool = True  # whether those are whole numbers

    def joined(self, other: Span) -> Span:
        """Return the span of both."""
        return Span(
            min(self.low, other.low),
            max(self.high, other.high),
            self.is_known and other.is_known,
            self.is_whole and other.is_whole,
        )


class Known(NamedTuple):
    """Which fields record where and when the points of a map were seen; decided once for a map."""

    moment: str | None  # field of the moments
    start: float  # least time, where moments are times
    has_rays: bool  # whether it is known where the sensor was

    @property
    def fields(self) -> tuple[str, ...]:
        """Names of the fields that count."""
        return (*((self.moment,) if self.moment is not None else ()), *(TO_SENSOR if self.has_rays else ()))


def spans_of(cloud: PointCloud, names: tuple[str, ...]) -> dict[str, Span]:
    """Return what those fields hold that are a number a point."""
    number = np.flatnonzero(cloud.finite())
    spans = {name: span_of(cloud, name, number) for name in names}
    return {name: span for name, span in spans.items() if span is not None}


def span_of(cloud: PointCloud, name: str, number: NDArray[np.int64]) -> Span | None:
    """Return what a field holds at some points (k,) of a cloud; None if it is not one number a point."""
    values = cloud.fields.get(name)
    if values is None or values.ndim != 1 or values.dtype.kind not in "fiub":
        return None
    values = np.asarray(values[number], np.float64)
    known = np.isfinite(values)
    finite = values[known]
    if len(finite) == 0:
        return Span(is_known=len(values) == 0)
    return Span(float(finite.min()), float(finite.max()), bool(known.all()), bool((finite == np.floor(finite)).all()))


def decide(spans: Mapping[str, Span]) -> Known:
    """Return which fields count, of those whose spans over a whole map are given.

    Moments are scans, else times, else passes. A scan sees all that it sees at once, but a pass may see a place twice,
    so a single pass shows nothing.
    """
    moment, start = None, 0.0
    scan, time = spans.get(SCAN, Span()), spans.get(TIME, Span())
    if _are_numbers(scan, least=1):
        moment = SCAN
    # Below a moment in all, the field is not a clock of the drive: it may be the time within one turn of the laser.
    elif time.is_known and MOMENT < time.high - time.low < MOST_MOMENTS * MOMENT:
        moment, start = TIME, time.low
    elif _are_numbers(spans.get(PASS, Span()), least=2):
        moment = PASS
    return Known(moment, start, all(name in spans for name in TO_SENSOR))


def known_of(cloud: PointCloud) -> Known:
    """Return which fields of a cloud count."""
    return decide(spans_of(cloud, FIELDS))


def _are_numbers(span: Span, least: int) -> bool:
    """Return whether a field numbers scans or passes, and has one or at least two different values."""
    return span.is_known and span.is_whole and (span.low <= span.high if least == 1 else span.low < span.high)


def moments_of(cloud: PointCloud, number: NDArray[np.int64], known: Known) -> NDArray[np.int64] | None:
    """Return the moments (k,) of some points of a cloud, numbered from 0; None if they are not known."""
    if known.moment is None or len(number) == 0:
        return None
    values = np.asarray(cloud.fields[known.moment][number], np.float64)
    if known.moment == TIME:
        return ((values - known.start) / MOMENT).astype(np.int64)
    return np.unique(values, return_inverse=True)[1].astype(np.int64)


def ways_of(cloud: PointCloud, number: NDArray[np.int64], known: Known) -> NDArray[np.float64] | None:
    """Return the way to the sensor (k, 3) in metres of some points (k,) of a cloud; None if no rays are known."""
    if not known.has_rays:
        return None
    return np.column_stack([np.asarray(cloud.fields[name][number], np.float64) for name in TO_SENSOR])
