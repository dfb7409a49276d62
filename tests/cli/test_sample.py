"""The verb `sample`: its directory, resuming, refusals, interruption."""

from __future__ import annotations

import dataclasses
import json
import os
import shlex
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from prf.commands.sample import _advice
from prf.model.coloring import violations
from prf.output.run import read_run
from prf.sampler import ensemble
from tests.cli.calls import prf
from tests.output.report.test_live import address_in, get

TEMPERATURES = ("--set", "sampler.temperatures=3")
LOWEST = "sampler.lowest_inverse_temperature"
QUICK = ("--every-scan", "8", "--every-beam", "6", "--chains", "2", "--resolution", "0.5")
IMPATIENT = """
from prf.cli import main
from prf.output.report import live
from prf.shell.cli import console

console.PLAIN_INTERVAL = live.EVERY = live.FAREWELL = 0.0
main()
"""
"""`prf`, with a line of progress and a new page as soon as there is one, that waits for no browser at its end."""
RESULTS = ("draws.npz", "posterior.npz", "readings.npz", "map.geojson")


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    source = Path(__file__).resolve().parents[2] / "data" / "demo-office.log.gz"
    copy = tmp_path_factory.mktemp("log") / "office.log.gz"
    copy.write_bytes(source.read_bytes())
    return copy


