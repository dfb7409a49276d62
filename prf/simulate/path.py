"""A robot's drive, planned or from a CSV file, the poses at which it measures, and those that it writes down."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import shapely

from prf.poses.model import PosePrior, step_spread
from prf.poses.plane import seen_from, wrapped
from prf.readings.text import BYTE_ORDER_MARK, IntArray, decompress, read_rows
from prf.shell.cli.files import open_input
from prf.shell.errors import ConfigError, InputError
from prf.simulate.roadmap import CELL, Roadmap, tour_places, viewpoints
from prf.simulate.world import Floats, World

SPEED = 0.5  # metres a second, while driving
TURNING = 1.0  # radians a second, while turning in place
MAX_SCANS = 10**8
MIN_STOPS = 4  # viewpoints of a drive, so that a room is seen from more than one side
DIGITS = 6  # decimals of a pose, metres and radians: what a log writes is what was simulated
COLUMNS = ("x", "y", "theta", "t")
SPACING = (0.5, 0.5)
"""Metres and radians: a robot measures whenever those since the last scan, each in these units, add up to 1."""


class Scans(NamedTuple):
    """Where and when a robot measures."""

    pose: Floats  # (n, 3) x, y in metres, heading in radians from -pi to pi
    time: Floats  # (n,) seconds from the start

    @classmethod
    def rounded(cls, pose: Floats, time: Floats) -> Scans:
        """Return scans at poses on `DIGITS` decimals and times in milliseconds, headings wrapped."""
        turned = pose.copy()
        turned[:, 2] = np.arctan2(np.sin(pose[:, 2]), np.cos(pose[:, 2]))
        return cls(np.round(turned, DIGITS), np.round(time, 3))


def plan_drive(road: Roadmap, reach: float) -> Floats:
    """Return corners (n, 2) of a way that passes near every place of the roadmap.

    Viewpoints are chosen in the middle of the space first, until every place has one within `reach` metres of way, or
    less where the space is so small that the robot would hardly move. It visits all of them by a short tour; its legs
    are pulled straight where nothing is in between.

    `reach`: metres.
    """
    stops = viewpoints(road, reach)
    while len(stops) < MIN_STOPS and reach > CELL:
        reach *= 0.5
        stops = viewpoints(road, reach)
    corners = [road.xy[stops[0]][None]]  # the place with most space round it
    corners += [pulled(road, road.xy[places])[1:] for places in tour_places(road, stops, 0)]
    return np.concatenate(corners)


def pulled(road: Roadmap, way: Floats) -> Floats:
    """Return the corners (m, 2) of a way (n, 2) after leaving out all that are not needed to keep clear."""
    kept, here = [0], 0
    while here < len(way) - 1:
        clear = np.flatnonzero(road.clear(way[here], way[here + 1 :]))
        here += int(clear[-1]) + 1 if len(clear) else 1
        kept.append(here)
    return way[kept]


def scans_along(corners: Floats, spacing: tuple[float, float] = SPACING, n_scans: int | None = None) -> Scans:
    """Return the scans of a robot that drives along straight legs and turns in place between them.

    `corners` (n, 2): metres. `spacing`: as :data:`SPACING`. `n_scans`: how many, spread evenly over the drive, metres
    and radians in the proportion of `spacing`. Default: by spacing.
    """
    knots = _knots(corners, spacing)
    way = knots[-1, 0]
    if not max(way, n_scans or 0) <= MAX_SCANS:
        raise ConfigError(
            f"the drive would have {max(way, n_scans or 0):.3g} scans. Give a larger --set simulate.spacing=, or fewer "
            "--readings."
        )
    marks = np.arange(int(way) + 1.0) if n_scans is None else np.arange(n_scans) * (way / n_scans)
    found = np.column_stack([np.interp(marks, knots[:, 0], column) for column in knots[:, 1:].T])
    return Scans.rounded(found[:, 1:], found[:, 0])


def _knots(corners: Floats, spacing: tuple[float, float]) -> Floats:
    """Return the way as (n, 5) points to interpolate between: units of spacing, seconds, x, y, heading."""
    legs = np.diff(corners, axis=0)
    length = np.hypot(*legs.T)
    corners, legs, length = np.r_[corners[:1], corners[1:][length > 0.0]], legs[length > 0.0], length[length > 0.0]
    if len(legs) == 0:
        return np.array([[0.0, 0.0, *corners[0], 0.0]])
    heading = np.unwrap(np.arctan2(legs[:, 1], legs[:, 0]))
    turn = np.abs(np.diff(heading, prepend=heading[0]))
    # Each leg has two knots: after the turn before it, and at its end.
    parts = np.column_stack([turn / spacing[1], length / spacing[0]]).ravel()
    seconds = np.column_stack([turn / TURNING, length / SPEED]).ravel()
    xy = np.stack([corners[:-1], corners[1:]], axis=1).reshape(-1, 2)
    return np.column_stack([np.cumsum(parts), np.cumsum(seconds), xy, np.repeat(heading, 2)])


class PathFile(NamedTuple):
    """The rows of a file."""

    source: str
    line: IntArray  # (n,) lines of the rows
    # (n, 2) waypoints x, y in metres, or poses with the heading in radians and perhaps the time in seconds
    rows: Floats

    @property
    def has_headings(self) -> bool:
        """Whether the rows are poses at which to measure."""
        return bool(self.rows.shape[1] > 2)

    def scans(self) -> Scans:
        """Return scans at the poses; without times the robot turns and drives from one to the next."""
        if self.rows.shape[1] == len(COLUMNS):
            return Scans.rounded(self.rows[:, :3], self.rows[:, 3])
        turn = np.abs(np.angle(np.exp(1j * np.diff(self.rows[:, 2]))))
        seconds = np.hypot(*np.diff(self.rows[:, :2], axis=0).T) / SPEED + turn / TURNING
        return Scans.rounded(self.rows, np.r_[0.0, np.cumsum(seconds)])

    def check(self, world: World) -> None:
        """Refuse a path that runs into a wall or out of the window."""
        free = world.free_at(self.rows[:, :2])
        if not free.all():
            first = int(np.argmin(free))
            x, y = self.rows[first, :2]
            raise InputError(f"{self.source}:{self.line[first]}: ({x:g}, {y:g}) is occupied or outside the world.")
        if self.has_headings or len(self.rows) < 2:
            return
        legs = shapely.linestrings(np.stack([self.rows[:-1], self.rows[1:]], axis=1))
        hit = shapely.intersects(world.occupied, legs)
        if hit.any():
            first = int(np.argmax(hit))
            a, b = self.line[first], self.line[first + 1]
            raise InputError(f"{self.source}:{b}: the way from the waypoint of line {a} runs into a wall.")


def read_path(path: str | os.PathLike[str]) -> PathFile:
    """Read a path: CSV with the columns x, y and perhaps theta and t; ``-`` is standard input.

    With theta the rows are poses to measure at, and t is the time; without theta they are waypoints and t is not read.
    """
    with open_input(path) as stream:
        data = decompress(stream.read(), str(path)).removeprefix(BYTE_ORDER_MARK)
    rows = read_rows(data, str(path), COLUMNS[:2], COLUMNS[2:], {}, "Give a CSV with the columns x,y or x,y,theta.")
    names = COLUMNS if "theta" in rows.columns else COLUMNS[:2]
    table = np.column_stack([rows.columns[name] for name in names if name in rows.columns])
    return PathFile(str(path), rows.line, table)


NO_STEPS = np.zeros((0, 3))
UNKNOWN = (np.inf, np.inf)


def given_scans(
    scans: Scans, noise: Sequence[float] | None, odometry: Sequence[float] | None, rng: np.random.Generator
) -> Scans:
    """Return scans at the poses that a robot would write down, drawn from what `prf sample` assumes; wheels never slip.

    `noise`: standard deviations of independent errors, metres and radians. `odometry`: the four numbers of
    :data:`prf.configuration.ODOMETRY`; steps from scan to scan, each with its error, add up from the true first pose.
    """
    steps = (NO_STEPS, NO_STEPS)
    if odometry is not None:
        motion = seen_from(scans.pose[:-1], scans.pose[1:])
        steps = (motion, step_spread(motion, odometry))
    errors = np.tile(np.array(UNKNOWN if noise is None else noise, np.float64), (len(scans.pose), 1))
    prior = PosePrior(scans.pose, errors, *steps, slip=0.0)
    return Scans.rounded(prior.draw(rng), scans.time)


def rms_errors(scans: Scans, given: Scans) -> list[float]:
    """Return the root mean square errors of given poses: of the place, metres, and of the heading, radians."""
    error: Floats = given.pose - scans.pose
    squares = (error[:, 0] ** 2 + error[:, 1] ** 2, wrapped(error[:, 2]) ** 2)
    return [float(np.sqrt(each.mean())) for each in squares]
