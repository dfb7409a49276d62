"""The simulated ring of sonars: what echoes, from where, and what is in the way."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray

from prf.simulate.sensors import SonarPhysics, directivity_db, simulate_sonar
from tests.readings.sonar_sets import ARENA_POSITIONS, CORRIDOR_BEARINGS, arena_readings, corridor8_readings

QUIET = SonarPhysics(
    flutter_db=0.0, noise=0.0, noise_relative=0.0, outlier_probability=0.0, miss_probability=0.0, edge_db=-90.0
)
AHEAD = np.zeros((1, 3))
ROOM = np.array([[-2.0, -1.0, 4.0, -1.0], [4.0, -1.0, 4.0, 3.0], [4.0, 3.0, -2.0, 3.0], [-2.0, 3.0, -2.0, -1.0]])
"""Walls round a room of 6 x 4 m, the free side on the left."""
BLOCK = np.array([[1.0, 0.2, 1.0, -0.2], [1.0, -0.2, 0.8, -0.2], [0.8, -0.2, 0.8, 0.2], [0.8, 0.2, 1.0, 0.2]])
"""Walls round a block of 0.2 x 0.4 m in it."""


def heard(walls: np.ndarray, heading: float, physics: SonarPhysics = QUIET) -> float:
    pose = np.array([[0.0, 0.0, heading]])
    return float(simulate_sonar(walls, pose, physics, np.random.default_rng(1), AHEAD)[0, 0])


def test_a_wall_echoes_from_the_foot_of_the_perpendicular_within_the_beam() -> None:
    assert heard(ROOM, 0.0) == 4.0
    assert heard(ROOM, math.radians(8.0)) == 4.0
    assert heard(ROOM, math.pi) == 2.0
    wall = ROOM[1:2]
    assert heard(wall, math.radians(13.6)) == math.inf
    assert heard(wall, math.pi) == math.inf


def test_a_square_corner_echoes_and_its_slanting_walls_do_not() -> None:
    corner = math.atan2(3.0, 4.0)
    assert heard(ROOM, corner) == pytest.approx(5.0)
    assert heard(ROOM[[0, 2, 3]], corner) == math.inf


def test_edges_that_stick_out_echo_weakly() -> None:
    diamond = np.array([[2.0, 0.0, 3.0, 1.0], [3.0, 1.0, 4.0, 0.0], [4.0, 0.0, 3.0, -1.0], [3.0, -1.0, 2.0, 0.0]])
    loud = dataclasses.replace(QUIET, edge_db=12.0)
    assert heard(diamond, 0.0, loud) == 2.0
    assert heard(diamond, math.radians(9.0), loud) == math.inf
    assert heard(diamond, 0.0) == math.inf


def test_nothing_behind_a_wall_is_heard() -> None:
    assert heard(np.concatenate([ROOM, BLOCK]), 0.0) == pytest.approx(0.8)
    assert heard(np.concatenate([ROOM, BLOCK + np.tile([0.0, 0.5], 2)]), 0.0) == 4.0
    assert heard(np.concatenate([ROOM, BLOCK - np.tile([2.0, 0.0], 2)]), 0.0) == 4.0
    screen = np.array([[1.0, -0.3, 3.0, 0.5]])
    assert heard(np.concatenate([ROOM[1:2], screen]), 0.0) == math.inf


def test_the_beam_has_its_first_zero_where_a_piston_has() -> None:
    zero = math.asin(3.8317 / (2.0 * math.pi * 49.4e3 / 343.0 * 0.018))
    assert directivity_db(np.array([0.0]), QUIET)[0] == pytest.approx(0.0)
    assert directivity_db(np.array([zero]), QUIET)[0] < -100.0
    assert directivity_db(np.array([3.0]), QUIET)[0] == -math.inf


def test_noise_outliers_and_misses_have_their_shares() -> None:
    noisy = dataclasses.replace(QUIET, noise=0.02, outlier_probability=0.1, miss_probability=0.2)
    poses = np.zeros((4000, 3))
    readings = simulate_sonar(ROOM, poses, noisy, np.random.default_rng(2), AHEAD)[:, 0]
    # Five standard errors of a share of 4,000; of the mean of 2,800; of their standard deviation.
    assert np.isinf(readings).mean() == pytest.approx(0.2, abs=5 * math.sqrt(0.16 / 4000))
    near = readings[np.abs(readings - 4.0) < 0.1]
    assert len(near) / 4000 == pytest.approx(0.7 + 0.1 * 0.2 / 8.0, abs=5 * math.sqrt(0.21 / 4000))
    assert near.mean() == pytest.approx(4.0, abs=5 * 0.02 / math.sqrt(2800))
    assert near.std() == pytest.approx(0.02, rel=0.1)


def test_an_empty_world_and_a_far_wall_return_nothing() -> None:
    assert heard(np.empty((0, 4)), 0.0) == math.inf
    assert heard(ROOM, 0.0, dataclasses.replace(QUIET, max_range=3.9)) == math.inf


# The simulated sonar beside real readings: an arena with known walls, and two corridors drawn after their echoes.
#
# Bounds are what was seen, with some room for another seed; docs/simulation.md has the figures.


Floats = NDArray[np.float64]

SPUR = 0.005
"""Metres. Half of the thickness of the arena's spur wall."""
ARENA = [(0, 0), (2.1, 0), (2.1, 0.84), (1.68, 0.84), (1.68, 2.1), (0.84 + SPUR, 2.1), (0.84 + SPUR, 1.26),
         (0.84 - SPUR, 1.26), (0.84 - SPUR, 1.68), (0, 1.68)]  # fmt: skip
