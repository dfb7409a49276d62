"""A laser range finder and a ring of sonars in a world of walls: what each meets, and what it reads.

The laser's caster sweeps over angles and shares nothing with the one that maps are inferred with: every wall that shows
its free side to the sensor covers an interval of bearings, so only the beams in that interval are tested.

Sonars hear specular reflections: what a pulse meets face on, or in a corner, sends it back. A wall echoes from the foot
of the perpendicular on it, a right-angled corner of the room from every direction, and an edge that sticks out weakly;
each must be in view. The reading is the nearest echo that is loud enough. Nothing here is taken from the likelihood of
:mod:`prf.model.ranges`, so that maps made with it can be judged (docs/simulation.md).
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import numpy as np
from scipy.special import j1

from prf.configuration import LaserPhysics, SimulationOptions
from prf.readings.readings import PIONEER, QUARTER_DEGREES, half_circle, mounted
from prf.simulate.world import Floats

REL_TOL = 1e-9
"""Share of the step between beams by which intervals are widened, so that no beam slips between neighbouring walls."""
BLOCK = 64  # scans between two reports of progress


def is_half_circle(physics: LaserPhysics) -> bool:
    """Return whether the field of view is what a FLASER line of CARMEN of so many beams has."""
    return abs(physics.field_of_view - math.pi) < REL_TOL and physics.beams not in QUARTER_DEGREES


def step_of(physics: LaserPhysics) -> float:
    """Return the angle from beam to beam, radians."""
    if is_half_circle(physics):
        return float(np.diff(half_circle(physics.beams)[:2])[0])
    is_round = physics.field_of_view > 2.0 * math.pi - REL_TOL
    return physics.field_of_view / (physics.beams if is_round else physics.beams - 1)


def bearings_of(physics: LaserPhysics) -> Floats:
    """Return the directions of the beams (n,), radians from the heading, counter-clockwise from the right."""
    return np.asarray(-0.5 * physics.field_of_view + step_of(physics) * np.arange(physics.beams), dtype=np.float64)


def simulate_laser(
    walls: Floats,
    poses: Floats,
    physics: LaserPhysics,
    rng: np.random.Generator,
    report: Callable[[float], None] = lambda done: None,
) -> Floats:
    """Return what a laser reads.

    `walls` (n_walls, 4): as :attr:`World.walls`. `poses` (m, 3): of the sensor, in free space: x, y in metres, heading
    in radians. `report`: called with the share of scans done. Returns (m, beams): metres above 0; inf: no return.
    """
    return measure(cast(walls, poses, physics, report), physics, rng)


def cast(
    walls: Floats, poses: Floats, physics: LaserPhysics, report: Callable[[float], None] = lambda done: None
) -> Floats:
    """Return the distance (m, n) of the first wall on every beam, inf for none; see :func:`simulate_laser`."""
    distance = np.full((len(poses), physics.beams), np.inf)
    for i, pose in enumerate(poses):
        _sweep(walls, pose, physics, distance[i])
        if i % BLOCK == 0:
            report(i / len(poses))
    return distance


def measure(distance: Floats, physics: LaserPhysics, rng: np.random.Generator) -> Floats:
    """Return the readings of beams whose first wall lies at `distance`, any shape; inf: no wall.

    A return is normal round the distance, cut at 0; what it has beyond the maximum range is no return.
    """
    kind = rng.random(distance.shape)
    outlier = physics.max_range * (1.0 - rng.random(distance.shape))  # in (0, max_range]
    in_reach = distance < physics.max_range
    d = np.where(in_reach, distance, 0.0)
    spread = np.maximum(physics.noise, physics.noise_relative * d)
    reading = d + spread * rng.standard_normal(distance.shape)
    again = in_reach & (reading <= 0.0)
    while again.any():
        reading[again] = d[again] + spread[again] * rng.standard_normal(np.count_nonzero(again))
        again &= reading <= 0.0
    reading = np.where(in_reach & (reading < physics.max_range), reading, np.inf)
    miss = physics.outlier_probability + physics.miss_probability
    reading = np.where(kind < miss, np.inf, reading)
    return np.where((kind < physics.outlier_probability) & (outlier < physics.max_range), outlier, reading)


def _sweep(walls: Floats, pose: Floats, physics: LaserPhysics, distance: Floats) -> None:
    """Enter the distances of the nearest walls of one scan into `distance` (beams,)."""
    first, second = walls[:, :2] - pose[:2], walls[:, 2:] - pose[:2]
    # Twice the area between sensor and wall; positive if the sensor is on the wall's left, the free side.
    area = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]
    faces = np.flatnonzero(area > 0.0)
    first, second, area = first[faces], second[faces], area[faces]
    step, bearings = step_of(physics), bearings_of(physics)
    begin = np.arctan2(first[:, 1], first[:, 0]) - (pose[2] + bearings[0])
    begin = np.mod(begin, 2.0 * np.pi) / step
    width = np.arctan2(area, (first * second).sum(axis=1)) / step
    turn = 2.0 * np.pi / step
    # An interval may begin before the first beam, a turn earlier.
    begin = np.concatenate([begin, begin - turn])
    low = np.maximum(np.ceil(begin - REL_TOL), 0.0).astype(np.int64)
    high = np.minimum(np.floor(begin + np.tile(width, 2) + REL_TOL), physics.beams - 1.0).astype(np.int64)
    count = np.maximum(high - low + 1, 0)
    at = np.repeat(np.tile(np.arange(len(faces)), 2), count)
    beam = np.repeat(low - np.cumsum(count) + count, count) + np.arange(len(at))
    angle = pose[2] + bearings[beam]
    along = second[at] - first[at]
    slope = np.cos(angle) * along[:, 1] - np.sin(angle) * along[:, 0]
    with np.errstate(divide="ignore"):
        away = area[at] / slope
    # Beams that graze a wall's end divide rounding by rounding: what they find lies on the wall nevertheless.
    ends = np.hypot(*first[at].T), np.hypot(*second[at].T)
    away = np.clip(np.where(slope > 0.0, away, np.inf), None, np.maximum(*ends))
    nearest_last = np.argsort(-away, kind="stable")
    distance[beam[nearest_last]] = away[nearest_last]


RIGHT_ANGLE = math.radians(10.0)  # corners within this of a right angle send sound back to where it came from
SOUND_SPEED = 343.0  # metres a second
SHORT_OF = 1.0 - 1e-9  # share of the way to an echo on which a wall hides it: the wall that echoes does not


@dataclasses.dataclass(frozen=True)
class SonarPhysics:
    """A transducer of the ring; levels are decibels of amplitude over the threshold, on the axis of the beam.

    The receiver's gain grows with time and makes up for the distance, so walls and corners are equally loud everywhere.
    """

    max_range: float = SimulationOptions().sonar_max_range  # metres; farther echoes are not heard
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


def reflectors_of(walls: Floats) -> tuple[Floats, Floats]:
    """Return the walls with the corners between those that follow one another."""
    start = {tuple(xy): i for i, xy in enumerate(walls[:, :2].tolist())}
    after = np.array([start.get(tuple(xy), -1) for xy in walls[:, 2:].tolist()], dtype=np.int64)
    heading = np.arctan2(walls[:, 3] - walls[:, 1], walls[:, 2] - walls[:, 0])
    turn = np.where(after >= 0, np.angle(np.exp(1j * (heading[after] - heading))), 0.0) if len(walls) else heading
    is_square = np.abs(turn - 0.5 * np.pi) < RIGHT_ANGLE
    return walls[is_square, 2:], walls[turn < -RIGHT_ANGLE, 2:]


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
    corners, edges = reflectors_of(walls)
    places = [at for pose in poses for at in mounted(pose, ring)]
    heard = np.array([_nearest_echo(walls, corners, edges, at, physics, rng) for at in places])
    distance = heard.reshape(len(poses), len(ring))
    spread = np.maximum(physics.noise, physics.noise_relative * np.where(np.isinf(distance), 0.0, distance))
    reading = np.maximum(distance + spread * rng.standard_normal(distance.shape), 0.001)
    kind, outlier = rng.random(distance.shape), physics.max_range * (1.0 - rng.random(distance.shape))
    reading = np.where(kind < physics.outlier_probability, outlier, reading)
    missed = (kind >= physics.outlier_probability) & (kind < physics.outlier_probability + physics.miss_probability)
    return np.where(missed | (reading >= physics.max_range), np.inf, reading)


def _nearest_echo(
    walls: Floats, corners: Floats, edges: Floats, at: Floats, physics: SonarPhysics, rng: np.random.Generator
) -> float:
    """Return the distance of the nearest echo that is in view and loud enough; inf if there is none."""
    first, along = walls[:, :2] - at[:2], walls[:, 2:] - walls[:, :2]
    # Positive where the sensor is on the wall's left, the free side.
    area = first[:, 0] * along[:, 1] - first[:, 1] * along[:, 0]
    share = -(first * along).sum(axis=1) / np.maximum((along**2).sum(axis=1), 1e-18)
    feet = first + share[:, None] * along
    feet = feet[(area > 0.0) & (share >= 0.0) & (share <= 1.0)]
    loud = np.concatenate([feet, corners - at[:2]])
    places = np.concatenate([loud, edges - at[:2]])
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
