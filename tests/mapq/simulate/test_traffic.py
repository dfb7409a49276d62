"""Who moves while the robot passes: people on the pavements, cars that come towards it."""

from __future__ import annotations

import numpy as np
import pytest

from mapq.simulate import Kind, Settings
from mapq.simulate.robot import Trajectory
from mapq.simulate.scene import SceneBuilder
from mapq.simulate.street import add_traffic


def movers(way: Trajectory, width: float, seed: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Return what moves: rows of whether a box, start, velocity, times, half sides, z, heading; and kinds."""
    builder = SceneBuilder()
    settings = Settings.of_size("small", {"street_width": width, "clutter": 2.0})
    add_traffic(builder, way, settings, np.random.default_rng(seed))
    return builder._movers.array(), np.array([kind for *_, kind in builder._movers.tags])


def straight(length: float = 2000.0) -> Trajectory:
    """Along x."""
    distance = np.linspace(0.0, length, 201)
    return Trajectory(distance, np.column_stack([distance, 0.0 * distance]), 0.0 * distance, np.empty(0))


def circle(radius: float = 12.0, turns: int = 25) -> Trajectory:
    heading = np.linspace(0.0, 2.0 * np.pi * turns, 200 * turns)
    xy = radius * np.column_stack([np.sin(heading), 1.0 - np.cos(heading)])
    return Trajectory(radius * heading, xy, heading, np.empty(0))


def test_cars_come_towards_the_robot_in_the_other_lane() -> None:
    rows, kinds = movers(straight(), 16.0)
    bodies, cabins = rows[kinds == Kind.MOVING_CAR][::2], rows[kinds == Kind.MOVING_CAR][1::2]
    assert len(bodies) == len(cabins) == pytest.approx(2.0 * 2000.0 / 45.0, rel=0.35)
    assert (bodies[:, 0] == 1.0).all(), "boxes"
    assert (bodies[:, 3] < -3.9).all(), "against the robot's heading"
    assert (np.abs(bodies[:, 2] - 2.9) <= 0.3).all(), "left of its lane"
    np.testing.assert_array_equal(bodies[:, 1:7], cabins[:, 1:7])
    np.testing.assert_array_equal(bodies[:, 10], cabins[:, 9])
    assert (cabins[:, 7] < bodies[:, 7]).all(), "a cabin is shorter than its body, and stands on it"


def test_there_are_none_in_narrow_streets_nor_where_the_robot_turns() -> None:
    assert Kind.MOVING_CAR not in movers(straight(), 11.0)[1]
    assert Kind.MOVING_CAR not in movers(circle(), 16.0)[1]
    assert Kind.PERSON in movers(circle(), 16.0)[1]


def test_people_keep_to_the_pavements() -> None:
    rows, kinds = movers(straight(), 11.0)
    assert set(kinds.tolist()) == {Kind.PERSON}
    assert len(rows) == pytest.approx(2.0 * 2000.0 / 11.0, rel=0.25)
    assert ((np.abs(rows[:, 2]) >= 3.5) & (np.abs(rows[:, 2]) <= 4.7)).all()
    assert (np.abs(rows[:, 3]) <= 1.6).all()
