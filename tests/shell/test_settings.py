"""Settings of both tools: what flags, --set, a file and presets make, and one line for what cannot be used."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

import mapq.configuration
from prf.configuration import Configuration
from prf.shell.cli.settings import Tree, load, preset_names, preset_text, read_preset
from prf.shell.cli.settings_file import described_text, settings_text
from prf.shell.errors import ConfigError, InputError, UsageError

TREES: list[type[Tree]] = [Configuration, mapq.configuration.Configuration]
PRESETS = [(tree, name) for tree in TREES for name in preset_names(tree)]


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "site.toml"


def test_flags_win_over_assignments_over_the_file_over_presets(file: Path) -> None:
    file.write_text('preset = "sick-lms200"\n[laser]\nnoise = 0.05\nmiss_probability = 0.1\n[prior]\nscale = 0.2\n')
    found = load(Configuration, file, (), ("laser.noise=0.06", "prior.scale = 0.3"), {"prior.scale": 0.4})
    assert (found.settings.laser.max_range, found.settings.laser.noise) == (80.0, 0.06)
    assert (found.settings.laser.miss_probability, found.settings.prior.scale) == (0.1, 0.4)
    assert found.sources == {
        "laser.max_range": "preset sick-lms200: [laser] max_range",
        "laser.noise": "--set laser.noise",
        "laser.miss_probability": f"{file}: [laser] miss_probability",
        "prior.scale": "--scale",
    }
    other = load(Configuration, file, ("hokuyo-urg-04lx", "pioneer-ring"))
    assert (other.settings.laser.max_range, other.settings.sonar.cone) == (4.0, 0.349)
    assert load(Configuration, defaults={"laser.noise": 0.05}).settings.laser.noise == 0.05


def test_values_of_assignments_are_toml_and_words_need_no_quotes() -> None:
    texts = ("prior.window=[0, 0, 1, 2]", "sampler.temperatures=auto", "readings.scans=5::10", "sampler.chains=2")
    found = load(Configuration, assignments=texts).settings
    assert (found.prior.window, found.sampler.temperatures) == ((0.0, 0.0, 1.0, 2.0), "auto")
    assert (found.readings.scans, found.sampler.chains) == ("5::10", 2)
    with pytest.raises(UsageError, match=r"^--set noise=1: give TABLE\.KEY=VALUE"):
        load(Configuration, assignments=("noise=1",))


@pytest.mark.parametrize(
    "written", ["sonar.cone = 0.4", "sonar = { cone = 0.4 }", '["sonar"]\n"cone" = 0.4', "\ufeff[sonar]\ncone=0.4", ""]
)
def test_toml_has_several_ways_to_write_a_table(file: Path, written: str) -> None:
    file.write_text(written)
    assert load(Configuration, file).settings.sonar.cone == (0.4 if written else 0.349)


def test_an_unusual_combination_is_judged_as_a_whole(file: Path) -> None:
    file.write_text("[laser]\noutlier_probability = 0.99\nmiss_probability = 0\n")
    assert load(Configuration, file).settings.laser.outlier_probability == 0.99


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[prior]\nscael = 1\n", ": [prior] scael: unknown key. Did you mean scale?"),
        ("[laser]\nnoise-relative = 1\n", "Did you mean noise_relative?"),
        ("[laser]\nzzz = 1\n", "Known are max_range, noise, noise_relative"),
        ("\n[sonor]\ncone = 1\n", ": unknown table [sonor]. Did you mean sonar?"),
        ("noise = 1\n", ": noise is outside the tables. Move it to [laser] or [sonar] or [simulate]."),
        ("laser = 1\n", ": laser is outside the tables. Write [laser] once"),
        ("presett = 'x'\n", "Did you mean preset?"),
        ("[laser]\nnoise = 'low'\n", ': [laser] noise = "low": must be a valid number.'),
        ("[laser]\nnoise = true\n", "must be a valid number"),
        ("[laser]\nnoise = nan\n", "must be a finite number"),
        ("[prior]\nwindow = [0, 0, 1]\n", ": [prior] window"),
        ("[prior]\nwindow = [0, 0, 1, -1]\n", "needs X0 < X1 and Y0 < Y1"),
        ("[prior]\nscale = 0\n", ": [prior] scale = 0: must be above 0, in 1/m."),
        ("[laser]\nmax_range = -1\nnoise = 1\n", ": [laser] max_range = -1: must be at least 1e-09, in m."),
        ("[sonar]\nnoise = 1\nshort_length = 0\n", ": [sonar] short_length = 0: must be at least 1e-09, in m."),
        ("sonar.cone = 4\n", ": [sonar] cone = 4: must be below 3.14159, in rad."),
        (
            "[sonar]\nuniform_probability = 0.6\nshort_probability = 0.6\n",
            ": [sonar] short_probability: short and uniform probability must sum to less than 1.",
        ),
        ("[points]\nkind = 'normal'\n", "must be 'gaussian' or 'binary'."),
        ("[points]\nmean_black = 3\nmean_white = 3\n", "are both 3.0"),
        ("[thinning]\nbeam_density = -1\n", ": [thinning] beam_density = -1: must be at least 0, in 1/m²."),
        ("[sampler]\ntemperatures = 3\ntiles = 4\n", ": [sampler] tiles: tempered chains have no tiles"),
        ("[sonar\n", ": not valid TOML"),
        ("preset = 'kinect'\n", ": preset: unknown preset 'kinect'"),
        ("preset = 3\n", "must be the name of a preset"),
        ("preset = ['sick-lms200', 'sick-lms111']\n", "both set [laser]"),
    ],
)
def test_what_cannot_be_used_is_named_with_its_place(file: Path, text: str, words: str) -> None:
    file.write_text(text)
    with pytest.raises(ConfigError) as caught:
        load(Configuration, file)
    message = str(caught.value)
    assert message.startswith(f"{file}: "), message
    assert words in message
    assert "\n" not in message


def test_flags_and_presets_are_named_as_they_are_given() -> None:
    with pytest.raises(ConfigError, match=r"^--noise = -1\.0: must be at least 1e-09, in m\."):
        load(Configuration, flags={"laser.noise": -1.0})
    with pytest.raises(ConfigError, match=r"^--set laser\.noise = \"x\": must be"):
        load(Configuration, assignments=("laser.noise=x",))
    with pytest.raises(ConfigError, match=r"^--preset: unknown preset 'x'"):
        load(Configuration, presets=("x",))


def test_files_that_are_no_text(file: Path, tmp_path: Path) -> None:
    file.write_bytes(b"[prior]\n\xff\xfe")
    with pytest.raises(ConfigError, match="not valid TOML"):
        load(Configuration, file)
    for missing in (tmp_path / "absent.toml", tmp_path):
        with pytest.raises(InputError, match=missing.name):
            load(Configuration, missing)


@pytest.mark.parametrize("tree", TREES)
def test_what_is_described_is_read_back(tree: type[Tree], file: Path) -> None:
    found = load(tree)
    file.write_text(described_text(found, "Two\n\nlines"))
    assert file.read_text().startswith("# Two\n#\n# lines\n\n# ")
    assert load(tree, file).settings == found.settings


numbers = st.floats(1e-9, 0.4, exclude_min=True)


@given(scale=numbers, bias=st.floats(-1e6, 1e6))
def test_numbers_are_read_back_to_the_last_bit(
    tmp_path_factory: pytest.TempPathFactory, scale: float, bias: float
) -> None:
    values: dict[str, Any] = {"prior": {"scale": scale}, "sonar": {"corner_bias": bias}, "points": {"kind": "binary"}}
    file = tmp_path_factory.getbasetemp() / "settings.toml"
    file.write_text(settings_text(values, {}))
    found = load(Configuration, file).settings
    assert (found.prior.scale, found.sonar.corner_bias, found.points.kind) == (scale, bias, "binary")


@pytest.mark.parametrize(("tree", "name"), PRESETS)
def test_every_preset_is_sound_and_names_its_sources(tree: type[Tree], name: str, project_root: Path) -> None:
    assert load(tree, presets=(name,)).sources
    lines = [line for line in preset_text(tree, name).splitlines() if "=" in line.partition("#")[0]]
    assert sum(len(values) for values in read_preset(tree, name).values()) == len(lines)
    comments = " ".join(line.partition("#")[2] for line in lines)
    assert "data sheet: " in comments or "measured: " in comments, "a preset without a source is a guess"
    assert f"`{name}`" in (project_root / "docs" / "configuration.md").read_text()
    same = load(tree, presets=(name,)).settings == tree()
    assert same == (name == "pioneer-ring"), "the ring's are the defaults, which were made for it"


def test_comments_are_where_they_belong() -> None:
    values = {"prior": {"scale": 0.1}, "sonar": {"noise": 0.05, "surface_oblique": 16.0}}
    text = settings_text(values, {"": "Head", "sonar": "A ring", "sonar.noise": "metres"})
    assert text == (
        "# Head\n\n[prior]\nscale = 0.1\n\n"
        "# A ring\n[sonar]\nnoise = 0.05            # metres\nsurface_oblique = 16.0\n"
    )
    assert tomllib.loads(text) == values
