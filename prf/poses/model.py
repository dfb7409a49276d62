"""Which poses are uncertain, and their prior: independent errors of given poses, odometry from one to the next.

A state is a pose that several readings share: those of a scan, and those of another sensor's scan at nearly the same
time. Scans of which no reading is used have none. A state is given a pose; its readings are kept in the frame of that,
so that where a sensor sits on the robot need not be known.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from prf.kernels.poses.state import SLIP_REACH, SLIPPED
from prf.poses.plane import Floats, compose, seen_from, wrapped
from prf.readings import Readings
from prf.shell.cli.console import Report
from prf.shell.errors import InputError

SAME_TIME = 0.1
"""Seconds between scans of two sensors up to which these share a state: errors change more slowly than poses."""

ANOTHER_LOG = 1e10
"""Seconds by which the clock of a log is put after that of the one before it; more than any of them counts."""

STAND = np.array([1e-3, 1e-3, 1e-4])
"""Standard deviations (m, m, rad) that a step of the odometry has at least: of a robot that does not move."""

SLIP, CARRIED = 0.01, 0.1
"""Probability of a step in which wheels slip, and share of these in which the robot may be carried anywhere."""


LEAST_HELD = 1e-3
"""1/rad2, of the turn where the robot was carried: enough to have a solution."""

FAR_OFF = 16.0
"""Squared distance, in standard deviations, up to which a closure holds."""


class PosePrior(NamedTuple):
    """Density of all poses: independent normal errors of given ones, normal errors of each step of the odometry.

    A step's error is that of the next pose as the pose before it has it. In a slip it is :data:`SLIPPED` times as
    large; or, where the robot is carried, Cauchy's of the plane, and the turn any.
    """

    given: Floats  # (n, 3)
    noise: Floats  # (n, 2) standard deviations, metres and radians; inf: odometry alone, and the first pose is held
    motion: Floats  # (n - 1, 3) measured step from each pose to the next, in the frame of the former; (0, 3): none
    spread: Floats  # (n - 1, 3) its standard deviations: ahead, to the side (m), turn (rad)
    slip: float = SLIP  # probability that a step is one in which the robot slipped or was carried

    @property
    def is_held(self) -> bool:
        """Whether the first pose is held at the given one, which fixes the frame."""
        return not bool(np.isfinite(self.noise).all())

    def log_density(self, poses: Floats) -> float:
        """Return the log density of poses (n, 3), up to a constant."""
        total = 0.0
        if not self.is_held:
            error = poses - self.given
            error[:, 2] = wrapped(error[:, 2])
            total -= 0.5 * float(((error / self.noise[:, [0, 0, 1]]) ** 2).sum())
        if len(self.motion):
            total += float(np.logaddexp.reduce(self.step_terms(poses), axis=0).sum())
        return total

    @property
    def log_slip(self) -> Floats:
        """Log densities (n - 1, 2) of a slip and of being carried, without error, over those of the normal errors."""
        with np.errstate(divide="ignore"):
            odds = np.log(self.slip) - np.log1p(-self.slip)
        slipped = np.full(len(self.spread), odds + np.log1p(-CARRIED) - 3.0 * np.log(SLIPPED))
        carried = odds + np.log(CARRIED) - 2.0 * np.log(SLIP_REACH) - 0.5 * np.log(2.0 * np.pi)
        return np.column_stack([slipped, carried + np.log(self.spread).sum(axis=1)])

    def step_terms(self, poses: Floats) -> Floats:
        """Return log densities (3, ..., n - 1) of the steps between poses (..., n, 3): normal, in a slip, carried."""
        error = seen_from(poses[..., :-1, :], poses[..., 1:, :]) - self.motion
        error[..., 2] = wrapped(error[..., 2])
        normal = -0.5 * ((error / self.spread) ** 2).sum(axis=-1)
        slipped, carried = self.log_slip.T
        away = np.log1p((error[..., :2] ** 2).sum(axis=-1) / SLIP_REACH**2)
        return np.stack([normal, slipped + normal / SLIPPED**2, carried - 1.5 * away])

    def parts(self, poses: Floats) -> Floats:
        """Return the probabilities (3, ..., n - 1) that the steps are normal, slips, or the robot is carried."""
        terms = self.step_terms(poses)
        return np.asarray(np.exp(terms - np.logaddexp.reduce(terms, axis=0)))

    def slipped(self, poses: Floats) -> Floats:
        """Return the probability (..., n - 1) that in each step between poses (..., n, 3) it slipped or was carried."""
        return np.asarray(1.0 - self.parts(poses)[0])

    def precision(self, poses: Floats) -> Floats:
        """Return how much each step holds at poses (n, 3): (n - 1, 3) of ahead, to the side (1/m2), turn (1/rad2).

        What pulls where the robot was carried is the slope of the density; the turn hardly pulls.
        """
        off = seen_from(poses[:-1], poses[1:])[:, :2] - self.motion[:, :2]
        normal, slipped, carried = self.parts(poses)[:, :, None]
        place = 3.0 / (SLIP_REACH**2 + np.square(off).sum(axis=1))
        loose = np.column_stack([place, place, np.full(len(place), LEAST_HELD)])
        return np.asarray((normal + slipped / SLIPPED**2) / self.spread**2 + carried * loose)

    def draw(self, rng: np.random.Generator, sign: float = 1.0) -> Floats:
        """Return poses (n, 3) of the prior of odometry alone, or of independent errors alone; -1: the opposite ones."""
        if not len(self.motion):
            return self.given + sign * rng.standard_normal(self.given.shape) * self.noise[:, [0, 0, 1]]
        error = self.spread * rng.standard_normal(self.motion.shape)
        if self.slip > 0.0:
            chance = rng.random(len(error))
            error[chance < self.slip] *= SLIPPED
            slips = np.flatnonzero(chance < CARRIED * self.slip)
            away = SLIP_REACH * np.sqrt(rng.random(len(slips)) ** -2.0 - 1.0)
            angle, turn = rng.uniform(-np.pi, np.pi, (2, len(slips)))
            error[slips] = np.column_stack([away * np.cos(angle), away * np.sin(angle), turn])
        steps = self.motion + sign * error
        poses = [self.given[0]]
        for step in steps:
            poses.append(compose(poses[-1], step))
        return np.array(poses)


class Closures(NamedTuple):
    """Loops that close or not: poses of states in the frames of earlier ones."""

    tail: NDArray[np.int64]  # (k,) earlier state
    head: NDArray[np.int64]  # (k,) later state
    pose: Floats  # (k, 3) of the later in the frame of the earlier: m, m, rad
    covariance: Floats  # (k, 3, 3)

    def hold(self, poses: Floats) -> NDArray[np.bool_]:
        """Return which hold (..., k) at poses (..., n, 3), within their covariances."""
        error = seen_from(poses[..., self.tail, :], poses[..., self.head, :]) - self.pose
        error[..., 2] = wrapped(error[..., 2])
        return np.asarray(np.einsum("...ki,kij,...kj->...k", error, np.linalg.inv(self.covariance), error) < FAR_OFF)


NO_CLOSURES = Closures(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros((0, 3, 3)))


class LocalReadings(NamedTuple):
    """Readings of one sensor in the frames of the given poses of their states."""

    owner: NDArray[np.int32]  # (n,) state of each reading
    origin: Floats  # (n, 2) metres
    angle: Floats  # (n,) radians

    def at(self, poses: Floats) -> tuple[Floats, Floats]:
        """Return origins (n, 2) and angles (n,) in the world if the states are at `poses` (n_states, 3)."""
        world = compose(poses[self.owner], np.column_stack([self.origin, self.angle]))
        return np.ascontiguousarray(world[:, :2]), world[:, 2].copy()


@dataclasses.dataclass(frozen=True)
class PoseModel:
    """The uncertain poses of readings in use, in order of time."""

    prior: PosePrior
    scan: NDArray[np.int64]  # (n,) number of the scan in its log
    time: Floats  # (n,) seconds; nan where unknown
    start: Floats  # (n, 3) where scans agree
    laser: LocalReadings | None = None
    sonar: LocalReadings | None = None
    # Draws (n, 3) of where chains start, round `start` (:meth:`prf.poses.start.Start.draw`); None: there
    draw_start: Callable[[np.random.Generator, float, float, Report], Floats] | None = None
    driven: Floats | None = None  # (n, 3) poses whose steps the odometry measured
    way: Floats | None = None  # (n, 2) metres driven and radians turned up to each state, along the whole log
    odometry: Sequence[float] | None = None  # its four numbers (:data:`prf.configuration.ODOMETRY`)
    disputed: Closures = NO_CLOSURES  # of which it is open whether they hold

    def scaled(self, place: float, turn: float) -> PoseModel:
        """Return the model with odometry that errs so many times as far, and turns so many times as far off."""
        assert self.odometry is not None
        a, b, c, d = self.odometry
        odometry = (turn * a, turn * b, place * c, place * d)
        motion, spread = _steps(self.driven, odometry, self.way)
        return dataclasses.replace(self, odometry=odometry, prior=self.prior._replace(motion=motion, spread=spread))

    def used(self, rows: NDArray[np.int64], cone_rows: NDArray[np.int64]) -> PoseModel:
        """Return the model of these readings of laser and sonar; states without a reading are left out."""
        parts = [_rows(local, chosen) for local, chosen in ((self.laser, rows), (self.sonar, cone_rows))]
        kept = np.unique(np.concatenate([part.owner for part in parts if part is not None]))
        laser, sonar = (
            None if part is None else part._replace(owner=np.searchsorted(kept, part.owner).astype(np.int32))
            for part in parts
        )
        driven, way = (None if part is None else part[kept] for part in (self.driven, self.way))
        steps = _steps(driven, self.odometry, way)
        prior = PosePrior(self.prior.given[kept], self.prior.noise[kept], *steps, self.prior.slip)
        start, draw = self.start[kept], self.draw_start

        def drawn(rng: np.random.Generator, sign: float, way: float, report: Report) -> Floats:
            found: Floats = start.copy() if draw is None else draw(rng, sign, way, report)[kept]
            if prior.is_held:
                found[0] = start[0]
            return found

        tail, head, *rest = self.disputed
        stays = np.isin(tail, kept) & np.isin(head, kept)
        tail, head = (np.searchsorted(kept, each[stays]) for each in (tail, head))
        disputed = Closures(tail, head, *(each[stays] for each in rest))
        return PoseModel(prior, self.scan[kept], self.time[kept], start, laser, sonar, drawn, disputed=disputed)

    def followed_by(self, other: PoseModel, first_scan: int) -> PoseModel:
        """Return the model of these poses and those of other logs, whose scans are numbered from `first_scan` on.

        Errors of both are independent; none is of odometry. Chains start at `start`.
        """
        n = len(self.scan)
        prior = self.prior._replace(
            given=np.concatenate([self.prior.given, other.prior.given]),
            noise=np.concatenate([self.prior.noise, other.prior.noise]),
        )
        start, time = np.concatenate([self.start, other.start]), np.concatenate([self.time, other.time])
        laser, sonar = (_follow(*parts, n) for parts in ((self.laser, other.laser), (self.sonar, other.sonar)))
        scan = np.concatenate([self.scan, other.scan + first_scan])
        return PoseModel(prior, scan, time, start, laser, sonar)

    def placed(self, laser: Readings | None, sonar: Readings | None, poses: Floats) -> list[Readings | None]:
        """Return readings of a laser and a sonar, those of this model, as they are with the states at `poses`."""
        found: list[Readings | None] = []
        for local, readings in ((self.laser, laser), (self.sonar, sonar)):
            if local is None or readings is None:
                found.append(readings)
                continue
            origin, angle = local.at(poses)
            found.append(dataclasses.replace(readings, origin=origin, angle=angle))
        return found


class _States(NamedTuple):
    """Scans of one log of which readings are used."""

    scan: NDArray[np.int64]  # (n,)
    time: Floats  # (n,)
    pose: Floats  # (n, 3)
    odometry: Floats  # (n, 3) poses whose steps the odometry measured: `pose`, or those of a file
    of_reading: NDArray[np.int64]  # (n_readings,)
    when: Floats  # (n,) `time` with each of several logs after those before it


def pose_model(
    laser: Readings | None,
    sonar: Readings | None,
    noise: Sequence[float] | None,
    odometry: Sequence[float] | None = None,
) -> PoseModel:
    """Return the states of readings in use and their prior; chains start at the given poses.

    `noise`: standard deviations of the given poses, metres and radians; None: only the odometry counts. `odometry`: its
    four numbers (:data:`prf.configuration.ODOMETRY`); the given poses are then its record, step by step.
    """
    kept = [part for part in (laser, sonar) if part is not None]
    found = [_states(part) for part in kept]
    shared = _shared_states(found)
    _, first, state = np.unique(np.concatenate(shared), return_index=True, return_inverse=True)
    scan, time, given, driven, when = (
        np.concatenate([getattr(each, name) for each in found])[first] for name in (*_States._fields[:4], "when")
    )
    order = _in_time(when, scan)
    owners = np.split(np.argsort(order)[state], np.cumsum([len(own) for own in shared])[:-1])
    scan, time, given, driven = scan[order], time[order], given[order], driven[order]
    way = None if odometry is None else np.concatenate(_ways(kept, found))[first][order]
    steps = _steps(driven, odometry, way)
    errors = np.array([np.inf, np.inf] if noise is None else noise, np.float64)
    prior = PosePrior(given, np.tile(errors, (len(given), 1)), *steps)
    local = [_local(part, each, own, given) for part, each, own in zip(kept, found, owners, strict=True)]
    lasers, sonars = (local[0] if laser is not None else None), (local[-1] if sonar is not None else None)
    return PoseModel(prior, scan, time, given.copy(), lasers, sonars, driven=driven, way=way, odometry=odometry)


def _rows(local: LocalReadings | None, rows: NDArray[np.int64]) -> LocalReadings | None:
    if local is None or len(rows) == 0:
        return None
    return LocalReadings(local.owner[rows], local.origin[rows], local.angle[rows])


def _follow(one: LocalReadings | None, other: LocalReadings | None, n: int) -> LocalReadings | None:
    """Return readings of both; the states of the second come after `n` of the first."""
    later = None if other is None else other._replace(owner=other.owner + np.int32(n))
    if one is None or later is None:
        return one or later
    owner = np.concatenate([one.owner, later.owner])
    return LocalReadings(owner, np.concatenate([one.origin, later.origin]), np.concatenate([one.angle, later.angle]))


def _states(readings: Readings) -> _States:
    """Return the scans of which readings are used; one without a heading is given that of its first beam."""
    scan, first, of_reading = np.unique(readings.scan, return_index=True, return_inverse=True)
    own = np.column_stack([readings.origin[first], readings.angle[first]])
    table = readings.notes.scans
    if len(table.number):
        listed = table.pose[np.searchsorted(table.number, scan)]
        own = np.where(np.isfinite(listed).all(axis=1, keepdims=True), listed, own)
    driven = own if table.odometry is None else table.odometry[np.searchsorted(table.number, scan)]
    time = readings.time[first]
    return _States(scan, time, own, driven, of_reading, time + ANOTHER_LOG * readings.log[first])


def _shared_states(found: Sequence[_States]) -> list[NDArray[np.int64]]:
    """Return for the scans of each log a number of their state; scans of a second log share those of the first."""
    n = len(found[0].scan)
    numbers, order = [np.arange(n)], np.argsort(found[0].when)
    known = found[0].when[order]
    for each in found[1:]:
        after = np.clip(np.searchsorted(known, each.when), 1, n - 1) if n > 1 else np.zeros(len(each.when), np.int64)
        before = np.maximum(after - 1, 0)
        is_before = np.abs(each.when - known[before]) <= np.abs(each.when - known[after])
        nearest = np.where(is_before, before, after)
        near = np.abs(each.when - known[nearest]) <= SAME_TIME
        numbers.append(np.where(near, order[nearest], n + np.arange(len(each.scan))))
    return numbers


def _in_time(time: Floats, scan: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the order of states in time, or that of their scans where times are unknown."""
    return np.lexsort((scan, time)) if np.isfinite(time).all() else np.argsort(scan, kind="stable")