ARENA_HEADINGS = np.radians([3.0, 3.0, -9.0, -9.0, 0.0])
"""That fit best: the robot was placed by hand."""
ARENA_SONAR = SonarPhysics(max_range=2.55, frequency=40e3, aperture=0.006, wall_db=25.0, edge_db=0.0)
"""A pair of small transducers of 40 kHz, which have a wide beam."""

CORRIDOR_SONAR = SonarPhysics(max_range=5.11)
DOOR, RECESS = 0.95, 0.1
"""Metres. Doors in the corridors, as far as their echoes show: width, and depth behind the wall."""


def ring_of(bearings: Floats) -> Floats:
    return np.stack([np.zeros_like(bearings), np.zeros_like(bearings), bearings], axis=1)


def rooms(free: shapely.Polygon) -> Floats:
    """Return the walls round free space."""
    xy = np.array(shapely.geometry.polygon.orient(free).exterior.coords)
    return np.hstack([xy[:-1], xy[1:]])


def corridors() -> shapely.Polygon:
    """Return the free space of the two corridors, drawn by hand after the picture of the echoes."""
    parts = [(-4, -0.87, 18.2, 1.22), (15.3, -12.5, 17.6, 1.22), (11, -2.7, 15.4, 0)]
    parts += [(x - DOOR, 1.2, x, 1.22 + RECESS) for x in (2.0, 5.2, 8.6, 11.9, 15.2)]
    parts += [(x - DOOR, -0.87 - RECESS, x, -0.8) for x in (2.4, 3.6, 4.8, 6.0, 7.5, 10.6)]
    parts += [(17.5, y - DOOR, 17.6 + RECESS, y) for y in (-2.7, -4.3, -5.4, -8.5)]
    parts += [(15.3 - RECESS, y - DOOR, 15.35, y) for y in (-4.5, -5.7, -9.1)]
    return shapely.union_all([shapely.box(*part) for part in parts])


def along_axis(free: shapely.Polygon, poses: Floats, bearings: Floats) -> tuple[Floats, Floats]:
    """Return the distance (m, n) to the first obstacle on each axis, and the angle of incidence there, degrees."""
    walls = rooms(free)
    angle = poses[:, 2, None] + bearings
    u = np.stack([np.cos(angle), np.sin(angle)], axis=-1)[:, :, None]
    across, off = walls[:, 2:] - walls[:, :2], walls[:, :2] - poses[:, None, None, :2]
    sine = u[..., 0] * across[:, 1] - u[..., 1] * across[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = (off[..., 0] * across[:, 1] - off[..., 1] * across[:, 0]) / sine
        share = (off[..., 0] * u[..., 1] - off[..., 1] * u[..., 0]) / sine
    distance = np.where((distance > 0) & (share >= 0) & (share <= 1), distance, np.inf)
    first = distance.argmin(axis=2)[..., None]
    cosine = np.take_along_axis(np.abs(sine) / np.hypot(across[:, 0], across[:, 1]), first, 2)[..., 0]
    return np.take_along_axis(distance, first, 2)[..., 0], np.degrees(np.arccos(np.minimum(cosine, 1.0)))


def shares(reading: Floats, axis: Floats) -> Floats:
    """Return the shares of readings that are near the first obstacle, shorter, longer, and no return."""
    off = reading - axis
    near, short = np.abs(off) < 0.08, off <= -0.08
    return np.array([near.mean(), short.mean(), (~near & ~short & np.isfinite(off)).mean(), np.isinf(off).mean()])


def test_the_arena_reads_as_it_did(shared_data: Path) -> None:
    real = arena_readings(shared_data / "prf" / "sonar" / "arena_known_map").range.reshape(5, 180)
    bearings = np.arange(180) * np.radians(2.0)
    poses = np.column_stack([0.01 * np.array(ARENA_POSITIONS, dtype=np.float64), ARENA_HEADINGS])
    free = shapely.Polygon(ARENA)
    simulated = simulate_sonar(rooms(free), poses, ARENA_SONAR, np.random.default_rng(4), ring_of(bearings))
    both = np.isfinite(simulated) & np.isfinite(real)
    off = simulated[both] - real[both]
    assert both.mean() > 0.9
    assert abs(np.median(off)) < 0.02
    assert (np.abs(off) < 0.06).mean() > 0.7
    axis, incidence = along_axis(free, poses, bearings)
    for low, most in ((0.0, 0.08), (7.5, 0.1), (15.0, 0.1), (22.5, 0.12), (30.0, 0.22)):
        band = (incidence >= low) & (incidence < low + 7.5)
        assert np.abs(shares(simulated[band], axis[band]) - shares(real[band], axis[band])).max() < most


def test_the_corridors_read_much_as_they_did(shared_data: Path) -> None:
    readings = corridor8_readings(shared_data / "prf" / "sonar" / "corridor8")
    real = readings.range.reshape(-1, 8)
    poses = np.column_stack([readings.origin[::8], readings.angle[::8] - CORRIDOR_BEARINGS[0]])
    simulated = simulate_sonar(
        rooms(corridors()), poses, CORRIDOR_SONAR, np.random.default_rng(4), ring_of(CORRIDOR_BEARINGS)
    )
    # The transducer at +7.5 degrees heard next to nothing in reality; the others are compared.
    sound = np.arange(8) != 4
    lost = np.isinf(simulated).mean(axis=0) - np.isinf(real).mean(axis=0)
    assert np.abs(lost[sound]).max() < 0.2
    assert abs(lost[sound].mean()) < 0.07
    assert abs((simulated > 3.5)[:, sound].mean() - (real > 3.5)[:, sound].mean()) < 0.12
    sideways = np.array([0, 7])
    middle = [np.median(one[:, sideways][np.isfinite(one[:, sideways])]) for one in (simulated, real)]
    assert abs(middle[0] - middle[1]) < 0.05
