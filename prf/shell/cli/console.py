"""What goes to which stream: the result to standard output, everything else to standard error, progress among it.

Library code logs through ``logging.getLogger(__name__)``; the handler that :func:`configure` installs shows it.
Progress is a bar on a terminal, a plain line every ten seconds elsewhere.
"""

from __future__ import annotations

import io
import logging
import os
import sys
import textwrap
import time
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import timedelta
from importlib.util import find_spec
from typing import IO, TYPE_CHECKING, Any, Literal

if TYPE_CHECKING:
    from rich.progress import Progress

logger = logging.getLogger(__name__)

LOGGERS = ("prf", "mapq")
"""Only our own packages' messages are shown; a library's messages do not concern the user."""


ColorChoice = Literal["auto", "always", "never"]
"""When to use colour."""


@dataclass
class Settings:
    """How much to show and how, by the flags of this command."""

    verbosity: int = 0  # -1 errors only (-q), 0 notes and warnings, 1 details (-v), 2 also tracebacks (-vv)
    color: ColorChoice = "auto"
    progress: bool = True
    command: str = ""  # tool and verb, such as prf report; empty in Python
    begun: float | None = None  # when the command began, by time.monotonic; None in Python


settings = Settings()
"""Of this process; set by :mod:`prf.shell.cli.app`."""


class _Handler(logging.Handler):
    """Writes to the standard error of the moment, so that a progress bar can stay below the messages."""

    def emit(self, record: logging.LogRecord) -> None:
        prefix = f"{record.levelname.lower()}: " if record.levelno >= logging.WARNING else ""
        sys.stderr.write(prefix + record.getMessage() + "\n")  # at once: other threads write too


def reset(command: str = "") -> None:
    """Go back to what holds without flags, as a tool does when it starts; `command`: tool and verb."""
    settings.verbosity, settings.color, settings.progress = 0, "auto", True
    settings.command, settings.begun = command, time.monotonic() if command else None
    if isinstance(sys.stdout, io.TextIOWrapper):  # names of files may hold bytes that are not text
        sys.stdout.reconfigure(errors="backslashreplace")
    configure()


def configure() -> None:
    """Send our loggers to standard error at the level that `settings` asks for."""
    level = {-1: logging.ERROR, 0: logging.INFO}.get(max(settings.verbosity, -1), logging.DEBUG)
    for name in LOGGERS:
        logger = logging.getLogger(name)
        logger.handlers = [_Handler()]
        logger.propagate = False
        logger.setLevel(level)


@contextmanager
def warnings_as_details() -> Iterator[None]:
    """Show what libraries warn of, such as numpy of an overflow, in a line each and with ``-v`` alone."""

    def show(message: Warning | str, category: type[Warning], *_place: object, **_more: object) -> None:
        logger.debug(f"{category.__name__}: {' '.join(str(message).split())}")

    before = warnings.showwarning
    warnings.showwarning = show
    try:
        yield
    finally:
        warnings.showwarning = before


def emit(text: str) -> None:
    """Print the result (or a line of it) on standard output."""
    print(text)


def summarize(text: str) -> None:
    """Print a line for a person on standard output, about a result that is written to a file; not under ``-q``."""
    if settings.verbosity >= 0:
        print(text)


def wrapped_lines(text: str) -> list[str]:
    """Return a long line for a person in lines of at most 120 characters, names of files whole."""
    return textwrap.wrap(text, 120, subsequent_indent="  ", break_long_words=False, break_on_hyphens=False)


def is_verbose() -> bool:
    """Return whether ``-v`` asks for long tables: without it an answer has at most 15 lines."""
    return settings.verbosity >= 1


def say_beside(output: str | None) -> Callable[[str], None]:
    """Return what prints lines for a person: the result itself if there is no output, else a summary of it.

    A summary goes to standard output, or to the log where the output itself goes there.
    """
    if output is None:
        return emit
    return logger.info if output == "-" else summarize


def is_terminal(stream: IO[str]) -> bool:
    """Return whether `stream` is a terminal that a person looks at."""
    return not stream.closed and stream.isatty()


def can_redraw(stream: IO[str]) -> bool:
    """Return whether `stream` is a terminal on which a line can be drawn anew."""
    return is_terminal(stream) and os.environ.get("TERM") != "dumb"


def in_notebook() -> bool:
    """Return whether a notebook shows what is printed, with the widgets by which a bar is drawn anew in it."""
    ipython = sys.modules.get("IPython")
    if ipython is None or type(ipython.get_ipython()).__name__ != "ZMQInteractiveShell":
        return False
    return find_spec("ipywidgets") is not None


def use_color(stream: IO[str]) -> bool:
    """Return whether to write colour to `stream`.

    ``--color always|never`` wins, then ``NO_COLOR``, then ``FORCE_COLOR`` (both count when not empty), then
    ``TERM=dumb``; else colour goes to terminals only.
    """
    if settings.color != "auto":
        return settings.color == "always"
    if os.environ.get("NO_COLOR"):
        return False
    if os.environ.get("FORCE_COLOR"):
        return True
    return can_redraw(stream)


