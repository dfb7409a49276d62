"""Reading a settings file."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any

from prf.settings_file.tables import SCHEMA
from prf.shell import configuration
from prf.shell.configuration import Preset, Settings


def read_settings(path: str | os.PathLike[str]) -> dict[str, dict[str, Any]]:
    """Read a settings file and the presets that it stands on; ``-`` is standard input.

    Parameters
    ----------
    path : path
        A UTF-8 file of TOML 1.0.

    Returns
    -------
    dict of str to dict
        The tables and keys that are set there, no defaults: floats, a tuple of four floats for a window, a word for a
        kind. SI units.

    Raises
    ------
    InputError
        If the file is missing or may not be read.
    ConfigError
        If it is no TOML, or has an unknown preset, table or key, or a value of another type or out of its range.
    """
    return settings_from(path).tables


def settings_from(path: str | os.PathLike[str] | None, presets: Sequence[str] = ()) -> Settings:
    """Return what a settings file sets over presets, and where each value was said.

    Parameters
    ----------
    path : path or None
        A settings file.
    presets : sequence of str
        Names that take the place of those in the file.

    Raises
    ------
    InputError, ConfigError
        As :func:`read_settings`.
    """
    return configuration.settings_from(path, presets, SCHEMA)


def check_settings(path: str | os.PathLike[str]) -> list[str]:
    """Return all that is wrong with a settings file, one line each with file and line.

    Raises
    ------
    InputError
        If the file is missing or may not be read.
    """
    return configuration.problems_of(path, SCHEMA)


def read_presets() -> list[Preset]:
    """Return the presets of sensors that come with the package, by name."""
    return [configuration.read_preset(name, SCHEMA) for name in configuration.preset_names(SCHEMA)]
