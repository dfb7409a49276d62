"""`mapq config`, and `--config` and `--preset` of segment, features, train and classify."""

from __future__ import annotations

import json
import re
import tomllib
from pathlib import Path

import pytest

from mapq.cli import app
from mapq.io import read_patches
from mapq.settings import KEY_WORDS, defaults
from mapq.settings.asked import FLAGS
from tests.cli.mapq_samples import call, call_json, save_cloud, save_model, save_patches


@pytest.fixture
def site(tmp_path: Path) -> Path:
    file = tmp_path / "site.toml"
    file.write_text(
        'preset = "velodyne-vlp16"\n[segment]\nmin_points = 30\nmax_tilt = 80\n'
        "[features]\nradius = 2.5\n[crf]\nregularisation = 3\nmax_false_alarms = 0.2\n"
    )
    return file


def test_what_it_shows_is_sound_and_has_every_key(capsys, tmp_path):
    code, shown, _ = call(capsys, "config")
    assert code == 0
    for words in KEY_WORDS.values():
        assert str(words) in shown
    (tmp_path / "all.toml").write_text(shown)
    code, out, err = call(capsys, "config", "check", tmp_path / "all.toml")
    assert (code, out, err) == (0, f"{tmp_path}/all.toml: sound\n", "")


def test_it_shows_what_a_file_and_presets_make(capsys, site):
    shown = tomllib.loads(call(capsys, "config", "show", site)[1])
    assert (shown["segment"]["noise"], shown["segment"]["min_points"]) == (0.03, 30)
    told = call_json(capsys, "config", "show", site, "--preset", "survey-scanner")
    assert told["settings"]["segment"]["noise"] == 0.005
    assert "preset survey-scanner: [segment] noise" in told["set"]
    assert f"{site}: [crf] regularisation" in told["set"]


def test_presets_are_listed_and_printed(capsys):
    listed = call(capsys, "config", "presets")[1].splitlines()
    assert [line.split()[0] for line in listed] == [
        "ouster-os1-64", "survey-scanner", "velodyne-hdl64e", "velodyne-vlp16"
    ]  # fmt: skip
    text = call(capsys, "config", "presets", "velodyne-vlp16")[1]
    assert tomllib.loads(text)["segment"] == {"noise": 0.03}
    assert "data sheet" in text
    told = call_json(capsys, "config", "presets", "velodyne-vlp16")["presets"]
    assert [preset["settings"]["segment"] for preset in told] == [{"noise": 0.03}]


@pytest.mark.parametrize(
    ("args", "code", "words"),
    [
        (["check"], 2, "config check needs a FILE"),
        (["check", "absent.toml"], 3, "absent.toml: no such file"),
        (["presets", "vlp-16"], 2, "there is no preset 'vlp-16'"),
        (["presets", "--preset", "survey-scanner"], 2, "--preset goes with config show"),
        (["show", "--preset", "vlp"], 2, "--preset: there is no preset 'vlp'"),
    ],
)
def test_errors_are_one_line(capsys, args, code, words):
    found, out, err = call(capsys, "config", *args)
    assert (found, out, err.count("\n")) == (code, "", 1)
    assert words in err


def test_segment_takes_options_over_the_file_over_the_preset(capsys, tmp_path, site):
    cloud, target = save_cloud(tmp_path), tmp_path / "m.patches"
    told = call_json(capsys, "segment", cloud, "--config", site, "--max-tilt", 70, "-o", target)
    used = told["parameters"]
    assert (used["noise"], used["min_points"], used["max_tilt"]) == (0.03, 30, 70.0)
    assert read_patches(str(target)).report["sources"] == {
        "noise": "preset velodyne-vlp16: [segment] noise",
        "min_points": f"{site}: [segment] min_points",
        "max_tilt": "--max-tilt",
    }


