"""A robot's drive through all space that it can reach, and the poses at which it measures."""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import numpy as np

from prf.shell.errors import ConfigError
from prf.simulate.roadmap import CELL, Roadmap
from prf.simulate.tour import tour_places, viewpoints
from prf.simulate.world import Floats

SPEED = 0.5
"""Metres a second, while driving."""
TURNING = 1.0
"""Radians a second, while turning in place."""
MOST_SCANS = 10**8
LEAST_STOPS = 4
"""Viewpoints of a drive, so that a room is seen from more than one side."""
DIGITS = 6
"""Decimals of a pose, metres and radians: what a log writes is what was simulated."""


@dataclasses.dataclass(frozen=True)
class Spacing:
    """When a robot measures: whenever the metres and radians since the last scan, each in these units, add up to 1.

    Attributes
    ----------
    metres, radians : float
    """

    metres: float = 0.5
    radians: float = 0.5


class Scans(NamedTuple):
    """Where and when a robot measures.

    Attributes
    ----------
    pose : (n, 3) float64
        x, y in metres, heading in radians from -pi to pi.
    time : (n,) float64
        Seconds from the start.
    """

    pose: Floats
    time: Floats

    @classmethod
    def rounded(cls, pose: Floats, time: Floats) -> Scans:
        """Return scans at poses on `DIGITS` decimals and times in milliseconds, headings wrapped."""
        turned = pose.copy()
        turned[:, 2] = np.arctan2(np.sin(pose[:, 2]), np.cos(pose[:, 2]))
        return cls(np.round(turned, DIGITS), np.round(time, 3))


def plan_drive(road: Roadmap, reach: float, start: tuple[float, float] | None = None) -> Floats:
    """Return corners (n, 2) of a way that comes near every place of the roadmap.

    Viewpoints are chosen in the middle of the space first, until every place has one within `reach` metres of way, or
    less where the space is so small that the robot would hardly move. It visits all of them by a short tour; its legs
    are pulled straight where nothing stands in between.

    Parameters
    ----------
    road : Roadmap
    reach : float
        Metres.
    start : (x, y), optional
        Where to begin; default the place with most space round it.
    """
    stops = viewpoints(road, reach)
    while len(stops) < LEAST_STOPS and reach > CELL:
        reach *= 0.5
        stops = viewpoints(road, reach)
    first = 0 if start is None else int(np.hypot(*(road.xy[stops] - np.asarray(start)).T).argmin())
    corners = [road.xy[stops[first]][None]]
    corners += [pulled(road, road.xy[places])[1:] for places in tour_places(road, stops, first)]
    return np.concatenate(corners)


def pulled(road: Roadmap, way: Floats) -> Floats:
    """Return the corners (m, 2) of a way (n, 2) after leaving out all that are not needed to keep clear."""
    kept, here = [0], 0
    while here < len(way) - 1:
        clear = np.flatnonzero(road.clear(way[here], way[here + 1 :]))
        here += int(clear[-1]) + 1 if len(clear) else 1
        kept.append(here)
    return way[kept]


def scans_along(corners: Floats, spacing: Spacing, n_scans: int | None = None, stretch: bool = False) -> Scans:
    """Return the scans of a robot that drives along straight legs and turns in place between them.

    Parameters
    ----------
    corners : (n, 2) float64
        Metres.
    spacing : Spacing
    n_scans : int, optional
        How many; the robot drives the way and back until it has them. Default: as many as one drive gives.
    stretch : bool
        Spread `n_scans` evenly over one drive, metres and radians in the proportion of `spacing`.

    Raises
    ------
    ConfigError
        If there would be more than `MOST_SCANS`.
    """
    knots = _knots(corners, spacing)
    way = knots[-1, 0]
    wanted = max(way, n_scans or 0)
    if not wanted <= MOST_SCANS:
        raise ConfigError(f"the drive would have {wanted:.3g} scans. Give a larger --spacing, or fewer --readings.")
    if n_scans is None:
        marks = np.arange(int(way) + 1, dtype=np.float64)
    elif stretch:
        marks = np.arange(n_scans) * (way / max(n_scans, 1))
    else:
        laps = [corners, corners[::-1]]
        while len(corners) > 1 and knots[-1, 0] < n_scans - 1:
            corners = np.concatenate([corners, laps[1][1:]])
            laps.reverse()
            knots = _knots(corners, spacing)
        marks = np.minimum(np.arange(n_scans), knots[-1, 0])
    found = np.column_stack([np.interp(marks, knots[:, 0], column) for column in knots[:, 1:].T])
    return Scans.rounded(found[:, 1:], found[:, 0])


def _knots(corners: Floats, spacing: Spacing) -> Floats:
    """Return the way as (n, 5) points to interpolate between: units of spacing, seconds, x, y, heading."""
    legs = np.diff(corners, axis=0)
    length = np.hypot(*legs.T)
    corners, legs, length = np.r_[corners[:1], corners[1:][length > 0.0]], legs[length > 0.0], length[length > 0.0]
    if len(legs) == 0:
        return np.array([[0.0, 0.0, *corners[0], 0.0]])
    heading = np.unwrap(np.arctan2(legs[:, 1], legs[:, 0]))
    turn = np.abs(np.diff(heading, prepend=heading[0]))
    # Each leg has two knots: after the turn before it, and at its end.
    parts = np.column_stack([turn / spacing.radians, length / spacing.metres]).ravel()
    seconds = np.column_stack([turn / TURNING, length / SPEED]).ravel()
    xy = np.stack([corners[:-1], corners[1:]], axis=1).reshape(-1, 2)
    return np.column_stack([np.cumsum(parts), np.cumsum(seconds), xy, np.repeat(heading, 2)])