def show_progress() -> bool:
    """Return whether progress may be shown at all (a bar on a terminal, plain lines elsewhere)."""
    return settings.progress and settings.verbosity >= 0


def report_error(message: str) -> None:
    """Print ``error: message`` as exactly one line on standard error, whatever the message holds."""
    line = " ".join(message.split())
    label = "\x1b[1;31merror:\x1b[0m" if use_color(sys.stderr) else "error:"
    print(f"{label} {line}", file=sys.stderr)


PLAIN_INTERVAL = 10.0
"""Seconds between two plain lines: enough for a log file, too few to flood it."""

Report = Callable[..., None]
"""Shows that so much of the total is done, and named values beside it: ``report(completed, steps="150k")``."""

ProgressCallback = Callable[[float, Mapping[str, object]], None]
"""What a Python caller may give instead of True: it gets the share that is done, and what a bar shows beside it."""

_bars: list[Progress] = []
"""The bar on the terminal, if there is one."""


@contextmanager
def progress(total: float | None, description: str) -> Iterator[Report]:
    """Show the progress of the block, in which a report is cheap enough for every poll.

    `total`: what is counted up to (steps, seconds); None when the end is not known. `description`: what is being done,
    e.g. ``sampling``. What is shown as elapsed began with the command, in Python with the block.
    """
    if not show_progress():
        yield report_nothing
    elif not (can_redraw(sys.stderr) or in_notebook()):
        yield _plain(total, description)
    elif _bars:  # one within another gets a line of its own below it
        task = _add_task(_bars[-1], description, total)
        yield _on_bar(_bars[-1], task)
        _bars[-1].remove_task(task)
    else:
        with _make_bar() as bar:
            _bars.append(bar)
            try:
                yield _on_bar(bar, _add_task(bar, description, total))
            finally:
                _bars.remove(bar)


@contextmanager
def reported(wanted: bool | ProgressCallback, total: float, description: str) -> Iterator[Report]:
    """Yield what long work of a Python call reports to; `total` and `description` as in :func:`progress`.

    `wanted`: True: a bar on a terminal or in a notebook, elsewhere a line every ten seconds. False: nothing. A callable
    gets the share in [0, 1] and a mapping of what the bar would show beside it.
    """
    if callable(wanted):
        yield lambda completed, **fields: wanted(completed / total, fields)
    elif not wanted:
        yield report_nothing
    else:
        with progress(total, description) as report:
            yield report


@contextmanager
def progress_if(wanted: bool | ProgressCallback) -> Iterator[None]:
    """Show progress of the block only where a Python caller wants a bar; `wanted` as in :func:`reported`."""
    before, settings.progress = settings.progress, settings.progress and wanted is True
    try:
        yield
    finally:
        settings.progress = before


def report_nothing(completed: float, **fields: object) -> None:
    """Show nothing (``-q``, ``--no-progress``, `progress=False`)."""


def _add_task(bar: Progress, description: str, total: float | None) -> Any:
    task = bar.add_task(description, total=total, fields="")
    if settings.begun is not None:
        next(each for each in bar.tasks if each.id == task).start_time = settings.begun
    return task


def _on_bar(bar: Progress, task: Any) -> Report:
    """Return what moves a bar and shows the fields beside it."""
    return lambda completed, **fields: bar.update(task, completed=completed, fields=_join(fields))


def _plain(total: float | None, description: str) -> Report:
    """Return what prints a line every :data:`PLAIN_INTERVAL` seconds, for pipes and log files."""
    last = time.monotonic()
    start = last if settings.begun is None else settings.begun
    first: tuple[float, float] | None = None

    def report(completed: float, **fields: object) -> None:
        nonlocal last, first
        now = time.monotonic()
        if first is None:  # what came before, such as compiling, does not count for the time left
            first = completed, now
        if now - last < PLAIN_INTERVAL:
            return
        last = now
        done, since = first
        left = (now - since) * ((total or 0.0) - completed) / (completed - done) if completed > done else None
        line = plain_line(description, completed, total, now - start, left, fields)
        sys.stderr.write(line + "\n")

    return report


def _make_bar() -> Progress:
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        Progress,
        TaskProgressColumn,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(bar_width=24),
        TaskProgressColumn(),
        TextColumn("{task.fields[fields]}", markup=False),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
    )
    stderr = Console(stderr=True, no_color=not use_color(sys.stderr), highlight=False)
    return Progress(*columns, console=stderr, redirect_stdout=False, refresh_per_second=4, transient=True)


def plain_line(
    description: str,
    completed: float,
    total: float | None,
    elapsed: float,
    left: float | None,
    fields: dict[str, object],
) -> str:
    """Return one line of progress without control characters; share and time left need a `total`."""
    parts = [description]
    if total:
        parts.append(f"{100 * completed / total:.0f} %")
    parts += [_join(fields)] if fields else []
    parts.append(f"elapsed {_clock(elapsed)}")
    if total and left is not None:
        parts.append(f"left {_clock(max(0.0, left))}")
    return "  ".join(parts)


def _join(fields: dict[str, object]) -> str:
    return "  ".join(f"{name.replace('_', ' ')} {value}" for name, value in fields.items())


def _clock(seconds: float) -> str:
    return str(timedelta(seconds=round(seconds)))
