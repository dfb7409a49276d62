"""The robot's way through the world, where it is at any time, and where it believes to be by odometry."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.configuration import SimulateSettings

Floats = NDArray[np.float64]

STEP = 0.05
"""Metres between two poses of a trajectory; between them the robot moves evenly."""

SMOOTH = 12.0
"""Metres over which the scale error keeps its value: slip depends on the ground, not on the instant."""


class Trajectory(NamedTuple):
    """Where the robot is: at driven distances (n,) in metres the place (n, 2) and the heading (n,), without jumps.

    `pass_starts` (k,) are the driven distances at which each pass but the first begins.
    """

    distance: Floats
    xy: Floats
    heading: Floats
    pass_starts: Floats

    @property
    def length(self) -> float:
        """Length of the path in metres."""
        return float(self.distance[-1])

    def at(self, distance: Floats) -> tuple[Floats, Floats]:
        """Return positions (n, 2) and headings (n,) at driven distances (n,)."""
        x, y, heading = (
            np.interp(distance, self.distance, values) for values in (self.xy[:, 0], self.xy[:, 1], self.heading)
        )
        return np.stack([x, y], axis=1), heading


class Waypoint(NamedTuple):
    """A corner of the path before it is rounded; a new pass may begin there."""

    xy: Floats
    begins_pass: bool = False


def drive_along(waypoints: Sequence[Waypoint], rng: np.random.Generator) -> Trajectory:
    """Return the trajectory along the waypoints with rounded corners and a slight swaying of the heading."""
    corners = np.array([point.xy for point in waypoints])
    pieces, marks, length = [corners[:1]], [], 0.0
    for k in range(1, len(corners)):
        arc = corners[k : k + 1]
        if k < len(corners) - 1:
            arc = _rounded(corners[k - 1], corners[k], corners[k + 1], rng.uniform(2.5, 4.0))
        length += float(np.hypot(*(arc[0] - pieces[-1][-1])))
        within = float(np.hypot(*np.diff(arc, axis=0).T).sum())
        if waypoints[k].begins_pass:
            marks.append(length + 0.5 * within)
        length += within
        pieces.append(arc)
    line = np.concatenate(pieces)
    steps = np.hypot(*np.diff(line, axis=0).T)
    kept = np.concatenate([[True], steps > 1e-9])
    line, driven = line[kept], np.concatenate([[0.0], np.cumsum(steps[steps > 1e-9])])
    distance = np.arange(0.0, driven[-1], STEP)
    xy = np.stack([np.interp(distance, driven, line[:, axis]) for axis in (0, 1)], axis=1)
    tangent = np.gradient(xy, axis=0)
    heading = np.unwrap(np.arctan2(tangent[:, 1], tangent[:, 0]))
    sway = 0.015 * np.sin(2.0 * np.pi * distance / rng.uniform(5.0, 9.0) + rng.uniform(0.0, 6.0))
    return Trajectory(distance, xy, heading + sway, np.array(marks))


def _rounded(before: Floats, corner: Floats, after: Floats, radius: float) -> Floats:
    """Return points (n, 2) of the arc that replaces a corner."""
    a, b = before - corner, after - corner
    la, lb = np.hypot(*a), np.hypot(*b)
    a, b = a / la, b / lb
    turn = np.pi - np.arccos(np.clip(a @ b, -1.0, 1.0))
    if turn < 1e-6:
        return corner[None]
    cut = min(radius * np.tan(0.5 * turn), 0.45 * la, 0.45 * lb)
    radius = cut / np.tan(0.5 * turn)
    middle = corner + (a + b) / np.hypot(*(a + b)) * (radius / np.cos(0.5 * turn))
    first = corner + cut * a - middle
    sign = 1.0 if a[1] * b[0] - a[0] * b[1] > 0.0 else -1.0
    angles = sign * np.linspace(0.0, turn, max(3, int(radius * turn / STEP)))
    c, s = np.cos(angles), np.sin(angles)
    return np.asarray(middle + np.stack([c * first[0] - s * first[1], s * first[0] + c * first[1]], axis=1))


def odometry(truth: Trajectory, settings: SimulateSettings, rng: np.random.Generator) -> Trajectory:
    """Return the trajectory as odometry has it, which begins where the true one does.

    The heading error grows by a constant bias and a random walk, the driven length is wrong by a share that wanders
    slowly. Errors grow evenly along the way, so that what is seen within some metres of driving stays crisp; what is
    seen again a lap later has moved.
    """
    n_steps = len(truth.distance) - 1
    per_metre = np.radians(settings.drift * settings.yaw_bias) / 100.0
    bias = rng.choice([-1.0, 1.0]) * rng.uniform(0.6, 1.4) * per_metre
    walk = np.radians(settings.drift * settings.yaw_walk) * np.sqrt(STEP / 100.0)
    turned = np.concatenate([[0.0], np.cumsum(bias * STEP + walk * rng.standard_normal(n_steps))])
    scale = 1.0 + settings.drift * settings.scale_walk / 100.0 * _wandering(n_steps, rng)
    steps = np.diff(truth.xy, axis=0) * scale[:, None]
    middle = 0.5 * (turned[1:] + turned[:-1])
    c, s = np.cos(middle), np.sin(middle)
    moved = np.stack([c * steps[:, 0] - s * steps[:, 1], s * steps[:, 0] + c * steps[:, 1]], axis=1)
    xy = np.concatenate([truth.xy[:1], truth.xy[0] + np.cumsum(moved, axis=0)])
    return truth._replace(xy=xy, heading=truth.heading + turned)


def _wandering(n_steps: int, rng: np.random.Generator) -> Floats:
    """Return a stationary series (n_steps,) of variance 1 that forgets itself over `SMOOTH` metres."""
    knots = rng.standard_normal(int(n_steps * STEP / SMOOTH) + 2)
    # Between knots the variance falls to a half; the factor makes it 1 on average.
    between = np.interp(np.arange(n_steps) * STEP / SMOOTH, np.arange(len(knots)), knots)
    return np.asarray(between * np.sqrt(1.5))
