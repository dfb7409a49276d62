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

from prf.logs import Readings
from prf.poses.plane import Floats, compose, seen_from, wrapped
from prf.shell.errors import InputError

SAME_TIME = 0.1
"""Seconds between scans of two sensors up to which these share a state: errors change more slowly than poses."""

ODOMETRY = {
    "precise": (0.01, 0.002, 0.01, 0.01),
    "wheels": (0.05, 0.01, 0.03, 0.03),
    "poor": (0.2, 0.05, 0.1, 0.1),
}
"""Noise of odometry, by name: radians per root radian turned, radians per root metre driven, metres per root metre
driven, metres per root radian turned. Variances add up along the way, however finely a log divides it."""

STAND = np.array([1e-3, 1e-3, 1e-4])
"""Standard deviations (m, m, rad) that a step of the odometry has at least: of a robot that stands."""


class PosePrior(NamedTuple):
    """Density of all poses: independent normal errors of given ones, normal errors of each step of the odometry.

    A step's error is that of the next pose as the pose before it has it.
    """

    given: Floats  # (n, 3)
    noise: Floats  # (2,) standard deviations, metres and radians; inf: odometry alone, and the first pose is held
    motion: Floats  # (n - 1, 3) measured step from each pose to the next, in the frame of the former; (0, 3): none
    spread: Floats  # (n - 1, 3) its standard deviations: ahead, to the side (m), turn (rad)

    @property
    def is_held(self) -> bool:
        """Whether the first pose is held at the given one, which fixes the frame."""
        return not bool(np.isfinite(self.noise).all())

    def log_density(self, poses: Floats) -> float:
        """Return the log density of poses (n, 3), up to a constant."""
        total = 0.0
        if not self.is_held:
            error = poses - self.given
            total -= 0.5 * float((error[:, :2] ** 2).sum() / self.noise[0] ** 2)
            total -= 0.5 * float((wrapped(error[:, 2]) ** 2).sum() / self.noise[1] ** 2)
        if len(self.motion):
            error = seen_from(poses[:-1], poses[1:]) - self.motion
            error[:, 2] = wrapped(error[:, 2])
            total -= 0.5 * float(((error / self.spread) ** 2).sum())
        return total

    def draw(self, rng: np.random.Generator) -> Floats:
        """Return poses (n, 3) of the prior of odometry alone, or of independent errors alone."""
        if not len(self.motion):
            return self.given + rng.standard_normal(self.given.shape) * self.noise[[0, 0, 1]]
        steps = self.motion + self.spread * rng.standard_normal(self.motion.shape)
        poses = [self.given[0]]
        for step in steps:
            poses.append(compose(poses[-1], step))
        return np.array(poses)


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
    # Draws (n, 3) of where chains start, round `start`; None: there
    draw_start: Callable[[np.random.Generator], Floats] | None = None

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
    of_reading: NDArray[np.int64]  # (n_readings,)


def pose_model(
    laser: Readings | None,
    sonar: Readings | None,
    noise: Sequence[float] | None,
    odometry: Sequence[float] | None = None,
) -> PoseModel:
    """Return the states of readings in use and their prior; chains start at the given poses.

    `noise`: standard deviations of the given poses, metres and radians; None: only the odometry counts. `odometry`: its
    four numbers (:data:`ODOMETRY`); the given poses are then its record, step by step.
    """
    kept = [part for part in (laser, sonar) if part is not None]
    found = [_states(part) for part in kept]
    shared = _shared_states(found)
    first = np.unique(np.concatenate(shared), return_index=True)[1]
    scan, time, given = (np.concatenate([getattr(each, name) for each in found])[first] for name in _States._fields[:3])
    order = _in_time(time, scan)
    rank = np.argsort(order)
    scan, time, given = scan[order], time[order], given[order]
    steps = (np.zeros((0, 3)), np.zeros((0, 3)))
    if odometry is not None:
        steps = odometry_steps(kept[0], scan, given, odometry)
    prior = PosePrior(given, np.array([np.inf, np.inf] if noise is None else noise, np.float64), *steps)
    local = [_local(part, each, rank[own], given) for part, each, own in zip(kept, found, shared, strict=True)]
    lasers, sonars = (local[0] if laser is not None else None), (local[-1] if sonar is not None else None)
    return PoseModel(prior, scan, time, given.copy(), lasers, sonars)


def _states(readings: Readings) -> _States:
    """Return the scans of which readings are used; one without a heading is given that of its first beam."""
    scan, first, of_reading = np.unique(readings.scan, return_index=True, return_inverse=True)
    own = np.column_stack([readings.origin[first], readings.angle[first]])
    table = readings.notes.scans
    if len(table.number):
        listed = table.pose[np.searchsorted(table.number, scan)]
        own = np.where(np.isfinite(listed).all(axis=1, keepdims=True), listed, own)
    return _States(scan, readings.time[first], own, of_reading)


def _shared_states(found: Sequence[_States]) -> list[NDArray[np.int64]]:
    """Return for the scans of each log a number of their state; scans of a second log share those of the first."""
    numbers, n = [np.arange(len(found[0].scan))], len(found[0].scan)
    for each in found[1:]:
        own = n + np.arange(len(each.scan))
        gap = np.abs(each.time[:, None] - found[0].time[None])
        nearest = np.argmin(np.where(np.isnan(gap), np.inf, gap), axis=1)
        near = gap[np.arange(len(own)), nearest] <= SAME_TIME
        numbers.append(np.where(near, nearest, own))
    return numbers


def _in_time(time: Floats, scan: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the order of states in time, or that of their scans where times are unknown."""
    return np.lexsort((scan, time)) if np.isfinite(time).all() else np.argsort(scan, kind="stable")


def _local(readings: Readings, states: _States, state: NDArray[np.int64], given: Floats) -> LocalReadings:
    owner = state[states.of_reading]
    local = seen_from(given[owner], np.column_stack([readings.origin, readings.angle]))
    return LocalReadings(owner.astype(np.int32), np.ascontiguousarray(local[:, :2]), local[:, 2].copy())


def odometry_steps(
    log: Readings, scan: NDArray[np.int64], given: Floats, odometry: Sequence[float]
) -> tuple[Floats, Floats]:
    """Return the measured steps (n - 1, 3) between given poses (n, 3) of scans, and their standard deviations.

    The way between two scans is that of all scans of the log between them, used or not.
    """
    table = log.notes.scans
    if len(table.number) and not np.isfinite(table.pose).all():
        raise InputError(f"{log.source}: its poses have no heading, which odometry needs. Leave --odometry out.")
    driven, turned = np.zeros(len(scan)), np.zeros(len(scan))
    if len(table.number):
        change = np.diff(table.pose, axis=0)
        along = np.append(0.0, np.cumsum(np.hypot(change[:, 0], change[:, 1])))
        about = np.append(0.0, np.cumsum(np.abs(wrapped(change[:, 2]))))
        at = np.searchsorted(table.number, scan)
        driven, turned = along[at], about[at]
    motion = seen_from(given[:-1], given[1:])
    return motion, step_spread(motion, odometry, np.abs(np.diff(driven)), np.abs(np.diff(turned)))


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
