"""Settings of both tools: a tree of pydantic models, from TOML over presets, under ``--set`` and flags."""

from __future__ import annotations

import difflib
import importlib.resources
import json
import os
import re
import tomllib
from collections.abc import Collection, Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import Any, ClassVar, Generic, Literal, NamedTuple, Self, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator
from pydantic_core import ErrorDetails

from prf.shell.cli.files import STREAM, open_input
from prf.shell.errors import ArgumentError, ConfigError, UsageError

PRESET = "preset"
"""The one key outside the tables: a name or several, whose values the file is laid over."""

BOUND_WORDS = {
    "greater_than": "must be above {gt:g}",
    "greater_than_equal": "must be at least {ge:g}",
    "less_than": "must be below {lt:g}",
    "less_than_equal": "must be at most {le:g}",
}
"""What is said of a number out of bounds, by pydantic's name of the error."""
NOTHING: Mapping[str, Any] = MappingProxyType({})
DEFAULT = "default"
Values = dict[str, dict[str, Any]]
"""Table to key to value."""
Layer = tuple[str, Values]
"""What messages call it, and its values; the name may have ``{table}`` and ``{key}`` in it."""


class SettingError(ValueError):
    """Values of a table that cannot be used together: the keys whose values these are, and why."""

    def __init__(self, words: str, *keys: str) -> None:
        super().__init__(words)
        self.keys = keys


class Table(BaseModel):
    """A table of a settings file, and the object that the library takes; its docstring is its heading.

    Made by keywords in Python, it raises ArgumentError with the name of the keyword that cannot be used.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    def __init__(self, *args: Any, **values: Any) -> None:
        values |= _named(type(self), args, values)
        try:
            self.__pydantic_validator__.validate_json(_json(values), strict=True, self_instance=self)
        except ValidationError as error:
            first = error.errors()[0]
            given = {name: name for name in values}
            raise ArgumentError(_refusal(type(self), first, first["loc"], given, "")) from None

    __init__.__pydantic_base_init__ = True  # type: ignore[attr-defined]  # tables in a tree are validated without it

    @classmethod
    def __pydantic_init_subclass__(cls, **kwargs: Any) -> None:
        """List the fields in the docstring, with their units and meanings."""
        super().__pydantic_init_subclass__(**kwargs)
        rows = []
        for name, field in cls.model_fields.items():
            unit = note_of(cls, name, "unit")
            rows.append(f"    {name} : {f'[{unit}] ' if unit else ''}{field.description}\n")
        cls.__doc__ = f"{cls.__doc__}\n\n    Parameters\n    ----------\n{''.join(rows)}"

    def check(self) -> None:
        """Raise SettingError where the values together make no model."""

    def replace(self, **changes: Any) -> Self:
        """Return the table with other values; ArgumentError names one that cannot be used."""
        return type(self)(**{**dict(self), **changes})

    @model_validator(mode="after")
    def _checked(self) -> Self:
        self.check()
        return self


def _named(table: type[Table], args: tuple[Any, ...], values: Mapping[str, Any]) -> dict[str, Any]:
    """Return values that are given by place, by the names of their fields."""
    names = list(table.model_fields)
    if len(args) > len(names):
        raise ArgumentError(f"{table.__name__}: takes {len(names)} values, but {len(args)} are given.")
    found = dict(zip(names, args, strict=False))
    for name in found.keys() & values.keys():
        raise ArgumentError(f"{name}: given twice, by place and by name.")
    return found


class Tree(BaseModel):
    """All settings of a tool, a field a table."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    PACKAGE: ClassVar[str]  # its files ``presets/NAME.toml`` are the presets

    @classmethod
    def flag(cls, place: str) -> str:
        """Return the flag that sets ``TABLE.KEY``."""
        return "--" + place.partition(".")[2].replace("_", "-")

    @classmethod
    def tables(cls) -> dict[str, type[Table]]:
        """Return the tables by name."""
        found = {name: field.annotation for name, field in cls.model_fields.items()}
        return {name: table for name, table in found.items() if isinstance(table, type) and issubclass(table, Table)}

    def get(self, key: str) -> Any:
        """Return the value of ``TABLE.KEY``."""
        table, name = key.split(".")
        return getattr(getattr(self, table), name)


