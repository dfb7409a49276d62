"""Options of a verb from the tables of settings that it reads: a field is the one place of its name, unit and help."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Mapping, Sequence
from types import NoneType, UnionType
from typing import Annotated, Any, Union, get_args, get_origin

import typer
from typer.models import OptionInfo

from prf.shell.cli.files import STREAM
from prf.shell.cli.options import Assignments, Presets
from prf.shell.cli.settings import NOTHING, Tree, flag_name, load_options, note_of, places_of
from prf.shell.errors import UsageError

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
        return run

    return decorated


def _parameter(option: tuple[str, Any]) -> inspect.Parameter:
    name, annotation = option
    return inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=None, annotation=annotation)


def _refuse_shared_stream(parameters: Sequence[inspect.Parameter], given: Mapping[str, Any]) -> None:
    """Raise UsageError if more than one input is standard input."""
    shared = [each for each in parameters if given[each.name] == STREAM and each.name != "output"]
    if len(shared) > 1:
        streams = (f"{_written(get_args(each.annotation)[-1])} {STREAM}" for each in shared)
        raise UsageError(f"{' '.join(streams)}: standard input can be read once only.")


def _written(option: Any) -> str:
    """Return how a command line has an option or an argument: typer keeps an option's flag as its default."""
    return str(option.default if isinstance(option, OptionInfo) else option.metavar)


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
        shown = note_of(model, name, "unset") if default is None else _words(default)
    bounds = {side: getattr(each, bound) for each in field.metadata for bound, side in BOUNDS if hasattr(each, bound)}
    option = typer.Option(
        f"{flag}/--no-{flag.removeprefix('--')}" if kind is bool else flag,
        metavar=None if kind is bool else _metavar(tree, place),
        help=f"{words[0].upper()}{words[1:]}." + (f"  [{shown}]" if shown else ""),
        **(bounds if kind is int else {}),
    )
    return Annotated[kind | None, option]


def _type(annotation: Any) -> Any:
    """Return the type of a flag's value: numbers, pairs of numbers and switches as they are, all else as text."""
    if get_origin(annotation) in (Union, UnionType):
        kinds = [each for each in get_args(annotation) if each is not NoneType]
        return _type(kinds[0]) if len(kinds) == 1 else str
    if get_origin(annotation) is tuple and Ellipsis not in get_args(annotation):
        return annotation
    return annotation if annotation in (int, float, bool) else str


def _words(value: Any) -> str:
    """Return a default as the command line would have it."""
    if isinstance(value, bool):
        return "on" if value else "off"
    if isinstance(value, tuple):
        return " ".join(map(_words, value))
    return f"{value:g}" if isinstance(value, float) else f"{value:,}" if isinstance(value, int) else str(value)
