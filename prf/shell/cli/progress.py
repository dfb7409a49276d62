"""Progress of a long run on standard error: a bar on a terminal, a plain line every ten seconds elsewhere."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import timedelta
from typing import TYPE_CHECKING, Protocol

from prf.shell.cli import console

if TYPE_CHECKING:
    from rich.progress import Progress, TaskID

PLAIN_INTERVAL = 10.0
"""Seconds between two plain lines: enough for a log file, too few to flood it."""


_bars: list[Progress] = []
"""The bar on the terminal, if there is one."""


class Reporter(Protocol):
    """What :func:`progress` yields."""

    def update(self, completed: float, **fields: object) -> None:
        """Say that `completed` of the total is done; `fields` are shown as ``name value``."""


class Silent:
    """Says nothing (``-q``, ``--no-progress``, `progress=False`)."""

    def update(self, completed: float, **fields: object) -> None:
        """Do nothing."""


class _Plain:
    """One line every :data:`PLAIN_INTERVAL` seconds, for pipes and log files."""

    def __init__(self, total: float | None, description: str) -> None:
        self._total = total
        self._description = description
        self._start = self._last = time.monotonic()
        self._first: tuple[float, float] | None = None

    def update(self, completed: float, **fields: object) -> None:
        """Print a line if the last one is old enough."""
        now = time.monotonic()
        if self._first is None:  # what came before, such as compiling, says nothing of the time left
            self._first = completed, now
        if now - self._last < PLAIN_INTERVAL:
            return
        self._last = now
        done, since = self._first
        left = (now - since) * ((self._total or 0.0) - completed) / (completed - done) if completed > done else None
        line = plain_line(self._description, completed, self._total, now - self._start, left, fields)
        print(line, file=sys.stderr, flush=True)


class _Bar:
    """A bar with the fields beside it."""

    def __init__(self, bar: Progress, task: TaskID) -> None:
        self._bar = bar
        self._task = task

    def update(self, completed: float, **fields: object) -> None:
        """Move the bar."""
        self._bar.update(self._task, completed=completed, fields=_join(fields))


@contextmanager
def progress(total: float | None, description: str) -> Iterator[Reporter]:
    """Show the progress of the block, in which ``update(completed, **fields)`` is cheap enough for every poll.

    `total`: what `completed` counts up to (steps, seconds); None when the end is not known. `description`: what is
    being done, e.g. ``sampling``.
    """
    if not console.show_progress():
        yield Silent()
    elif not (console.can_redraw(sys.stderr) or console.in_notebook()):
        yield _Plain(total, description)
    elif _bars:  # one within another gets a line of its own below it
        task = _bars[-1].add_task(description, total=total, fields="")
        yield _Bar(_bars[-1], task)
        _bars[-1].remove_task(task)
    else:
        with _make_bar() as bar:
            _bars.append(bar)
            try:
                yield _Bar(bar, bar.add_task(description, total=total, fields=""))
            finally:
                _bars.remove(bar)


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
    stderr = Console(stderr=True, no_color=not console.use_color(sys.stderr), highlight=False)
    return Progress(*columns, console=stderr, redirect_stdout=False, refresh_per_second=4, transient=True)


def plain_line(
    description: str,
    completed: float,
    total: float | None,
    elapsed: float,
    left: float | None,
    fields: dict[str, object],
) -> str:
    """Return one line of progress without control characters; without a `total` there is no share and no time left."""
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
