"""The settings file: what is written is read, and what cannot be used is named with its line."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from prf.sensors.laser import LaserModel
from prf.sensors.points import PointModel
from prf.sensors.sonar import SonarModel
from prf.settings_file import TABLES, read_settings, settings_text, write_settings
from prf.shell.errors import ConfigError, InputError

SOUND = """\
# A laser and a ring.
[prior]
scale = 0.2
window = [0, 0, 10, 7.5]

[laser]
max_range = 30
noise = 1e-2

[sonar]
cone = 0.4
surface_oblique = 12.5   # smooth walls

[points]
kind = "binary"
flip_probability = 0.25

[thinning]
beam_density = 12
"""


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "site.toml"


def test_reads_what_is_there_and_nothing_more(file: Path) -> None:
    file.write_text(SOUND)
    assert read_settings(file) == {
        "prior": {"scale": 0.2, "window": (0.0, 0.0, 10.0, 7.5)},
        "laser": {"max_range": 30.0, "noise": 0.01},
        "sonar": {"cone": 0.4, "surface_oblique": 12.5},
        "points": {"kind": "binary", "flip_probability": 0.25},
        "thinning": {"beam_density": 12.0},
    }
    file.write_text("")
    assert read_settings(file) == {}


def test_every_parameter_of_the_models_is_a_key() -> None:
    assert set(LaserModel.__dataclass_fields__) == set(TABLES["laser"].keys)
    assert {*SonarModel.__dataclass_fields__, "cone"} == set(TABLES["sonar"].keys)
    assert set(PointModel.__dataclass_fields__) == set(TABLES["points"].keys)


@pytest.mark.parametrize(
    "written", ["sonar.cone = 0.4", "sonar = { cone = 0.4 }", '["sonar"]\n"cone" = 0.4', "\ufeff[sonar]\ncone=0.4"]
)
def test_toml_has_several_ways_to_write_a_table(file: Path, written: str) -> None:
    file.write_text(written)
    assert read_settings(file) == {"sonar": {"cone": 0.4}}


def test_an_unusual_combination_is_judged_as_a_whole(file: Path) -> None:
    """Alone, beside the default of the other, 0.99 would leave no room."""
    file.write_text("[laser]\noutlier_probability = 0.99\nmiss_probability = 0\n")
    assert read_settings(file)["laser"]["outlier_probability"] == 0.99


@pytest.mark.parametrize(
    ("text", "line", "words"),
    [
        ("[prior]\nscael = 1\n", 2, "[prior] scael: there is no such key. Did you mean scale?"),
        ("\n[sonor]\ncone = 1\n", 2, "there is no table [sonor]. Did you mean sonar?"),
        ("[run]\nsteps = 1\n", 1, "there is no table [run]. Known are prior, laser, sonar"),
        ("[laser]\nnoise-relative = 1\n", 2, "Did you mean noise_relative?"),
        ("[laser]\nzzz = 1\n", 2, "Known are max_range, noise, noise_relative"),
        ("scale = 1\n", 1, "scale stands outside the tables. Move it to [prior]."),
        ("noise = 1\n", 1, "Move it to [laser] or [sonar]."),
        ("steps = 1\n", 1, "Move it into its table."),
        ("[laser]\n\nnoise = 'low'\n", 3, "[laser] noise = 'low': must be a finite number."),
        ("[laser]\nnoise = true\n", 2, "must be a finite number"),
        ("[laser]\nnoise = nan\n", 2, "must be a finite number"),
        (f"[laser]\nnoise = 1{400 * '0'}\n", 2, "must be a finite number"),
        ("[laser]\nnoise = {a = 1}\n", 2, "must be a finite number"),
        ("[laser]\nnoise = [0.1]\n", 2, "must be a finite number"),
        ("[prior]\nwindow = [0, 0, 1]\n", 2, "must be an array of 4 finite numbers"),
        ("[prior]\nwindow = 7\n", 2, "must be an array of 4 finite numbers"),
        ("[prior]\nwindow = [0, 0, 1, -1]\n", 2, "needs X0 < X1 and Y0 < Y1"),
        ("[prior]\nscale = 0\n", 2, "[prior] scale 0.0: must be a finite number above 0"),
        ("[laser]\nmax_range = -1\nnoise = 1\n", 2, "[laser] max_range -1.0: must be a positive number"),
        ("[sonar]\nnoise = 1\nshort_length = 0\n", 3, "[sonar] short_length 0.0: must be a positive number"),
        ("sonar.cone = 4\n", 1, "[sonar] cone 4.0: must lie between 0 and pi"),
        ("[sonar]\nuniform_probability = 0.6\nshort_probability = 0.6\n", 1, "short_probability + uniform_probability"),
        ("[points]\nkind = 1\n", 2, "[points] kind = 1: must be 'gaussian' or 'binary'."),
        ("[points]\nkind = 'normal'\n", 2, "[points] kind = 'normal': must be 'gaussian' or 'binary'."),
        ("[points]\nsigma = -1\n", 2, "[points] sigma -1.0: must be a positive number"),
        ("[points]\nmean_black = 3\nmean_white = 3\n", 1, "mean_black and mean_white are both 3.0"),
        ("[points]\nflip_probability = 0.5\n", 2, "[points] flip_probability 0.5: must lie in (0, 0.5)"),
        ("[thinning]\nbeam_density = -1\n", 2, "[thinning] beam_density -1.0: must be a number of beams"),
        ("[sonar\n", 1, "not valid TOML"),
        ("[sonar]\ncone = 1\ncone = 2\n", 3, "not valid TOML"),
    ],
)  # fmt: skip
def test_what_cannot_be_used_is_named_with_its_line(file: Path, text: str, line: int, words: str) -> None:
    file.write_text(text)
    with pytest.raises(ConfigError) as caught:
        read_settings(file)
    message = str(caught.value)
    assert message.startswith(f"{file}:{line}: "), message
    assert words in message
    assert "\n" not in message


def test_files_that_are_no_text(file: Path, tmp_path: Path) -> None:
    file.write_bytes(b"[prior]\n\xff\xfe")
    with pytest.raises(ConfigError, match="not UTF-8"):
        read_settings(file)
    for missing in (tmp_path / "absent.toml", tmp_path):
        with pytest.raises(InputError, match=missing.name):
            read_settings(missing)


numbers = st.floats(1e-9, 0.4, exclude_min=True)


@given(scale=numbers, noise=numbers, cone=numbers, bias=st.floats(-1e6, 1e6))
def test_what_is_written_is_read_to_the_last_bit(
    tmp_path_factory: pytest.TempPathFactory, scale: float, noise: float, cone: float, bias: float
) -> None:
    tables = {
        "prior": {"scale": scale, "window": (-1.0, 0.0, scale, 1.0)},
        "laser": {"noise": noise},
        "sonar": {"cone": cone, "corner_bias": bias},
        "points": {"kind": "gaussian", "mean_black": 1.0 + scale},
    }
    file = tmp_path_factory.getbasetemp() / "settings.toml"
    write_settings(file, tables)
    assert read_settings(file) == tables


def test_comments_stand_where_they_belong(file: Path) -> None:
    tables = {"prior": {"scale": 0.1}, "sonar": {"noise": 0.05, "surface_oblique": 16}}
    write_settings(file, tables, {"": "Two\n\nlines", "sonar": "A ring", "sonar.noise": "metres"})
    assert file.read_text() == (
        "# Two\n#\n# lines\n\n[prior]\nscale = 0.1\n\n# A ring\n[sonar]\nnoise = 0.05            # metres\n"
        "surface_oblique = 16.0\n"
    )
    assert settings_text({}) == ""
    assert tomllib.loads(file.read_text())["sonar"]["surface_oblique"] == 16.0


def test_nothing_is_written_that_would_not_be_read(file: Path) -> None:
    for tables in ({"prior": {"scale": -1.0}}, {"priory": {}}, {"laser": {"noise": float("inf")}}):
        with pytest.raises(ConfigError, match=file.name):
            write_settings(file, tables)
    assert not file.exists()
