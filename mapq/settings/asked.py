"""What a user asks of the steps: options of a verb, over a settings file, over presets, over defaults."""

from __future__ import annotations

from collections.abc import Mapping
from enum import Enum
from types import MappingProxyType
from typing import Any, NamedTuple

from mapq.crf.train import TrainSettings
from mapq.features.settings import FeatureSettings
from mapq.segmentation.settings import SegmentSettings
from mapq.settings.tables import FIELDS, TABLES, in_fields
from mapq.settings.words import KEY_WORDS, TABLE_WORDS, source_of
from prf.shell.configuration import Settings

FLAGS: Mapping[str, str] = MappingProxyType({"reading": "--features"})
"""Options that are not named like their key."""


class Asked(NamedTuple):
    """Values of keys of one table, and where each was said.

    Attributes
    ----------
    values : dict of str to Any
    places : dict of str to str
        ``--noise``, ``site.toml: [segment] noise`` or ``preset velodyne-vlp16: [segment] noise``.
    """

    values: dict[str, Any]
    places: dict[str, str]

    @property
    def by_option(self) -> bool:
        """Whether an option of a verb asks for something."""
        return any(place.startswith("--") for place in self.places.values())


def ask(table: str, options: Mapping[str, Any], settings: Settings) -> Asked:
    """Return what options and settings ask of the keys of one table; options win.

    Parameters
    ----------
    table : str
        One of `TABLES`.
    options : mapping of str to Any
        Key to value; None: not given. Keys of other tables are passed over.
    settings : Settings
        As :func:`mapq.settings.settings_from` returns them.
    """
    given = {
        key: value.value if isinstance(value, Enum) else value
        for key, value in options.items()
        if value is not None and key in TABLES[table].keys
    }
    values = {**settings.tables.get(table, {}), **given}
    said = settings.places.get(table, {})
    return Asked(
        values, {key: FLAGS.get(key, "--" + key.replace("_", "-")) if key in given else said[key] for key in values}
    )


def segment_settings(values: Mapping[str, Any]) -> SegmentSettings:
    """Return the settings that values of [segment] make.

    Raises
    ------
    UsageError
        If a value is outside its domain.
    """
    settings = SegmentSettings(**values)
    settings.check()
    return settings


def feature_settings(values: Mapping[str, Any]) -> FeatureSettings:
    """Return the settings that values of [features] make.

    Raises
    ------
    ConfigError
        If a value is outside its domain.
    """
    return FeatureSettings(**in_fields(values))


def train_settings(values: Mapping[str, Any]) -> TrainSettings:
    """Return the settings that values of [crf] make; the share of false alarms is none of training's.

    Raises
    ------
    ConfigError
        If a value is outside its domain.
    """
    TABLES["crf"].check(values)
    fields = {key: value for key, value in values.items() if key not in ("class_weight", "folds", "max_false_alarms")}
    if "class_weight" in values:
        fields["balanced"] = values["class_weight"] == "balanced"
    if "folds" in values:
        fields["n_folds"] = values["folds"]
    return TrainSettings(**fields)


def defaults() -> dict[str, dict[str, Any]]:
    """Return every key with its default; None where it is estimated or left to something else."""
    features, train = FeatureSettings(), TrainSettings()
    crf = {key: getattr(train, key, None) for key in TABLES["crf"].keys}
    crf |= {"class_weight": "balanced" if train.balanced else "none", "folds": train.n_folds}
    return {
        "segment": {key: getattr(SegmentSettings(), key) for key in TABLES["segment"].keys},
        "features": {key: getattr(features, FIELDS.get(key, key)) for key in TABLES["features"].keys},
        "crf": crf,
    }


def described(settings: Settings) -> tuple[dict[str, dict[str, Any]], dict[str, str]]:
    """Return the tables of a settings file with every key that has a value, and its comments: meaning and source."""
    tables: dict[str, dict[str, Any]] = {}
    comments = {"": "Parameters of the steps of mapq. Keys that are left out have their defaults."}
    for table, values in defaults().items():
        lines = [TABLE_WORDS[table]]
        asked = ask(table, {}, settings)
        tables[table] = {key: value for key, value in {**values, **asked.values}.items() if value is not None}
        for key in values:
            words = str(KEY_WORDS[f"{table}.{key}"])
            if key in tables[table]:
                comments[f"{table}.{key}"] = words + _set_by(asked.places.get(key))
            else:
                lines.append(f"{key}: {words}; {source_of(table, key)} unless given")
        comments[table] = "\n".join(lines)
    return tables, comments


def _set_by(place: str | None) -> str:
    if place is None:
        return ""
    preset = place.partition(":")[0] if place.startswith("preset ") else "set here"
    return f" ({preset})"
