"""What goes to which stream: the result to standard output, everything else to standard error.

Library code logs through ``logging.getLogger(__name__)``; the handler that :func:`configure` installs shows it.
"""

from __future__ import annotations

import io
import logging
import os
import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.util import find_spec
from typing import IO, Literal

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


settings = Settings()
"""Of this process; set by :mod:`prf.shell.cli.app`."""


class _Handler(logging.Handler):
    """Writes to the standard error of the moment, so that a progress bar can stay below the messages."""

    def emit(self, record: logging.LogRecord) -> None:
        prefix = f"{record.levelname.lower()}: " if record.levelno >= logging.WARNING else ""
        print(prefix + record.getMessage(), file=sys.stderr)


def reset() -> None:
    """Go back to what holds without flags, as a tool does when it starts."""
    settings.verbosity, settings.color, settings.progress = 0, "auto", True
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