T = TypeVar("T", bound=Tree)


class Loaded(NamedTuple, Generic[T]):
    """Settings, ``TABLE.KEY`` to what has set it (``--noise``, ``site.toml: [laser] noise``), and their file."""

    settings: T
    sources: dict[str, str]
    file: str | None = None


def key(default: Any, unit: str, meaning: str, flag: str = "", unset: str = "", **constraints: Any) -> Any:
    """Return the pydantic field of a key.

    `unit`: empty for a plain number. `meaning`: in words for a help text, without capital and full stop.
    `flag`: the metavar of its flag; empty: it has none, and is set by files and --set alone. `unset`: what applies
    where its default is None, for the help text. `constraints`: those of pydantic, such as ``gt=0``.
    """
    extra: dict[str, Any] = {"unit": unit, "flag": flag, "unset": unset}
    return Field(default, description=meaning, json_schema_extra=extra, **constraints)


def note_of(table: type[Table], name: str, what: Literal["unit", "flag", "unset"]) -> str:
    """Return what :func:`key` was given for a key of a table."""
    extra = table.model_fields[name].json_schema_extra
    return str(extra[what]) if isinstance(extra, dict) else ""


def load(
    tree: type[T],
    path: str | os.PathLike[str] | None = None,
    presets: Sequence[str] = (),
    assignments: Sequence[str] = (),
    flags: Mapping[str, Any] = NOTHING,
    defaults: Mapping[str, Any] = NOTHING,
    read: Collection[str] | None = None,
) -> Loaded[T]:
    """Return settings: flags over assignments over a file over presets over defaults.

    `path`: a file of TOML; ``-`` is standard input. `presets`: names that replace those in the file. `assignments`:
    ``TABLE.KEY=VALUE``; VALUE as in TOML, where a word needs no quotes. `flags`: ``TABLE.KEY`` to value; None: not
    given. `defaults`: ``TABLE.KEY`` to a value that replaces the tree's default. `read`: each a ``TABLE`` or
    ``TABLE.KEY``; an assignment to another is refused (UsageError), while a file may hold all, which then has no
    effect. ConfigError names what cannot be used.
    """
    own = {} if path is None else _read_toml(path)
    name = "standard input" if path is not None and os.fspath(path) == STREAM else path
    given, where = own.pop(PRESET, ()), f"{name}: preset"
    if presets:
        given, where = presets, "--preset"
    layers = _preset_layers(tree, [given] if isinstance(given, str) else given, where)
    layers.append((f"{name}: [{{table}}] {{key}}", own))
    layers += [("--set {table}.{key}", _assigned(tree, text, read)) for text in assignments]
    layers += [(tree.flag(place), _nested(place, value)) for place, value in flags.items() if value is not None]
    found = _merged(tree, [(DEFAULT, _nested(*each)) for each in defaults.items()] + layers)
    restricted = found if read is None else _restricted(tree, *found, read, defaults)
    return Loaded(*restricted, None if path is None else os.fspath(path))


def _restricted(
    tree: type[T], settings: T, sources: dict[str, str], read: Collection[str], defaults: Mapping[str, Any]
) -> tuple[T, dict[str, str]]:
    """Return settings without the values of keys that are not read."""
    kept = {place: each for place, each in sources.items() if place in places_of(tree, read)}
    values: Values = {}
    for place in (*defaults, *kept):
        table, name = place.split(".")
        values.setdefault(table, {})[name] = settings.get(place)
    return build(tree, values, kept), kept


