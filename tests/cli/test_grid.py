"""`prf grid`, and the verbs that take a GRID where they take a RUN."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from prf.results.occupancy import occupied_probability, path_free, read_grid
from tests.cli.calls import prf

THIN = ("--every-scan", "4", "--every-beam", "3")


@pytest.fixture(scope="module")
def log() -> Path:
    return Path(__file__).resolve().parents[2] / "data" / "demo-office.log.gz"


@pytest.fixture(scope="module")
def office(log: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("grid") / "office.npz"
    assert prf("grid", "--laser", log, *THIN, "-o", file, "-q") == 0
    return file


@pytest.fixture
def points(tmp_path: Path) -> Path:
    (tmp_path / "points.csv").write_text("x,y\n5.0,7.0\n6.0,7.0\n")
    return tmp_path / "points.csv"


def test_a_grid_of_a_log(
    log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    monkeypatch.chdir(tmp_path)
    assert prf("grid", "--laser", log, *THIN, "--json") == 0
    found = json.loads(capsys.readouterr().out)
    assert found["schema"] == "prf.grid.built/1"
    assert found["grid"] == "demo-office.grid.npz"
    grid = read_grid(found["grid"])
    assert list(grid.occupancy.shape) == found["shape"]
    assert found["window"] == list(grid.window)
    assert (found["n_outside"], found["method"], grid.settings["every_scan"]) == (0, "count", 4)
    assert grid.hits.sum() <= found["n_beams"]
    assert len(grid.process["inputs"][0]["sha256"]) == 64
    assert prf("grid", "--laser", log, *THIN) == 4
    assert "--force" in capsys.readouterr().err
    assert prf("grid", "--laser", log, *THIN, "-f", "--set", "grid.method=log-odds", "--resolution", 0.5) == 0
    assert "0.5 m" in capsys.readouterr().out
    assert read_grid(found["grid"]).occupancy.max() <= 1.0 / (1.0 + np.exp(-3.5)) + 1e-6


def test_sonar_alone_and_with_a_laser(log: Path, tmp_path: Path) -> None:
    table = tmp_path / "ring.csv"
    table.write_text("x,y,theta,range,cone\n5,7,0,1.5,0.4\n5,7,1,,0.4\n5,7,2,2.5,0.4\n")
    assert prf("grid", "--sonar", table, "-o", tmp_path / "s.npz", "-q") == 0
    assert read_grid(tmp_path / "s.npz").hits.sum() > 5
    assert prf("grid", "--sonar", table, "--laser", log, *THIN, "-o", tmp_path / "b.npz", "-q") == 0
    assert len(read_grid(tmp_path / "b.npz").process["inputs"]) == 2


def test_query_takes_a_grid(office: Path, points: Path, capsys: pytest.CaptureFixture) -> None:
    grid, xy = read_grid(office), [[5.0, 7.0], [6.0, 7.0]]
    assert prf("query", office, "--points", points, "--square", 0.2) == 0
    header, *rows = capsys.readouterr().out.splitlines()
    assert header == "x,y,p_occupied,low,high,seen"
    answered = np.array([[float(field) for field in row.split(",")] for row in rows])
    for column in (2, 3, 4):
        assert answered[:, column].tolist() == occupied_probability(grid, xy, 0.2).tolist()
    np.testing.assert_array_equal(answered[:, 5], grid.image().seen_at(np.array(xy)))
    assert prf("query", office, "--points", points, "--json") == 0
    assert json.loads(capsys.readouterr().out)["n_draws"] is None
    assert prf("query", office, "--path", points, "--radius", 0.3) == 0
    p = path_free(grid, xy, 0.3)
    assert capsys.readouterr().out == f"p_free   {p!r}\nlow      {p!r}\nhigh     {p!r}\n"
    assert prf("query", office, "--path", points, "--radius", 0.3, "--json") == 0
    answer = json.loads(capsys.readouterr().out)
    assert (answer["p_free"], answer["low"], answer["high"], answer["ess"]) == (p, p, p, None)


def test_render_takes_a_grid(office: Path, tmp_path: Path) -> None:
    assert prf("render", office, "-o", tmp_path / "grid.png") == 0
    assert (tmp_path / "grid.png").stat().st_size > 10_000
