"""Errors that a user can cause, each with the exit code that a script can rely on.

A message is one line: what is wrong, where (``file:line`` or the option), and what to do about it, for instance
``scan.log:118: range -4.2 < 0 (beam 37). Remove the line or raise --skip-scans.``
"""

from __future__ import annotations

import importlib
import os
import shlex
from importlib import metadata
from typing import Any

EXIT_OK = 0
EXIT_INTERNAL = 70
"""``EX_SOFTWARE`` of sysexits.h: the fault is the program's."""
EXIT_BROKEN_PIPE = 141
"""What the shell reports for a program that SIGPIPE ended, as in ``prf query ... | head``."""

DISTRIBUTION = "prf-mapq"

LONGEST_MESSAGE = 4000
"""Characters. A message that quotes a damaged file may be longer; its middle is left out."""


class PrfError(Exception):
    """Root of every error that is reported in one line, without a traceback.

    Line ends become blanks, and what else a terminal would act on is escaped: a file, or its name, may hold it.
    """

    exit_code = EXIT_INTERNAL

    def __init__(self, message: str = "") -> None:
        super().__init__(_one_line(message))


class CheckFailed(PrfError):  # noqa: N818 - a "no" for an answer is not an error
    """A check ran and failed."""

    exit_code = 1


class UsageError(PrfError, ValueError):
    """Options or arguments that do not go together, or a value outside its domain."""

    exit_code = 2


class ArgumentError(UsageError):
    """An argument of a Python call that cannot be used: wrong shape, not finite, of another unit or kind."""


class ConfigError(PrfError, ValueError):
    """A configuration that cannot be used: unknown key, wrong type, value outside its domain."""

    exit_code = 2


class InputError(PrfError):
    """An input that is missing, unreadable or malformed."""

    exit_code = 3


class OutputError(PrfError):
    """An output that cannot be written."""

    exit_code = 4


class OutputExists(OutputError):  # noqa: N818 - reads as what happened
    """An output that exists already, without ``--force``."""


class Interrupted(PrfError):  # noqa: N818 - reads as what happened
    """A run that a signal ended in good order: 2 (SIGINT) gives exit code 130, 15 (SIGTERM) gives 143."""

    def __init__(self, message: str, signal_number: int = 2) -> None:
        super().__init__(message)
        self.exit_code = 128 + signal_number


def system_reason(error: OSError) -> str:
    """Return the system's words for an error, with a small letter first as the rest of our messages have it."""
    words = error.strerror or str(error)
    return words[:1].lower() + words[1:]


def cannot_write(place: str | os.PathLike[str], error: OSError) -> OutputError:
    """Return what to raise when the system refuses that `place` be written."""
    return OutputError(f"{os.fspath(place)}: cannot be written ({system_reason(error)}).")


def require(module: str, extra: str, what: str) -> Any:
    """Return the module, imported by name, or raise UsageError if it is not installed.

    `extra`: of this distribution, which brings it. `what`: needs it, say ``--format netcdf`` or ``map.e57: E57``.
    """
    try:
        return importlib.import_module(module)
    except ImportError as cause:
        raise UsageError(f"{what} needs {module}, which is not installed. {install_hint(extra)}") from cause


def install_hint(extra: str) -> str:
    """Return how to install an extra: in a checkout by its name, elsewhere (from a wheel) by what it consists of."""
    try:
        wanted = metadata.requires(DISTRIBUTION) or []
    except metadata.PackageNotFoundError:  # the tree itself, not installed
        wanted = []
    parts = [shlex.quote(one.partition(";")[0].strip()) for one in wanted if f"extra == '{extra}'" in one]
    return f"In a checkout: pip install '.[{extra}]'" + (f"; elsewhere: pip install {' '.join(parts)}" if parts else "")


def _one_line(message: str) -> str:
    """Return the message as one line of characters that can be shown."""
    if len(message) > LONGEST_MESSAGE:
        message = f"{message[: LONGEST_MESSAGE - 1000]} ... {message[-1000:]}"
    if message.isprintable():
        return message
    return "".join(map(_shown, message))


def _shown(letter: str) -> str:
    if letter.isspace():
        return " "
    return letter if letter.isprintable() else repr(letter)[1:-1]
