"""What a settings file and presets come to: the file over the presets, and where each value was said."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any, NamedTuple

from prf.shell.configuration.file import read_settings
from prf.shell.configuration.presets import chosen_presets, read_preset
from prf.shell.configuration.schema import Schema


class Settings(NamedTuple):
    """Values of some keys, and where each was said.

    Attributes
    ----------
    tables : dict of str to dict
        Table to key to value.
    places : dict of str to dict
        Table to key to the place, for messages and manifests: ``site.toml: [laser] noise``,
        ``preset sick-lms200: [laser] noise``.
    presets : tuple of str
        Names of the presets, in the order given.
    """

    tables: dict[str, dict[str, Any]]
    places: dict[str, dict[str, str]]
    presets: tuple[str, ...] = ()


def settings_from(path: str | os.PathLike[str] | None, presets: Sequence[str], schema: Schema) -> Settings:
    """Return what a settings file says, and beneath it what presets say.

    Parameters
    ----------
    path : path or None
        A settings file.
    presets : sequence of str
        Names that take the place of those that the file has under ``preset``, unless there are none.
    schema : Schema

    Raises
    ------
    InputError, ConfigError
        As :func:`prf.shell.configuration.read_settings`; and for names of presets that cannot be used.
    """
    own, named = ({}, ()) if path is None else read_settings(path, schema)
    chosen = chosen_presets(tuple(presets), schema, "--preset") or named
    layers = [(f"preset {name}", read_preset(name, schema).tables) for name in chosen]
    tables: dict[str, dict[str, Any]] = {}
    places: dict[str, dict[str, str]] = {}
    for source, content in [*layers, (os.fspath(path) if path is not None else "", own)]:
        for table, values in content.items():
            tables.setdefault(table, {}).update(values)
            places.setdefault(table, {}).update({key: f"{source}: [{table}] {key}" for key in values})
    return Settings(tables, places, chosen)
