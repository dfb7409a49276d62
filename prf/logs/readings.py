"""`Readings`: the beams of a log in flat arrays, and what the reader noticed on the way."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from prf.shell.errors import ConfigError, InputError
from prf.window import LARGEST_RANGE

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

Kind = Literal["laser", "sonar"]


class NoReadings(InputError):  # noqa: N818 - reads as what happened
    """A sound log without readings of the kind that was asked for."""


class OwnPoses(ConfigError):  # noqa: N818 - reads as what happened
    """A frame was asked for of readings whose lines carry their poses."""


class ScanTable(NamedTuple):
    """One row a scan of the whole log, before thinning.

    Attributes
    ----------
    number : (n_scans,) int64
        Scan number, as in `Readings.scan`.
    line : (n_scans,) int64
        Line of the file, from 1, on which the scan begins; in a bag, which of the sensors' messages it is.
    n_beams : (n_scans,) int64
        Beams in the file, those with an unusable range included.
    device : (n_scans,) int64
        Which sensor made the scan, an index into `LogNotes.devices`.
    pose : (n_scans, 3) float64
        Position in metres and heading in radians of the sensor, of the robot for a ring of sonars; heading nan where
        the format has none.
    time : (n_scans,) float64
        Seconds; nan where unknown.
    """

    number: IntArray
    line: IntArray
    n_beams: IntArray
    device: IntArray
    pose: FloatArray
    time: FloatArray


def _no_scans() -> ScanTable:
    none = np.empty(0, dtype=np.int64)
    return ScanTable(none, none, none, none, np.empty((0, 3)), np.empty(0))


@dataclass(frozen=True)
class LogNotes:
    """What a reader noticed; it always speaks of the whole log, also after thinning.

    Attributes
    ----------
    format : str
        Name of the format, for a person.
    scans : ScanTable
        The scans of the log.
    devices : tuple of str
        Names of the sensors, in the order of their first scan.
    n_zero_ranges : int
        Beams dropped because their range is exactly 0: an error code of the scanner, neither a hit nor a miss.
    n_invalid : int
        Beams dropped because their range is no number, or below the least that the sensor itself claims to measure.
    sensor_max : float
        The sensors' own maximum range, where the log states it and has finite readings at or above it: these are inf
        in `Readings`. nan otherwise.
    poses : str
        Where the poses come from, for a person.
    ring : tuple of (x, y, heading)
        Where the transducers of a sonar ring sit on the robot, metres and radians; empty for other sensors.
    lines : mapping of str to int
        How many lines of each kind were passed over, kinds that the format knows.
    odd_lines : mapping of str to int
        The same for kinds that the format does not know.
    remarks : tuple of str
        What the reader had to assume.
    """

    format: str = ""
    scans: ScanTable = field(default_factory=_no_scans)
    devices: tuple[str, ...] = ()
    n_zero_ranges: int = 0
    n_invalid: int = 0
    sensor_max: float = math.nan
    poses: str = "in the log"
    ring: tuple[tuple[float, float, float], ...] = ()
    lines: Mapping[str, int] = field(default_factory=dict)
    odd_lines: Mapping[str, int] = field(default_factory=dict)
    remarks: tuple[str, ...] = ()


@dataclass(frozen=True)
class Readings:
    """Range readings at known sensor poses, one row a beam, SI units.

    Attributes
    ----------
    origin : (n_beams, 2) float64
        Sensor position in the world, metres.
    angle : (n_beams,) float64
        Direction of the beam in the world, radians counter-clockwise, not wrapped.
    range : (n_beams,) float64
        Measured distance, metres, greater than 0. A log's own number for "no return" is kept as it stands, for it
        differs from log to log: whatever is at least the maximum range counts as no return. inf is no return too.
    scan : (n_beams,) int64
        Scan number in the whole log, from 0; thinning keeps the numbers.
    beam : (n_beams,) int32
        Number of the beam in its scan, from 0, by the file: dropped beams leave gaps.
    time : (n_beams,) float64
        Seconds; nan where unknown.
    cone : (n_beams,) float64
        Full opening angle, radians; 0 for a laser.
    source : str
        Where the readings come from, for messages.
    notes : LogNotes
        What the reader noticed.
    """

    origin: FloatArray
    angle: FloatArray
    range: FloatArray
    scan: IntArray
    beam: NDArray[np.int32]
    time: FloatArray
    cone: FloatArray
    source: str
    notes: LogNotes = field(default_factory=LogNotes)

    @classmethod
    def from_arrays(
        cls,
        origin: ArrayLike,
        angle: ArrayLike,
        ranges: ArrayLike,
        *,
        scan: ArrayLike = 0,
        beam: ArrayLike | None = None,
        time: ArrayLike = np.nan,
        cone: ArrayLike = 0.0,
        source: str = "arrays",
        notes: LogNotes | None = None,
    ) -> Readings:
        """Return readings with every array cast to its type, C-contiguous; a scalar stands for every beam.

        Parameters
        ----------
        origin : (n, 2) or (2,) array_like
            Sensor positions, metres.
        angle, ranges : (n,) array_like
            Directions in radians and distances in metres; `ranges` fixes n. One beyond `LARGEST_RANGE` is no return.
        scan, beam, time, cone : (n,) array_like or scalar, optional
            As the attributes; `beam` counts through the beams of each scan if absent.
        source : str, optional
            Where the readings come from.
        notes : LogNotes, optional
            What the reader noticed.

        Raises
        ------
        ValueError
            If the shapes do not agree.
        """
        distance = np.array(ranges, dtype=np.float64, order="C").reshape(-1)
        distance[distance > LARGEST_RANGE] = np.inf
        shape = distance.shape
        scans = np.array(np.broadcast_to(scan, shape), dtype=np.int64)
        beams = beam_numbers(scans) if beam is None else beam
        return cls(
            origin=np.array(np.broadcast_to(np.asarray(origin, dtype=np.float64), (*shape, 2)), order="C"),
            angle=np.array(np.broadcast_to(angle, shape), dtype=np.float64),
            range=distance,
            scan=scans,
            beam=np.array(np.broadcast_to(beams, shape), dtype=np.int32),
            time=np.array(np.broadcast_to(time, shape), dtype=np.float64),
            cone=np.array(np.broadcast_to(cone, shape), dtype=np.float64),
            source=source,
            notes=notes if notes is not None else LogNotes(),
        )

    @property
    def n_beams(self) -> int:
        """Number of beams."""
        return len(self.range)

    @property
    def n_scans(self) -> int:
        """Number of different scans that have a beam here."""
        return len(np.unique(self.scan))

    @property
    def largest_range(self) -> float:
        """Largest finite range in metres; nan if no range is finite."""
        finite = self.range[np.isfinite(self.range)]
        return float(finite.max()) if len(finite) else float("nan")

    def select(self, mask: NDArray[np.bool_] | IntArray) -> Readings:
        """Return the beams that a boolean mask or an index array picks, in its order, with the same notes."""
        return replace(
            self,
            origin=np.ascontiguousarray(self.origin[mask]),
            angle=self.angle[mask],
            range=self.range[mask],
            scan=self.scan[mask],
            beam=self.beam[mask],
            time=self.time[mask],
            cone=self.cone[mask],
        )

    def where(self, mask: NDArray[np.bool_]) -> Readings:
        """Return the beams of a boolean mask, without a copy where that is all of them."""
        return self if mask.all() else self.select(mask)


def beam_numbers(scan: IntArray) -> NDArray[np.int32]:
    """Return for every beam how many beams of the same scan stand before it.

    Parameters
    ----------
    scan : (n,) int64
        Scan numbers, in any order.
    """
    order = np.argsort(scan, kind="stable")
    ordered = scan[order]
    starts = np.flatnonzero(np.r_[True, ordered[1:] != ordered[:-1]]) if len(scan) else np.empty(0, dtype=np.int64)
    lengths = np.diff(np.r_[starts, len(scan)])
    numbers = np.empty(len(scan), dtype=np.int32)
    numbers[order] = np.arange(len(scan)) - np.repeat(starts, lengths)
    return numbers