@pytest.fixture(scope="module")
def office(log: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("runs") / "office"
    assert prf("sample", "--laser", str(log), *QUICK, "--steps", "60000", "--seed", "5", "-o", str(folder), "-q") == 0
    return folder


def test_a_run_has_every_file_and_valid_maps(office: Path) -> None:
    found = read_run(office)
    assert found.manifest["configuration"]["chains"] == 2
    assert found.manifest["configuration"]["start"] == "grid"
    assert "tempering" not in json.loads((office / "diagnostics.json").read_text())
    assert found.manifest["seed"] == 5
    assert found.manifest["steps"] == 60_000
    assert found.manifest["burn_in"] == 16_000
    assert set(found.chain) == {0, 1}
    assert found.step.min() > 16_000
    assert not any(violations(draw) for draw in found.draws)
    assert found.best is not None
    assert found.image is not None
    assert found.image.resolution == 0.5
    assert (office / "posterior.png").stat().st_size > 10_000
    assert (office / "checkpoint.npz").is_file()


def test_uncertain_poses_are_sampled_and_reported(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "moved"
    how = ("--pose-noise", "0.05", "0.01", "--chains", "4", "--steps", "20000", "--seed", "5", "-o", str(folder))
    assert prf("sample", "--laser", str(log), *QUICK, *how) == 0
    printed = capsys.readouterr()
    found = read_run(folder)
    assert found.trajectory is not None
    assert f"Trajectory: {found.trajectory.words()}; {folder}/trajectory.csv" in " ".join(
        (printed.out + printed.err).split()
    )
    assert found.trajectory.draws.shape == (len(found.draws), 4, 3)
    # Errors of .05 m on each axis, and Student's factor for two pairs of chains that have hardly left their starts.
    assert 0.0 < found.trajectory.figures()["mean_sd_m"] < 0.05 * np.sqrt(2.0) * 2.2
    assert prf("sample", "--resume", str(folder), "--steps", "20000", "--json", "-q") == 0
    shown = json.loads(capsys.readouterr().out)["trajectory"]
    assert (shown.pop("slips"), shown.pop("disputed")) == ([], [])
    assert shown == pytest.approx(found.trajectory.figures())


def test_resuming_gives_what_an_uninterrupted_run_gives(log: Path, office: Path, tmp_path: Path) -> None:
    folder = tmp_path / "office"
    args = ("--laser", str(log), *QUICK, "--seed", "5", "-o", str(folder), "-q", "--threads", "1")
    assert prf("sample", *args, "--steps", "20000") == 0
    assert prf("sample", "--resume", str(folder), "--steps", "60000", "-q") == 0
    for name in RESULTS:
        assert (folder / name).read_bytes() == (office / name).read_bytes(), name


@pytest.mark.parametrize(
    "options",
    [("--pose-noise", "0.05", "0.01"), pytest.param(("--odometry", "wheels"), marks=pytest.mark.slow)],
    ids=["errors", "odometry"],
)
def test_resuming_with_uncertain_poses_gives_what_an_uninterrupted_run_gives(
    log: Path, tmp_path: Path, options: tuple[str, ...]
) -> None:
    args = ("--laser", str(log), *QUICK, *options, "--seed", "5", "-q")
    whole, parts = tmp_path / "whole", tmp_path / "parts"
    assert prf("sample", *args, "--steps", "40000", "-o", str(whole)) == 0
    assert prf("sample", *args, "--steps", "20000", "-o", str(parts), "--threads", "1") == 0
    assert prf("sample", "--resume", str(parts), "--steps", "40000", "-q") == 0
    for name in (*RESULTS, "poses.npz", "trajectory.csv"):
        assert (parts / name).read_bytes() == (whole / name).read_bytes(), name


@pytest.mark.parametrize(
    "options",
    [
        pytest.param(TEMPERATURES, id="reach"),
        pytest.param(
            (*TEMPERATURES, "--set", f"{LOWEST}=0", "--set", "sampler.start=prior"), id="prior", marks=pytest.mark.slow
        ),
    ],
)
def test_resuming_tempered_chains_gives_what_an_uninterrupted_run_gives(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], options: tuple[str, ...]
) -> None:
    args = ("--laser", str(log), *QUICK, *options, "--seed", "5")
    whole, parts = tmp_path / "whole", tmp_path / "parts"
    assert prf("sample", *args, "--steps", "40000", "-o", str(whole), "-v") == 0
    assert "Tempering: 3 temperatures" in capsys.readouterr().out
    assert prf("sample", *args, "--steps", "20000", "-o", str(parts), "-q", "--threads", "1") == 0
    assert prf("sample", "--resume", str(parts), "--steps", "40000", "-q") == 0
    for name in RESULTS:
        assert (parts / name).read_bytes() == (whole / name).read_bytes(), name
    found = read_run(whole)
    assert found.manifest["burn_in"] == 20_000
    assert found.step.min() > 20_000
    assert found.diagnostics is not None
    first, second = found.diagnostics["tempering"]
    assert len(first["powers"]) == 3
    assert len(first["swap_rates"]) == 2
    assert first != second
    assert prf("sample", "--resume", str(whole), "--set", "sampler.temperatures=4") == 2
    assert "--set sampler.temperatures 4" in capsys.readouterr().err


@pytest.mark.slow
def test_chains_that_disagree_get_a_ladder_and_report_it(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Chains from contours are far from agreement after 40,000 steps; resumed or not, the run is the same."""
    monkeypatch.setattr(ensemble, "FIRST_LOOK", 40_000)
    monkeypatch.setattr("prf.results.convergence.STALLED", 0.0)
    args = ("--laser", str(log), *QUICK, "--set", "sampler.temperatures=auto", "--seed", "5")
    whole, parts = tmp_path / "whole", tmp_path / "parts"
    assert prf("sample", *args, "--steps", "40000", "-o", str(parts)) == 0
    assert "Tempering: none so far" in capsys.readouterr().out
    assert "tempered_from" not in read_run(parts).manifest
    assert prf("sample", "--resume", str(parts), "--set", "sampler.temperatures=auto", "--steps", "50000", "-q") == 0
    assert prf("sample", "--resume", str(parts), "--steps", "60000", "-q") == 0
    assert prf("sample", *args, "--steps", "60000", "-o", str(whole), "-v") == 0
    printed = capsys.readouterr()
    assert "Tempering: 6 temperatures from step 40,000 on" in printed.out
    assert "the chains disagree: 6 temperatures each from step 40,000 on" in printed.err
    for name in RESULTS:
        assert (parts / name).read_bytes() == (whole / name).read_bytes(), name
    found = read_run(whole)
    assert found.manifest["tempered_from"] == 40_000
    assert found.manifest["configuration"]["temperatures"] == "auto"
    assert found.diagnostics is not None
    assert [chain["first_step"] for chain in found.diagnostics["tempering"]] == [40_000, 40_000]
    assert prf("sample", "--resume", str(whole), "--set", "sampler.temperatures=4") == 2
    assert "the run to resume has auto" in capsys.readouterr().err


def test_the_advice_to_temper_is_a_command_that_runs(log: Path, office: Path, tmp_path: Path) -> None:
    """A ladder cannot be given to a run: the advice is to sample anew, elsewhere, with what the run was made with."""
    read = read_run(office)
    folder = tmp_path / "my office"
    command = ["prf", "sample", "--laser", str(log), *QUICK, "-f", "--steps", "2000", "-o", str(folder)]
    diagnostics = {**(read.diagnostics or {}), "suggested_seconds": None, "converged_seen": False, "trend": "flat"}
    run = dataclasses.replace(read, manifest={**read.manifest, "command": command}, diagnostics=diagnostics)
    advice = _advice(run, folder)
    assert advice.startswith("The chains do not approach each other, and more time alone will not help: sample anew")
    words = shlex.split(advice[advice.index("prf sample") :])
    assert "-f" not in words
    assert prf(*words[1:], "-q") == 0
    assert read_run(f"{folder}-tempered").manifest["configuration"]["temperatures"] == "auto"
    assert not folder.exists()


@pytest.mark.parametrize(
    "made",
    [{"sources": {"tiles": "--set"}}, {"extends": {"path": "before"}}, {"command": ["script.py", "--fast"]}],
)
def test_no_command_is_advised_that_would_be_refused(office: Path, made: dict[str, Any]) -> None:
    read = read_run(office)
    diagnostics = {**(read.diagnostics or {}), "suggested_seconds": None, "converged_seen": False, "trend": "unknown"}
    manifest = {**read.manifest, "command": ["prf", "sample", "--laser", "log"], **made}
    advice = _advice(dataclasses.replace(read, manifest=manifest, diagnostics=diagnostics), office)
    assert advice == f"Run longer (prf sample --resume {office}), or see docs/convergence.md."


def test_nothing_is_left_to_do_for_a_run_that_has_its_steps(office: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = (office / "draws.npz").read_bytes()
    assert prf("sample", "--resume", str(office), "--steps", "1000", "--json") == 0
    assert json.loads(capsys.readouterr().out)["steps"] == 60_000
    assert (office / "draws.npz").read_bytes() == before


@pytest.mark.parametrize(
    ("args", "code", "words"),
    [
        (["--scale", "0.3"], 2, "--scale 0.3"),
        (["--seed", "6"], 2, "--seed 6"),
        (["--laser", "OTHER"], 3, "not the log"),
        (["-o", "elsewhere"], 2, "leave -o out"),
    ],
)
def test_resuming_with_something_else_is_refused(
    office: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], args: list[str], code: int, words: str
) -> None:
    other = tmp_path / "other.csv"
    other.write_text("x,y,theta,range\n0,0,0,1\n")
    given = [str(other) if arg == "OTHER" else arg for arg in args]
    assert prf("sample", "--resume", str(office), *given) == code
    error = capsys.readouterr().err.strip()
    assert words in error
    assert "\n" not in error


@pytest.mark.parametrize(("chains", "steps"), [(1, 60_000), (2, 2_000)])
def test_few_draws_are_no_disagreement(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], chains: int, steps: int
) -> None:
    args = ("--chains", str(chains), "--resolution", "0.5", "--steps", str(steps), "--seed", "5")
    assert prf("sample", "--laser", str(log), *args, "-o", str(tmp_path / "run")) == 0
    printed = capsys.readouterr().out
    judged = "The one chain is not settled yet" if steps > 2_000 else "Too few draws to judge"
    assert printed.splitlines()[1].startswith(judged)
    assert f"30 minutes: prf sample --resume {tmp_path / 'run'}\npicture " in printed
    assert "The chains" not in printed
    assert "Place by place" not in printed
    assert ("10,000 steps each (rounded up from 2,000)" in printed) == (steps == 2_000)
    assert ("rounded" in printed) == (steps == 2_000)


def test_sensors_outside_the_window_are_dropped_and_counted(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "part"
    window = ("--window", "0", "0", "11", "14")
    assert prf("sample", "--laser", str(log), *QUICK, *window, "--steps", "100", "-o", str(folder)) == 0
    assert "readings dropped" in capsys.readouterr().err
    beams = read_run(folder).laser
    assert beams is not None
    assert beams.origin[:, 0].max() < 11.0


def test_a_table_without_returns_leaves_free_space(tmp_path: Path) -> None:
    table = tmp_path / "free.csv"
    table.write_text("x,y,theta,range\n" + "".join(f"0,0,{angle / 10},\n" for angle in range(63)))
    folder = tmp_path / "free"
    args = ("--max-range", "5", "--window", "-4", "-4", "4", "4", "--chains", "1", "--steps", "40000", "--seed", "1")
    assert prf("sample", "--laser", str(table), *args, "-o", str(folder), "-q") == 0
    image = read_run(folder).image
    assert image is not None
    assert np.nanmean(image.occupancy[20:30, 20:30]) < 0.05
    assert prf("sample", "--laser", str(table), "-o", str(tmp_path / "none")) == 3


@pytest.mark.parametrize(
    ("number", "code"), [(signal.SIGINT, 130), pytest.param(signal.SIGTERM, 143, marks=pytest.mark.slow)]
)
def test_a_signal_leaves_a_run_that_can_be_resumed(
    log: Path, tmp_path: Path, number: signal.Signals, code: int
) -> None:
    folder = tmp_path / "run"
    args = ["--laser", str(log), *QUICK, "--seed", "1", "-o", str(folder), "--time-budget", "300"]
    process = subprocess.Popen(
        [sys.executable, "-c", IMPATIENT, "sample", *args],
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ | {"LC_ALL": "C"},
    )
    assert process.stderr is not None
    while "sampling" not in process.stderr.readline():  # said after a round: before one nothing is kept
        pass
    process.send_signal(number)
    _, errors = process.communicate(timeout=120)
    assert process.returncode == code, errors
    assert "prf sample --resume" in errors
    assert read_run(folder).manifest["status"] == "interrupted"
    steps = read_run(folder).manifest["steps"]
    assert prf("sample", "--resume", str(folder), "--steps", str(steps + 10_000), "-q") == 0


def test_a_damaged_checkpoint_is_named(office: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "copy"
    folder.mkdir()
    for path in office.iterdir():
        (folder / path.name).write_bytes(path.read_bytes())
    (folder / "checkpoint.npz").write_bytes((office / "checkpoint.npz").read_bytes()[:5000])
    assert prf("sample", "--resume", str(folder), "--steps", "70000") == 3
    assert "checkpoint.npz: damaged" in capsys.readouterr().err
    (folder / "checkpoint.npz").unlink()
    assert prf("sample", "--resume", str(folder), "--steps", "70000") == 3
    assert "checkpoint.npz: no such file" in capsys.readouterr().err


def test_a_checkpoint_of_another_run_is_refused(
    log: Path, office: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = tmp_path / "other"
    assert prf("sample", "--laser", str(log), *QUICK, "--steps", "100", "--seed", "6", "-o", str(other), "-q") == 0
    (other / "checkpoint.npz").write_bytes((office / "checkpoint.npz").read_bytes())
    assert prf("sample", "--resume", str(other), "--steps", "70000") == 3
    assert "other readings or configuration" in capsys.readouterr().err


def test_force_leaves_nothing_of_the_older_run(log: Path, office: Path, tmp_path: Path) -> None:
    folder = tmp_path / "w$x^$"
    folder.mkdir()
    for path in office.iterdir():
        (folder / path.name).write_bytes(path.read_bytes())
    assert prf("sample", "--laser", str(log), *QUICK, "--time-budget", "0", "-o", str(folder), "-f", "-q") == 0
    assert not (folder / "map.geojson").exists()
    assert len(read_run(folder).draws) == 0


def test_the_maximum_range_is_that_of_the_whole_log(tmp_path: Path) -> None:
    table = tmp_path / "far.csv"
    table.write_text("x,y,theta,range,scan\n0,0,0,2,0\n0,0,1,3,0\n0,0,2,40,1\n")
    folder = tmp_path / "far"
    args = ("--every-scan", "2", "--chains", "1", "--steps", "100", "-q")
    assert prf("sample", "--laser", str(table), *args, "-o", str(folder)) == 0
    found = read_run(folder).manifest
    assert found["configuration"]["max_range"] == pytest.approx(0.97 * 40.0)
    assert (found["n_beams"], found["n_outside"]) == (2, 0)


def test_a_viewed_run_serves_its_page_and_leaves_it_beside(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    args = ["sample", "--laser", str(log), *QUICK, "--seed", "1", "-o", str(tmp_path / "run"), "--view"]
    process = subprocess.Popen(
        [sys.executable, "-c", IMPATIENT, *args, "--time-budget", "300"],
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ | {"BROWSER": "true"},
    )
    assert process.stderr is not None
    line = process.stderr.readline()
    while "page of the run" not in line:
        line = process.stderr.readline()
    address = address_in(line)
    assert "Under way" in get(address)[1]
    while get(address, "/after/1")[0] != 200:
        time.sleep(0.2)
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=120)
    assert process.returncode == 130, errors
    page = (tmp_path / "run.html").read_text()
    assert "connect-src" not in page
    assert "Under way" not in page
    shutil.rmtree(tmp_path / "run")
    assert prf(*args) == 4
    assert "run.html already exists. Use --force" in capsys.readouterr().err
