"""`prf query`: rows in, rows out; paths; every way to ask wrongly."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
import shapely

from prf.model.coloring import Draws, from_polygons
from prf.output.run import read_run
from prf.readings import Readings
from prf.results import write_run
from prf.results.estimate import occupied_probability
from tests.cli.calls import prf
from tests.factories import WINDOW, make_run


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("query") / "run"
    write_run(path, make_run(n_draws=48))
    return path


def rows(text: str) -> np.ndarray:
    header, *lines = text.splitlines()
    assert header == "x,y,p_occupied,low,high,seen,p_return"
    return np.array([[float(field) for field in line.split(",")] for line in lines])


@pytest.mark.parametrize("square", [None, 0.0, 0.5])
def test_points_in_input_order(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture, square: float) -> None:
    xy = np.random.default_rng(1).uniform(-20.0, 40.0, (50, 2))
    (tmp_path / "points.csv").write_text("x,y\n" + "".join(f"{x!r},{y!r}\n" for x, y in xy.tolist()))
    extra = [] if square is None else ["--square", square]
    assert prf("query", folder, "--points", tmp_path / "points.csv", *extra) == 0
    answered = rows(capsys.readouterr().out)
    np.testing.assert_array_equal(answered[:, :2], xy)
    np.testing.assert_array_equal(answered[:, 2], occupied_probability(read_run(folder).draws, xy, square or 0.0))
    assert np.isnan(answered[:, 2:5]).any(axis=1).tolist() == np.isnan(answered[:, 2]).tolist()
    inside = ~np.isnan(answered[:, 2])
    assert not inside.all()
    assert (answered[inside, 3] <= answered[inside, 2]).all()
    assert (answered[inside, 2] <= answered[inside, 4]).all()
    returned = read_run(folder).return_probability(xy, square or 0.2)
    np.testing.assert_array_equal(answered[:, 6], returned)
    seen = read_run(folder).image.seen_at(xy)
    np.testing.assert_array_equal(answered[:, 5], seen)
    assert not seen[~inside].any()
    assert 0 < seen[inside].sum() < inside.sum()


@pytest.mark.parametrize(
    "text",
    [
        "x,y\n1.5,2\n3,4\n",
        "1.5,2\n3,4\n",
        "\ufeffname, Y ,x\r\na,2,1.5\r\nb,4,3\r\n",
        "# two points\nx,y\n\n1.5, 2\n3,4",
    ],
)
def test_forms_of_points(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture, text: str) -> None:
    (tmp_path / "points.csv").write_bytes(text.encode())
    assert prf("query", folder, "--points", tmp_path / "points.csv") == 0
    np.testing.assert_array_equal(rows(capsys.readouterr().out)[:, :2], [[1.5, 2.0], [3.0, 4.0]])


def test_json_has_null_for_the_outside(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    (tmp_path / "points.csv").write_text("x,y\n1,2\n999,0\n")
    assert prf("query", folder, "--points", tmp_path / "points.csv", "--json") == 0
    answer = json.loads(capsys.readouterr().out)
    assert (answer["schema"], answer["n_draws"]) == ("prf.query.points/1", 48)
    unknown = dict.fromkeys(("p_occupied", "low", "high", "ess", "rhat", "p_return"))
    assert answer["points"][1] == {"x": 999.0, "y": 0.0, **unknown, "seen": False}


def test_path(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    (tmp_path / "path.csv").write_text("x,y\n1,2\n1.5,2.5\n")
    assert prf("query", folder, "--path", tmp_path / "path.csv", "--radius", 0.1, "--json") == 0
    answer = json.loads(capsys.readouterr().out)
    expected = read_run(folder).paths([[1.0, 2.0], [1.5, 2.5]], 0.1, interval=True)
    bounds = {name: getattr(expected, name)[0] for name in ("low", "high", "ess", "rhat")}
    found = answer.pop("blocked")
    assert found["piece"] == [[1.0, 2.0], [1.5, 2.5]]
    assert found["p_free"] == expected.probability[0]
    assert answer == {"schema": "prf.query.path/1", "p_free": expected.probability[0], **bounds, "n_draws": 48}
    assert 0.0 < answer["low"] < answer["p_free"] < answer["high"] < 1.0
    assert prf("query", folder, "--path", tmp_path / "path.csv", "--radius", 0.1) == 0
    shown = dict(line.split() for line in capsys.readouterr().out.splitlines())
    assert list(shown) == list(answer)[1:]
    assert float(shown["p_free"]) == answer["p_free"]


@pytest.mark.slow
def test_few_effective_draws_are_warned_of(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    (tmp_path / "points.csv").write_text("1,2\n3,4\n")
    assert prf("query", folder, "--points", tmp_path / "points.csv") == 0
    assert "2 of 2 points" in capsys.readouterr().err
    write_run(tmp_path / "long", make_run(n_draws=2000, resolution=5.0))
    assert prf("query", tmp_path / "long", "--points", tmp_path / "points.csv") == 0
    assert capsys.readouterr().err == ""


def test_the_piece_that_blocks_a_path_is_named(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    """A triangle in every draw on the second piece of the way, with two returns on its sides."""
    wall = from_polygons(shapely.MultiPolygon([shapely.Polygon([[2.4, 0.9], [2.6, 0.9], [2.5, 1.1]])]), WINDOW)
    laser = Readings.from_arrays([[2.0, 1.0], [3.0, 1.0]], [0.0, np.pi], [0.45, 0.45])
    made, draws, way = make_run(n_draws=48), Draws.from_colorings([wall] * 48), np.array([[1.0, 1.0, 2.0, 1.0]])
    run = dataclasses.replace(made, draws=draws, laser=laser, way=way)
    write_run(tmp_path / "run", run)
    (tmp_path / "path.csv").write_text("x,y\n1,1\n4,1\n")
    assert prf("query", tmp_path / "run", "--path", tmp_path / "path.csv", "--radius", 0.2, "--json") == 0
    shown = capsys.readouterr()
    expected = {"piece": [[2.0, 1.0], [3.0, 1.0]], "p_free": 0.0, "n_returns": 2, "is_driven": False}
    assert json.loads(shown.out)["blocked"] == expected
    assert "from (2.00, 1.00) to (3.00, 1.00) is free in 0.00 of the draws; 2 returns lie within 0.2 m" in shown.err
    assert run.what_blocks([[1.0, 1.0], [2.0, 1.0]], 0.2).is_driven


def test_a_path_that_leaves_the_window_is_reported(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    (tmp_path / "path.csv").write_text("x,y\n1,2\n999,2\n")
    assert prf("query", folder, "--path", tmp_path / "path.csv", "--radius", 0.1, "--json") == 0
    shown = capsys.readouterr()
    assert json.loads(shown.out)["p_free"] is None
    assert "leaves the window" in shown.err
