"""What a settings file may hold: tables, their keys, what they mean, and where presets are kept."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from prf.shell.configuration.kinds import Kind

Place = Callable[[str, str], str]
"""Takes a table and a key, or "" for the table itself; tells where it stands, for messages."""

PRESET = "preset"
"""The one key outside the tables: a name or several, whose values the file stands on."""


class Meaning(NamedTuple):
    """Unit (empty for a plain number) and meaning of a key."""

    unit: str
    meaning: str

    def __str__(self) -> str:
        """Return both as they stand in a comment."""
        return f"[{self.unit}] {self.meaning}" if self.unit else self.meaning


class Table(NamedTuple):
    """A table of the file.

    Attributes
    ----------
    keys : mapping of str to Kind
    check : callable
        Takes the values of some keys, and raises ConfigError or UsageError where they make no model.
    """

    keys: Mapping[str, Kind]
    check: Callable[[Mapping[str, Any]], None]


class Schema(NamedTuple):
    """The tables of one tool.

    Attributes
    ----------
    tables : mapping of str to Table
    presets : str
        Package whose files ``presets/NAME.toml`` are the presets.
    """

    tables: Mapping[str, Table]
    presets: str
