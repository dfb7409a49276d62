"""The settings file: what is known of prior and sensors, as TOML (docs/configuration.md)."""

from prf.settings_file.read import check_settings, read_settings
from prf.settings_file.tables import TABLES, Tables
from prf.settings_file.words import KEY_WORDS, TABLE_WORDS
from prf.settings_file.write import settings_text, write_settings

__all__ = [
    "KEY_WORDS",
    "TABLES",
    "TABLE_WORDS",
    "Tables",
    "check_settings",
    "read_settings",
    "settings_text",
    "write_settings",
]
