"""`--config`, `--topic` and `--frame` of sample, anneal and grid."""

from __future__ import annotations

import json
import re
import tomllib
from pathlib import Path

import pytest

from mapq.cli import app as mapq_app
from mapq.configuration import Configuration
from mapq.io import read_patches
from prf.output.run import read_run
from prf.results.occupancy import read_grid
from tests.cli.calls import mapq, prf
from tests.cli.mapq_samples import call_json, save_cloud

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


# `prf config` and `mapq config`, and --config, --preset and --set of mapq's verbs.


TOOLS = {"prf": prf, "mapq": mapq}


def config(tool: str, *args: object) -> int:
    return TOOLS[tool]("config", *args)


@pytest.fixture
def config_site(tmp_path: Path) -> Path:
    file = tmp_path / "site.toml"
    file.write_text(
        'preset = "velodyne-vlp16"\n[segment]\nmin_points = 30\nsurfaces = ["level"]\n'
        "[features]\nradius = 2.5\n[crf]\nregularisation = 3\nmax_false_alarms = 0.2\n"
    )
    return file


@pytest.mark.parametrize("tool", TOOLS)
def test_what_it_shows_is_a_settings_file_of_the_defaults(tool, tmp_path, capsys):
    assert config(tool) == 0
    shown = capsys.readouterr().out
    (tmp_path / "site.toml").write_text(shown)
    assert config(tool, "show", tmp_path / "site.toml", "--json") == 0
    assert json.loads(capsys.readouterr().out)["settings"].keys() == tomllib.loads(shown).keys()


def test_it_shows_what_has_set_each_value(tmp_path, capsys):
    (tmp_path / "site.toml").write_text('preset = "sick-lms200"\n[laser]\nnoise = 0.05\n')
    assert config("prf", "show", tmp_path / "site.toml", "--set", "prior.scale=0.2") == 0
    shown = capsys.readouterr().out
    values = tomllib.loads(shown)
    assert (values["laser"]["max_range"], values["laser"]["noise"], values["prior"]["scale"]) == (80.0, 0.05, 0.2)
    assert [line.split()[0] for line in shown.splitlines() if "(preset sick-lms200)" in line] == ["max_range"]
    assert [line.split()[0] for line in shown.splitlines() if "(set here)" in line] == ["scale", "noise"]


@pytest.mark.parametrize(("tool", "name"), [("prf", "sick-lms200"), ("mapq", "velodyne-vlp16")])
def test_presets_are_listed_and_printed(tool, name, capsys):
    assert config(tool, "presets") == 0
    names = [line.split()[0] for line in capsys.readouterr().out.splitlines()]
    assert name in names
    assert config(tool, "presets", name) == 0
    assert "data sheet" in capsys.readouterr().out
    assert config(tool, "presets", "--json") == 0
    assert [preset["name"] for preset in json.loads(capsys.readouterr().out)["presets"]] == names


@pytest.mark.parametrize(
    ("args", "code"),
    [
        (["presets", "kinect"], 2),
        (["show", "--preset", "kinect"], 2),
        (["chekc", "x"], 2),
        (["show", "absent.toml"], 3),
        (["show", "--set", "laser.nose=1"], 2),
        (["show", "--set", "laser"], 2),
    ],
)
@pytest.mark.parametrize("tool", TOOLS)
def test_errors_are_one_line(tool, args, code, capsys):
    assert config(tool, *args) == code
    printed = capsys.readouterr()
    assert (printed.out, printed.err.count("\n")) == ("", 1)


def test_segment_takes_options_over_the_file_over_the_preset(capsys, tmp_path, config_site):
    cloud, target = save_cloud(tmp_path), tmp_path / "m.patches"
    used = call_json(capsys, "segment", cloud, "--config", config_site, "--surfaces", "upright", "-o", target)[
        "parameters"
    ]
    assert (used["noise"], used["min_points"], used["surfaces"]) == (0.03, 30, ["upright"])
    assert read_patches(str(target)).report["sources"] == {
        "noise": "preset velodyne-vlp16: [segment] noise",
        "min_points": f"{config_site}: [segment] min_points",
        "surfaces": "--surfaces",
    }
    args = ("segment", cloud, "--set", "segment.max_gap=0.5", "-o", target, "-f")
    assert call_json(capsys, *args)["parameters"]["max_gap"] == 0.5


@pytest.mark.parametrize(("verb", "table"), [("segment", "segment"), ("features", "features"), ("train", "crf")])
def test_defaults_that_the_help_shows_are_those_of_the_library(verb, table):
    """And no option has another: a file could not set what an option always sets."""
    params = {flag: param for param in mapq_app.get_command(None, verb).params for flag in param.opts}
    for key, value in getattr(Configuration(), table):
        param = params.get(Configuration.flag(f"{table}.{key}"))
        bracket = re.search(r"\s{2}\[([^\[\]]*)\]$", param.help) if param is not None else None
        assert param is None or param.default is None, key
        if bracket is not None and value is not None:
            numbers = value if isinstance(value, tuple) else (value,)
            words = " ".join(f"{number:g}" if not isinstance(number, str) else number for number in numbers)
            assert bracket[1] == words, key
