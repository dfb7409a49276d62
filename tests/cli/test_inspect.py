"""`prf inspect`: the manifest and the state of every file."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from prf.results import write_run
from prf.results.occupancy import OccupancyGrid, write_grid
from prf.shell.cli.storage import save_arrays
from tests.cli.calls import prf
from tests.factories import make_run


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    write_run(tmp_path / "run", make_run())
    return tmp_path / "run"


def test_a_sound_run(folder: Path, capsys: pytest.CaptureFixture) -> None:
    assert prf("inspect", str(folder)) == 0
    assert "more entries: prf inspect -v)" in capsys.readouterr().out
    assert prf("inspect", str(folder), "-v") == 0
    shown = capsys.readouterr().out
    assert "configuration.scale" in shown
    assert "12 draws of 4 chains" in shown
    assert "checkpoint.npz    missing" in shown


def test_json(folder: Path, capsys: pytest.CaptureFixture) -> None:
    assert prf("inspect", str(folder), "--json") == 0
    found = json.loads(capsys.readouterr().out)
    assert found["schema"] == "prf.inspect/1"
    assert found["manifest"]["status"] == "finished"
    assert {file["name"]: file["state"] for file in found["files"]}["draws.npz"] == "ok"


def test_a_damaged_file_is_shown_and_fails(folder: Path, capsys: pytest.CaptureFixture) -> None:
    (folder / "posterior.npz").write_bytes(b"PK broken")
    assert prf("inspect", str(folder)) == 3
    shown = capsys.readouterr()
    assert "posterior.npz     damaged" in shown.out
    assert "damaged: posterior.npz" in shown.err


def test_an_unknown_version_is_refused(folder: Path, capsys: pytest.CaptureFixture) -> None:
    (folder / "manifest.json").write_text('{"schema": "prf.run/7"}')
    assert prf("inspect", str(folder)) == 3
    assert "version 7 of prf.results is not known" in capsys.readouterr().err


def test_files_of_other_versions(folder: Path, capsys: pytest.CaptureFixture) -> None:
    """A checkpoint of another release takes nothing from what can be read; draws do."""
    save_arrays(folder / "checkpoint.npz", "prf.checkpoint/1", {})
    assert prf("inspect", str(folder)) == 0
    shown = capsys.readouterr()
    assert shown.err == ""
    assert "checkpoint.npz    other version" in shown.out
    assert "prf.checkpoint/1: this release reads the draws, but cannot resume from here" in shown.out
    save_arrays(folder / "draws.npz", "prf.draws/9", {})
    assert prf("inspect", str(folder), "--json") == 3
    shown = capsys.readouterr()
    assert shown.err.strip().endswith("other version: draws.npz.")
    files = {file["name"]: file for file in json.loads(shown.out)["files"]}
    assert (files["draws.npz"]["state"], files["draws.npz"]["schema"]) == ("other version", "prf.draws/9")
    assert "version 9 of prf.draws is not known" in files["draws.npz"]["summary"]


def inspected(path: Path, capsys: pytest.CaptureFixture) -> dict[str, Any]:
    assert prf("inspect", str(path), "--json") == 0
    found: dict[str, Any] = json.loads(capsys.readouterr().out)
    assert [file["state"] for file in found["files"]] == ["ok"]
    assert prf("inspect", str(path)) == 0
    assert path.name in capsys.readouterr().out
    return found


def test_a_grid(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    cells = np.zeros((3, 4), np.int32)
    process = {"inputs": [{"path": "a.log"}]}
    grid = OccupancyGrid((cells + 0.5).astype(np.float32), cells, cells + 1, np.zeros(2), 0.1, {"clamp": 3.5}, process)
    write_grid(tmp_path / "a.npz", grid)
    found = inspected(tmp_path / "a.npz", capsys)
    assert (found["kind"], found["manifest"]["schema"]) == ("grid", "prf.grid/1")
    assert found["manifest"]["configuration"] == {"clamp": 3.5}
    assert found["manifest"]["inputs"] == process["inputs"]
    assert found["files"][0]["summary"] == "4 x 3 cells of 0.1 m, 100.0% seen"


def test_maps(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    found = inspected(folder / "map.geojson", capsys)
    assert (found["kind"], found["files"][0]["schema"]) == ("map", "prf.map/1")
    assert found["manifest"]["n_edges"] > 0
    other = tmp_path / "plan.json"
    other.write_text('{"type": "Polygon",\n"coordinates": [[[0, 0], [1, 0], [1, 1], [0, 1], [0, 0]]]}')
    found = inspected(other, capsys)
    assert (found["kind"], found["files"][0]["schema"]) == ("map", None)
    assert found["files"][0]["summary"] == "polygons of another program: 1, together 1.0 m2"


@pytest.mark.parametrize("n", [1, 3])
def test_draws(n: int, tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    file = tmp_path / "draws.geojsonl"
    args = ["--scale", "1", "--window", "0", "0", "2", "1", "--draws", str(n), "--seed", "1", "-o", str(file)]
    assert prf("prior", *args, "-q") == 0
    capsys.readouterr()
    found = inspected(file, capsys)
    assert (found["kind"], found["manifest"]["window"]) == ("draws", [0.0, 0.0, 2.0, 1.0])
    assert found["files"][0]["summary"].startswith(f"{n} draws, on average ")
    file.write_text(file.read_text() + "{}\n")
    assert prf("inspect", str(file)) == 3
    assert f"draws.geojsonl:{n + 1}: " in capsys.readouterr().err
