"""Thinning as `prf sample` and `prf anneal` do it: reported, recorded, repeated by --resume, switched off."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from prf.output.run import read_run
from tests.cli.calls import prf

QUICK = ("--chains", "1", "--resolution", "0.5", "--seed", "3")
ALL = 5580
"""Beams of the office's log."""
EXACT = ("--set", "thinning.beam_density=0")
DENSITY = ("--set", "thinning.beam_density=4")
"""Of it that log has some fifteen."""


@pytest.fixture
def log(data_dir: Path) -> Path:
    return data_dir / "demo-office.log.gz"


def test_a_log_as_sparse_as_the_office_is_used_whole(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name, flags in (("default", ()), ("exact", EXACT)):
        assert prf("sample", "--laser", log, *QUICK, *flags, "--steps", 10, "-o", tmp_path / name, "--json") == 0
        found = json.loads(capsys.readouterr().out)
        assert (found["n_beams"], found["n_beams_thinned"]) == (ALL, 0)
    default, exact = (read_run(tmp_path / name) for name in ("default", "exact"))
    assert default.manifest["configuration"]["beam_density"] > 0.0
    assert exact.manifest["configuration"]["beam_density"] == 0.0
    assert (tmp_path / "default" / "draws.npz").read_bytes() == (tmp_path / "exact" / "draws.npz").read_bytes()


def test_what_was_left_out_is_reported_and_recorded(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "run"
    assert prf("sample", "--laser", log, *QUICK, *DENSITY, "--steps", 10, "-o", folder, "--json") == 0
    captured = capsys.readouterr()
    found = json.loads(captured.out)
    assert found["n_beams"] + found["n_beams_thinned"] == ALL
    assert 1000 < found["n_beams"] < 2500
    assert f"{found['n_beams']:,} of 5,580 beams (thinned)" in captured.err
    (reason,) = (line for line in captured.err.splitlines() if line.startswith("thinned to about "))
    assert "--set thinning.beam_density=0 keeps all" in reason
    run = read_run(folder)
    assert run.laser is not None
    assert len(run.laser.range) == run.manifest["n_beams"] == found["n_beams"]
    assert run.manifest["n_beams_thinned"] == found["n_beams_thinned"]


@pytest.mark.slow
def test_resuming_repeats_a_thinned_run(log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    whole, halved = tmp_path / "whole", tmp_path / "halved"
    for folder, steps in ((whole, 40_000), (halved, 20_000)):
        assert prf("sample", "--laser", log, *QUICK, *DENSITY, "--steps", steps, "-o", folder, "-q") == 0
    capsys.readouterr()
    assert prf("sample", "--resume", halved, "--laser", log, *DENSITY, "--steps", 40_000, "--json") == 0
    assert json.loads(capsys.readouterr().out)["n_beams_thinned"] > 0
    for name in ("draws.npz", "posterior.npz", "readings.npz"):
        assert (whole / name).read_bytes() == (halved / name).read_bytes(), name
    assert prf("sample", "--resume", halved, *EXACT, "--steps", 40_000) == 2
    assert "the run to resume has 4.0" in capsys.readouterr().err


def test_a_settings_file_can_set_it_and_options_win(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "site.toml").write_text("[thinning]\nbeam_density = 4\n")
    common = ("sample", "--laser", log, *QUICK, "--config", tmp_path / "site.toml", "--steps", 10, "--json")
    assert prf(*common, "-o", tmp_path / "a") == 0
    assert json.loads(capsys.readouterr().out)["n_beams_thinned"] > 0
    assert prf(*common, "-o", tmp_path / "b", *EXACT) == 0
    assert json.loads(capsys.readouterr().out)["n_beams_thinned"] == 0


def test_annealing_thins_too(log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    target = tmp_path / "best.geojson"
    common = ("anneal", "--laser", log, "--chains", 1, "--seed", 1, "--steps", 10, "-o", target, "--json")
    assert prf(*common, *DENSITY) == 0
    captured = capsys.readouterr()
    found, made = json.loads(captured.out), json.loads(target.read_text())["properties"]
    assert found["n_beams"] + found["n_beams_thinned"] == ALL
    assert (made["n_beams"], made["n_beams_thinned"]) == (found["n_beams"], found["n_beams_thinned"])
    assert "of 5,580 beams (thinned)" in captured.err
    (reason,) = (line for line in captured.err.splitlines() if line.startswith("thinned to about "))
    assert "--set thinning.beam_density=0 keeps all" in reason
    assert prf(*common, *EXACT, "--force") == 0
    assert json.loads(capsys.readouterr().out)["n_beams"] == ALL


def test_a_dense_public_log_keeps_the_density(shared_data: Path) -> None:
    from prf.configuration import Configuration
    from prf.readings import read_readings
    from prf.sampler.prepare import prepare

    readings = read_readings(str(shared_data / "prf" / "carmen" / "intel-corrected.log.gz"))
    prepared = prepare(Configuration.of(max_range=40.0, beam_density=20.0), readings)
    assert prepared.settings.laser is not None
    assert len(prepared.settings.laser.readings.range) + prepared.n_beams_thinned == readings.n_beams
    assert 18_000 < len(prepared.settings.laser.readings.range) < 22_000
    assert np.isin(prepared.settings.laser.readings.scan, readings.scan).all()
