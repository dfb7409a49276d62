"""The verb `prior`: its file, its summary, its refusals."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import shapely

from prf.model.coloring import read_geojsonl, violations
from prf.model.window import Window
from prf.results import write_run
from prf.results.geojson import read_map_feature
from tests.cli.calls import call, prf
from tests.factories import make_run

ARGS = ("prior", "--scale", "0.5", "--window", "-1", "-2.5", "3", "0.1")


def test_draws_and_summary(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "draws.geojsonl"
    assert prf(*ARGS, "--draws", "40", "--method", "exact", "--seed", "3", "-o", str(path)) == 0
    draws = read_geojsonl(path)
    assert len(draws) == 40
    assert draws.window == Window(-1.0, -2.5, 3.0, 0.1)
    assert not any(violations(draw) for draw in draws)
    table = capsys.readouterr().out
    assert f"{draws.n_edges.mean():.4f}" in table
    assert "seed        3" in table


def test_json_and_the_seed_that_was_drawn(capsys: pytest.CaptureFixture[str]) -> None:
    assert prf(*ARGS, "--draws", "300", "--json") == 0
    first = json.loads(capsys.readouterr().out)
    assert first["schema"] == "prf.prior/1"
    assert (first["n_draws"], first["thin"], first["output"]) == (300, None, None)
    assert first["mean_edges"] == pytest.approx(first["expected_edges"], rel=0.15)
    assert prf(*ARGS, "--draws", "300", "--json", "--seed", str(first["seed"])) == 0
    assert json.loads(capsys.readouterr().out) == first


def test_draws_to_standard_output_leave_the_summary_to_standard_error(capsys: pytest.CaptureFixture[str]) -> None:
    assert prf(*ARGS, "--draws", "3", "--seed", "1", "-o", "-") == 0
    streams = capsys.readouterr()
    lines = [json.loads(line) for line in streams.out.splitlines()]
    assert [line["type"] for line in lines] == ["Feature"] * 3
    assert "draws       3" in streams.err


@pytest.mark.parametrize("method", ["exact", "mcmc"])
def test_directions_and_free_space_have_their_laws(method: str, capsys: pytest.CaptureFixture[str]) -> None:
    draw = [
        "prior",
        "--window",
        "0",
        "0",
        "2",
        "1",
        "--scale",
        "1",
        "--draws",
        "400",
        "--seed",
        "1",
        "--json",
        "--method",
    ]
    oriented = ["--set", "prior.orientation=3", "--set", "prior.orientation_angle=0.2"]
    results = []
    for settings in (oriented, [], ["--set", "prior.free_space=1"]):
        assert prf(*draw, method, *settings) == 0
        results.append(json.loads(capsys.readouterr().out))
    turned, plain, free = results
    assert turned["orientation"] == 3.0
    assert turned["mean_edges"] == pytest.approx(turned["expected_edges"], rel=0.1)
    assert turned["expected_edges"] < plain["expected_edges"]
    assert free["expected_edges"] is None


def test_the_chain_draws_maps_too(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "draws.geojsonl"
    args = ("--draws", "20", "--method", "mcmc", "--thin", "200", "--seed", "2", "-o", str(path), "--json")
    assert prf(*ARGS, *args) == 0
    summary = json.loads(capsys.readouterr().out)
    assert (summary["method"], summary["thin"], summary["n_draws"]) == ("mcmc", 200, 20)
    draws = read_geojsonl(path)
    assert not any(violations(draw) for draw in draws)
    assert np.all(np.diff(draws.vertex_offsets) >= 0)


# The verb `prf simulate`: its directory runs through the other verbs, its numbers, its refusals.


SIMULATE_ARGS = ("simulate", "--size", "9", "8", "--set", "simulate.beams=36", "--readings", "720")


def test_the_directory_and_the_table(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "floor"
    assert prf(*SIMULATE_ARGS, "--seed", "2", "-o", str(folder)) == 0
    table = capsys.readouterr().out
    assert table.endswith(f"output    {folder}/, its picture {folder}/plan.png\n")
    assert "world     office, 10 x 9 m, " in table
    assert "laser     720 beams, " in table
    assert "seed      2\n" in table


def test_the_truth_scores_well_and_the_logs_are_read(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "floor"
    assert prf(*SIMULATE_ARGS, "--seed", "3", "-o", str(folder), "--set", "simulate.outlier_probability=0", "-q") == 0
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
    assert prf(*SIMULATE_ARGS, "--seed", "4", "-o", str(folder)) == 0
    truth, path = str(folder / "truth.geojson"), str(folder / "path.csv")
    ros = str(tmp_path / "map.yaml")
    assert prf("export", truth, "--format", "ros-map", "-o", ros, "-q") == 0
    for name, world in (("again", truth), ("raster", ros)):
        again = tmp_path / name
        args = ["simulate", "--world", world, "--path", path, "--set", "simulate.beams=36"]
        assert prf(*args, "--seed", "4", "-o", str(again)) == 0
        assert (again / "path.csv").read_text() == (folder / "path.csv").read_text()
    assert (tmp_path / "again" / "laser.log.gz").read_bytes() == (folder / "laser.log.gz").read_bytes()


def test_json_of_a_simulation_and_its_seed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "draw"
    options = ("--world", "arak", "--json", "-o", str(folder))
    assert prf(*SIMULATE_ARGS, *options) == 0
    first = json.loads(capsys.readouterr().out)
    assert first["schema"] == "prf.simulate/1"
    assert (first["output"], first["world"], first["n_scans"], first["n_beams"]) == (str(folder), "arak", 20, 720)
    assert prf(*SIMULATE_ARGS, *options, "--seed", str(first["seed"]), "-f") == 0
    assert json.loads(capsys.readouterr().out) == first


# `prf anneal`: what it writes, and that other verbs read it.


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory, data_dir: Path) -> Path:
    target = tmp_path_factory.mktemp("anneal") / "office.geojson"
    arguments = ["--every-scan", "5", "--every-beam", "6", "--chains", "1", "--steps", "40000", "--seed", "1"]
    log = str(data_dir / "demo-office.log.gz")
    assert prf("anneal", "--laser", log, *arguments, "-o", str(target), "-q") == 0
    return target


def test_the_map_is_a_valid_multipolygon_that_prf_reads_back(made: Path) -> None:
    content = json.loads(made.read_text())
    assert content["geometry"]["type"] == "MultiPolygon"
    assert shapely.geometry.shape(content["geometry"]).is_valid
    coloring, properties = read_map_feature(made)
    assert coloring.n_edges == properties["n_edges"] > 0
    assert properties["seed"] == 1
    assert properties["configuration"]["every_beam"] == 6
    assert properties["inputs"][0]["path"].endswith("demo-office.log.gz")


def test_json_has_sizes(data_dir: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    target = tmp_path / "a.geojson"
    arguments = ["--every-scan", "10", "--every-beam", "12", "--chains", "2", "--steps", "20000", "--seed", "1"]
    log = str(data_dir / "demo-office.log.gz")
    assert prf("anneal", "--laser", log, *arguments, "-o", str(target), "--json", "-q") == 0
    result = json.loads(capsys.readouterr().out)
    assert result["geojson_bytes"] == target.stat().st_size
    assert result["packed_bytes"] == 4 * result["n_vertices"]
    assert len(result["score_by_chain"]) == 2
    assert result["complete"]


def test_a_map_is_simpler_within_a_budget_of_nats(
    made: Path, data_dir: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    target = tmp_path / "b.geojson"
    arguments = ["--every-scan", "5", "--every-beam", "6", "--chains", "1", "--steps", "40000", "--seed", "1"]
    log, simpler = str(data_dir / "demo-office.log.gz"), ["--simplify", "60", "--json", "-q"]
    assert prf("anneal", "--laser", log, *arguments, "-o", str(target), *simpler) == 0
    result = json.loads(capsys.readouterr().out)
    coloring, properties = read_map_feature(made)
    assert result["n_vertices"] < coloring.n_vertices
    assert result["score"] >= properties["score"] - 60.0
    assert result["score"] == pytest.approx(max(result["score_by_chain"]) - result["given_up"])


def test_the_page_is_beside_the_run_by_default(tmp_path: Path) -> None:
    write_run(tmp_path / "office", make_run(n_draws=4))
    done = call("prf report office", tmp_path)
    assert (done.code, done.out) == (0, "")
    assert "wrote office.html: 0." in done.err
    assert "answers from 4 of 4 draws" in done.err
    before = (tmp_path / "office.html").read_text()
    assert call("prf report .", tmp_path / "office").code == 4
    assert call("prf report . -f", tmp_path / "office").code == 0
    assert (tmp_path / "office.html").read_text() == before
