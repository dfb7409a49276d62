"""The settings file of `mapq`: segmentation, features and random field, as TOML (docs/configuration.md)."""

from mapq.settings.asked import Asked, ask, defaults, described, feature_settings, segment_settings, train_settings
from mapq.settings.read import check_settings, read_presets, read_settings, settings_from
from mapq.settings.tables import SCHEMA, TABLES
from mapq.settings.words import KEY_WORDS, TABLE_WORDS

__all__ = [
    "KEY_WORDS",
    "SCHEMA",
    "TABLES",
    "TABLE_WORDS",
    "Asked",
    "ask",
    "check_settings",
    "defaults",
    "described",
    "feature_settings",
    "read_presets",
    "read_settings",
    "segment_settings",
    "settings_from",
    "train_settings",
]
