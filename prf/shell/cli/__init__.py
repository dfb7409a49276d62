"""The command line of both tools: streams, flags, files, errors, signals.

Here is what Ctrl-C and SIGTERM do while a tool starts, so that nothing is imported that takes time.
"""

from __future__ import annotations

import os
import signal
from types import FrameType
from typing import NoReturn


def _end(number: int, _frame: FrameType | None) -> NoReturn:
    os._exit(128 + number)


def end_quietly() -> None:
    """Have the signals end the process with exit code 130 or 143, until the tool takes them (`shell.cli.run`)."""
    for number in (signal.SIGINT, signal.SIGTERM):
        if signal.getsignal(number) != signal.SIG_IGN:  # as a shell starts what runs in the background
            signal.signal(number, _end)
