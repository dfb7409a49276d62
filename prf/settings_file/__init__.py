"""The settings file: what is known of prior and sensors, as TOML (docs/configuration.md)."""

from prf.settings_file.read import check_settings, read_presets, read_settings, settings_from
from prf.settings_file.tables import SCHEMA, TABLES, Tables
from prf.settings_file.words import KEY_WORDS, TABLE_WORDS
from prf.settings_file.write import write_settings
from prf.shell.configuration import settings_text

__all__ = [
    "KEY_WORDS",
    "SCHEMA",
    "TABLES",
    "TABLE_WORDS",
    "Tables",
    "check_settings",
    "read_presets",
    "read_settings",
    "settings_from",
    "settings_text",
    "write_settings",
]
