"""What a user asks of the science of a run: options of the verb, over a settings file, over presets, over defaults."""

from __future__ import annotations

import os
from collections.abc import Collection, Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple

from prf.sampler.config import SampleConfig
from prf.settings_file import KEY_WORDS, TABLE_WORDS, TABLES, settings_from

PREFIXES: Mapping[str, str] = MappingProxyType({"sonar": "sonar_", "points": "points_"})
"""What stands before the keys of a table in the fields of a configuration; nothing for other tables."""


class Asked(NamedTuple):
    """Fields of a configuration with the values asked for.

    Attributes
    ----------
    values : dict of str to Any
    places : dict of str to str
        Where each was said, for messages and manifests: ``--noise``, ``site.toml: [laser] noise`` or
        ``preset sick-lms200: [laser] noise``.
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
    presets: Sequence[str] = (),
) -> Asked:
    """Return what options, a settings file and presets ask for; options win over the file, the file over presets.

    Parameters
    ----------
    options : mapping of str to Any
        Field to value; None: not given.
    settings : path or None
        A settings file.
    known : collection of str, optional
        The fields of a configuration that takes only some of what a settings file may say; the rest is passed over.
    presets : sequence of str
        Names, in place of those in the settings file.

    Raises
    ------
    InputError, ConfigError
        As :func:`prf.settings_file.settings_from`.
    """
    values: dict[str, Any] = {}
    places: dict[str, str] = {}
    found = settings_from(settings, presets)
    for table, content in found.tables.items():
        for key, value in content.items():
            field = field_of(table, key)
            if known is None or field in known:
                values[field], places[field] = value, found.places[table][key]
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
                comments[f"{table}.{key}"] = words + _set_by(asked.places.get(field))
        comments[table] = "\n".join(lines)
    return comments


def _set_by(place: str | None) -> str:
    """Return in brackets what has set a key, for a comment; nothing for a default."""
    if place is None:
        return ""
    preset = place.partition(":")[0] if place.startswith("preset ") else "set here"
    return f" ({preset})"
