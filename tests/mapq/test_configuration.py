"""The settings of `mapq`: the tables that its steps take, and what each refuses."""

from __future__ import annotations

from typing import Any

import pytest

from mapq.configuration import (
    Configuration,
    FeatureSettings,
    FindSettings,
    MergeSettings,
    PerturbSettings,
    ReadOptions,
    ScanSettings,
    SegmentSettings,
    Table,
    TileSettings,
    TrainSettings,
    sources_of,
    typed_keys,
)
from prf.shell.cli.settings import load_options
from prf.shell.errors import ArgumentError, ConfigError

READ = ("segment", "features", "crf", "cloud")


def test_the_values_reach_the_tables() -> None:
    texts = ["segment.neighbours=20", "features.watched=3", "features.context=['rays']", "crf.class_weight=none"]
    loaded = load_options(Configuration, {"assignments": texts, "surfaces": ["upright,tilted"], "unit": "ft"}, READ)
    assert loaded.settings.segment == SegmentSettings(neighbours=20, surfaces=("upright", "tilted"))
    assert loaded.settings.features == FeatureSettings(watched=3, context=("rays",))
    assert loaded.settings.crf == TrainSettings(class_weight="none")
    assert loaded.settings.cloud == ReadOptions(unit=0.3048)
    assert sources_of(loaded, "segment") == {"neighbours": "--set segment.neighbours", "surfaces": "--surfaces"}
    assert typed_keys(loaded, "features") == ["watched", "context"]


def test_scans_are_found_and_merged_by_one_table() -> None:
    scans = ScanSettings(poses="a.tum", voxel=0.1)
    assert isinstance(scans, FindSettings)
    assert isinstance(scans, MergeSettings)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("segment.surfaces=round", r"^--set segment\.surfaces = .*must be"),
        ("segment.max_gap=0", r"^--set segment\.max_gap = 0: must be above 0"),
        ("segment.up=[0,0,0]", r"^--set segment\.up = .*must not be 0 0 0"),
        ("features.radius=0", r"^--set features\.radius = 0: must be above 0"),
        ("features.context=['sky']", r"^--set features\.context.*'copies'"),
        ("crf.regularisation=0", r"^--set crf\.regularisation = 0: must be above 0"),
        ("crf.max_false_alarms=2", "must be a share between 0 and 1"),
        ("crf.objective=magic", "'pl' or 'max-margin'"),
        ("cloud.unit=yard", "must be one of m, cm, mm, ft, us-ft"),
    ],
)
def test_values_outside_their_domain_are_named(text: str, words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        load_options(Configuration, {"assignments": [text]}, READ)


@pytest.mark.parametrize(
    ("table", "values", "words"),
    [
        (SegmentSettings, {"surfaces": ()}, "^surfaces = .*at least 1 item"),
        (FeatureSettings, {"up": (0.0, 0.0, 0.0)}, "^up = .*must not be 0 0 0"),
        (FeatureSettings, {"n_neighbours": 4}, "^n_neighbours: unknown key. Did you mean neighbours"),
        (ReadOptions, {"unit": 0.0}, "^unit = 0"),
        (ReadOptions, {"unit": float("nan")}, "^unit"),
        (ReadOptions, {"bin_columns": 5}, "^bin_columns = 5: must be 3 or 4"),
        (MergeSettings, {"min_range": 2.0, "max_range": 1.0}, "^min_range: min_range must be below max_range"),
        (PerturbSettings, {"offset": -1.0}, "^offset = -1"),
        (PerturbSettings, {"drift": (0.0, -1.0)}, "^drift: must be from 0 to 10000"),
        (PerturbSettings, {"missed_loop": (1e5, 0.0)}, "^missed_loop: must be from 0 to 10000"),
        (PerturbSettings, {"plausible_below": 1.0}, "^plausible_below"),
        (TileSettings, {"tile_points": 9}, "^tile_points = 9"),
        (TileSettings, {"workers": 2, "scheduler": "tcp://a:1"}, "^workers: Dask has workers of its own"),
    ],
)
def test_python_is_told_the_keyword(table: type[Table], values: dict[str, Any], words: str) -> None:
    with pytest.raises(ArgumentError, match=words):
        table(**values)