def _local(readings: Readings, states: _States, state: NDArray[np.int64], given: Floats) -> LocalReadings:
    owner = state[states.of_reading]
    local = seen_from(given[owner], np.column_stack([readings.origin, readings.angle]))
    return LocalReadings(owner.astype(np.int32), np.ascontiguousarray(local[:, :2]), local[:, 2].copy())


def _ways(logs: Sequence[Readings], found: Sequence[_States]) -> list[Floats]:
    """Return how far was driven and turned up to the scans of each log, (n, 2): along the first log, used or not."""
    table = logs[0].notes.scans
    if not len(table.number) or not np.isfinite(table.pose).all():
        raise InputError(f"{logs[0].source}: its poses have no heading, which odometry needs. Leave --odometry out.")
    way = np.zeros((len(table.number), 2))
    for device in np.unique(table.device):
        own = table.device == device
        change = np.diff((table.pose if table.odometry is None else table.odometry)[own], axis=0)
        steps = np.column_stack([np.hypot(change[:, 0], change[:, 1]), np.abs(wrapped(change[:, 2]))])
        way[own] = np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])
    ways = [way[np.searchsorted(table.number, found[0].scan)]]
    for log, each in zip(logs[1:], found[1:], strict=True):
        if not (np.isfinite(table.time).all() and np.isfinite(each.time).all()):
            raise InputError(f"{log.source}: odometry of two logs needs the times of both. Leave one log out.")
        order = np.argsort(table.time, kind="stable")
        ways.append(np.column_stack([np.interp(each.time, table.time[order], column[order]) for column in way.T]))
    return ways


