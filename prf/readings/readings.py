"""`Readings`: beams of a log in flat arrays, what the reader noticed on the way, where sensors sit on a robot."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from prf.model.ranges import unit_vectors
from prf.model.sensors import LARGEST_RANGE
from prf.readings.text import FloatArray, IntArray, check_domains
from prf.shell.cli.pictures import card
from prf.shell.errors import ConfigError, InputError

QUARTER_DEGREES = (400, 401)  # beams of a scan over 100 degrees in steps of a quarter of a degree

_LEFT_FRONT = ((0.115, 0.130, 1.5708), (0.155, 0.115, 0.8727), (0.190, 0.080, 0.5236), (0.210, 0.025, 0.1745))
_FRONT = (*_LEFT_FRONT, *((x, -y, -turn) for x, y, turn in reversed(_LEFT_FRONT)))
_BACK = tuple((-x, -y, turn - np.copysign(np.pi, turn)) for x, y, turn in _FRONT)

PIONEER = np.array((*_FRONT, *_BACK))
"""(16, 3): position in metres and heading in radians of the transducers of a Pioneer 2 on the robot, clockwise from the
left. A robot with the front array alone has the first 8. As the Player server writes them, to 0.1 mrad."""


def mounted(robot: FloatArray, mount: FloatArray) -> FloatArray:
    """Return the world pose of something mounted on a robot.

    `robot` (3,): pose of the robot in the world, metres and radians. `mount` (3,) or (k, 3): poses in the robot's
    frame.
    """
    cosine, sine = np.cos(robot[2]), np.sin(robot[2])
    x, y = mount[..., 0], mount[..., 1]
    return np.stack(
        (robot[0] + cosine * x - sine * y, robot[1] + sine * x + cosine * y, robot[2] + mount[..., 2]), axis=-1
    )


def seen_from(robot: FloatArray, pose: FloatArray) -> FloatArray:
    """Return the pose (3,) on a robot of something whose world pose is `pose`, both as :func:`mounted` has them."""
    cosine, sine = np.cos(robot[2]), np.sin(robot[2])
    x, y, turn = pose - robot
    return np.array([cosine * x + sine * y, cosine * y - sine * x, np.arctan2(np.sin(turn), np.cos(turn))])


def ring_of(n: int) -> FloatArray | None:
    """Return the (n, 3) Pioneer ring of `n` transducers, or None if there is none of that size."""
    return PIONEER[:n] if n in (8, 16) else None


def fields_of_view(readings: Readings, cone: float) -> FloatArray:
    """Return the full field of view (n,) of sonar readings, radians: the log's, or `cone` where it has none."""
    if not 0.0 < cone < np.pi:
        raise ConfigError(f"sonar cone {cone}: must lie between 0 and pi radians")
    view = np.where(readings.cone > 0.0, readings.cone, cone)
    if view.max() >= np.pi:
        raise InputError(f"{readings.source}: a sonar cone of {view.max():g} radians. It must be narrower than pi.")
    return view


def spread(start: float, step: float, n: int) -> FloatArray:
    """Return n directions from `start` on, radians (ValueError unless they differ and stay within one turn)."""
    is_scan = n < 2 or 0.0 < abs(step) * (n - 1) <= 2.0 * np.pi + min(abs(step), 1.0)
    if not (is_scan and abs(start) <= 2.0 * np.pi):
        raise ValueError(
            f"{n} beams from {start:g} in steps of {step:g} rad: expected different directions within one turn"
        )
    return np.array([start]) if n == 1 else start + step * np.arange(n, dtype=np.float64)


@lru_cache(maxsize=8)
def plain_bearings(n: int) -> FloatArray:
    """Return the (n,) bearings in radians of the beams of a line that carries none, right to left."""
    if n not in QUARTER_DEGREES:
        return half_circle(n)
    return (np.arange(n, dtype=np.float64) - 200.0) * (np.pi / 720.0)


