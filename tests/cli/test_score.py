"""`prf score` of a RUN, a GRID and a map of polygons."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from prf.results import map_text, write_run
from tests.cli.calls import prf
from tests.factories import make_run

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


@pytest.mark.parametrize(("name", "kind"), [("run", "run"), ("map.geojson", "map")])
def test_sonar_alone(folder: Path, ring: Path, capsys: pytest.CaptureFixture, name: str, kind: str) -> None:
    assert prf("score", folder / name, "--sonar", ring, "--json") == 0
    shown = capsys.readouterr()
    result = json.loads(shown.out)
    assert (result["kind"], result["n_readings"], result["n_readings_outside"]) == (kind, 24, 12)
    assert result["n_readings_no_return"] == 6
    assert 0.0 < result["sonar_nll"] < 9.0
    assert not {"n_beams", "beam_nll", "auc", "seed", "sonar_nll_contours"} & {*result}
    assert "12 sonar readings dropped" in shown.err


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


def test_options_take_precedence_over_a_settings_file(
    folder: Path, ring: Path, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    (tmp_path / "ring.toml").write_text("[sonar]\nmax_range = 3.2\nuniform_probability = 0.6\n")

    def scores(*args: object) -> tuple[float, float]:
        assert prf("score", folder / "run", "--sonar", ring, "--json", "-q", *args) == 0
        result = json.loads(capsys.readouterr().out)
        return result["sonar_max_range"], result["sonar_nll"]

    plain, with_file = scores("--set", "sonar.max_range=3.2"), scores("--config", tmp_path / "ring.toml")
    assert plain[0] == with_file[0] == 3.2
    assert plain[1] != with_file[1]
    assert scores("--config", tmp_path / "ring.toml", "--set", "sonar.max_range=3.5")[0] == 3.5


def test_without_a_seed_one_is_drawn_and_reported(folder: Path, table: Path, capsys: pytest.CaptureFixture) -> None:
    assert prf("score", folder / "map.geojson", "--laser", table, "--json", "-q") == 0
    assert isinstance(json.loads(capsys.readouterr().out)["seed"], int)


def test_a_run_that_has_no_best_map_yet(tmp_path: Path, table: Path, capsys: pytest.CaptureFixture) -> None:
    write_run(tmp_path / "run", make_run(n_draws=3))
    (tmp_path / "run" / "map.geojson").unlink()
    assert prf("score", tmp_path / "run", "--laser", table, "--json") == 0
    shown = capsys.readouterr()
    assert json.loads(shown.out)["rmse"] is None
    assert "no best map yet" in shown.err