def load_options(
    tree: type[T], options: Mapping[str, Any], read: Collection[str], defaults: Mapping[str, Any] = NOTHING
) -> Loaded[T]:
    """Return what the options of a verb ask for that reads these tables and keys (:func:`load`).

    `options`: ``config``, ``preset``, ``assignments``, and values by the names of their flags; the rest is passed over.
    """
    names = {place: flag_name(tree, place) for place in places_of(tree, read)}
    flags = {place: options[name] for place, name in names.items() if name in options}
    path, presets, assignments = (options.get(name) for name in ("config", "preset", "assignments"))
    return load(tree, path, presets or (), assignments or (), flags, defaults, read)


def places_of(tree: type[Tree], read: Iterable[str]) -> list[str]:
    """Return every ``TABLE.KEY`` among tables and keys."""
    tables = tree.tables()
    found = [[each] if "." in each else [f"{each}.{name}" for name in tables[each].model_fields] for each in read]
    return [place for places in found for place in places]


def flag_name(tree: type[Tree], place: str) -> str:
    """Return the name of the parameter of a verb that the flag of ``TABLE.KEY`` fills."""
    return tree.flag(place).removeprefix("--").replace("-", "_")


def _preset_layers(tree: type[T], names: Any, where: str) -> list[Layer]:
    """Return the values of presets, of which no two may set the same table."""
    if not isinstance(names, list | tuple) or not all(isinstance(name, str) for name in names):
        raise ConfigError(f"{where} = {names!r}: must be the name of a preset, or an array of names.")
    layers: list[Layer] = []
    owner: dict[str, str] = {}
    for name in names:
        values = read_preset(tree, name, where)
        for table in values:
            if table in owner:
                raise ConfigError(f"{where}: presets {owner[table]} and {name} both set [{table}]. Choose one of them.")
            owner[table] = name
        layers.append((f"preset {name}: [{{table}}] {{key}}", values))
    return layers


def read_preset(tree: type[Tree], name: str, where: str = "--preset") -> Values:
    """Return the values of a preset; an unknown name raises ConfigError, whose message begins with `where`."""
    known = preset_names(tree)
    if name not in known:
        raise ConfigError(f"{where}: unknown preset {name!r}. {_instead(name, known)}")
    return tomllib.loads(preset_text(tree, name))


def preset_names(tree: type[Tree]) -> list[str]:
    """Return the names of all presets, sorted."""
    files = (importlib.resources.files(tree.PACKAGE) / "presets").iterdir()
    return sorted(file.name.removesuffix(".toml") for file in files if file.name.endswith(".toml"))


def preset_text(tree: type[Tree], name: str) -> str:
    """Return the file of a preset, with the source of every value in its comments."""
    return (importlib.resources.files(tree.PACKAGE) / "presets" / f"{name}.toml").read_text(encoding="utf-8")


def _read_toml(path: str | os.PathLike[str]) -> dict[str, Any]:
    with open_input(path) as stream:
        data = stream.read()
    try:
        return tomllib.loads(data.decode("utf-8-sig"))
    except (ValueError, RecursionError) as error:
        raise ConfigError(f"{os.fspath(path)}: not valid TOML ({error}).") from None


def _assigned(tree: type[Tree], text: str, read: Collection[str] | None) -> Values:
    place, equals, value = (part.strip() for part in text.partition("="))
    if not equals or not re.fullmatch(r"\w+\.\w+", place):
        raise UsageError(f"--set {text}: give TABLE.KEY=VALUE, as in --set prior.scale=0.2.")
    table, _, name = place.partition(".")
    is_known = table not in tree.tables() or name in tree.tables()[table].model_fields
    if read is not None and is_known and not {table, place} & set(read):
        raise UsageError(f"--set {place}: not read here. Set a key of {', '.join(read)}.")
    try:
        return _nested(place, tomllib.loads(f"value = {value}")["value"])
    except tomllib.TOMLDecodeError:
        return _nested(place, value)


def _nested(place: str, value: Any) -> Values:
    table, name = place.split(".")
    return {table: {name: value}}


