"""The tables of a settings file: one a model, a key a parameter of it.

Which keys there are follows from the models, and their own checks judge the values, so that a file and the options of a
verb can never disagree about what is allowed.
"""

from __future__ import annotations

import dataclasses
import difflib
import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

from prf.arak import checked_scale
from prf.sensors.laser import LaserModel
from prf.sensors.points import KINDS, PointModel
from prf.sensors.sonar import SonarModel
from prf.shell.errors import ConfigError
from prf.thinning import checked_density
from prf.window import Window

Tables = Mapping[str, Mapping[str, Any]]
"""Table to key to value: a float, a tuple of four for a window, or one of some words. SI units."""

ARRAYS: Mapping[str, int] = MappingProxyType({"window": 4})
"""Keys whose value is an array, and how many numbers it has."""

CHOICES: Mapping[str, tuple[str, ...]] = MappingProxyType({"kind": KINDS})
"""Keys whose value is one of some words; every other value is one number."""

Place = Callable[[str, str], str]
"""Takes a table and a key, or "" for the table itself; tells where it stands, for messages."""


class Table(NamedTuple):
    """A table of the file.

    Attributes
    ----------
    keys : tuple of str
    check : callable
        Takes the values of some keys, and raises ConfigError where they make no model.
    """

    keys: tuple[str, ...]
    check: Callable[[Mapping[str, Any]], None]


def _check_prior(values: Mapping[str, Any]) -> None:
    checked_scale(values.get("scale", 1.0))
    if "window" in values:
        Window.checked(*values["window"])


def _check_laser(values: Mapping[str, Any]) -> None:
    # Without one in the file the maximum range comes from the log.
    LaserModel(**{"max_range": 1.0, **values})


def _check_sonar(values: Mapping[str, Any]) -> None:
    cone = values.get("cone", 1.0)
    if not 0.0 < cone < math.pi:
        raise ConfigError(f"cone {cone}: must lie between 0 and pi radians")
    SonarModel(**{key: value for key, value in values.items() if key != "cone"})


def _check_points(values: Mapping[str, Any]) -> None:
    PointModel(**values)


def _check_thinning(values: Mapping[str, Any]) -> None:
    checked_density(values.get("beam_density", 0.0))


def _fields(model: type) -> tuple[str, ...]:
    return tuple(field.name for field in dataclasses.fields(model))


TABLES: Mapping[str, Table] = MappingProxyType(
    {
        "prior": Table(("scale", "window"), _check_prior),
        "laser": Table(_fields(LaserModel), _check_laser),
        "sonar": Table((*_fields(SonarModel), "cone"), _check_sonar),
        "points": Table(_fields(PointModel), _check_points),
        "thinning": Table(("beam_density",), _check_thinning),
    }
)
"""The tables that a file may have."""


def checked_tables(content: Mapping[str, Any], place: Place) -> dict[str, dict[str, Any]]:
    """Return the tables with every value of its type and in its range.

    Raises
    ------
    ConfigError
        For the first table, key or value that cannot be used; its message begins with what `place` tells.
    """
    tables, problems = sort_out(content, place)
    if problems:
        raise ConfigError(problems[0])
    return tables


def sort_out(content: Mapping[str, Any], place: Place) -> tuple[dict[str, dict[str, Any]], list[str]]:
    """Return the tables with what is sound in them, and a message for everything that is not."""
    tables: dict[str, dict[str, Any]] = {}
    problems: list[str] = []
    for name, values in content.items():
        try:
            table = _table(name, values, place)
        except ConfigError as error:
            problems.append(str(error))
            continue
        tables[name], found = _sound(name, table, place)
        problems += found
    return tables, problems


def _table(name: str, values: Any, place: Place) -> Mapping[str, Any]:
    if not isinstance(values, Mapping):
        homes = [f"[{table}]" for table in TABLES if name in TABLES[table].keys]
        to = f"to {' or '.join(homes)}" if homes else "into its table"
        raise ConfigError(f"{place('', name)}: {name} stands outside the tables. Move it {to}.")
    if name not in TABLES:
        raise ConfigError(f"{place(name, '')}: there is no table [{name}]. {_instead(name, TABLES)}")
    return values


def _sound(table: str, values: Mapping[str, Any], place: Place) -> tuple[dict[str, Any], list[str]]:
    """Return the values of a table, and what is wrong with them; their ranges are judged once all types are right."""
    typed: dict[str, Any] = {}
    problems: list[str] = []
    for key, value in values.items():
        try:
            typed[key] = _typed(table, key, value, place)
        except ConfigError as error:
            problems.append(str(error))
    return typed, problems or list(_out_of_range(table, typed, place))


def _typed(table: str, key: str, value: Any, place: Place) -> float | tuple[float, ...] | str:
    where = f"{place(table, key)}: [{table}] {key}"
    if key not in TABLES[table].keys:
        raise ConfigError(f"{where}: there is no such key. {_instead(key, TABLES[table].keys)}")
    if key in CHOICES:
        if value not in CHOICES[key]:
            raise ConfigError(f"{where} = {value!r}: must be {' or '.join(map(repr, CHOICES[key]))}.")
        return str(value)
    if key not in ARRAYS:
        if not _is_number(value):
            raise ConfigError(f"{where} = {value!r}: must be a finite number.")
        return float(value)
    if not (isinstance(value, list | tuple) and len(value) == ARRAYS[key] and all(map(_is_number, value))):
        raise ConfigError(f"{where} = {value!r}: must be an array of {ARRAYS[key]} finite numbers.")
    return tuple(map(float, value))


def _is_number(value: Any) -> bool:
    try:
        return not isinstance(value, bool) and math.isfinite(value)
    except (TypeError, OverflowError):
        return False


def _out_of_range(table: str, values: Mapping[str, Any], place: Place) -> Iterator[str]:
    """Let the model judge the values together; where it refuses, yield the keys that it refuses alone."""
    refusal = _refusal(table, values)
    if refusal is None:
        return
    alone = {key: _refusal(table, {key: value}) for key, value in values.items()}
    refused = {key: words for key, words in alone.items() if words is not None}
    for key, words in refused.items():
        yield f"{place(table, key)}: [{table}] {_named(words, table, (key,))}"
    if not refused:
        yield f"{place(table, '')}: [{table}] {_named(refusal, table, TABLES[table].keys)}"


def _refusal(table: str, values: Mapping[str, Any]) -> str | None:
    try:
        TABLES[table].check(values)
    except ConfigError as error:
        return str(error)
    return None


def _named(words: str, table: str, keys: Iterable[str]) -> str:
    """Return the words of a model's refusal with names as they stand in the file, not as options of a verb."""
    words = words.replace(f"{table}-", "")
    for key in keys:
        words = words.replace(key.replace("_", "-"), key)
    return words


def _instead(name: str, known: Iterable[str]) -> str:
    """Return what may have been meant by a name that is none of `known`."""
    close = difflib.get_close_matches(name.replace("-", "_").lower(), known, n=1)
    return f"Did you mean {close[0]}?" if close else f"Known are {', '.join(known)}."
