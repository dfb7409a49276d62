"""`prf export`: names and formats, streams, outputs that exist, wrong options."""

from __future__ import annotations

import dataclasses
import json
import shutil
import sys
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
import shapely

from prf.commands.export import Format
from prf.model.coloring import occupied_polygons
from prf.output.export import FORMATS
from prf.output.run import read_run
from prf.poses.plane import wrapped
from prf.results import read_map_feature, write_run
from prf.shell.poses.files import read_pose_file
from tests.cli.calls import prf
from tests.factories import make_run, make_trajectory


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("export") / "office.run"
    write_run(path, make_run(n_draws=8))
    return path


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def files(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


def test_the_options_offer_what_the_library_writes() -> None:
    assert {*get_args(Format)} == {*FORMATS}


@pytest.mark.parametrize(
    ("format", "names"),
    [
        ("geojson", {"office.geojson"}),
        ("ros-map", {"office.yaml", "office.pgm", "office.nav2.yaml"}),
        ("svg", {"office.svg"}),
        ("dxf", {"office.dxf"}),
        ("netcdf", {"office.nc"}),
    ],
)
def test_default_names_come_from_the_source(
    folder: Path, here: Path, capsys: pytest.CaptureFixture, format: str, names: set[str]
) -> None:
    """They lie beside it, wherever the command is given."""
    there = here / "runs"
    shutil.copytree(folder, there / "office.run")
    assert prf("export", "runs/office.run", "--format", format, "--json") == 0
    answer = json.loads(capsys.readouterr().out)
    assert files(there) == names | {"office.run"}
    assert (answer["schema"], answer["format"]) == ("prf.export/1", format)
    assert {file["path"]: file["bytes"] for file in answer["files"]} == {
        f"runs/{name}": (there / name).stat().st_size for name in names
    }
    assert prf("export", "runs/office.run", "--format", format) == 4
    assert "already exists" in capsys.readouterr().err
    assert prf("export", there / "office.run", "--format", format, "--force") == 0


@pytest.mark.parametrize(
    ("output", "names"),
    [
        ("a.json", {"a.json"}),
        ("a.SVG", {"a.SVG"}),
        ("a.dxf", {"a.dxf"}),
        ("a.nc", {"a.nc"}),
        ("a.v1.yaml", {"a.v1.yaml", "a.v1.pgm", "a.v1.nav2.yaml"}),
        ("a.yml", {"a.yml", "a.pgm", "a.nav2.yaml"}),
        ("a.pgm", {"a.yaml", "a.pgm", "a.nav2.yaml"}),
    ],
)
def test_the_suffix_names_the_format(folder: Path, here: Path, output: str, names: set[str]) -> None:
    assert prf("export", folder, "-o", output) == 0
    assert files(here) == names


def test_figures_for_a_person(folder: Path, here: Path, capsys: pytest.CaptureFixture) -> None:
    assert prf("export", folder, "-o", "a.geojson") == 0
    shown = capsys.readouterr().out
    shape = shapely.geometry.shape(json.loads((here / "a.geojson").read_text())["geometry"])
    corners = sum(len(r.coords) - 1 for p in shape.geoms for r in (p.exterior, *p.interiors))
    assert f"a.geojson, {(here / 'a.geojson').stat().st_size:,} B" in shown
    assert f"vertices  {corners:,}\n" in shown
    assert f"polygons  {len(shape.geoms)}\n" in shown


def test_a_draw_instead_of_the_best_map(folder: Path, here: Path, capsys: pytest.CaptureFixture) -> None:
    run = read_run(folder)
    for number, draw in ((2, run.draws[2]), (-1, run.draws[7])):
        assert prf("export", folder, "-o", "draw.geojson", "--draw", number, "-f", "--json") == 0
        read, properties = read_map_feature(here / "draw.geojson")
        assert sorted(read.edge_lengths()) == sorted(draw.edge_lengths())
        assert (properties["draw"], properties["chain"]) == (number % 8, run.chain[number])
        assert json.loads(capsys.readouterr().out)["map"] == f"office.run, draw {number % 8}"


def test_sampled_poses_are_a_trajectory_for_evo(folder: Path, here: Path, capsys: pytest.CaptureFixture) -> None:
    run = make_run(n_draws=8)
    assert run.laser is not None
    found = make_trajectory(run.laser, 8)
    write_run(here / "moved", dataclasses.replace(run, trajectory=found))
    assert prf("export", "moved", "--format", "tum", "--json") == 0
    answer = json.loads(capsys.readouterr().out)
    assert (answer["n_poses"], answer["files"][0]["path"]) == (5, "moved.tum")
    assert answer["rms_correction_m"] == pytest.approx(0.05, rel=0.1)
    read = read_pose_file("moved.tum")
    assert (read.layout, read.times.tolist()) == ("TUM", found.time.tolist())
    for draw, wanted in ((None, found.mean), (-1, found.given + found.draws[-1])):
        assert prf("export", "moved", "-o", "way.tum", "-f", *(() if draw is None else ("--draw", draw))) == 0
        poses = read_pose_file("way.tum").poses
        np.testing.assert_allclose(poses[:, :2, 3], wanted[:, :2], atol=1e-12)
        np.testing.assert_allclose(wrapped(np.arctan2(poses[:, 1, 0], poses[:, 0, 0]) - wanted[:, 2]), 0.0, atol=1e-12)
    write_run(here / "moved", dataclasses.replace(run, trajectory=dataclasses.replace(found, time=np.full(5, np.nan))))
    assert prf("export", "moved", "-o", "way.tum", "-f") == 0
    assert read_pose_file("way.tum").times.tolist() == found.scan.tolist()
    assert prf("export", "moved", "--format", "g2o") == 0
    read = read_pose_file("moved.g2o")
    np.testing.assert_allclose(read.poses[:, :2, 3], found.mean[:, :2])
    lines = [line.split() for line in Path("moved.g2o").read_text().splitlines()]
    edges = np.array([line[1:] for line in lines if line[0] == "EDGE_SE2"], float)
    read_back = read_run(Path("moved")).trajectory
    assert read_back is not None
    mean, covariance = read_back.steps()
    np.testing.assert_array_equal(edges[:, :2], np.column_stack([np.arange(4), np.arange(1, 5)]))
    np.testing.assert_allclose(edges[:, 2:5], mean)
    np.testing.assert_allclose(edges[:, 5], np.linalg.inv(covariance)[:, 0, 0], rtol=1e-3)
    assert prf("export", "moved", "--format", "g2o", "--draw", 0, "-f") == 2
    assert prf("export", "moved", "--format", "tum", "--draw", 8, "-f") == 2
    assert prf("export", "moved", "--format", "tum", "--extrapolate", 1, "-f") == 2


def test_a_map_instead_of_a_run(folder: Path, here: Path, capsys: pytest.CaptureFixture) -> None:
    assert prf("export", folder / "map.geojson", "-o", "map.geojson") == 0
    assert read_map_feature(here / "map.geojson")[1] == read_map_feature(folder / "map.geojson")[1]


def test_polygons_of_another_program(data_dir: Path, here: Path, capsys: pytest.CaptureFixture) -> None:
    plan = data_dir / "demo-office.geojson"
    assert prf("export", plan, "--format", "geojson", "-o", "plan.geojson") == 0
    drawn = shapely.union_all(shapely.from_geojson(plan.read_text()))
    coloring, _ = read_map_feature(here / "plan.geojson")
    assert occupied_polygons(coloring).symmetric_difference(drawn).area == pytest.approx(0.0, abs=1e-9)
    assert coloring.window == pytest.approx(shapely.box(*drawn.bounds).buffer(1.0, join_style="mitre").bounds)
    for format in FORMATS[1:4]:
        assert prf("export", plan, "--format", format, "-o", f"plan-{format}") == 0


@pytest.mark.parametrize(("format", "module"), [("netcdf", "xarray"), ("netcdf", "h5netcdf")])
def test_a_missing_library_is_named_with_its_extra(
    folder: Path, here: Path, capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch, format: str, module: str
) -> None:
    monkeypatch.setitem(sys.modules, module, None)
    assert prf("export", folder, "--format", format, "-o", "office") == 2
    error = capsys.readouterr().err
    assert f"needs {module}" in error
    assert f"pip install '.[{format}]'; elsewhere: pip install '" in error
    assert files(here) == set()