def _merged(tree: type[T], layers: Iterable[Layer]) -> tuple[T, dict[str, str]]:
    """Return settings of layers, the later the stronger, and what has set each value other than a default."""
    merged: Values = {}
    sources: dict[str, str] = {}
    for source, tables in layers:
        for table, values in tables.items():
            if not isinstance(values, dict):
                place = source.partition(": [")[0]
                raise ConfigError(f"{place}: {table} is outside the tables. {_home(tree, table)}")
            merged.setdefault(table, {}).update(values)
            sources |= {f"{table}.{name}": source.format(table=table, key=name) for name in values}
            sources.setdefault(table, source.partition(": [")[0])
    settings = build(tree, merged, sources)
    return settings, {place: each for place, each in sources.items() if "." in place and each != DEFAULT}


def build(
    tree: type[T], values: Values, sources: Mapping[str, str], kind: type[ConfigError | ArgumentError] = ConfigError
) -> T:
    """Return settings with these values; an error of this kind names one that cannot be used as `sources` do."""
    try:
        return tree.model_validate_json(_json(values), strict=True)
    except ValidationError as error:
        raise kind(_message(tree, error.errors()[0], sources)) from None


def _json(values: Mapping[str, Any]) -> str:
    """Return values as JSON: arrays may become tuples there, and no word becomes a number."""
    return json.dumps(values, default=_plain)


def _plain(value: Any) -> Any:
    """Return a number of numpy, a date or the like as JSON can have it."""
    return value.tolist() if hasattr(value, "tolist") else str(value)


def _home(tree: type[Tree], name: str) -> str:
    if name in tree.tables():
        return f"Write [{name}] once, and its keys below."
    homes = [f"[{table}]" for table, model in tree.tables().items() if name in model.model_fields]
    return f"Move it to {' or '.join(homes)}." if homes else _instead(name, [PRESET, *tree.tables()])


def _message(tree: type[Tree], error: ErrorDetails, sources: Mapping[str, str]) -> str:
    """Return one line for an error of pydantic: where, what, and what may have been meant."""
    table, rest = str(error["loc"][0]), error["loc"][1:]
    if table not in tree.tables():
        return f"{sources[table]}: unknown table [{table}]. {_instead(table, tree.tables())}"
    given = {place.partition(".")[2]: each for place, each in sources.items() if place.startswith(f"{table}.")}
    return _refusal(tree.tables()[table], error, rest, given, f"[{table}] ")


def _refusal(
    table: type[Table], error: ErrorDetails, loc: tuple[int | str, ...], given: Mapping[str, str], home: str
) -> str:
    """Return one line for an error in a table.

    `loc`: where in it. `given`: keys that were given, to what messages call them. `home`: before the names of others.
    """
    cause = error.get("ctx", {}).get("error")
    if isinstance(cause, SettingError):
        name = next((key for key in cause.keys if key in given), cause.keys[0])
        return f"{given.get(name, home + name)}: {cause}."
    name = str(loc[0])
    place = given.get(name, home + name)
    if error["type"] == "extra_forbidden":
        return f"{place}: unknown key. {_instead(name, table.model_fields)}"
    words = error["msg"].removeprefix("Value error, ").replace("Input should be", "must be")
    words = words.replace("Field required", "has too few values")
    if error["type"] in BOUND_WORDS:
        unit = note_of(table, name, "unit")
        words = BOUND_WORDS[error["type"]].format(**error["ctx"]) + (f", in {unit}" if unit else "")
    return f"{place} = {toml_of(error['input'])}: {words}."


def _instead(name: str, known: Iterable[str]) -> str:
    """Return what may have been meant by a name that is not in `known`."""
    names = list(known)
    close = difflib.get_close_matches(name.replace("-", "_").lower(), names, n=1)
    close = close or difflib.get_close_matches(name.lower(), names, n=1)
    return f"Did you mean {close[0]}?" if close else f"Known are {', '.join(names)}."


def toml_of(value: Any) -> str:
    """Return a value as TOML has it."""
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(toml_of, value))}]"
    return repr(value) if isinstance(value, float) else json.dumps(value, ensure_ascii=False, default=str)
