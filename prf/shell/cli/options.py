"""Options of verbs: those that mean the same in every verb, declared once, and those made from tables of settings.

A verb writes ``force: Force = False`` and gets flag, help text and metavar from here. These are for verbs to declare:

========== ======================== =====================================================
type       flag                     meaning
========== ======================== =====================================================
Output     ``-o/--output``          where the result goes; ``-`` is standard output
Force      ``-f/--force``           overwrite an output that exists
Seed       ``--seed``               seed of every random number; drawn and printed if absent
Threads    ``--threads``            threads to use, 0 = one a core; never changes a result
Json       ``--json``               the result as one JSON object on standard output
Presets    ``--preset``             presets of sensors, beneath the settings file
Assignments ``--set``                any key of the settings, above the file
========== ======================== =====================================================

``-v/--verbose``, ``-q/--quiet``, ``--color`` and ``--no-progress`` are added to every verb (`app.py`), so
that no verb can forget one; a verb must not declare them. `with_settings` makes the flags of settings: a field of a
table is the one place of its name, unit and help.
"""

from __future__ import annotations

import functools
import inspect
import re
from collections.abc import Callable, Mapping, Sequence
from enum import StrEnum
from operator import mul
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

import typer
from typer.models import OptionInfo

from prf.shell.cli.files import STREAM
from prf.shell.cli.settings import NOTHING, Tree, flag_name, load_options, note_of, places_of
from prf.shell.errors import UsageError

Output = Annotated[
    str | None, typer.Option("--output", "-o", metavar="PATH", help="Where the result goes; - is standard output.")
]
Force = Annotated[bool, typer.Option("--force", "-f", help="Overwrite an output that exists.")]
Seed = Annotated[
    int | None,
    typer.Option("--seed", metavar="INT", min=0, help="Seed of every random number; drawn and printed if absent."),
]
Threads = Annotated[
    int, typer.Option("--threads", metavar="N", min=0, help="Threads, 0 = one a core; never changes a result.")
]
Json = Annotated[bool, typer.Option("--json", help="Print the result as one JSON object.")]
Presets = Annotated[
    list[str] | None,
    typer.Option("--preset", metavar="NAME", help="Preset of a sensor, repeatable; config presets lists them."),
]
Assignments = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="TABLE.KEY=VALUE", help="Any key of the settings, repeatable; config lists them."),
]


SECONDS = {"h": 3600.0, "m": 60.0, "s": 1.0}
"""In each unit of a duration."""
DURATION = re.compile("(?=.)" + "".join(rf"(?:(\d+(?:\.\d+)?){unit})?" for unit in SECONDS))


def parse_duration(text: str) -> float:
    """Return the seconds in ``90``, ``90s``, ``1.5m``, ``2h`` or ``1h30m``; ValueError if it is none of these."""
    words = text.strip().lower()
    found = DURATION.fullmatch(words)
    try:
        seconds = sum(map(mul, map(float, found.groups("0")), SECONDS.values())) if found else float(words)
    except ValueError:
        seconds = -1.0
    if not 0.0 <= seconds < float("inf"):
        raise ValueError(f"{text!r}: must be seconds, or minutes and hours as 5m, 1.5h or 1h30m")
    return seconds


class ConfigAction(StrEnum):
    """What `prf config` and `mapq config` do."""

    show = "show"
    presets = "presets"


ConfigWhat = Annotated[
    ConfigAction,
    typer.Argument(metavar="show|presets", help="Print all settings, or presets of sensors."),
]
ConfigFile = Annotated[
    str | None, typer.Argument(metavar="FILE|NAME", help="Settings file, TOML, - is standard input; or a preset.")
]


Verb = Callable[..., None]
Config = Annotated[
    str | None, typer.Option("--config", metavar="FILE.toml", help="Settings file; flags and --set take precedence.")
]
BOUNDS = (("ge", "min"), ("le", "max"))
"""Bounds of pydantic, and of typer."""
COMMON: Mapping[str, Any] = {"config": Config, "preset": Presets, "assignments": Assignments}


