"""`--config`, `--topic` and `--frame` of sample, anneal and grid."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from prf.output.run import read_run
from prf.results.occupancy import read_grid
from tests.cli.calls import prf

QUICK = ("--chains", "1", "--steps", "100", "-q", "--seed", "1")


@pytest.fixture
def ring(tmp_path: Path) -> Path:
    rows = "".join(f"5,5,{angle / 8:.3f},{2 + angle % 3}\n" for angle in range(48))
    (tmp_path / "ring.csv").write_text("x,y,theta,range\n" + rows)
    return tmp_path / "ring.csv"


@pytest.fixture
def site(tmp_path: Path) -> Path:
    file = tmp_path / "site.toml"
    file.write_text(
        "[prior]\nwindow = [0, 0, 10, 10]\nscale = 0.2\n[laser]\nmiss_probability = 0.1\n"
        "[sonar]\nmax_range = 3.9\ncone = 0.5\nsurface_oblique = 8\n"
    )
    return file


def test_a_run_keeps_the_settings_of_the_file(
    ring: Path, site: Path, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    folder = tmp_path / "run"
    assert prf("sample", "--sonar", ring, "--config", site, "--scale", 0.3, *QUICK, "-o", folder) == 0
    run = read_run(folder)
    found = run.manifest["configuration"]
    assert (found["scale"], found["window"], found["sonar_cone"]) == (0.3, [0, 0, 10, 10], 0.5)
    assert (found["sonar_surface_oblique"], found["miss_probability"], found["sonar_max_range"]) == (8.0, 0.1, 3.9)
    assert run.sonar is not None
    assert run.sonar.cone.tolist() == [0.5] * 48
    more = ("--steps", "3000", "-q")
    assert prf("sample", "--resume", folder, *more) == 0
    assert prf("sample", "--resume", folder, "--config", site, *more) == 2
    assert "[prior] scale 0.2: the run to resume has 0.3" in capsys.readouterr().err
    assert prf("sample", "--resume", folder, "--config", site, "--scale", 0.3, *more) == 0


def test_options_override_the_file_and_presets_and_the_manifest_records_it(
    ring: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PRF_SAMPLE_NOISE", "0.06")
    Path("site.toml").write_text('preset = "sick-lms200"\n[laser]\nmiss_probability = 0.1\nmax_range = 7\n')
    args = ("--laser", ring, "--config", "site.toml", "--scale", 0.3, *QUICK)
    assert prf("sample", *args, "-o", "run") == 0
    manifest = read_run("run").manifest
    used = manifest["configuration"]
    assert (used["noise"], used["max_range"], used["miss_probability"], used["scale"]) == (0.06, 7.0, 0.1, 0.3)
    assert manifest["sources"] == {
        "noise": "--noise",
        "scale": "--scale",
        "chains": "--chains",
        "max_range": "site.toml: [laser] max_range",
        "miss_probability": "site.toml: [laser] miss_probability",
    }
    monkeypatch.delenv("PRF_SAMPLE_NOISE")
    assert prf("sample", *args, "--preset", "hokuyo-urg-04lx", "-o", "other") == 0
    manifest = read_run("other").manifest
    assert (manifest["configuration"]["noise"], manifest["configuration"]["max_range"]) == (0.02, 7.0)
    assert manifest["sources"]["noise"] == "preset hokuyo-urg-04lx: [laser] noise"
    assert prf("sample", "--resume", "other", "--steps", "3000", "-q") == 0
    assert read_run("other").manifest["sources"] == manifest["sources"]


def test_grid_and_anneal_take_presets_too(ring: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("site.toml").write_text('preset = "hokuyo-urg-04lx"\n')
    assert prf("grid", "--laser", ring, "--config", "site.toml", "-o", "g.npz", "-q") == 0
    grid = read_grid("g.npz")
    assert grid.settings["max_range"] == 4.0
    assert grid.process["sources"] == {"max_range": "preset hokuyo-urg-04lx: [laser] max_range"}
    assert prf("anneal", "--laser", ring, "--preset", "hokuyo-urg-04lx", *QUICK, "-o", "m.geojson") == 0
    found = json.loads(Path("m.geojson").read_text())["properties"]
    assert found["configuration"]["noise"] == 0.02
    assert found["sources"]["noise"] == "preset hokuyo-urg-04lx: [laser] noise"


def test_a_parameter_of_the_file_changes_the_likelihood(ring: Path, site: Path, tmp_path: Path) -> None:
    values = []
    for oblique in (8, 16):
        site.write_text(f"[prior]\nwindow = [0, 0, 10, 10]\n[sonar]\nsurface_oblique = {oblique}\n")
        args = ("--sonar", ring, "--config", site, "--chains", 1, "--steps", 4000, "-q", "--seed", 1)
        assert prf("sample", *args, "-o", tmp_path / f"run{oblique}") == 0
        values.append(read_run(tmp_path / f"run{oblique}").functionals["log_likelihood"].tolist())
    assert values[0] != values[1]


def test_a_grid_takes_what_it_knows(ring: Path, site: Path, tmp_path: Path) -> None:
    grid = tmp_path / "ring.grid.npz"
    assert prf("grid", "--sonar", ring, "--config", site, "--set", "sonar.max_range=3.0", "-o", grid, "-q") == 0
    settings = read_grid(grid).settings
    assert (settings["sonar_cone"], settings["sonar_max_range"], settings["window"]) == (0.5, 3.0, [0, 0, 10, 10])
    assert settings["miss_probability"] == 0.4, "of a cell; that of the file is the laser's"


def test_the_cone_of_the_option_reaches_the_readings_of_a_grid(ring: Path, tmp_path: Path) -> None:
    seen = []
    for cone in (0.1, 1.0):
        assert prf("grid", "--sonar", ring, "--set", f"sonar.cone={cone}", "-o", tmp_path / f"{cone}.npz", "-q") == 0
        seen.append(read_grid(tmp_path / f"{cone}.npz").share_seen)
    assert seen[0] < seen[1]


def test_anneal_takes_the_file(ring: Path, site: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert prf("anneal", "--sonar", ring, "--config", site, *QUICK) == 0
    assert json.loads((tmp_path / "ring.geojson").read_text())["properties"]["window"] == [0, 0, 10, 10]
