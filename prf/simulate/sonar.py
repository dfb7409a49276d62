"""A ring of sonars by specular reflection: what a pulse meets face on, or in a corner, sends it back.

A wall echoes from the foot of the perpendicular on it, a right-angled corner of the room from every direction, and an
edge that sticks out weakly; each must be in view. The reading is the nearest echo that is loud enough. Nothing here is
taken from the likelihood of :mod:`prf.model.sonar`, so that maps made with it can be judged (docs/simulation.md).
"""

from __future__ import annotations

import dataclasses
import math
from typing import NamedTuple

import numpy as np
from scipy.special import j1

from prf.model.domain import check_length
from prf.readings.robot import PIONEER, mounted
from prf.simulate.world import Floats

RIGHT_ANGLE = math.radians(10.0)  # corners within this of a right angle send sound back to where it came from
SOUND_SPEED = 343.0  # metres a second
SHORT_OF = 1.0 - 1e-9  # share of the way to an echo on which a wall hides it: the wall that echoes does not


@dataclasses.dataclass(frozen=True)
class SonarPhysics:
    """A transducer of the ring; levels are decibels of amplitude over the threshold, on the axis of the beam.

    The receiver's gain grows with time and makes up for the distance, so walls and corners are equally loud everywhere.
    """

    max_range: float = 8.0  # metres; farther echoes are not heard
    # frequency, aperture: hertz; radius of the transducer in metres: together they make the beam. Defaults of a
    # Polaroid transducer
    frequency: float = 49.4e3
    aperture: float = 0.018
    # wall_db, edge_db: level of a wall or corner, and of an edge at 1 m; an edge loses 10 dB a factor of ten in
    # distance
    wall_db: float = 30.0
    edge_db: float = 10.0
    flutter_db: float = 1.5  # standard deviation of the level of an echo
    # noise, noise_relative: standard deviation of a reading in metres and as a share of the distance; the larger counts
    noise: float = 0.005
    noise_relative: float = 0.002
    # outlier_probability, miss_probability: shares of the readings that are uniform between 0 and `max_range`, and that
    # hear nothing
    outlier_probability: float = 0.002
    miss_probability: float = 0.005

    def __post_init__(self) -> None:
        """Refuse a maximum range that no sonar has."""
        check_length("sonar-max-range", self.max_range)


class Reflectors(NamedTuple):
    """What echoes: walls (n, 4) as :attr:`World.walls`; places (m, 2) of right-angled corners, and of edges."""

    walls: Floats
    corners: Floats
    edges: Floats


def reflectors_of(walls: Floats) -> Reflectors:
    """Return the walls with the corners between those that follow one another."""
    start = {tuple(xy): i for i, xy in enumerate(walls[:, :2].tolist())}
    after = np.array([start.get(tuple(xy), -1) for xy in walls[:, 2:].tolist()], dtype=np.int64)
    heading = np.arctan2(walls[:, 3] - walls[:, 1], walls[:, 2] - walls[:, 0])
    turn = np.where(after >= 0, np.angle(np.exp(1j * (heading[after] - heading))), 0.0) if len(walls) else heading
    is_square = np.abs(turn - 0.5 * np.pi) < RIGHT_ANGLE
    return Reflectors(walls, walls[is_square, 2:], walls[turn < -RIGHT_ANGLE, 2:])


def directivity_db(angle: Floats, physics: SonarPhysics) -> Floats:
    """Return the level of a transducer, sending and hearing, at angles off its axis; a piston in a baffle."""
    size = 2.0 * math.pi * physics.frequency / SOUND_SPEED * physics.aperture
    x = np.maximum(size * np.sin(np.minimum(np.abs(angle), 0.5 * np.pi)), 1e-9)
    level: Floats = 40.0 * np.log10(np.maximum(np.abs(2.0 * j1(x) / x), 1e-6))
    return np.where(np.abs(angle) < 0.5 * np.pi, level, -np.inf)


def simulate_sonar(
    walls: Floats, poses: Floats, physics: SonarPhysics, rng: np.random.Generator, ring: Floats = PIONEER
) -> Floats:
    """Return what a ring of sonars reads at each pose, (m, r) metres; inf: no return.

    `walls` (n, 4): as :attr:`World.walls`. `poses` (m, 3): of the robot, in free space: x, y in metres, heading in
    radians. `ring` (r, 3): place and heading of each transducer on the robot; by default the 16 of a Pioneer.
    """
    reflectors = reflectors_of(walls)
    heard = np.array([[_nearest_echo(reflectors, at, physics, rng) for at in mounted(pose, ring)] for pose in poses])
    distance = heard.reshape(len(poses), len(ring))
    spread = np.maximum(physics.noise, physics.noise_relative * np.where(np.isinf(distance), 0.0, distance))
    reading = np.maximum(distance + spread * rng.standard_normal(distance.shape), 0.001)
    kind, outlier = rng.random(distance.shape), physics.max_range * (1.0 - rng.random(distance.shape))
    reading = np.where(kind < physics.outlier_probability, outlier, reading)
    missed = (kind >= physics.outlier_probability) & (kind < physics.outlier_probability + physics.miss_probability)
    return np.where(missed | (reading >= physics.max_range), np.inf, reading)


def _nearest_echo(reflectors: Reflectors, at: Floats, physics: SonarPhysics, rng: np.random.Generator) -> float:
    """Return the distance of the nearest echo that is in view and loud enough; inf if there is none."""
    walls = reflectors.walls
    first, along = walls[:, :2] - at[:2], walls[:, 2:] - walls[:, :2]
    # Positive where the sensor is on the wall's left, the free side.
    area = first[:, 0] * along[:, 1] - first[:, 1] * along[:, 0]
    share = -(first * along).sum(axis=1) / np.maximum((along**2).sum(axis=1), 1e-18)
    feet = first + share[:, None] * along
    feet = feet[(area > 0.0) & (share >= 0.0) & (share <= 1.0)]
    loud = np.concatenate([feet, reflectors.corners - at[:2]])
    places = np.concatenate([loud, reflectors.edges - at[:2]])
    distance = np.hypot(*places.T)
    off_axis = np.angle(np.exp(1j * (np.arctan2(places[:, 1], places[:, 0]) - at[2])))
    level = np.full(len(places), float(physics.wall_db))
    level[len(loud) :] = physics.edge_db - 10.0 * np.log10(np.maximum(distance[len(loud) :], 1e-3))
    level += directivity_db(off_axis, physics) + physics.flutter_db * rng.standard_normal(len(places))
    heard = np.flatnonzero((level > 0.0) & (distance < physics.max_range))
    for echo in heard[np.argsort(distance[heard], kind="stable")]:
        if not _is_hidden(places[echo], first, along, area):
            return float(distance[echo])
    return math.inf


def _is_hidden(place: Floats, first: Floats, along: Floats, area: Floats) -> bool:
    """Return whether a wall is between the sensor, at the origin, and a place; all walls relative to it."""
    slope = place[0] * along[:, 1] - place[1] * along[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        way = area / slope
        across = (first[:, 0] * place[1] - first[:, 1] * place[0]) / slope
    hides = (area > 0.0) & (slope > 0.0) & (way < SHORT_OF) & (across >= 0.0) & (across <= 1.0)
    return bool(hides.any())
