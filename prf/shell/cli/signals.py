"""Signals as a flag that a long run polls, so that Ctrl-C ends it after a checkpoint and not in the middle of one."""

from __future__ import annotations

import logging
import os
import signal
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from types import FrameType
from typing import Any, NoReturn

from prf.shell.cli.files import remove_all_temporary
from prf.shell.errors import Interrupted

logger = logging.getLogger(__name__)

_STOPPING = (signal.SIGINT, signal.SIGTERM)
_DEAF = ("numba", "llvmlite")
"""Packages that are called back from compiled code, which prints an exception and continues."""


class StopFlag:
    """Set by the first SIGINT or SIGTERM; a driver polls it between steps."""

    def __init__(self) -> None:
        self.signal_number = 0  # 0 while none has come

    @property
    def requested(self) -> bool:
        """Whether the run has been asked to stop."""
        return self.signal_number != 0

    def raise_if_requested(self, message: str) -> None:
        """Raise :class:`Interrupted` (exit code 130 or 143) if the run has been asked to stop.

        `message`: what was kept and how to continue, e.g. ``interrupted; continue with --resume demo/office``.
        """
        if self.requested:
            raise Interrupted(message, self.signal_number)


@contextmanager
def _handled(signals: Sequence[signal.Signals], handler: Callable[[int, FrameType | None], Any]) -> Iterator[None]:
    """Handle signals in the block, but those that are ignored; nothing outside the main thread, where none can be."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = _handlers(signals)
    for number in before:
        signal.signal(number, handler)
    try:
        yield
    finally:
        _restore(before)


def _handlers(signals: Sequence[signal.Signals]) -> dict[signal.Signals, Any]:
    """Return the handlers of signals, but of those that are ignored, or handled outside Python."""
    before = {number: signal.getsignal(number) for number in signals}
    return {number: old for number, old in before.items() if old not in (None, signal.SIG_IGN)}


def _restore(handlers: Mapping[signal.Signals, Any]) -> None:
    for number, handler in handlers.items():
        signal.signal(number, handler)


@contextmanager
def graceful_stop(signals: Sequence[signal.Signals] = _STOPPING) -> Iterator[StopFlag]:
    """Turn the first SIGINT or SIGTERM (or other `signals`) into a :class:`StopFlag`; the second acts as without it."""
    flag = StopFlag()
    before = _handlers(signals)

    def request(number: int, _frame: FrameType | None) -> None:
        flag.signal_number = number
        _restore(before)
        logger.info("stopping in good order; once more to stop at once")

    with _handled(signals, request):
        yield flag


def _is_deaf(frame: FrameType | None) -> bool:
    """Return whether what a signal interrupts, or what called that, would lose an exception or make another of it."""
    while frame is not None:
        package = str(frame.f_globals.get("__name__")).partition(".")[0]
        if package in _DEAF or frame.f_code.co_filename.startswith("<frozen importlib"):
            return True
        frame = frame.f_back
    return False


def _end(number: int, frame: FrameType | None) -> NoReturn:
    """End the tool through its ``finally`` clauses; where no exception passes, in imports and compilers, at once."""
    if _is_deaf(frame):
        remove_all_temporary()
        os._exit(128 + number)
    if number == signal.SIGINT:
        raise KeyboardInterrupt
    raise SystemExit(128 + number)


@contextmanager
def ending_the_tool() -> Iterator[None]:
    """Let SIGINT and SIGTERM end the tool (exit codes 130 and 143) and leave nothing half written, while it runs."""
    with _handled(_STOPPING, _end):
        yield
