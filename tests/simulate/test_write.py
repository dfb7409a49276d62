"""Logs that are written: the readers give back what was simulated, whatever the scanner."""

from __future__ import annotations

import dataclasses
import gzip
import math
from pathlib import Path

import numpy as np
import pytest

from prf.configuration import ODOMETRY, LaserPhysics
from prf.model.sensors import CONE
from prf.poses.model import PosePrior, step_spread
from prf.poses.plane import seen_from, wrapped
from prf.readings import read_readings
from prf.readings.carmen import read_carmen
from prf.readings.describe import default_max_range
from prf.readings.readings import PIONEER, mounted
from prf.readings.table import read_table
from prf.shell.errors import ConfigError
from prf.shell.poses.files import read_pose_file
from prf.simulate import Scans, SimulateConfig, scans_along, simulate, write_simulation
from prf.simulate.path import given_scans, rms_errors
from prf.simulate.sensors import SonarPhysics, bearings_of
from prf.simulate.write import carmen_lines, no_return_number, path_lines, pose_lines, sonar_lines, tum_lines

RNG = np.random.default_rng(1)
SCANS = Scans.rounded(RNG.uniform(-40.0, 40.0, (20, 3)), np.arange(20) * 0.7)

KINDS = (("laser.log.gz", "laser"), ("sonar.csv.gz", "sonar"))


def as_bytes(lines: object) -> bytes:
    return "".join(f"{line}\n" for line in lines).encode()  # type: ignore[attr-defined]


def some_ranges(n_beams: int, max_range: float) -> np.ndarray:
    ranges = RNG.uniform(0.01, max_range, (20, n_beams))
    ranges[RNG.random(ranges.shape) < 0.1] = np.inf
    return ranges


@pytest.mark.parametrize(
    "physics",
    [
        LaserPhysics(),
        LaserPhysics(beams=181, max_range=8.0),
        LaserPhysics(beams=7, max_range=80.0),
        LaserPhysics(beams=401, max_range=80.0),
        LaserPhysics(beams=36, field_of_view=2.0 * math.pi),
        LaserPhysics(beams=50, field_of_view=4.19),
    ],
)
def test_carmen_logs_are_read_back(physics: LaserPhysics) -> None:
    ranges = some_ranges(physics.beams, physics.max_range)
    readings = read_carmen(as_bytes(carmen_lines(SCANS, ranges, physics)), "log")
    assert readings.notes.odd_lines == {}
    assert readings.notes.n_zero_ranges == 0
    np.testing.assert_array_equal(readings.notes.scans.pose, SCANS.pose)
    np.testing.assert_allclose(readings.time, np.repeat(SCANS.time, physics.beams))
    np.testing.assert_allclose(readings.angle, (SCANS.pose[:, 2:] + bearings_of(physics)).ravel(), atol=1e-12)
    max_range = default_max_range(readings)
    assert max_range == pytest.approx(physics.max_range, rel=2e-3)
    assert max_range >= physics.max_range
    found = np.where(readings.range < max_range, readings.range, np.inf).reshape(ranges.shape)
    np.testing.assert_allclose(found, ranges, atol=0.00051)


def test_short_readings_are_no_error_codes() -> None:
    ranges = np.tile([0.0002, 5.0], (20, 1))
    readings = read_carmen(as_bytes(carmen_lines(SCANS, ranges, LaserPhysics(beams=2))), "log")
    assert readings.range.tolist() == [0.001, 5.0] * 20


@pytest.mark.parametrize("max_range", [3.5, 8.0, 29.1, 30.0, 80.0, 81.83])
def test_the_number_for_no_return_lies_above_all_ranges(max_range: float) -> None:
    number = no_return_number(max_range)
    assert number > max_range
    assert 0.97 * number >= max_range
    assert float(f"{number:.3f}") == number


def test_sonar_tables_are_read_back() -> None:
    ranges = some_ranges(len(PIONEER), 8.0)
    readings = read_table(as_bytes(sonar_lines(SCANS, ranges)), "table", "sonar")
    assert (readings.cone == CONE).all()
    assert readings.scan.tolist() == np.repeat(np.arange(20), len(PIONEER)).tolist()
    np.testing.assert_allclose(readings.range.reshape(ranges.shape), ranges, atol=0.00051)
    np.testing.assert_allclose(readings.time, np.repeat(SCANS.time, len(PIONEER)))
    x, y, turn = SCANS.pose[7]
    front = PIONEER[3]
    place = (
        x + math.cos(turn) * front[0] - math.sin(turn) * front[1],
        y + math.sin(turn) * front[0] + math.cos(turn) * front[1],
    )
    beam = 7 * len(PIONEER) + 3
    assert readings.origin[beam] == pytest.approx(place, abs=1e-6)
    assert readings.angle[beam] == pytest.approx(turn + front[2], abs=1e-6)


def test_paths_can_be_driven_again(tmp_path: object) -> None:
    from prf.simulate.path import read_path

    file = tmp_path / "path.csv"  # type: ignore[operator]
    file.write_bytes(as_bytes(path_lines(SCANS)))
    np.testing.assert_array_equal(read_path(file).scans().pose, SCANS.pose)


