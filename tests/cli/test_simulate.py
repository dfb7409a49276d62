"""The verb `prf simulate`: its directory runs through the other verbs, its numbers, its refusals."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.cli.calls import prf

ARGS = ("simulate", "--size", "9", "8", "--set", "simulate.beams=36", "--readings", "720")


def test_the_directory_and_the_table(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "floor"
    assert prf(*ARGS, "--seed", "2", "-o", str(folder)) == 0
    table = capsys.readouterr().out
    assert table.endswith(f"output    {folder}/, its picture {folder}/plan.png\n")
    assert "world     office, 10 x 9 m, " in table
    assert "laser     720 beams, " in table
    assert "seed      2\n" in table


def test_the_truth_scores_well_and_the_logs_are_read(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "floor"
    assert prf(*ARGS, "--seed", "3", "-o", str(folder), "--set", "simulate.outlier_probability=0", "-q") == 0
    capsys.readouterr()
    log = str(folder / "laser.log.gz")
    assert prf("score", str(folder / "truth.geojson"), "--laser", log, "--seed", "1", "--json") == 0
    scores = json.loads(capsys.readouterr().out)
    assert scores["within_0.2m"] > 0.99
    assert scores["beam_nll"] < -1.3
    assert scores["sensor_occupied"] == 0.0
    assert scores["max_range"] == pytest.approx(30.0, abs=0.01)
    assert prf("info", log, "--json") == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["n_scans"], found["n_beams"], found["suspicions"]) == (20, 720, [])
    assert prf("grid", "--laser", log, "-o", str(tmp_path / "g.npz"), "-q") == 0
    truth = str(folder / "truth.geojson")
    assert prf("export", truth, "--format", "ros-map", "-o", str(tmp_path / "map.yaml")) == 0


def test_an_exported_truth_can_be_simulated_in_again(tmp_path: Path) -> None:
    folder = tmp_path / "floor"
    assert prf(*ARGS, "--seed", "4", "-o", str(folder)) == 0
    truth, path = str(folder / "truth.geojson"), str(folder / "path.csv")
    ros = str(tmp_path / "map.yaml")
    assert prf("export", truth, "--format", "ros-map", "-o", ros, "-q") == 0
    for name, world in (("again", truth), ("raster", ros)):
        again = tmp_path / name
        args = ["simulate", "--world", world, "--path", path, "--set", "simulate.beams=36"]
        assert prf(*args, "--seed", "4", "-o", str(again)) == 0
        assert (again / "path.csv").read_text() == (folder / "path.csv").read_text()
    assert (tmp_path / "again" / "laser.log.gz").read_bytes() == (folder / "laser.log.gz").read_bytes()


def test_json_and_the_seed_that_was_drawn(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "draw"
    options = ("--world", "arak", "--json", "-o", str(folder))
    assert prf(*ARGS, *options) == 0
    first = json.loads(capsys.readouterr().out)
    assert first["schema"] == "prf.simulate/1"
    assert (first["output"], first["world"], first["n_scans"], first["n_beams"]) == (str(folder), "arak", 20, 720)
    assert prf(*ARGS, *options, "--seed", str(first["seed"]), "-f") == 0
    assert json.loads(capsys.readouterr().out) == first
