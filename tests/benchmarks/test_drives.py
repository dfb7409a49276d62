"""Drives of the benchmark of trajectories: rings that can be driven round, and logs that are disturbed as said."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import shapely

from benchmarks.drives import JUDGING, TUNING, disturbed, loop_world
from prf.simulate import read_world
from prf.simulate.path import read_path


@pytest.mark.parametrize("seed", TUNING + JUDGING)
def test_a_ring_is_driven_round_once_and_a_bit(tmp_path: Path, seed: int) -> None:
    world, path = (read(file) for read, file in zip((read_world, read_path), loop_world(tmp_path, seed), strict=True))
    path.check(world)
    way = shapely.LineString(path.rows)
    assert world.occupied.distance(way) > 0.2
    assert shapely.Polygon(path.rows[:5]).covers(shapely.Point(path.rows[:4].mean(axis=0)))
    assert way.length == pytest.approx(shapely.LinearRing(path.rows[:4]).length + 8.0)


def test_poses_of_a_log_are_disturbed_one_by_one(data_dir: Path, tmp_path: Path) -> None:
    drive = disturbed(tmp_path, data_dir / "demo-rooms.log.gz", [0.15, 0.03], 1)
    assert drive.poses is not None
    off = np.loadtxt(drive.poses, delimiter=",", skiprows=1) - drive.truth
    assert (off / [0.15, 0.15, 0.03]).std() == pytest.approx(1.0, abs=0.2)
