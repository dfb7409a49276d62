"""People who walk and cars that drive while the robot passes."""

from __future__ import annotations

import numpy as np

from mapq.simulate.kinds import Kind
from mapq.simulate.robot import Trajectory
from mapq.simulate.scene import SceneBuilder
from mapq.simulate.settings import Settings

METRES_PER_PERSON = 11.0
METRES_PER_CAR = 45.0
"""Of the robot's way, at clutter 1."""


def add_traffic(builder: SceneBuilder, way: Trajectory, settings: Settings, rng: np.random.Generator) -> None:
    """Add people on the pavements and, where the street is wide enough, cars in the other lane."""
    for _ in range(rng.poisson(settings.clutter * way.length / METRES_PER_PERSON)):
        _add_person(builder, way, settings, rng)
    if settings.street_width < 12.0:
        return
    for _ in range(rng.poisson(settings.clutter * way.length / METRES_PER_CAR)):
        _add_car(builder, way, settings, rng)


def _add_person(builder: SceneBuilder, way: Trajectory, settings: Settings, rng: np.random.Generator) -> None:
    """Add somebody who walks along the street for up to sixteen seconds, some metres before the robot."""
    distance = rng.uniform(0.0, way.length)
    side = rng.choice([-1.0, 1.0])
    lateral = side * (0.5 * settings.street_width - rng.uniform(0.8, 2.0))
    pace = rng.choice([-1.0, 1.0]) * rng.uniform(0.7, 1.6)
    start, velocity = _beside(way, distance, rng.uniform(2.0, 14.0), lateral, pace)
    time, span = distance / settings.speed, rng.uniform(4.0, 8.0)
    height = rng.uniform(1.5, 1.9)
    times = (time - span, time + span)
    builder.mover(start - span * velocity, velocity, times, rng.uniform(0.18, 0.28), (0.05, height), Kind.PERSON)


def _add_car(builder: SceneBuilder, way: Trajectory, settings: Settings, rng: np.random.Generator) -> None:
    """Add an oncoming car: a body and a cabin, both boxes; not where the robot turns."""
    distance = rng.uniform(0.0, way.length)
    _, headings = way.at(np.clip(distance + np.array([-6.0, 14.0]), 0.0, way.length))
    pace = -rng.uniform(4.0, 9.0)
    start, velocity = _beside(way, distance, rng.uniform(6.0, 16.0), rng.uniform(2.6, 3.2), pace)
    half, waist, top = rng.uniform(1.9, 2.3), rng.uniform(0.8, 0.95), rng.uniform(1.4, 1.6)
    if abs(headings[1] - headings[0]) > 0.1:
        return
    time, span = distance / settings.speed, 3.0
    times = (time - span, time + span)
    begin = start - span * velocity
    builder.mover(begin, velocity, times, (half, 0.85), (0.2, waist), Kind.MOVING_CAR)
    builder.mover(begin, velocity, times, (0.55 * half, 0.8), (waist, top), Kind.MOVING_CAR)


def _beside(way: Trajectory, distance: float, ahead: float, left: float, pace: float) -> tuple[np.ndarray, np.ndarray]:
    """Return a place (2,) seen from the robot, and a velocity (2,) along its heading."""
    xy, heading = way.at(np.array([distance]))
    c, s = np.cos(heading[0]), np.sin(heading[0])
    return xy[0] + ahead * np.array([c, s]) + left * np.array([-s, c]), pace * np.array([c, s])