def _steps(driven: Floats | None, odometry: Sequence[float] | None, way: Floats | None) -> tuple[Floats, Floats]:
    """Return the measured steps (n - 1, 3) between poses (n, 3), and their standard deviations; none without."""
    if driven is None or odometry is None or way is None:
        return np.zeros((0, 3)), np.zeros((0, 3))
    motion = seen_from(driven[:-1], driven[1:])
    return motion, step_spread(motion, odometry, *np.abs(np.diff(way, axis=0)).T)


def step_spread(
    motion: Floats, odometry: Sequence[float], driven: Floats | float = 0.0, turned: Floats | float = 0.0
) -> Floats:
    """Return the standard deviations (n, 3) of steps of the odometry: ahead, to the side (m), turn (rad).

    `motion` (n, 3): the steps, each in the frame of the pose before it. `driven`, `turned` (n,): metres and radians on
    the way, where that is longer than the straight one.
    """
    d = np.maximum(np.hypot(motion[:, 0], motion[:, 1]), driven)
    a = np.maximum(np.abs(motion[:, 2]), turned)
    turn = odometry[0] ** 2 * a + odometry[1] ** 2 * d
    ahead = odometry[2] ** 2 * d + odometry[3] ** 2 * a
    # An error of the heading anywhere along a step carries what is driven after it to the side.
    aside = ahead + turn * d**2 / 3.0
    return np.asarray(np.sqrt(np.column_stack([ahead, aside, turn]) + STAND**2))
