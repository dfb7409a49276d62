"""Reading a settings file: TOML, with the line of everything that is said of it."""

from __future__ import annotations

import os
import re
import tomllib
from collections.abc import Iterator
from typing import Any

from prf.shell.configuration.presets import chosen_presets, preset_problems
from prf.shell.configuration.schema import PRESET, Place, Schema
from prf.shell.configuration.tables import checked_tables, sort_out
from prf.shell.errors import ConfigError
from prf.shell.files import STREAM, open_input

Tables = dict[str, dict[str, Any]]


def read_settings(path: str | os.PathLike[str], schema: Schema) -> tuple[Tables, tuple[str, ...]]:
    """Read a settings file; ``-`` is standard input.

    Parameters
    ----------
    path : path
        A UTF-8 file of TOML 1.0.
    schema : Schema

    Returns
    -------
    tables : dict of str to dict
        The tables and keys that the file has itself, no defaults.
    presets : tuple of str
        The names under ``preset``, whose values the file stands on.

    Raises
    ------
    InputError
        If the file is missing or may not be read.
    ConfigError
        If it is no TOML, or has an unknown preset, table or key, or a value of another type or out of its range.
    """
    content, place = _load(path)
    presets = chosen_presets(content.pop(PRESET, ()), schema, place("", PRESET))
    return checked_tables(content, place, schema), presets


def problems_of(path: str | os.PathLike[str], schema: Schema) -> list[str]:
    """Return all that is wrong with a settings file, one line each with file and line.

    Raises
    ------
    InputError
        If the file is missing or may not be read.
    """
    try:
        content, place = _load(path)
    except ConfigError as error:
        return [str(error)]
    names = content.pop(PRESET, ())
    return preset_problems(names, schema, place("", PRESET)) + sort_out(content, place, schema)[1]


def _load(path: str | os.PathLike[str]) -> tuple[dict[str, Any], Place]:
    """Return what the TOML says, and where it says it."""
    with open_input(path) as stream:
        data = stream.read()
    source = "standard input" if os.fspath(path) == STREAM else os.fspath(path)
    try:
        text = data.decode("utf-8-sig")
        content = tomllib.loads(text)
    except UnicodeDecodeError as error:
        raise ConfigError(f"{source}: not UTF-8 (byte {error.start}). A settings file is TOML text.") from None
    except (tomllib.TOMLDecodeError, RecursionError, ValueError) as error:
        raise ConfigError(_not_toml(source, str(error))) from None
    return content, lambda table, key: source + _line_of(text, table, key)


def _not_toml(source: str, words: str) -> str:
    """Return the message for a text that is no TOML, with the line in front where the parser tells it."""
    found = re.search(r" \(at line (\d+), column (\d+)\)$", words)
    if found is None:
        return f"{source}: not valid TOML ({words})."
    return f"{source}:{found[1]}: not valid TOML ({words[: found.start()]}, column {found[2]})."


def _line_of(text: str, table: str, key: str) -> str:
    """Return ``:LINE`` of a key, or of a table if `key` is empty; of a table written in one line, that line."""
    wanted = ({(table, key), ("", f"{table}.{key}")}, {(table or key, ""), ("", table)})
    for names in wanted:
        for number, found in _names(text):
            if found in names:
                return f":{number}"
    return ""


def _names(text: str) -> Iterator[tuple[int, tuple[str, str]]]:
    """Yield the line, from 1, of every ``[table]`` and every ``key =`` with the pair of table and key that it names."""
    table = ""
    for number, line in enumerate(text.splitlines(), start=1):
        if head := re.match(r"\s*\[\[?\s*([^\[\]]+?)\s*\]", line):
            table = head[1].strip("\"'")
            yield number, (table, "")
        elif name := re.match(r"\s*([\w.\"'-]+?)\s*=", line):
            yield number, (table, name[1].strip("\"'"))
