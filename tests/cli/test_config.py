"""`prf config` and `mapq config`, and --config, --preset and --set of mapq's verbs."""

from __future__ import annotations

import json
import re
import tomllib
from pathlib import Path

import pytest

import mapq.cli
import prf.cli
from mapq.configuration import Configuration
from mapq.io import read_patches
from prf.shell.cli.run import run_app
from tests.cli.mapq_samples import call, call_json, save_cloud, save_model, save_patches

APPS = {"prf": prf.cli.app, "mapq": mapq.cli.app}


def config(tool: str, *args: object) -> int:
    return run_app(APPS[tool], tool, ["config", *map(str, args)])


@pytest.fixture
def site(tmp_path: Path) -> Path:
    file = tmp_path / "site.toml"
    file.write_text(
        'preset = "velodyne-vlp16"\n[segment]\nmin_points = 30\nmax_tilt = 80\n'
        "[features]\nradius = 2.5\n[crf]\nregularisation = 3\nmax_false_alarms = 0.2\n"
    )
    return file


@pytest.mark.parametrize("tool", APPS)
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
@pytest.mark.parametrize("tool", APPS)
def test_errors_are_one_line(tool, args, code, capsys):
    assert config(tool, *args) == code
    printed = capsys.readouterr()
    assert (printed.out, printed.err.count("\n")) == ("", 1)


def test_segment_takes_options_over_the_file_over_the_preset(capsys, tmp_path, site):
    cloud, target = save_cloud(tmp_path), tmp_path / "m.patches"
    used = call_json(capsys, "segment", cloud, "--config", site, "--max-tilt", 70, "-o", target)["parameters"]
    assert (used["noise"], used["min_points"], used["max_tilt"]) == (0.03, 30, 70.0)
    assert read_patches(str(target)).report["sources"] == {
        "noise": "preset velodyne-vlp16: [segment] noise",
        "min_points": f"{site}: [segment] min_points",
        "max_tilt": "--max-tilt",
    }
    args = ("segment", cloud, "--set", "segment.max_gap=0.5", "-o", target, "-f")
    assert call_json(capsys, *args)["parameters"]["max_gap"] == 0.5


def test_classify_takes_segmentation_and_false_alarms(capsys, tmp_path, site):
    cloud, model, target = save_cloud(tmp_path), save_model(tmp_path), tmp_path / "r.ply"
    site.write_text("[segment]\nmax_tilt = 80\nmin_points = 30\n")
    made = call_json(capsys, "classify", cloud, "--model", model, "--config", site, "--max-tilt", 60, "-o", target)
    sources = {"max_tilt": "--max-tilt", "min_points": f"{site}: [segment] min_points"}
    assert made["segmentation"]["report"]["sources"] == sources
    # A file may have settings of the segmentation beside patches, an option may not.
    patches = save_patches(tmp_path)
    assert call(capsys, "classify", patches, "--model", model, "--config", site, "-o", target, "-f")[0] == 0
    code, _, err = call(capsys, "classify", patches, "--model", model, "--max-tilt", 60, "-o", target, "-f")
    assert (code, "segmented already" in err) == (2, True)


def test_train_takes_features_and_field(capsys, tmp_path, site):
    patches, target = save_patches(tmp_path), tmp_path / "m.json"
    made = call_json(capsys, "train", patches, "--config", site, "--set", "features.radius=2", "-o", target)
    assert (made["features"]["radius"], made["features"]["tolerance"]) == (2.0, 0.1)
    assert made["training"]["regularisation"] == 3.0
    sources = made["training"]["sources"]
    assert sources["features"]["radius"] == "--set features.radius"
    assert sources["crf"]["regularisation"] == f"{site}: [crf] regularisation"


def test_features_take_the_file(capsys, tmp_path, site):
    used = call_json(capsys, "features", save_patches(tmp_path), "--config", site)["parameters"]
    assert (used["radius"], used["tolerance"]) == (2.5, 0.1)


@pytest.mark.parametrize(("verb", "table"), [("segment", "segment"), ("features", "features"), ("train", "crf")])
def test_defaults_that_the_help_shows_are_those_of_the_library(verb, table):
    """And no option has another: a file could not set what an option always sets."""
    params = {flag: param for param in mapq.cli.app.get_command(None, verb).params for flag in param.opts}
    for key, value in getattr(Configuration(), table):
        param = params.get(Configuration.flag(f"{table}.{key}"))
        bracket = re.search(r"\s{2}\[([^\[\]]*)\]$", param.help) if param is not None else None
        assert param is None or param.default is None, key
        if bracket is not None and value is not None:
            numbers = value if isinstance(value, tuple) else (value,)
            words = " ".join(f"{number:g}" if not isinstance(number, str) else number for number in numbers)
            assert bracket[1] == words, key


@pytest.mark.parametrize("verb", ["segment", "features", "train", "classify"])
def test_a_bad_file_ends_in_one_line_before_any_work(capsys, tmp_path, verb, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "bad.toml").write_text("[segment]\nnoise = 0.1\nnose = 1\n")
    file = save_cloud(tmp_path) if verb == "segment" else save_patches(tmp_path)
    before = sorted(tmp_path.iterdir())
    code, out, err = call(capsys, verb, file, "--config", "bad.toml")
    assert (code, out) == (2, "")
    assert err == "error: bad.toml: [segment] nose: unknown key. Did you mean noise?\n"
    assert sorted(tmp_path.iterdir()) == before
