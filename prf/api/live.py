"""A run, or the search for the best map, watched on the terminal."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial

from prf.anneal import Moment
from prf.api.sampling import Snapshot, Watch
from prf.render.live import live_lines
from prf.render.live_map import MapGlance, live_map_lines
from prf.shell.terminal.live import LiveScreen


@contextmanager
def live_map(name: str) -> Iterator[Callable[[Moment], None] | None]:
    """Yield what shows the best map on standard error, for the `on_progress` of :func:`prf.anneal.anneal`.

    None where standard error is no terminal, or progress is not to be shown.
    """
    if not LiveScreen.can_show(sys.stderr):
        yield None
        return
    with LiveScreen(sys.stderr) as screen:

        def watch(moment: Moment) -> None:
            if screen.is_due or moment.share >= 1.0:
                screen.show(partial(live_map_lines, _map_glance(name, moment)))

        yield watch


def _map_glance(name: str, moment: Moment) -> MapGlance:
    return MapGlance(name, moment.best, moment.by_chain, moment.temperature, moment.step, moment.seconds, moment.share)


@contextmanager
def live_view(name: str, is_limit: bool = False) -> Iterator[Watch | None]:
    """Yield what shows a run on standard error, for the `watch` of :func:`prf.sample`.

    None where standard error is no terminal, or progress is not to be shown.

    Parameters
    ----------
    name : str
        Of the run.
    is_limit : bool
        Whether the goal is agreement, so that the time left is a limit.
    """
    if not LiveScreen.can_show(sys.stderr):
        yield None
        return
    with LiveScreen(sys.stderr) as screen:

        def watch(snapshot: Snapshot) -> None:
            if screen.is_due or snapshot.progress.status != "running":
                begun = time.thread_time()
                glance = snapshot.glance(name, is_limit)
                screen.show(partial(live_lines, glance), time.thread_time() - begun)

        yield watch
