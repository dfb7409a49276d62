"""`prf calibrate`: sensors fitted in a known map, and the file that other verbs read."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path

import numpy as np
import pytest
import shapely

from prf.readings import write_table
from tests.cli.calls import prf
from tests.reference.known_worlds import HALL, laser_log, sonar_log


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("calibrate")
    sonar, laser = sonar_log(1, 25), laser_log(1, 10)
    write_table(path / "ring.csv", sonar.readings)
    write_table(path / "laser.csv", laser.readings)
    floor = {
        "type": "Feature",
        "geometry": shapely.geometry.mapping(sonar.area.region),
        "properties": {"window": list(HALL)},
    }
    (path / "floor.geojson").write_text(json.dumps(floor))
    far = {"type": "Polygon", "coordinates": [[[900, 0], [901, 0], [901, 1], [900, 0]]]}
    (path / "far.geojson").write_text(json.dumps(far))
    return path


def test_a_sonar_and_a_laser(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    args = [
        "calibrate",
        "--sonar",
        folder / "ring.csv",
        "--laser",
        folder / "laser.csv",
        "--set",
        "laser.max_range=8.0",
    ]
    args += ["--map", folder / "floor.geojson", "-o", tmp_path / "robot.toml"]
    assert prf(*args, "--json") == 0
    found = json.loads(capsys.readouterr().out)
    assert found["schema"] == "prf.calibrate/2"
    assert found["sonar"]["n_readings"] == 400
    assert found["laser"]["cone"] is None
    tables = tomllib.loads((tmp_path / "robot.toml").read_text())
    assert [*tables] == ["sonar", "laser"]
    values = {row["name"]: row["value"] for row in found["sonar"]["parameters"]}
    assert tables["sonar"]["surface_oblique"] == pytest.approx(values["surface_oblique"], rel=1e-4)
    assert prf(*args) == 4
    assert "already exists" in capsys.readouterr().err
    assert prf(*args, "-f") == 0
    shown = capsys.readouterr().out
    assert "surface_oblique" in shown
    assert "outlier_probability" in shown


def test_the_file_is_for_the_verbs_that_weigh_readings(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    """Fitted on some scans, other scans are more probable in the true map than with the defaults."""
    floor, ring = folder / "floor.geojson", folder / "ring.csv"
    assert prf("calibrate", "--sonar", ring, "--map", floor, "--skip-scans", "0::3", "-o", tmp_path / "s.toml") == 0
    capsys.readouterr()
    scores = []
    for options in ((), ("--config", tmp_path / "s.toml")):
        assert prf("score", floor, "--sonar", ring, "--scans", "0::3", "--json", *options) == 0
        scores.append(json.loads(capsys.readouterr().out)["sonar_nll"])
    assert scores[1] < scores[0] - 0.05


def test_wrong_poses_are_noticed(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    known = laser_log(1, 10)
    mixed = known.readings.select(np.arange(known.readings.n_beams))  # a copy
    mixed.range[:] = np.random.default_rng(1).permutation(mixed.range)
    write_table(tmp_path / "mixed.csv", mixed)
    assert (
        prf(
            "calibrate",
            "--laser",
            tmp_path / "mixed.csv",
            "--set",
            "laser.max_range=8.0",
            "--map",
            folder / "floor.geojson",
        )
        == 0
    )
    assert "no better than no map" in capsys.readouterr().err
