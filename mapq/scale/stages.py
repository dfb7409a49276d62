"""The stages of the work on a map: who does their tasks, and how far it is."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

from mapq.scale.workers import Workers
from prf.shell.progress import Reporter

TOLD = 500
"""Patches of the JSON after which progress is told again."""
CUTTING = ("counting", "sorting", "segmenting", "comparing", "cutting again", "joining")
"""Stages after which a map is cut into patches."""
COSTS = {"counting": 0.7, "sorting": 0.6, "segmenting": 3.8, "comparing": 0.1, "cutting again": 1.0, "joining": 0.1} | {
    "measuring": 1.5,
    "finding causes": 0.2,
    "writing": 1.5,
    "telling": 0.4,
}
"""Stages, and microseconds a point that each takes, about: what is left of the time is told by these."""


class Stages:
    """What does the tasks of one stage after the other.

    Parameters
    ----------
    workers : Workers
    n_points : int
        Of the map.
    progress : Reporter or None
        Told the seconds of work that are done, of those that :func:`total_cost` foresees.
    """

    def __init__(self, workers: Workers, n_points: int, progress: Reporter | None = None) -> None:
        self._workers, self._n_points, self._progress = workers, n_points, progress
        self._cost = 0.0

    def each(self, stage: str, function: Callable[[Any], Any], tasks: list[Any]) -> list[Any]:
        """Have a stage done; each of its tasks counts alike."""
        begun, cost = self._cost, COSTS[stage] * 1e-6 * self._n_points
        n_done = 0

        def done(_: int) -> None:
            nonlocal n_done
            n_done += 1
            if self._progress is not None:
                self._progress.update(begun + n_done * cost / len(tasks), stage=stage)

        found = self._workers.each(function, tasks, done)
        self._cost = begun + cost
        return found

    def telling(self, rows: Iterator[dict[str, Any]], n_rows: int) -> Iterator[dict[str, Any]]:
        """Yield the patches of the JSON, and tell how far it is."""
        share = COSTS["telling"] * 1e-6 * self._n_points / max(n_rows, 1)
        for place, row in enumerate(rows):
            yield row
            if place % TOLD == 0 and self._progress is not None:
                self._progress.update(self._cost + place * share, stage="telling")


def total_cost(n_points: int, stages: tuple[str, ...] = tuple(COSTS)) -> float:
    """Return the seconds of work that a map takes, about: all of it, or some stages."""
    return sum(COSTS[stage] for stage in stages) * 1e-6 * n_points