@lru_cache(maxsize=8)
def half_circle(n: int) -> FloatArray:
    """Return the (n,) bearings in radians of a scan over half a circle, right to left, by CARMEN's convention."""
    steps = n if n in (180, 360) else max(n - 1, 1)
    return -np.pi / 2 + np.arange(n, dtype=np.float64) * (np.pi / steps)


Kind = Literal["laser", "sonar"]

ARC_POINTS = 9  # points by which the arc of a sonar reading is drawn


class NoReadings(InputError):  # noqa: N818 - reads as what happened
    """A sound log without readings of the kind that is wanted."""


class OwnPoses(ConfigError):  # noqa: N818 - reads as what happened
    """A frame is chosen for readings whose lines carry their poses."""


class ScanTable(NamedTuple):
    """One row a scan of the whole log, before thinning."""

    number: IntArray  # (n_scans,) scan number, as in `Readings.scan`
    # (n_scans,) line of the file, from 1, on which the scan begins; in a bag, which of the sensors' messages it is
    line: IntArray
    n_beams: IntArray  # (n_scans,) beams in the file, those with an unusable range included
    device: IntArray  # (n_scans,) which sensor made the scan, an index into `LogNotes.devices`
    # (n_scans, 3) position in metres and heading in radians of the sensor, of the robot for a ring of sonars; heading
    # nan where the format has none
    pose: FloatArray
    time: FloatArray  # (n_scans,) seconds; nan where unknown
    # (n_scans, 3) of raw odometry, of what `pose` is of; None: `pose` is it, where it is odometry at all
    odometry: FloatArray | None = None


def _no_scans() -> ScanTable:
    none = np.empty(0, dtype=np.int64)
    return ScanTable(none, none, none, none, np.empty((0, 3)), np.empty(0))


@dataclass(frozen=True)
class LogNotes:
    """What a reader noticed; always of the whole log, also after thinning."""

    format: str = ""  # name of the format, for a person
    scans: ScanTable = field(default_factory=_no_scans)  # the scans of the log
    devices: tuple[str, ...] = ()  # names of the sensors, in the order of their first scan
    n_zero_ranges: int = 0  # beams dropped because their range is exactly 0: an error code, neither a hit nor a miss
    n_invalid: int = 0  # beams dropped because their range is nan, or below the least that the sensor claims to measure
    # the sensors' own maximum range, where the log states it and has finite readings at or above it: these are inf in
    # `Readings`. nan otherwise
    sensor_max: float = math.nan
    range_unit: str = ""  # in which unit ranges were that are metres here, and how that is known; empty: in metres
    # where the poses are from, for a person; of readings on the robot (prf.readings.poses) what the sensor sits on
    poses: str = "in the log"
    # where the transducers of a sonar ring sit on the robot, metres and radians; empty for other sensors
    ring: tuple[tuple[float, float, float], ...] = ()
    # how many lines of each kind were skipped, kinds that the format knows
    lines: Mapping[str, int] = field(default_factory=dict)
    odd_lines: Mapping[str, int] = field(default_factory=dict)  # the same for kinds that the format does not know
    remarks: tuple[str, ...] = ()  # what the reader had to assume
    warnings: tuple[str, ...] = ()  # what of that, or of scans without a pose, a person must know before mapping
    lengths: tuple[int, ...] = ()  # scans of each of several logs that were joined; empty for one
    names: tuple[str, ...] = ()  # their names


