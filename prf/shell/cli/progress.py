"""Progress of a long run on standard error: a bar on a terminal, a plain line every ten seconds elsewhere."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from datetime import timedelta
from typing import TYPE_CHECKING, Any

from prf.shell.cli import console

if TYPE_CHECKING:
    from rich.progress import Progress

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
    e.g. ``sampling``.
    """
    if not console.show_progress():
        yield report_nothing
    elif not (console.can_redraw(sys.stderr) or console.in_notebook()):
        yield _plain(total, description)
    elif _bars:  # one within another gets a line of its own below it
        task = _bars[-1].add_task(description, total=total, fields="")
        yield _on_bar(_bars[-1], task)
        _bars[-1].remove_task(task)
    else:
        with _make_bar() as bar:
            _bars.append(bar)
            try:
                yield _on_bar(bar, bar.add_task(description, total=total, fields=""))
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


def report_nothing(completed: float, **fields: object) -> None:
    """Show nothing (``-q``, ``--no-progress``, `progress=False`)."""


def _on_bar(bar: Progress, task: Any) -> Report:
    """Return what moves a bar and shows the fields beside it."""
    return lambda completed, **fields: bar.update(task, completed=completed, fields=_join(fields))


def _plain(total: float | None, description: str) -> Report:
    """Return what prints a line every :data:`PLAIN_INTERVAL` seconds, for pipes and log files."""
    start = last = time.monotonic()
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
        print(line, file=sys.stderr, flush=True)

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
