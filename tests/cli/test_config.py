"""`prf config`: the settings file shown and checked."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path

import pytest

from prf.cli import app
from prf.sampler.asked import settings_of
from prf.sampler.config import SampleConfig
from prf.settings_file import KEY_WORDS, read_settings
from prf.shell.run import run_app


def config(*args: object) -> int:
    return run_app(app, "prf", ["config", *map(str, args)])


@pytest.fixture
def bad(tmp_path: Path) -> Path:
    (tmp_path / "bad.toml").write_text(
        "[prior]\nscael = 1\nwindow = 3\n[sonr]\n[laser]\nnoise = -1\nmax_range = 0\n"
        "[sonar]\nuniform_probability = 0.6\nshort_probability = 0.6\n"
    )
    return tmp_path / "bad.toml"


def test_what_it_shows_is_a_settings_file_of_the_defaults(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert config() == 0
    shown = capsys.readouterr().out
    assert config("show") == 0
    assert capsys.readouterr().out == shown
    (tmp_path / "site.toml").write_text(shown)
    assert read_settings(tmp_path / "site.toml") == settings_of(SampleConfig())
    assert config("check", tmp_path / "site.toml") == 0
    assert capsys.readouterr().out == f"{tmp_path}/site.toml: sound\n"
    for words in KEY_WORDS.values():
        assert str(words) in shown


def test_it_shows_what_a_file_makes_of_them(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "site.toml").write_text("[laser]\nmax_range = 8\n[sonar]\nnoise = 0.05\n")
    assert config("show", tmp_path / "site.toml") == 0
    shown = capsys.readouterr().out
    assert tomllib.loads(shown)["laser"]["max_range"] == 8.0
    assert [line.split()[0] for line in shown.splitlines() if "(set here)" in line] == ["max_range", "noise"]
    assert config("show", tmp_path / "site.toml", "--json") == 0
    told = json.loads(capsys.readouterr().out)
    assert told["settings"]["sonar"]["noise"] == 0.05
    assert told["set"] == [f"{tmp_path}/site.toml: [laser] max_range", f"{tmp_path}/site.toml: [sonar] noise"]


def test_all_problems_are_reported_at_once(bad: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert config("check", bad) == 1
    told = capsys.readouterr()
    assert [line.removeprefix(f"{bad}:").partition(":")[0] for line in told.out.splitlines()] == list("234678")
    assert told.err == f"error: {bad}: 6 problems.\n"
    assert config("check", bad, "--json") == 1
    assert json.loads(capsys.readouterr().out)["problems"] == told.out.splitlines()
    bad.write_text("[prior\n")
    assert config("check", bad) == 1
    assert "bad.toml:1: not valid TOML" in capsys.readouterr().out


def test_it_shows_what_presets_make(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "site.toml").write_text('preset = "sick-lms200"\n[laser]\nnoise = 0.05\n')
    assert config("show", tmp_path / "site.toml") == 0
    shown = capsys.readouterr().out
    assert (tomllib.loads(shown)["laser"]["max_range"], tomllib.loads(shown)["laser"]["noise"]) == (80.0, 0.05)
    assert [line.split()[0] for line in shown.splitlines() if "(preset sick-lms200)" in line] == ["max_range"]
    assert config("show", tmp_path / "site.toml", "--preset", "hokuyo-urg-04lx", "--preset", "pioneer-ring") == 0
    shown = capsys.readouterr().out
    assert tomllib.loads(shown)["laser"]["max_range"] == 4.0
    assert "(preset pioneer-ring)" in shown


def test_presets_are_listed_and_printed(capsys: pytest.CaptureFixture[str]) -> None:
    assert config("presets") == 0
    names = [line.split()[0] for line in capsys.readouterr().out.splitlines()]
    assert {"hokuyo-utm-30lx", "sick-lms200", "pioneer-ring"} <= set(names)
    assert config("presets", "sick-lms200") == 0
    assert tomllib.loads(capsys.readouterr().out) == {"laser": {"max_range": 80.0, "noise": 0.04}}
    assert config("presets", "--json") == 0
    assert [preset["name"] for preset in json.loads(capsys.readouterr().out)["presets"]] == names


@pytest.mark.parametrize(
    ("args", "code"),
    [
        (["presets", "kinect"], 2),
        (["check", "BAD", "--preset", "sick-lms200"], 2),
        (["show", "--preset", "kinect"], 2),
        (["check"], 2),
        (["chekc", "x"], 2),
        (["check", "absent.toml"], 3),
        (["show", "absent.toml"], 3),
        (["show", "BAD"], 2),
    ],
)
def test_errors_are_one_line(args: list[str], code: int, bad: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert config(*[str(bad) if arg == "BAD" else arg for arg in args]) == code
    told = capsys.readouterr()
    assert (told.out, told.err.count("\n")) == ("", 1)
