"""Simulations as a whole: every sensor in free space, streams of their own, files that follow from the seed."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

from prf.configuration import LaserPhysics
from prf.readings import read_readings
from prf.results import read_map_feature
from prf.shell.errors import ConfigError, InputError
from prf.simulate import SimulateConfig, simulate, summary, write_simulation
from prf.simulate.sensors import SonarPhysics
from prf.simulate.simulation import MIN_ROOM
from prf.simulate.write import FILES
from tests.reference.slow_coloring import edge_set

SMALL = SimulateConfig(size=(9.0, 8.0), laser=LaserPhysics(beams=36), readings=720)


@pytest.mark.parametrize("world", ["office", "arak"])
def test_sensors_are_in_free_space(world: str) -> None:
    for seed in range(3):
        made = simulate(dataclasses.replace(SMALL, world=world, scale=0.15), seed)
        assert made.world.free_at(made.scans.pose[:, :2]).all()
        assert made.laser is not None
        assert made.laser.shape == (20, 36)


def test_draws_are_redrawn_until_there_is_room_or_the_path_is_free(tmp_path: Path) -> None:
    config = dataclasses.replace(SMALL, world="arak", size=(12.0, 12.0), scale=0.25)
    redrawn = [simulate(config, seed).n_redrawn for seed in range(8)]
    assert max(redrawn) > 0
    (tmp_path / "path.csv").write_text("x,y,theta\n2,2,0\n10,3,1\n6,6,2\n3,10,3\n")
    given = dataclasses.replace(config, path=str(tmp_path / "path.csv"), readings=None)
    for seed in range(4):
        made = simulate(given, seed)
        assert made.scans.pose[:, 0].tolist() == [2.0, 10.0, 6.0, 3.0]
        assert made.world.free_at(made.scans.pose[:, :2]).all()
    assert 0.0 < MIN_ROOM < 0.5


def test_waypoints_are_driven_at_the_spacing(tmp_path: Path) -> None:
    (tmp_path / "map.geojson").write_text(
        json.dumps({"type": "Polygon", "coordinates": [[[0, 0], [5, 0], [5, 0.2], [0, 0.2], [0, 0]]]})
    )
    (tmp_path / "path.csv").write_text("x,y\n1,1\n4,1\n")
    config = SimulateConfig(
        world=str(tmp_path / "map.geojson"), path=str(tmp_path / "path.csv"), spacing=0.25, laser=LaserPhysics(beams=3)
    )
    made = simulate(config, 1)
    np.testing.assert_allclose(np.diff(made.scans.pose[:, 0]), 0.25)
    assert len(made.scans.time) == 13
    (tmp_path / "path.csv").write_text("x,y\n1,1\n4,0.1\n")
    with pytest.raises(InputError, match=r"path\.csv:3"):
        simulate(config, 1)


def test_written_simulations_are_read_back_and_follow_the_seed(tmp_path: Path) -> None:
    made = simulate(SMALL, 5)
    manifest = write_simulation(tmp_path / "a", made)
    write_simulation(tmp_path / "b", simulate(SMALL, 5))
    names = sorted(path.name for path in (tmp_path / "a").iterdir())
    assert names == sorted(set(FILES) - {"sonar.csv.gz", "true_poses.csv", "true_poses.tum"})
    for name in names:
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes(), name
    coloring, properties = read_map_feature(tmp_path / "a" / "truth.geojson")
    assert edge_set(coloring) == edge_set(made.world.coloring())
    assert properties["seed"] == 5
    readings = read_readings(str(tmp_path / "a" / "laser.log.gz"))
    assert readings.n_beams == manifest["n_beams"] == 720
    stored = json.loads((tmp_path / "a" / "manifest.json").read_text())
    assert stored["schema"] == "prf.simulation/2"
    assert stored["configuration"]["laser"]["beams"] == 36
    assert {entry["path"] for entry in stored["files"]} == set(names) - {"manifest.json"}
    assert summary(made).items() <= manifest.items()


def test_logs_of_an_earlier_simulation_are_removed_and_other_files_kept(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    folder.mkdir()
    (folder / "sonar.csv.gz").write_bytes(b"old")
    (folder / "notes.txt").write_text("mine")
    write_simulation(folder, simulate(SMALL, 6))
    assert not (folder / "sonar.csv.gz").exists()
    assert (folder / "notes.txt").read_text() == "mine"


def test_a_sonar_joins_without_changing_the_rest(tmp_path: Path) -> None:
    both = dataclasses.replace(SMALL, sonar=SonarPhysics(max_range=5.0), readings=320)
    made, alone = simulate(both, 7), simulate(SMALL, 7)
    assert made.sonar is not None
    assert made.laser is not None
    assert made.sonar.shape == (20, 16)
    assert np.array_equal(made.laser, alone.laser)
    assert 0.5 < np.isfinite(made.sonar).mean() < 1.0
    assert made.sonar[np.isfinite(made.sonar)].max() <= 5.1
    manifest = write_simulation(tmp_path / "ring", made)
    readings = read_readings(str(tmp_path / "ring" / "sonar.csv.gz"), "sonar")
    assert (readings.n_scans, readings.n_beams) == (20, manifest["n_sonar"]) == (20, 320)
    assert made.world.free_at(readings.origin).all()


def test_a_path_too_close_for_the_ring_is_refused(tmp_path: Path) -> None:
    (tmp_path / "map.geojson").write_text(
        json.dumps({"type": "Polygon", "coordinates": [[[0, 0], [5, 0], [5, 0.2], [0, 0.2], [0, 0]]]})
    )
    (tmp_path / "path.csv").write_text("x,y,theta\n1,1,0\n2,0.3,0\n")
    files = {"world": str(tmp_path / "map.geojson"), "path": str(tmp_path / "path.csv")}
    assert len(simulate(SimulateConfig(**files), 1).scans.time) == 2  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"path\.csv: at \(2, 0\.3\) the sonar ring is in a wall"):
        simulate(SimulateConfig(**files, sonar=SonarPhysics()), 1)  # type: ignore[arg-type]


def test_an_empty_world_and_a_small_one(tmp_path: Path) -> None:
    empty = {"type": "Feature", "properties": {"window": [0, 0, 6, 5]}, "geometry": None}
    (tmp_path / "map.geojson").write_text(json.dumps(empty))
    made = simulate(SimulateConfig(world=str(tmp_path / "map.geojson"), readings=1800), 1)
    assert made.laser is not None
    assert np.isinf(made.laser).mean() > 0.98
    write_simulation(tmp_path / "empty", made)
    small = simulate(SimulateConfig(size=(3.5, 3.0), readings=1800), 1)
    assert np.ptp(small.scans.pose[:, 2]) > np.pi
    assert np.ptp(small.scans.pose[:, 0]) > 0.5


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"spacing": 0.5}, "not both"),
        ({"readings": 0}, "readings"),
        ({"laser": None}, "no sensor"),
        ({"sonar": SonarPhysics(), "robot_radius": 0.2}, "the sonar ring needs 0.211 m"),
    ],
)
def test_what_cannot_be_simulated_is_refused(changes: dict[str, object], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        dataclasses.replace(SMALL, **changes)  # type: ignore[arg-type]
