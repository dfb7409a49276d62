"""The settings of `mapq`: their defaults are those of the steps, and they reach them."""

from __future__ import annotations

import pytest

from mapq.configuration import Configuration, load_configuration, sources_of
from mapq.crf.settings import TrainSettings
from mapq.features.settings import FeatureSettings
from mapq.segmentation.settings import SegmentSettings
from prf.shell.errors import ConfigError


def test_the_defaults_are_those_of_the_steps() -> None:
    found = Configuration()
    assert found.segment.settings() == SegmentSettings()
    assert found.features.settings() == FeatureSettings()
    assert found.crf.settings() == TrainSettings()


def test_the_values_reach_the_steps() -> None:
    texts = ["segment.neighbours=20", "features.watched=3", "features.context=['rays']", "crf.class_weight=none"]
    loaded = load_configuration({"assignments": texts, "max_tilt": 15.0}, "segment", "features", "crf")
    assert loaded.settings.segment.settings() == SegmentSettings(neighbours=20, max_tilt=15.0)
    assert loaded.settings.features.settings() == FeatureSettings(n_watched=3, context=("rays",))
    assert loaded.settings.crf.settings() == TrainSettings(balanced=False)
    assert sources_of(loaded, "segment") == {"neighbours": "--set segment.neighbours", "max_tilt": "--max-tilt"}


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("segment.max_tilt=95", r"^--set segment\.max_tilt must be from 0 to 90, not 95\.0"),
        ("segment.max_gap=0", r"^--set segment\.max_gap must be above 0"),
        ("features.radius=0", r"^--set features\.radius 0\.0 m"),
        ("features.context=['sky']", "context sky: must be one of"),
        ("crf.regularisation=0", r"^--set crf\.regularisation 0\.0"),
        ("crf.max_false_alarms=2", "less than or equal to 1"),
        ("crf.objective=magic", "'pl' or 'max-margin'"),
    ],
)
def test_values_outside_their_domain_are_named(text: str, words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        load_configuration({"assignments": [text]}, "segment", "features", "crf")
