"""Tables of values against a schema: every key known, every value of its kind, and all together in their ranges.

The models judge the values themselves, so that a file and the options of a verb can never disagree.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from prf.shell.configuration.kinds import instead
from prf.shell.configuration.schema import PRESET, Place, Schema, Table
from prf.shell.errors import ConfigError, UsageError


def checked_tables(content: Mapping[str, Any], place: Place, schema: Schema) -> dict[str, dict[str, Any]]:
    """Return the tables with every value of its kind and in its range.

    Raises
    ------
    ConfigError
        For the first table, key or value that cannot be used; its message begins with what `place` tells.
    """
    tables, problems = sort_out(content, place, schema)
    if problems:
        raise ConfigError(problems[0])
    return tables


def sort_out(content: Mapping[str, Any], place: Place, schema: Schema) -> tuple[dict[str, dict[str, Any]], list[str]]:
    """Return the tables with what is sound in them, and a message for everything that is not."""
    tables: dict[str, dict[str, Any]] = {}
    problems: list[str] = []
    for name, values in content.items():
        try:
            given = _table(name, values, place, schema)
        except ConfigError as error:
            problems.append(str(error))
            continue
        tables[name], found = _sound(name, given, place, schema.tables[name])
        problems += found
    return tables, problems


def _table(name: str, values: Any, place: Place, schema: Schema) -> Mapping[str, Any]:
    if not isinstance(values, Mapping) and name in schema.tables:
        raise ConfigError(f"{place('', name)}: {name} is a table. Write [{name}] once, and its keys below.")
    if not isinstance(values, Mapping):
        homes = [f"[{table}]" for table in schema.tables if name in schema.tables[table].keys]
        to = f"to {' or '.join(homes)}" if homes else "into its table"
        meant = " Did you mean preset?" if difflib.get_close_matches(name, [PRESET]) else ""
        raise ConfigError(f"{place('', name)}: {name} stands outside the tables. Move it {to}.{meant}")
    if name not in schema.tables:
        raise ConfigError(f"{place(name, '')}: there is no table [{name}]. {instead(name, schema.tables)}")
    return values


def _sound(name: str, values: Mapping[str, Any], place: Place, table: Table) -> tuple[dict[str, Any], list[str]]:
    """Return the values of a table, and what is wrong with them; their ranges are judged once all kinds are right."""
    typed: dict[str, Any] = {}
    problems: list[str] = []
    for key, value in values.items():
        try:
            typed[key] = _typed(f"{place(name, key)}: [{name}] {key}", key, value, table)
        except ConfigError as error:
            problems.append(str(error))
    return typed, problems or list(_out_of_range(name, typed, place, table))


def _typed(where: str, key: str, value: Any, table: Table) -> Any:
    if key not in table.keys:
        raise ConfigError(f"{where}: there is no such key. {instead(key, table.keys)}")
    try:
        return table.keys[key].read(value)
    except ValueError as error:
        raise ConfigError(f"{where} = {value!r}: must be {error}.") from None


def _out_of_range(name: str, values: Mapping[str, Any], place: Place, table: Table) -> Iterator[str]:
    """Let the model judge the values together; where it refuses, yield the keys that it refuses alone."""
    refusal = _refusal(values, table)
    if refusal is None:
        return
    alone = {key: _refusal({key: value}, table) for key, value in values.items()}
    refused = {key: words for key, words in alone.items() if words is not None}
    for key, words in refused.items():
        yield f"{place(name, key)}: [{name}] {_named(words, name, (key,))}"
    if not refused:
        yield f"{place(name, '')}: [{name}] {_named(refusal, name, table.keys)}"


def _refusal(values: Mapping[str, Any], table: Table) -> str | None:
    try:
        table.check(values)
    except (ConfigError, UsageError) as error:
        return str(error)
    return None


def _named(words: str, table: str, keys: Iterable[str]) -> str:
    """Return the words of a model's refusal with names as they stand in the file, not as options of a verb."""
    words = words.removeprefix(f"{table}: ").replace(f"{table}-", "")
    for key in keys:
        flag = key.replace("_", "-")
        words = words.replace(f"--{flag}", key).replace(flag, key)
    return words
