"""Presets of sensors: settings files that come with a tool, named in a settings file or by ``--preset``."""

from __future__ import annotations

import importlib.resources
import tomllib
from collections.abc import Iterable
from typing import Any, NamedTuple

from prf.shell.configuration.kinds import instead
from prf.shell.configuration.schema import Schema
from prf.shell.configuration.tables import checked_tables
from prf.shell.errors import ConfigError

SUFFIX = ".toml"


class Preset(NamedTuple):
    """A preset.

    Attributes
    ----------
    name : str
    title : str
        What it is of: the first line of its comments.
    tables : dict of str to dict
    text : str
        The file, with the source of every value in its comments.
    """

    name: str
    title: str
    tables: dict[str, dict[str, Any]]
    text: str


def preset_names(schema: Schema) -> list[str]:
    """Return the names of all presets, sorted."""
    folder = importlib.resources.files(schema.presets) / "presets"
    files = folder.iterdir() if folder.is_dir() else ()
    return sorted(file.name.removesuffix(SUFFIX) for file in files if file.name.endswith(SUFFIX))


def read_preset(name: str, schema: Schema, place: str = "--preset") -> Preset:
    """Return a preset.

    Raises
    ------
    ConfigError
        If there is none of this name; the message begins with `place`.
    """
    known = preset_names(schema)
    if name not in known:
        raise ConfigError(f"{place}: there is no preset {name!r}. {instead(name, known)}")
    file = importlib.resources.files(schema.presets) / "presets" / (name + SUFFIX)
    text = file.read_text(encoding="utf-8")
    tables = checked_tables(tomllib.loads(text), lambda table, key: f"preset {name}", schema)
    return Preset(name, text.partition("\n")[0].removeprefix("# "), tables, text)


def chosen_presets(names: Any, schema: Schema, place: str) -> tuple[str, ...]:
    """Return names, one or an array of them, of presets that are there and say nothing about the same table.

    Raises
    ------
    ConfigError
        For the first of them that cannot be used; the message begins with `place`.
    """
    problems = preset_problems(names, schema, place)
    if problems:
        raise ConfigError(problems[0])
    return _as_names(names) or ()


def preset_problems(names: Any, schema: Schema, place: str) -> list[str]:
    """Return what is wrong with the names of presets."""
    chosen = _as_names(names)
    if chosen is None:
        return [f"{place}: preset = {names!r}: must be the name of a preset, or an array of names."]
    problems: list[str] = []
    seen: dict[str, str] = {}
    for name in chosen:
        try:
            tables = read_preset(name, schema, place).tables
        except ConfigError as error:
            problems.append(str(error))
            continue
        problems += [
            f"{place}: presets {seen[table]} and {name} both set [{table}]. Choose one of them."
            for table in tables
            if table in seen
        ]
        seen.update(dict.fromkeys(tables, name))
    return problems


def _as_names(names: Any) -> tuple[str, ...] | None:
    given = (names,) if isinstance(names, str) else names
    if not isinstance(given, Iterable) or isinstance(given, dict) or not all(isinstance(name, str) for name in given):
        return None
    return tuple(given)
