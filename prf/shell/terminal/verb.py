"""What `prf render --terminal` and `mapq render --terminal` do alike."""

from __future__ import annotations

from prf.shell.errors import UsageError


def refuse_files(terminal: bool, width: int | None, output: str | None, force: bool) -> bool:
    """Return whether the picture goes to the terminal.

    Raises
    ------
    UsageError
        If options of both ways are given.
    """
    if terminal and (output is not None or force):
        raise UsageError("--terminal prints the picture on standard output: leave -o and -f out, or redirect it.")
    if width is not None and not terminal:
        raise UsageError("--width goes with --terminal.")
    return terminal