def with_settings(
    tree: type[Tree], *read: str, defaults: Mapping[str, Any] = NOTHING, shown: Mapping[str, str] = NOTHING
) -> Callable[[Verb], Verb]:
    """Return a decorator that gives a verb the options of its settings, and loads them.

    The verb has a keyword parameter ``settings``: a :class:`~prf.shell.cli.settings.Loaded` of the tree. In its place
    the command line has ``--config``, ``--preset``, ``--set`` and the flag of every key read that has one. One input of
    the verb at most may be standard input.

    Parameters
    ----------
    tree : type of Tree
    read : str
        What the verb reads, each a ``TABLE`` or a ``TABLE.KEY``; ``--set`` refuses all else.
    defaults : mapping of ``TABLE.KEY`` to value
        Defaults of this verb that differ from those of the tree.
    shown : mapping of ``TABLE.KEY`` to str
        What help says of a default, where the field's own words do not apply to this verb.
    """
    options = dict(COMMON)
    flagged = [place for place in places_of(tree, read) if _metavar(tree, place)]
    options |= {flag_name(tree, place): _option(tree, place, defaults, shown.get(place)) for place in flagged}

    def decorated(verb: Verb) -> Verb:
        own = inspect.signature(verb, eval_str=True)
        parameters: list[inspect.Parameter] = []
        for each in own.parameters.values():
            parameters += map(_parameter, options.items()) if each.name == "settings" else [each]

        @functools.wraps(verb)
        def run(**given: Any) -> None:
            _refuse_shared_stream(parameters, given)
            chosen = {name: given.pop(name) for name in options}
            verb(**given, settings=load_options(tree, chosen, read, defaults))

        run.__signature__ = own.replace(parameters=parameters)  # type: ignore[attr-defined]
        run.__annotations__ = {}
        run.words = {tree.flag(place): place for place in flagged if _takes_words(tree, place)}  # type: ignore[attr-defined]
        return run

    return decorated


def _parameter(option: tuple[str, Any]) -> inspect.Parameter:
    name, annotation = option
    return inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=None, annotation=annotation)


def _refuse_shared_stream(parameters: Sequence[inspect.Parameter], given: Mapping[str, Any]) -> None:
    """Raise UsageError if more than one input is standard input."""
    inputs = [each for each in parameters if each.name != "output"]
    shared = [each for each in inputs for value in _several(given[each.name]) if value == STREAM]
    if len(shared) > 1:
        streams = (f"{_written(get_args(each.annotation)[-1])} {STREAM}" for each in shared)
        raise UsageError(f"{' '.join(streams)}: standard input can be read once only.")


def _several(value: Any) -> list[Any]:
    """Return the values of an option that may be repeated."""
    return value if isinstance(value, list) else [value]


def _written(option: Any) -> str:
    """Return how a command line has an option or an argument: typer keeps an option's flag as its default."""
    return str(option.default if isinstance(option, OptionInfo) else option.metavar)


def _takes_words(tree: type[Tree], place: str) -> bool:
    """Return whether a key takes a word in place of several numbers."""
    table, name = place.split(".")
    annotation = tree.tables()[table].model_fields[name].annotation
    return get_origin(_type(annotation)) is tuple and any(get_origin(each) is Literal for each in get_args(annotation))


def _metavar(tree: type[Tree], place: str) -> str:
    table, name = place.split(".")
    return note_of(tree.tables()[table], name, "flag")


def _option(tree: type[Tree], place: str, defaults: Mapping[str, Any], shown: str | None) -> Any:
    """Return what typer makes the flag of a key from; not given it is None, and help shows what applies then."""
    table, name = place.split(".")
    model, flag = tree.tables()[table], tree.flag(place)
    field = model.model_fields[name]
    default, words, kind = defaults.get(place, field.default), str(field.description), _type(field.annotation)
    if shown is None:
        shown = note_of(model, name, "unset") if default in (None, ()) else _words(default)
    bounds = {side: getattr(each, bound) for each in field.metadata for bound, side in BOUNDS if hasattr(each, bound)}
    option = typer.Option(
        f"{flag}/--no-{flag.removeprefix('--')}" if kind is bool else flag,
        metavar=None if kind is bool else _metavar(tree, place),
        help=f"{words[0].upper()}{words[1:]}." + (f"  [{shown}]" if shown else ""),
        **(bounds if kind is int else {}),
    )
    return Annotated[kind | None, option]


def _type(annotation: Any) -> Any:
    """Return the type of a flag's value: numbers, pairs of numbers and switches as they are, all else as text.

    A flag of several words is repeated.
    """
    if get_origin(annotation) is tuple and Ellipsis in get_args(annotation):
        return list[str]
    if get_origin(annotation) in (Union, UnionType):
        kinds = [each for each in get_args(annotation) if each is not NoneType and get_origin(each) is not Literal]
        return _type(kinds[0]) if len(kinds) == 1 else str
    if get_origin(annotation) is tuple:
        return annotation
    return annotation if annotation in (int, float, bool) else str


def _words(value: Any) -> str:
    """Return a default as the command line would have it."""
    if isinstance(value, bool):
        return "on" if value else "off"
    if isinstance(value, tuple):
        return " ".join(map(_words, value))
    return f"{value:g}" if isinstance(value, float) else f"{value:,}" if isinstance(value, int) else str(value)
