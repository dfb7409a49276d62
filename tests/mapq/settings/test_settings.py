"""The settings file of mapq: every parameter of its steps is a key, and options win over files over presets."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest

from mapq.crf.train import TrainSettings
from mapq.features.settings import FeatureSettings
from mapq.segmentation import SegmentSettings
from mapq.settings import (
    KEY_WORDS,
    TABLE_WORDS,
    TABLES,
    Asked,
    ask,
    check_settings,
    defaults,
    described,
    feature_settings,
    read_settings,
    segment_settings,
    settings_from,
    train_settings,
)
from mapq.settings.tables import in_fields
from prf.shell.configuration import settings_text
from prf.shell.errors import ConfigError

ALL = """\
[segment]
neighbours = 20
resolution = 0.1
noise = 0.02
max_angle = 12
max_distance = 0.07
max_gap = 0.5
max_variation = 0.2
min_points = 40
min_extent = 0.4
max_tilt = 90
up = [0, 1, 0]

[features]
reading = "literal"
neighbours = 5
watched = 0
radius = 2
tau = 1
eps = 0.02
noise = 0.03
tolerance = 0.1
spacing = 0.2
up = [0, 1, 0]
context = ["rays"]

[crf]
objective = "max-margin"
potential = "linear"
edge_model = "none"
regularisation = 2
coupling_regularisation = 3
class_weight = "none"
folds = 4
max_false_alarms = 0.02
"""


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "site.toml"


def test_every_parameter_is_a_key_and_reaches_its_step(file: Path) -> None:
    """No parameter can be added to a step without a way to set it."""
    file.write_text(ALL)
    assert check_settings(file) == []
    tables = read_settings(file)
    assert {table: set(values) for table, values in tables.items()} == {
        table: set(content.keys) for table, content in TABLES.items()
    }
    assert set(tables["segment"]) == {field.name for field in dataclasses.fields(SegmentSettings)}
    assert set(in_fields(tables["features"])) == {field.name for field in dataclasses.fields(FeatureSettings)}
    made = (
        segment_settings(tables["segment"]),
        feature_settings(tables["features"]),
        train_settings(tables["crf"]),
    )
    for settings, default in zip(made, (SegmentSettings(), FeatureSettings(), TrainSettings()), strict=True):
        for field in dataclasses.fields(settings):
            assert getattr(settings, field.name) != getattr(default, field.name), field.name


def test_the_defaults_are_a_settings_file(file: Path) -> None:
    tables, comments = described(settings_from(None))
    file.write_text(settings_text(tables, comments))
    read = read_settings(file)
    assert read == tables
    assert segment_settings(read["segment"]) == SegmentSettings()
    assert feature_settings(read["features"]) == FeatureSettings()
    assert train_settings(read["crf"]) == TrainSettings()
    for words in KEY_WORDS.values():
        assert str(words) in file.read_text()


def test_every_table_and_key_has_words() -> None:
    assert set(TABLE_WORDS) == set(TABLES)
    assert set(KEY_WORDS) == {f"{table}.{key}" for table, content in TABLES.items() for key in content.keys}
    assert {table: list(values) for table, values in defaults().items()} == {
        table: list(content.keys) for table, content in TABLES.items()
    }


def test_options_win_over_the_file_over_the_preset(file: Path) -> None:
    file.write_text('preset = "ouster-os1-64"\n[segment]\nmax_tilt = 20\nmin_points = 30\n[features]\neps = 0.02\n')
    found = settings_from(file)
    assert ask("segment", {"min_points": 99, "noise": None, "tau": 1.0}, found) == Asked(
        {"noise": 0.03, "max_tilt": 20.0, "min_points": 99},
        {
            "noise": "preset ouster-os1-64: [segment] noise",
            "max_tilt": f"{file}: [segment] max_tilt",
            "min_points": "--min-points",
        },
    )
    features = ask("features", {"reading": "safe"}, found)
    assert features.values == {"eps": 0.02, "tolerance": 0.1, "reading": "safe"}
    assert features.places["reading"] == "--features"
    assert features.by_option
    assert not ask("features", {"min_points": 3}, found).by_option
    assert ask("segment", {}, settings_from(file, ["survey-scanner"])).values["noise"] == 0.005


def test_it_is_shown_what_has_set_a_key(file: Path) -> None:
    file.write_text('preset = "velodyne-vlp16"\n[segment]\nmax_tilt = 20\n')
    tables, comments = described(settings_from(file))
    assert (tables["segment"]["noise"], tables["segment"]["max_tilt"]) == (0.03, 20.0)
    assert comments["segment.noise"].endswith("(preset velodyne-vlp16)")
    assert comments["segment.max_tilt"].endswith("(set here)")
    assert "(" not in comments["segment.min_points"]


@pytest.mark.parametrize(
    ("text", "line", "words"),
    [
        ("[segmnt]\n", 1, "there is no table [segmnt]. Did you mean segment?"),
        ("[segment]\nmax-tilt = 1\n", 2, "Did you mean max_tilt?"),
        ("[segment]\nmin_points = 2.5\n", 2, "min_points = 2.5: must be a whole number."),
        ("[segment]\nneighbours = 2\n", 2, "[segment] neighbours must be from 3 to 64, not 2."),
        ("[segment]\nup = [0, 0, 0]\n", 2, "[segment] up must not be 0 0 0"),
        ("[features]\nradius = -1\n", 2, "[features] radius -1.0 m"),
        ("[features]\ncontext = ['ray']\n", 2, "an array of words from outlines, moments, rays"),
        ("[features]\nreading = 'as printed'\n", 2, "must be 'safe' or 'literal'"),
        ("[crf]\nregularisation = 0\n", 2, "[crf] regularisation 0.0: must be above 0"),
        ("[crf]\nfolds = 1\n", 2, "[crf] folds 1: must be 2 or more"),
        ("[crf]\nmax_false_alarms = 2\n", 2, "must be a share between 0 and 1"),
        ("noise = 1\n", 1, "Move it to [segment] or [features]."),
    ],
)
def test_what_cannot_be_used_is_named_with_its_line(file: Path, text: str, line: int, words: str) -> None:
    file.write_text(text)
    with pytest.raises(ConfigError) as caught:
        read_settings(file)
    assert str(caught.value).startswith(f"{file}:{line}: ")
    assert words in str(caught.value)
    assert check_settings(file) == [str(caught.value)]
