"""`prf score` of a RUN, a GRID and a map of polygons."""

from __future__ import annotations

import gzip
import json
import tomllib
from pathlib import Path

import numpy as np
import pytest
import shapely

from prf.readings import read_readings, write_table
from prf.results import map_text, write_run
from prf.results.occupancy import occupied_probability, path_free, read_grid
from tests.cli.calls import prf
from tests.factories import make_run
from tests.reference.known_worlds import HALL, laser_log, sonar_log

KEYS = ("n_beams", "beam_nll", "auc", "nll", "brier", "within_0.2m", "rmse", "n_draws", "no_obstacle", "seed")


@pytest.fixture(scope="module")
def log() -> Path:
    return Path(__file__).resolve().parents[2] / "data" / "demo-office.log.gz"


@pytest.fixture(scope="module")
def table(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("held") / "held.csv"
    rows = "".join(f"{x},1.0,{angle / 4},{1 + angle % 7}\n" for x in (2.0, 12.0, -50.0) for angle in range(25))
    file.write_text("x,y,theta,range\n" + rows)
    return file


@pytest.fixture(scope="module")
def ring(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("ring") / "ring.csv"
    rows = "".join(f"{x},1.0,{angle / 2},{1 + angle % 4},0.3\n" for x in (2.0, 12.0, -50.0) for angle in range(12))
    file.write_text("x,y,theta,range,cone\n" + rows)
    return file


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("score")
    write_run(path / "run", make_run(n_draws=8))
    best = make_run(n_draws=8).best
    assert best is not None
    (path / "map.geojson").write_text(map_text(best, {}))
    return path


@pytest.mark.parametrize(("name", "kind", "n_draws"), [("run", "run", 8), ("map.geojson", "map", 1)])
def test_resultof_polygonal_maps(
    folder: Path, table: Path, capsys: pytest.CaptureFixture, name: str, kind: str, n_draws: int
) -> None:
    args = ("score", folder / name, "--laser", table, "--max-range", 20, "--seed", 4)
    assert prf(*args, "--json") == 0
    shown = capsys.readouterr()
    result = json.loads(shown.out)
    assert (result["schema"], result["kind"], result["n_draws"]) == ("prf.score/1", kind, n_draws)
    assert all(result[key] is not None for key in KEYS)
    assert (result["n_beams"], result["n_outside"], result["seed"]) == (50, 25, 4)
    assert "25 beams dropped" in shown.err
    assert prf(*args) == 0
    rows = [line.split()[:2] for line in capsys.readouterr().out.splitlines()]
    assert ["n_beams", str(result["n_beams"])] in rows
    assert prf(*args, "-v") == 0
    assert len(capsys.readouterr().out.splitlines()) == len(result) - 1 > len(rows)
    assert result["square"] == 0.2
    assert prf(*args, "--square", 3, "--json", "-q") == 0
    wide = json.loads(capsys.readouterr().out)
    assert (wide["square"], wide["beam_nll"]) == (3.0, result["beam_nll"])
    assert wide["brier"] != result["brier"]


def test_uncertain_poses(folder: Path, table: Path, capsys: pytest.CaptureFixture) -> None:
    args = ("score", folder / "map.geojson", "--laser", table, "--max-range", 20, "--seed", 4, "--json")
    assert prf(*args, "--pose-noise", 0.05, 0.01) == 0
    first = json.loads(capsys.readouterr().out)
    assert (first["pose_noise"], first["pose_draws"], first["n_beams"], first["n_outside"]) == ([0.05, 0.01], 1, 50, 25)
    assert prf(*args, "--set", "trajectory.pose_noise=[0.05, 0.01]") == 0
    assert json.loads(capsys.readouterr().out) == first


def test_odometry_of_held_out_poses_is_refused(folder: Path, table: Path, capsys: pytest.CaptureFixture) -> None:
    args = ("score", folder / "run", "--laser", table, "--set", "trajectory.odometry=wheels")
    assert prf(*args) == 2
    assert "trajectory.odometry" in capsys.readouterr().err


def test_scans_of_the_log_of_a_run_have_the_poses_that_it_was_given(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    poses = read_readings(str(log)).notes.scans.pose + np.array([1.0, 0.0, 0.0])
    file = tmp_path / "poses.csv"
    np.savetxt(file, poses, fmt="%.6f", delimiter=",", header="x,y,theta", comments="")
    sample = (
        "sample",
        "--laser",
        log,
        "--every-scan",
        40,
        "--poses",
        file,
        "--steps",
        5000,
        "--chains",
        1,
        "--seed",
        1,
    )
    assert prf(*sample, "-o", tmp_path / "run", "-q") == 0
    found = []
    for given in ((), ("--poses", file)):
        capsys.readouterr()
        assert prf("score", tmp_path / "run", "--laser", log, "--scans", "20::40", *given, "--seed", 1, "--json") == 0
        found.append(json.loads(capsys.readouterr().out))
    assert found[0] == found[1]
    copy = tmp_path / "other.log.gz"
    copy.write_bytes(log.read_bytes() + gzip.compress(b"# another\n"))
    assert prf("score", tmp_path / "run", "--laser", copy, "--scans", "20::40", "--seed", 1, "--json") == 0
    assert json.loads(capsys.readouterr().out)["beam_nll"] != found[0]["beam_nll"]


def test_held_out_scans_of_the_log_that_a_grid_was_made_from(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    assert prf("grid", "--laser", log, "--skip-scans", "2::5", "-o", tmp_path / "grid.npz", "-q") == 0
    assert prf("score", tmp_path / "grid.npz", "--laser", log, "--scans", "2::5", "--json", "--seed", 1) == 0
    result = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert result["kind"] == "grid"
    assert result["auc"] > 0.9
    assert result["within_0.2m"] > 0.4
    assert result["beam_nll"] < 3.0


def test_sonar_and_laser_and_a_grid(
    log: Path, ring: Path, table: Path, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    assert prf("grid", "--laser", log, "-o", tmp_path / "grid.npz", "-q") == 0
    assert prf("score", tmp_path / "grid.npz", "--sonar", ring, "--laser", table, "--seed", 2, "--json") == 0
    result = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert result["sonar_nll"] == min(result["sonar_nll_contours"], result["sonar_nll_first_hit"])
    assert result["n_beams"] > 0
    assert (result["seed"], result["kind"]) == (2, "grid")


def test_a_true_plan_with_and_without_readings(folder: Path, ring: Path, capsys: pytest.CaptureFixture) -> None:
    plan = folder / "plan.geojson"
    corners = [[20.0, 0.0], [30.0, 0.0], [30.0, 20.0], [20.0, 0.0]]
    window = {"window": [-10, -5, 30, 20]}
    polygon = {"type": "Polygon", "coordinates": [corners]}
    plan.write_text(json.dumps({"type": "Feature", "geometry": polygon, "properties": window}))
    assert prf("score", plan, "--truth", plan, "--json", "-q") == 0
    whole = json.loads(capsys.readouterr().out)
    assert (whole["iou_occupied"], whole["iou_free"], whole["cell_brier"]) == (1.0, 1.0, 0.0)
    assert prf("score", folder / "run", "--truth", plan, "--sonar", ring, "--json", "-q") == 0
    seen = json.loads(capsys.readouterr().out)
    assert 0 < seen["n_cells"] < whole["n_cells"]
    assert 0.0 <= seen["iou_free"] <= 1.0
    assert "sonar_nll" in seen


def test_a_run_that_has_no_best_map_yet(tmp_path: Path, table: Path, capsys: pytest.CaptureFixture) -> None:
    write_run(tmp_path / "run", make_run(n_draws=3))
    (tmp_path / "run" / "map.geojson").unlink()
    assert prf("score", tmp_path / "run", "--laser", table, "--json") == 0
    shown = capsys.readouterr()
    assert json.loads(shown.out)["rmse"] is None
    assert "no best map yet" in shown.err


# `prf grid`, and the verbs that take a GRID where they take a RUN.


THIN = ("--every-scan", "4", "--every-beam", "3")


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
    copy = tmp_path / log.name
    copy.write_bytes(log.read_bytes())
    assert prf("grid", "--laser", copy, *THIN, "--json") == 0
    found = json.loads(capsys.readouterr().out)
    assert found["schema"] == "prf.grid.built/1"
    assert found["grid"] == str(tmp_path / "demo-office.grid.npz")
    grid = read_grid(found["grid"])
    assert list(grid.occupancy.shape) == found["shape"]
    assert found["window"] == list(grid.window)
    assert (found["n_outside"], found["method"], grid.settings["every_scan"]) == (0, "count", 4)
    assert grid.hits.sum() <= found["n_beams"]
    assert len(grid.process["inputs"][0]["sha256"]) == 64
    assert prf("grid", "--laser", copy, *THIN) == 4
    assert "--force" in capsys.readouterr().err
    assert prf("grid", "--laser", copy, *THIN, "-f", "--set", "grid.method=log-odds", "--resolution", 0.5) == 0
    assert "0.5 m" in capsys.readouterr().out
    assert read_grid(found["grid"]).occupancy.max() <= 1.0 / (1.0 + np.exp(-3.5)) + 1e-6


def test_query_takes_a_grid(office: Path, points: Path, capsys: pytest.CaptureFixture) -> None:
    grid, xy = read_grid(office), [[5.0, 7.0], [6.0, 7.0]]
    assert prf("query", office, "--points", points, "--square", 0.2) == 0
    header, *rows = capsys.readouterr().out.splitlines()
    assert header == "x,y,p_occupied,low,high,seen,p_return"
    answered = np.array([[float(field) for field in row.split(",")] for row in rows])
    for column in (2, 3, 4):
        assert answered[:, column].tolist() == occupied_probability(grid, xy, 0.2).tolist()
    np.testing.assert_array_equal(answered[:, 5], grid.image().seen_at(np.array(xy)))
    assert answered[:, 6].tolist() == answered[:, 2].tolist()
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


# `prf calibrate`: sensors fitted in a known map, and the file that other verbs read.


@pytest.fixture(scope="module")
def calibrate_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
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


def test_a_sonar_and_a_laser(calibrate_folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    args = [
        "calibrate",
        "--sonar",
        calibrate_folder / "ring.csv",
        "--laser",
        calibrate_folder / "laser.csv",
        "--set",
        "laser.max_range=8.0",
    ]
    args += ["--map", calibrate_folder / "floor.geojson", "-o", tmp_path / "robot.toml"]
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
    calibrate_folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    """Fitted on some scans, other scans are more probable in the true map than with the defaults."""
    floor, ring = calibrate_folder / "floor.geojson", calibrate_folder / "ring.csv"
    assert prf("calibrate", "--sonar", ring, "--map", floor, "--skip-scans", "0::3", "-o", tmp_path / "s.toml") == 0
    capsys.readouterr()
    scores = []
    for options in ((), ("--config", tmp_path / "s.toml")):
        assert prf("score", floor, "--sonar", ring, "--scans", "0::3", "--json", *options) == 0
        scores.append(json.loads(capsys.readouterr().out)["sonar_nll"])
    assert scores[1] < scores[0] - 0.05


def test_wrong_poses_are_noticed(calibrate_folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
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
            calibrate_folder / "floor.geojson",
        )
        == 0
    )
    assert "no better than no map" in capsys.readouterr().err
