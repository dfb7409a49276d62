"""A picture that is drawn anew while work goes on: by a thread of its own, and never for more than a small share."""

from __future__ import annotations

import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from types import TracebackType
from typing import TYPE_CHECKING, Self, TextIO

from prf.shell import console
from prf.shell.terminal.screen import Screen, find_screen

if TYPE_CHECKING:
    from rich.live import Live
    from rich.text import Text

PERIOD = 0.5
"""Seconds between two pictures, at least."""
SHARE = 0.02
"""Of the processor's time of this process that pictures may take: the dearer one is, the later comes the next."""

Make = Callable[[Screen], "list[Text]"]
"""Makes the lines of a picture for what the terminal is now."""


class LiveScreen:
    """Lines on a terminal that are drawn anew in place; what is written to standard error meanwhile stands above them.

    Parameters
    ----------
    stream : text file
        A terminal.
    """

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self._pool = ThreadPoolExecutor(1, "live")
        self._latest: Future[float] | None = None
        self._due = time.monotonic()
        self._begun = time.process_time()
        self._spent = 0.0
        self._live: Live | None = None

    @staticmethod
    def can_show(stream: TextIO) -> bool:
        """Return whether `stream` is a terminal that can redraw, and progress may be shown."""
        return console.show_progress() and console.can_redraw(stream)

    def __enter__(self) -> Self:
        """Begin below what stands on the terminal."""
        from rich.console import Console
        from rich.live import Live

        screen = find_screen(self._stream)
        target = Console(
            file=self._stream,
            force_terminal=True,
            color_system=screen.colours,
            no_color=screen.colours is None,
            highlight=False,
        )
        self._live = Live("", console=target, auto_refresh=False, redirect_stdout=False, vertical_overflow="crop")
        self._live.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Leave the last picture standing."""
        self._pool.shutdown()
        assert self._live is not None
        self._live.stop()
        if kind is None and self._latest is not None:
            self._latest.result()

    @property
    def is_due(self) -> bool:
        """Whether a picture may be drawn now; cheap enough to ask after every round of the work."""
        if self._latest is not None:
            if not self._latest.done():
                return False
            self._spent += self._latest.result()
            self._latest = None
        return time.monotonic() >= self._due and SHARE * (time.process_time() - self._begun) >= self._spent

    def show(self, make: Make, spent: float = 0.0) -> None:
        """Have a picture drawn, and return at once.

        Parameters
        ----------
        make : callable
            Called in another thread: what it looks at must not change.
        spent : float
            Seconds of the processor that went into what it looks at.
        """
        if self._latest is not None:
            self._latest.result()
        self._spent += spent
        self._due = time.monotonic() + PERIOD
        self._latest = self._pool.submit(self._draw, make)

    def _draw(self, make: Make) -> float:
        """Draw a picture; return the seconds of the processor that it took."""
        from rich.console import Group

        begun = time.thread_time()
        screen = find_screen(self._stream)
        lines = make(screen)
        for line in lines:
            line.no_wrap = True
            line.truncate(screen.columns)
        assert self._live is not None
        self._live.update(Group(*lines), refresh=True)
        return time.thread_time() - begun
