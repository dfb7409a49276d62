"""The flags that every verb has; typer copies them from a signature, their callbacks fill `console.settings`."""

from __future__ import annotations

from typing import Annotated, Any

import typer

from prf.shell import console
from prf.shell.console import ColorChoice


def _set_verbose(count: int) -> None:
    console.settings.verbosity += count
    console.configure()


def _set_quiet(quiet: bool) -> None:
    console.settings.verbosity -= int(quiet)
    console.configure()


def _set_color(choice: ColorChoice | None) -> None:
    console.settings.color = choice or console.settings.color


def _set_no_progress(no_progress: bool) -> None:
    console.settings.progress = console.settings.progress and not no_progress


_Verbose = Annotated[
    int,
    typer.Option(
        *("--verbose", "-v"),
        count=True,
        callback=_set_verbose,
        expose_value=False,
        show_default=False,
        help="Say more on standard error; -vv also shows tracebacks.",
    ),
]
_Quiet = Annotated[
    bool,
    typer.Option(
        "--quiet",
        "-q",
        callback=_set_quiet,
        expose_value=False,
        help="Say nothing but errors: no summary of a result that is written to a file.",
    ),
]
_Color = Annotated[
    ColorChoice | None,
    typer.Option(
        "--color",
        callback=_set_color,
        expose_value=False,
        metavar="auto|always|never",
        help="Colour on standard error; NO_COLOR and FORCE_COLOR count too.",
    ),
]
_NoProgress = Annotated[
    bool, typer.Option("--no-progress", callback=_set_no_progress, expose_value=False, help="Show no progress.")
]


def _signature(
    verbose: _Verbose = 0, quiet: _Quiet = False, color: _Color = None, no_progress: _NoProgress = False
) -> None:
    """Carry the flags for :func:`common_flags` to read; never called."""


def common_flags() -> list[Any]:
    """Return the parameters ``-v``, ``-q``, ``--color`` and ``--no-progress`` for a command to append to its own."""
    carrier = typer.Typer(add_completion=False, rich_markup_mode=None)
    carrier.command()(_signature)
    return list(typer.main.get_command(carrier).params)
