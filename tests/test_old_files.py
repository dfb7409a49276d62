"""What earlier states of the program wrote is read, or refused in one line that says what to do."""

from __future__ import annotations

import importlib
import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from mapq.io import read_cloud, read_patches
from prf.output.run import read_run
from prf.shell.cli.run import run_app

OLD = Path(__file__).resolve().parent / "old_files"
RUNS = ("run-checkpoint-1", "run-checkpoint-2")


@pytest.fixture
def old(tmp_path, monkeypatch):
    """Return a copy of the old files, which is the working directory."""
    shutil.copytree(OLD, tmp_path / "old")
    monkeypatch.chdir(tmp_path / "old")
    (tmp_path / "old" / "points.csv").write_text("x,y\n1,1\n5.5,2\n")
    return tmp_path / "old"


def call(command, capsys):
    """Run a command; return its exit code, what it printed, and the lines of its errors."""
    tool, *words = command.split()
    code = run_app(importlib.import_module(f"{tool}.cli").app, tool, words)
    said = capsys.readouterr()
    return code, said.out, [line for line in said.err.splitlines() if line.startswith("error")]


@pytest.mark.parametrize("run", RUNS)
def test_an_old_run_is_read_queried_scored_and_exported(run, old, capsys):
    found = read_run(run)
    assert len(found.draws) == 3
    assert found.laser is not None
    assert len(found.laser.range) == 36
    for command in (
        f"prf query {run} --points points.csv",
        f"prf score {run} --laser log.csv --seed 1 --json",
        f"prf render {run} -o run.png",
        f"prf export {run} --format geojson -o out.geojson",
        f"prf export {run} --format ros-map -o out.yaml",
    ):
        code, _, errors = call(command, capsys)
        assert (code, errors) == (0, []), command


def test_old_readings_of_all_sensors_are_there(old):
    found = read_run("run-checkpoint-2")
    assert found.sonar is not None
    assert found.points is not None
    assert (len(found.sonar.range), len(found.points.value)) == (9, 24)
    first = read_run("run-checkpoint-1")
    assert first.sonar is None
    assert first.points is None


@pytest.mark.parametrize("version", [1, 2])
def test_an_old_checkpoint_is_refused_in_one_line(version, old, capsys):
    code, _, errors = call(f"prf sample --resume run-checkpoint-{version} --steps 20000", capsys)
    assert code == 3
    assert len(errors) == 1
    assert "checkpoint.npz" in errors[0]
    assert f"version {version} of prf.checkpoint" in errors[0]
    assert "Use the release that wrote it" in errors[0]


@pytest.mark.parametrize("file", ["room.grid.npz", "best.geojson"])
def test_an_old_grid_and_an_old_map_are_read(file, old, capsys):
    for command in (f"prf inspect {file} --json", f"prf score {file} --laser log.csv --seed 1 --json"):
        code, out, errors = call(command, capsys)
        assert (code, errors) == (0, []), command
        assert json.loads(out)["schema"].startswith("prf.")


def test_old_draws_are_read(old, capsys):
    assert call("prf inspect draws.geojsonl", capsys)[0] == 0
    assert call("prf render draws.geojsonl -o draws.png", capsys)[0] == 0


@pytest.mark.parametrize("file", ["settings-0874d18.toml", "settings-d766385.toml"])
def test_old_settings_are_read(file, old, capsys):
    assert call(f"prf config show {file}", capsys)[0] == 0


@pytest.mark.parametrize("file", ["patches-cd86f81.patches", "patches-1aa9a88.patches"])
def test_old_patches_are_read_measured_and_classified(file, old, capsys):
    patches = read_patches(file)
    assert len(patches) == 4
    assert patches.cloud.unit.tolist() == [1.0, 1.0, 1.0]
    np.testing.assert_array_equal(patches.cloud.fields["intensity"], np.arange(216) % 256)
    for command in (f"mapq inspect {file} --json", f"mapq features {file} --json", f"mapq classify {file} -o new.ply"):
        code, _, errors = call(command, capsys)
        assert (code, errors) == (0, []), command


def test_an_old_journal_of_labels_counts(old):
    assert read_patches("patches-cd86f81.patches").label.tolist() == [1, 1, 0, 255]
    assert read_patches("patches-1aa9a88.patches").label.tolist() == [1, 1, 0, 0]


@pytest.mark.parametrize("file", ["result-9d16515.ply", "result-1b41af3.ply"])
def test_an_old_result_is_read_compared_and_reported(file, old, capsys):
    assert "p_suspicious" in read_cloud(file).fields
    for command in (f"mapq inspect {file} --json", f"mapq report {file} -o r.html", f"mapq render {file} -o r.png"):
        code, _, errors = call(command, capsys)
        assert (code, errors) == (0, []), command
    code, _, errors = call(f"mapq compare {file} {file} --json", capsys)
    assert (code, errors) == (0, [])


@pytest.mark.parametrize(
    ("file", "words"),
    [
        ("model-9d16515.json", "version 1 of mapq.model"),
        ("model-39f3d5a.json", "version 2 of mapq.model is not known"),
    ],
)
def test_an_old_model_is_refused_in_one_line(file, words, old, capsys):
    code, _, errors = call(f"mapq classify patches-1aa9a88.patches --model {file} -o new.ply", capsys)
    assert code == 3
    assert len(errors) == 1
    assert words in errors[0]


@pytest.mark.parametrize("run", RUNS)
def test_inspect_reports_which_file_of_an_old_run_is_usable(run, old, capsys):
    (old / run / "posterior.png").unlink(missing_ok=True)
    code, out, errors = call(f"prf inspect {run} --json", capsys)
    assert (code, errors) == (0, [])
    states = {file["name"]: (file["state"], file["summary"]) for file in json.loads(out)["files"]}
    assert states.pop("posterior.png")[0] == "missing"
    state, summary = states.pop("checkpoint.npz")
    assert state == "other version"
    assert "reads the draws, but cannot resume" in summary
    assert {found for found, _ in states.values()} == {"ok"}


def test_every_old_file_is_in_the_list():
    text = (OLD / "README.md").read_text()
    for path in set(OLD.iterdir()) - {OLD / "README.md"}:
        assert path.stem.split(".")[0] in text or path.name in text, path.name
        files = [path] if path.is_file() else list(path.iterdir())
        assert max(file.stat().st_size for file in files) < 30_000
