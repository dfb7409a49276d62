"""Settings files of both tools: tables of TOML whose values are checked, over presets (docs/configuration.md)."""

from prf.shell.configuration.file import problems_of, read_settings
from prf.shell.configuration.kinds import Array, Flag, Kind, Number, Whole, Word, Words
from prf.shell.configuration.presets import Preset, preset_names, read_preset
from prf.shell.configuration.schema import Meaning, Place, Schema, Table
from prf.shell.configuration.settings import Settings, settings_from
from prf.shell.configuration.tables import checked_tables, sort_out
from prf.shell.configuration.text import settings_text

__all__ = [
    "Array",
    "Flag",
    "Kind",
    "Meaning",
    "Number",
    "Place",
    "Preset",
    "Schema",
    "Settings",
    "Table",
    "Whole",
    "Word",
    "Words",
    "checked_tables",
    "preset_names",
    "problems_of",
    "read_preset",
    "read_settings",
    "settings_from",
    "settings_text",
    "sort_out",
]