def test_poses_are_read_as_poses_of_other_verbs(tmp_path: Path) -> None:
    for name, lines in (("true.csv", pose_lines(SCANS)), ("true.tum", tum_lines(SCANS))):
        (tmp_path / name).write_bytes(as_bytes(lines))
        found = read_pose_file(str(tmp_path / name))
        np.testing.assert_allclose(found.times, SCANS.time)
        np.testing.assert_allclose(found.poses[:, :2, 3], SCANS.pose[:, :2])
        turn = np.arctan2(found.poses[:, 1, 0], found.poses[:, 0, 0])
        np.testing.assert_allclose(turn, SCANS.pose[:, 2], atol=1e-8)


def test_without_errors_logs_stay_as_they_were(data_dir: Path, tmp_path: Path) -> None:
    laser = LaserPhysics(beams=180, field_of_view=6.283185307, outlier_probability=0.001)
    made = write_simulation(tmp_path, simulate(SimulateConfig(size=(10.0, 8.0), readings=3000, laser=laser), 1))
    packed = (data_dir / "demo-rooms.log.gz").read_bytes()
    assert gzip.decompress((tmp_path / "laser.log.gz").read_bytes()) == gzip.decompress(packed)
    assert not {"pose_noise", "odometry_noise"} & set(made["configuration"])
    assert "pose_rmse" not in made


def test_logs_share_errors_and_the_true_poses_lie_beside(tmp_path: Path) -> None:
    config = SimulateConfig(size=(9.0, 8.0), laser=LaserPhysics(beams=36), sonar=SonarPhysics())
    exact, made = simulate(config, 3), simulate(dataclasses.replace(config, pose_noise=(0.1, 0.02)), 3)
    manifest = write_simulation(tmp_path, made)
    laser, sonar = (read_readings(str(tmp_path / name), kind) for name, kind in KINDS)
    np.testing.assert_array_equal(laser.notes.scans.pose, made.given.pose)
    np.testing.assert_allclose(sonar.origin[0], mounted(made.given.pose[0], PIONEER)[0, :2], atol=1e-6)
    np.testing.assert_array_equal(exact.scans.pose, made.scans.pose)
    np.testing.assert_array_equal(exact.laser, made.laser)
    assert manifest["pose_rmse"] == pytest.approx([0.14, 0.02], rel=0.25)
    assert {"true_poses.csv", "true_poses.tum"} <= {entry["path"] for entry in manifest["files"]}
    write_simulation(tmp_path, exact)
    assert not (tmp_path / "true_poses.tum").exists()


# Poses of a log with errors: their sizes are those of the prior that the sampler has.


CORNERS = np.array([[2.0, 2.0], [28.0, 2.0], [28.0, 18.0], [2.0, 18.0], [2.0, 2.0]])
GIVEN_SCANS = scans_along(CORNERS)


def test_independent_errors_have_the_deviations_asked_for() -> None:
    found = np.array([rms_errors(GIVEN_SCANS, given(noise=(0.05, 0.01), seed=seed)) for seed in range(20)])
    assert np.sqrt((found**2).mean(axis=0)) == pytest.approx([0.05 * 2**0.5, 0.01], rel=0.05)
    assert np.array_equal(given(noise=(0.05, 0.01), seed=1).time, GIVEN_SCANS.time)


def test_steps_of_odometry_err_as_the_sampler_assumes_and_add_up() -> None:
    motion = seen_from(GIVEN_SCANS.pose[:-1], GIVEN_SCANS.pose[1:])
    spread = step_spread(motion, ODOMETRY["poor"])
    drawn = [given(odometry=ODOMETRY["poor"], seed=seed).pose for seed in range(50)]
    error = np.array([seen_from(pose[:-1], pose[1:]) - motion for pose in drawn])
    error[:, :, 2] = wrapped(error[:, :, 2])
    assert ((error / spread) ** 2).mean(axis=(0, 1)) == pytest.approx([1.0, 1.0, 1.0], abs=0.06)
    assert all(np.array_equal(pose[0], GIVEN_SCANS.pose[0]) for pose in drawn)
    # The law of the true poses around the recorded ones is the sampler's prior.
    prior = PosePrior(drawn[0], np.full((len(drawn[0]), 2), np.inf), seen_from(drawn[0][:-1], drawn[0][1:]), spread)
    assert -2.0 * prior.log_density(GIVEN_SCANS.pose) == pytest.approx(motion.size, rel=0.25)


@pytest.mark.parametrize(("kind", "largest"), [("precise", 0.6), ("wheels", 3.0), ("poor", 15.0)])
def test_a_loop_misses_by_what_such_a_robot_misses(kind: str, largest: float) -> None:
    missed = [given(odometry=ODOMETRY[kind], seed=seed).pose[-1, :2] - GIVEN_SCANS.pose[-1, :2] for seed in range(50)]
    assert largest / 6.0 < np.sqrt((np.array(missed) ** 2).sum(axis=1).mean()) < largest


def test_errors_of_both_kinds_at_once_are_refused() -> None:
    with pytest.raises(ConfigError, match="--pose-noise or --odometry"):
        SimulateConfig(pose_noise=(0.1, 0.1), odometry_noise=ODOMETRY["wheels"])


def given(noise: tuple[float, float] | None = None, odometry: tuple[float, ...] | None = None, seed: int = 0) -> Scans:
    return given_scans(GIVEN_SCANS, noise, odometry, np.random.default_rng(seed))
