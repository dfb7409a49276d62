"""What an export starts from: a run, or one map in a file."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from prf.coloring import Coloring
from prf.run import Run, names, read_map_feature, read_run
from prf.shell.errors import InputError, UsageError

PARTS = (names.POSTERIOR, names.MAP, names.DIAGNOSTICS)
KEPT = ("log_posterior", "draw", "chain", "step")
"""Properties of a map in a file that an export of it has too; the rest follows from the map."""
STEM_SUFFIXES = (".run", ".geojson", ".json")


class Map(NamedTuple):
    """One map, the properties that go with it, and words for it."""

    coloring: Coloring
    properties: dict[str, Any]
    title: str


@dataclass(frozen=True, eq=False)
class Source:
    """A run or a map.

    Attributes
    ----------
    path : Path
    run : Run or None
        None where the source is one map.
    map : Map or None
        The best map of the run, None if it has none yet; or the map.
    """

    path: Path
    run: Run | None
    map: Map | None

    def require_run(self, what: str) -> Run:
        """Return the run (InputError if the source is one map, which has not `what`)."""
        if self.run is None:
            raise InputError(f"{self.path}: one map has no {what}. Give the RUN directory that prf sample wrote.")
        return self.run

    def choose_map(self, draw: int | None) -> Map:
        """Return draw number `draw` of the run, or for None the best map.

        Raises
        ------
        InputError
            If the source is one map and a draw is asked for, or the run has no best map yet.
        UsageError
            If the run has no such draw.
        """
        if draw is not None:
            return _draw_of(self.require_run("draws"), draw)
        if self.map is not None:
            return self.map
        raise self.require_run("best map").missing(names.MAP)


def stem_of(path: str | os.PathLike[str]) -> str:
    """Return the name of a source without the suffix of its kind."""
    name = Path(path).resolve().name
    for suffix in STEM_SUFFIXES:
        name = name.removesuffix(suffix)
    return name or "map"


def require_existing(path: str | os.PathLike[str]) -> None:
    """Raise InputError if nothing stands at `path`."""
    if not Path(path).exists():
        raise InputError(f"{path}: no such file or directory.")


def read_source(path: str | os.PathLike[str]) -> Source:
    """Return the run in the directory, or the map in the file, `path`.

    Raises
    ------
    InputError
        If it is neither, damaged, or of an unknown version.
    """
    place = Path(path)
    stem = stem_of(place)
    if not place.is_dir():
        coloring, properties = read_map_feature(place)
        kept: dict[str, Any] = {key: properties[key] for key in KEPT if key in properties}
        return Source(place, None, Map(coloring, kept, stem))
    run = read_run(place, PARTS)
    best = None if run.best is None else Map(run.best, {"log_posterior": run.best_log_posterior}, f"{stem}, best map")
    return Source(place, run, best)


def _draw_of(run: Run, number: int) -> Map:
    n = len(run.draws)
    if not -n <= number < n:
        held = "no draws yet" if n == 0 else f"draws 0 to {n - 1}"
        raise UsageError(f"--draw {number}: {run.name} has {held}.")
    number %= n
    properties: dict[str, Any] = {
        "log_posterior": _log_posterior(run, number),
        "draw": number,
        "chain": int(run.chain[number]),
        "step": int(run.step[number]),
    }
    return Map(run.draws[number], properties, f"{run.name}, draw {number}")


def _log_posterior(run: Run, number: int) -> float | None:
    """Return prior and likelihood of a draw together, as far as the run knows them."""
    if not {"log_prior", "log_likelihood"} <= run.functionals.keys():
        return None
    return float(run.functionals["log_prior"][number] + run.functionals["log_likelihood"][number])