def test_classify_takes_segmentation_and_false_alarms(capsys, tmp_path, site):
    cloud, model, target = save_cloud(tmp_path), save_model(tmp_path), tmp_path / "r.ply"
    site.write_text("[segment]\nmax_tilt = 80\nmin_points = 30\n")
    told = call_json(capsys, "classify", cloud, "--model", model, "--config", site, "--max-tilt", 60, "-o", target)
    sources = {"max_tilt": "--max-tilt", "min_points": f"{site}: [segment] min_points"}
    assert told["segmentation"]["report"]["sources"] == sources
    assert json.loads(target.with_suffix(".json").read_text())["segmentation"] == told["segmentation"]
    tiled = call_json(capsys, "classify", cloud, "--model", model, "--config", site, "--workers", 1, "-o", target, "-f")
    assert tiled["segmentation"]["report"]["sources"] == {**sources, "max_tilt": f"{site}: [segment] max_tilt"}
    # Patches are what they are: a file may speak of segmentation, an option may not.
    patches = save_patches(tmp_path)
    assert call(capsys, "classify", patches, "--model", model, "--config", site, "-o", target, "-f")[0] == 0
    code, _, err = call(capsys, "classify", patches, "--model", model, "--max-tilt", 60, "-o", target, "-f")
    assert (code, "segmented already" in err) == (2, True)


def test_train_takes_features_and_field(capsys, tmp_path, site):
    patches, target = save_patches(tmp_path), tmp_path / "m.json"
    told = call_json(capsys, "train", patches, "--config", site, "--radius", 2, "-o", target)
    assert (told["features"]["radius"], told["features"]["tolerance"]) == (2.0, 0.1)
    assert told["training"]["regularisation"] == 3.0
    assert told["training"]["sources"] == {
        "features": {"tolerance": "preset velodyne-vlp16: [features] tolerance", "radius": "--radius"},
        "crf": {
            "regularisation": f"{site}: [crf] regularisation",
            "max_false_alarms": f"{site}: [crf] max_false_alarms",
        },
    }


def test_the_false_alarms_of_a_file_move_the_threshold(capsys, tmp_path, site):
    patches = [save_patches(tmp_path, seed) for seed in (1, 2)]
    thresholds = []
    for share in (0.0, 0.5):
        site.write_text(f"[crf]\nmax_false_alarms = {share}\nregularisation = 1\ncoupling_regularisation = 1\n")
        told = call_json(capsys, "train", *patches, "--config", site, "-o", tmp_path / f"{share}.json")
        thresholds.append(told["threshold"])
    assert thresholds[0] > thresholds[1]


def test_features_take_the_file(capsys, tmp_path, site):
    used = call_json(capsys, "features", save_patches(tmp_path), "--config", site, "--tau", 1.5)["parameters"]
    assert (used["radius"], used["tolerance"], used["tau"]) == (2.5, 0.1, 1.5)


@pytest.mark.parametrize(("verb", "table"), [("segment", "segment"), ("features", "features"), ("train", "crf")])
def test_defaults_that_the_help_shows_are_those_of_the_library(verb, table):
    """And no option has another: a file could not set what an option always sets."""
    params = {flag: param for param in app.get_command(None, verb).params for flag in param.opts}
    shown = 0
    for key, value in defaults()[table].items():
        param = params.get(FLAGS.get(key, "--" + key.replace("_", "-")))
        bracket = re.search(r"\s{2}\[([^\[\]]*)\]$", param.help) if param is not None else None
        assert param is None or param.default is None, key
        if bracket is not None and value is not None:
            numbers = value if isinstance(value, tuple) else (value,)
            words = " ".join(f"{number:g}" if not isinstance(number, str) else number for number in numbers)
            assert bracket[1] == words, key
            shown += 1
    assert shown >= 3


@pytest.mark.parametrize("verb", ["segment", "features", "train", "classify"])
def test_a_bad_file_ends_in_one_line_before_any_work(capsys, tmp_path, verb, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "bad.toml").write_text("[segment]\nnoise = 0.1\nnose = 1\n")
    file = save_cloud(tmp_path) if verb == "segment" else save_patches(tmp_path)
    before = sorted(tmp_path.iterdir())
    code, out, err = call(capsys, verb, file, "--config", "bad.toml")
    assert (code, out) == (2, "")
    assert err == "error: bad.toml:3: [segment] nose: there is no such key. Did you mean noise?\n"
    assert sorted(tmp_path.iterdir()) == before
