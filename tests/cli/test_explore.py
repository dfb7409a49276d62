"""`prf explore`: rows, what they are ranked by, what is asked, picture, and the layer of the report."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

from prf.output.report.page import places_of
from prf.output.run import read_run
from prf.results import write_run
from tests.cli.calls import prf
from tests.factories import make_room_run, make_run

COLUMNS = "x,y,theta,gain_nats,low,high,metres,gain_per_metre,p_free"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("explore") / "room"
    write_run(path, make_room_run())
    return path


def rows(text: str) -> np.ndarray:
    header, *lines = text.splitlines()
    assert header == COLUMNS
    return np.array([[float(field) for field in line.split(",")] for line in lines])


def test_rows_are_those_of_python_best_first(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    assert prf("explore", folder, "--places", 5) == 0
    found, expected = rows(capsys.readouterr().out), read_run(folder).explore()
    np.testing.assert_allclose(found[:, :2], expected.xy[:5], atol=1e-4)
    np.testing.assert_allclose(found[:, 3], expected.gain[:5], atol=1e-4)
    assert (np.diff(found[:, 3]) <= 0.0).all()
    assert (found[:, 8] >= 0.9).all()
    target, picture = tmp_path / "x.csv", tmp_path / "x.png"
    asked = ("--from", 2, 1.2, "--by", "gain-per-metre", "-o", target, "--picture", picture)
    assert prf("explore", folder, *asked) == 0
    by_way = rows(target.read_text())
    assert (np.diff(by_way[:, 7]) <= 0.0).all()
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert prf("explore", folder, *asked) == 4  # both exist
    assert prf("explore", folder, *asked, "--force") == 0


def test_a_path_is_asked_about(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    path = tmp_path / "path.csv"
    path.write_text("x,y\n8,1.5\n8,4.5\n")
    assert prf("explore", folder, "--for", path, "--radius", 0.3, "--json", "--picture", tmp_path / "p.svg") == 0
    found = json.loads(capsys.readouterr().out)
    assert found["schema"] == "prf.explore/1"
    assert list(found["places"][0]) == COLUMNS.split(",")
    assert 0.0 < found["places"][0]["gain_nats"] <= found["entropy"] * 1.05 <= 1.05 * math.log(2.0)
    path.write_text("x,y\n8,1.5\n8,8\n")
    assert prf("explore", folder, "--for", path) == 3
    assert "target: (8, 8) lies outside the window of room" in capsys.readouterr().err


def test_the_report_shows_the_best_places_or_none(folder: Path, tmp_path: Path) -> None:
    run = read_run(folder)
    places = places_of(run)
    assert places[0]["gain"] == pytest.approx(run.explore().gain[0], abs=1e-3)
    apart = [math.hypot(a["x"] - b["x"], a["y"] - b["y"]) for a in places for b in places if a is not b]
    assert min(apart, default=9.9) >= 1.5
    assert places_of(make_run()) == []  # its robot stands in black
    run.report(tmp_path / "r.html")
    assert 'id="places"' in (tmp_path / "r.html").read_text()