@dataclass(frozen=True, repr=False)
class Readings:
    """Range readings at known sensor poses, one row a beam, SI units.

    Attributes
    ----------
    origin : (n_beams, 2) float64
        Sensor position in the world, metres.
    angle : (n_beams,) float64
        Direction of the beam in the world, radians counter-clockwise, not wrapped.
    range : (n_beams,) float64
        Measured distance, metres, greater than 0. A log's own number for "no return" is kept, for it
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
        Where the readings are from, for messages.
    notes : LogNotes
        What the reader noticed.
    max_range : float
        Metres; a reading at or above it is no return. inf: not known from the log alone (:meth:`within`).
    log : (n_beams,) int64
        Which of several logs the reading is of, from 0; scan numbers go on from log to log.
    weight : (n_beams,) float64
        Independent readings that it counts as: 1, or more where it stands for others.
    share : (n_beams,) float64
        Of beams like it, what thinning left.
    """

    origin: FloatArray
    angle: FloatArray
    range: FloatArray
    scan: IntArray
    beam: NDArray[np.int32]
    time: FloatArray
    cone: FloatArray
    log: IntArray
    weight: FloatArray
    share: FloatArray
    source: str
    notes: LogNotes = field(default_factory=LogNotes)
    max_range: float = math.inf

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
        log: ArrayLike = 0,
        weight: ArrayLike = 1.0,
        share: ArrayLike = 1.0,
        source: str = "arrays",
        notes: LogNotes | None = None,
    ) -> Readings:
        """Return readings with every array cast to its type, C-contiguous; a scalar holds for every beam.

        `origin` (n, 2) or (2,): sensor positions, metres. `angle`, `ranges` (n,): directions in radians and distances
        in metres; `ranges` fixes n. One beyond `LARGEST_RANGE` is no return. The rest as the attributes; `beam` counts
        through the beams of each scan if absent.
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
            log=np.array(np.broadcast_to(log, shape), dtype=np.int64),
            weight=np.array(np.broadcast_to(weight, shape), dtype=np.float64),
            share=np.array(np.broadcast_to(share, shape), dtype=np.float64),
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
    def lengths(self) -> tuple[int, ...]:
        """Scans of each log, those that lost all their beams included."""
        numbers = self.notes.scans.number
        return self.notes.lengths or (1 + int(max(self.scan.max(initial=-1), numbers.max(initial=-1))),)

    @property
    def names(self) -> tuple[str, ...]:
        """Name of each log, for messages."""
        return self.notes.names or (self.source,)

    @property
    def largest_range(self) -> float:
        """Largest finite range in metres; nan if no range is finite."""
        finite = self.range[np.isfinite(self.range)]
        return float(finite.max()) if len(finite) else float("nan")

    @property
    def returned(self) -> NDArray[np.bool_]:
        """Which readings (n_beams,) have a return below the maximum range."""
        return np.isfinite(self.range) & (self.range < self.max_range)

    def within(self, max_range: float) -> Readings:
        """Return the readings with this maximum range, inf where there was no return below it."""
        return replace(self, range=np.where(self.range < max_range, self.range, np.inf), max_range=max_range)

    def impacts(self) -> FloatArray:
        """Return the end points of the beams with a return, (n_returns, 2) in metres."""
        hit = self.returned
        return np.asarray(self.origin[hit] + self.range[hit, None] * unit_vectors(self.angle[hit]))

    def arcs(self) -> FloatArray:
        """Return the arcs across the field of view of readings with a return, (n_returns, ARC_POINTS, 2) in metres."""
        hit = self.returned
        turn = self.angle[hit, None] + self.cone[hit, None] * np.linspace(-0.5, 0.5, ARC_POINTS)
        away = self.range[hit, None, None] * np.stack((np.cos(turn), np.sin(turn)), axis=-1)
        return np.asarray(self.origin[hit, None] + away)

    def sensor_path(self) -> FloatArray:
        """Return the position of the first beam of every scan, (n_scans, 2) in metres, in the order of the scans."""
        _, first = np.unique(self.scan, return_index=True)
        return self.origin[first]

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
            log=self.log[mask],
            weight=self.weight[mask],
            share=self.share[mask],
        )

    def where(self, mask: NDArray[np.bool_]) -> Readings:
        """Return the beams of a boolean mask, without a copy where that is all of them."""
        return self if mask.all() else self.select(mask)

    def _facts(self) -> dict[str, str]:
        width, height = np.ptp(self.origin, axis=0) if self.n_beams else (0.0, 0.0)
        what = "sonar readings" if self.cone.any() else "beams"
        return {
            "readings": f"{self.n_beams:,} {what} in {self.n_scans:,} scans",
            "source": " ".join((self.source, f"({self.notes.format})" if self.notes.format else "")).strip(),
            "sensor moves": f"within {width:.1f} x {height:.1f} m",
            "ranges": f"up to {self.largest_range:.2f} m",
        }

    def __repr__(self) -> str:
        """Return the readings in a line."""
        return f"<prf.Readings: {', '.join(self._facts().values())}>"

    def _repr_html_(self) -> str:
        """Return the card that a notebook shows."""
        return card("Readings at known poses", self._facts())


def beam_numbers(scan: IntArray) -> NDArray[np.int32]:
    """Return for every beam how many beams of the same scan (n,), in any order, precede it."""
    order = np.argsort(scan, kind="stable")
    ordered = scan[order]
    starts = np.flatnonzero(np.r_[True, ordered[1:] != ordered[:-1]]) if len(scan) else np.empty(0, dtype=np.int64)
    lengths = np.diff(np.r_[starts, len(scan)])
    numbers = np.empty(len(scan), dtype=np.int32)
    numbers[order] = np.arange(len(scan)) - np.repeat(starts, lengths)
    return numbers


class Scan(NamedTuple):
    """The beams of one line or message of a device.

    `line`, `time` and `pose` (3,) as in :class:`ScanTable`; `origin` (2,) or (n, 2) where the beams begin, metres;
    `angle` (n,) their directions in the world; `range` (n,) metres, inf: no return, 0 or nan: no measurement; `cone`
    their full opening angle. Angles in radians.
    """

    device: str
    line: int
    time: float
    pose: FloatArray
    origin: FloatArray
    angle: FloatArray
    range: FloatArray
    cone: float = 0.0


def assemble(scans: Sequence[Scan], source: str, notes: LogNotes) -> Readings:
    """Return the usable beams of all scans, at least one, numbered from 0 in their order; `notes` are completed."""
    table = _scan_table(scans)
    ranges = np.concatenate([scan.range for scan in scans])
    origin = np.concatenate([np.broadcast_to(scan.origin, (len(scan.range), 2)) for scan in scans])
    angle, time = np.concatenate([scan.angle for scan in scans]), np.repeat(table.time, table.n_beams)
    cone = np.repeat([scan.cone for scan in scans], table.n_beams)
    columns = {"x": origin[:, 0], "y": origin[:, 1], "theta": angle, "range": ranges, "cone": cone, "t": time}
    check_domains(source, np.repeat(table.line, table.n_beams), columns, nan=("t", "range"))
    usable = ranges > 0
    n_zero, n_invalid = int(np.count_nonzero(ranges == 0)), int(np.count_nonzero(np.isnan(ranges)))
    if not usable.any():
        why = "not a number or too short" if n_invalid else "0"
        raise InputError(f"{source}: every range is {why}, which means no measurement. Look for a log with readings.")
    devices = tuple(dict.fromkeys(scan.device for scan in scans))
    return Readings.from_arrays(
        origin,
        angle,
        ranges,
        scan=np.repeat(table.number, table.n_beams),
        time=time,
        cone=cone,
        source=source,
        notes=replace(notes, scans=table, devices=devices, n_zero_ranges=n_zero, n_invalid=n_invalid),
    ).where(usable)


def _scan_table(scans: Sequence[Scan]) -> ScanTable:
    devices = list(dict.fromkeys(scan.device for scan in scans))
    return ScanTable(
        number=np.arange(len(scans)),
        line=np.array([scan.line for scan in scans], dtype=np.int64),
        n_beams=np.array([len(scan.range) for scan in scans], dtype=np.int64),
        device=np.array([devices.index(scan.device) for scan in scans], dtype=np.int64),
        pose=np.array([scan.pose for scan in scans]),
        time=np.array([scan.time for scan in scans]),
    )
