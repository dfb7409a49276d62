"""What a user asks of the science of a run: options of the verb, over a settings file, over defaults."""

from __future__ import annotations

import os
from collections.abc import Collection, Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

from prf.sampler.config import SampleConfig
from prf.settings_file import KEY_WORDS, TABLE_WORDS, TABLES, read_settings

PREFIXES: Mapping[str, str] = MappingProxyType({"sonar": "sonar_", "points": "points_"})
"""What stands before the keys of a table in the fields of a configuration; nothing for other tables."""


class Asked(NamedTuple):
    """Fields of a configuration with the values asked for.

    Attributes
    ----------
    values : dict of str to Any
    places : dict of str to str
        Where each was said, for messages: ``--noise`` or ``site.toml: [laser] noise``.
    """

    values: dict[str, Any]
    places: dict[str, str]


SOURCES: Mapping[str, str] = MappingProxyType({"points": "from the values"})
"""Where the values of a table's keys come from if they are not set and have no default; for other tables the log."""


def source_of(table: str) -> str:
    """Return in words where a key of a table without default comes from."""
    return SOURCES.get(table, "from the log")


def field_of(table: str, key: str) -> str:
    """Return the field of a configuration that a key of a settings file sets."""
    return PREFIXES.get(table, "") + key


def ask(
    options: Mapping[str, Any],
    settings: str | os.PathLike[str] | None = None,
    known: Collection[str] | None = None,
) -> Asked:
    """Return what options and a settings file ask for; options win.

    Parameters
    ----------
    options : mapping of str to Any
        Field to value; None: not given.
    settings : path or None
        A settings file.
    known : collection of str, optional
        The fields of a configuration that takes only some of what a settings file may say; the rest is passed over.

    Raises
    ------
    InputError, ConfigError
        As :func:`prf.settings_file.read_settings`.
    """
    values: dict[str, Any] = {}
    places: dict[str, str] = {}
    for table, content in ({} if settings is None else read_settings(settings)).items():
        for key, value in content.items():
            field = field_of(table, key)
            if known is None or field in known:
                values[field], places[field] = value, f"{settings}: [{table}] {key}"
    for field, value in options.items():
        if value is not None:
            values[field], places[field] = value, "--" + field.replace("_", "-")
    return Asked(values, places)


def settings_of(config: SampleConfig) -> dict[str, dict[str, Any]]:
    """Return the tables of the settings file that says what `config` does; what it leaves to the log is left out."""
    tables = {
        table: {key: getattr(config, field_of(table, key)) for key in content.keys} for table, content in TABLES.items()
    }
    return {
        table: {key: value for key, value in values.items() if value is not None} for table, values in tables.items()
    }


def explain(config: SampleConfig, asked: Asked) -> dict[str, str]:
    """Return the comments for a settings file of `config`: what each key means, and whether `asked` has set it."""
    comments = {"": "Parameters of prior and sensors for prf, SI units. Keys that are left out have their defaults."}
    for table, content in TABLES.items():
        lines = [TABLE_WORDS[table]]
        for key in content.keys:
            words, field = str(KEY_WORDS[f"{table}.{key}"]), field_of(table, key)
            if getattr(config, field) is None:
                lines.append(f"{key}: {words}; {source_of(table)} unless given")
            else:
                comments[f"{table}.{key}"] = f"{words}{' (set here)' if field in asked.values else ''}"
        comments[table] = "\n".join(lines)
    return comments
