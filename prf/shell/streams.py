"""Results and tables where the output of a verb may be standard output itself."""

from __future__ import annotations

import logging
from collections.abc import Callable

from prf.shell import console
from prf.shell.errors import UsageError
from prf.shell.files import STREAM

logger = logging.getLogger(__name__)


def refuse_json_beside(output: str | None, json: bool) -> None:
    """Raise UsageError if an output and ``--json`` are both asked for on standard output."""
    if json and output == STREAM:
        raise UsageError("--json and -o - both want standard output. Name a file with -o.")


def say_beside(output: str | None) -> Callable[[str], None]:
    """Return what prints lines for a person: the result itself if there is no output, else what sums it up.

    A summary goes to standard output, or to the log where the output itself goes there.
    """
    if output is None:
        return console.emit
    return logger.info if output == STREAM else console.summarize
