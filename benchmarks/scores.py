"""How well maps made from public logs predict held-out scans: see README.md beside this file.

Run it from the repository's root::

    python -m benchmarks.scores [--quick] [--logs intel aces] [--sets tenth others] [-o FOLDER]

Of each log, scans 5, 15, 25 ... are held out. Maps are made from one scan in ten (0, 10, 20 ...) or from all others,
by the public commands, and scored by `prf score`. Tables go to standard output and to FOLDER/scores/, with the maps.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from benchmarks import commands
from benchmarks.commands import made, prf, say
from benchmarks.contours import write_contours
from benchmarks.octomap import INSTALLED, write_octomap
from prf.occupancy import read_grid
from prf.run import names
from prf.run.mapfile import read_map_feature

SECONDS = 1800.0
HELD_OUT = "5::10"
MAX_RANGE: dict[str, float | None] = {"intel": 40.0, "aces": None, "csail": None, "freiburg-101": None}
"""Metres; None: 0.97 of the largest range in the log."""
SETS: dict[str, dict[str, Any]] = {"tenth": {"every_scan": 10}, "others": {"skip_scans": HELD_OUT}}
SCALE = 0.1
CELL = 0.1
COLUMNS = ("beam_nll", "nll", "brier", "auc", "within_0.2m", "rmse", "vertices", "seconds")


class Task(NamedTuple):
    """One log and one choice of scans."""

    name: str
    log: Path
    scans: str
    folder: Path

    @property
    def readings(self) -> dict[str, Any]:
        """Options of every verb that makes a map."""
        return {"laser": self.log, "max_range": MAX_RANGE[self.name], **SETS[self.scans]}


class Map(NamedTuple):
    """A map that was made, its vertices where it has such, and how long that took: sampling or the whole command."""

    name: str
    path: Path
    vertices: int | None
    seconds: float


def sampled(task: Task, options: argparse.Namespace) -> list[Map]:
    """Return the posterior, with its own best map, and the annealed map."""
    run, best = task.folder / "posterior", task.folder / "annealed.geojson"
    how = {
        **task.readings,
        **commands.LASER,
        "scale": SCALE,
        "seed": options.seed,
        "threads": options.threads,
        "every_beam": options.every_beam,
        "time_budget": options.seconds,
    }
    say(f"{task.name}, {task.scans}: sampling and annealing, {options.seconds:g} s each")
    result = made("sample", run, **how)
    annealed = made("anneal", best, **how)
    coloring, _ = read_map_feature(run / names.MAP)
    return [
        Map("PRF posterior", run, coloring.n_vertices, result["seconds"]),
        Map("PRF, its best draw alone", run / names.MAP, coloring.n_vertices, result["seconds"]),
        Map("PRF annealed", best, annealed["n_vertices"], options.seconds),
    ]


def grids(task: Task) -> list[Map]:
    """Return the baselines."""
    count, odds = task.folder / "count.grid.npz", task.folder / "log-odds.grid.npz"
    contours = task.folder / "contours.geojson"
    times = [time.monotonic()]
    made("grid", count, method="count", resolution=CELL, **task.readings)
    times.append(time.monotonic())
    made("grid", odds, method="log-odds", resolution=CELL, **task.readings)
    times.append(time.monotonic())
    corners = write_contours(read_grid(count), contours)
    times.append(time.monotonic())
    octomap = task.folder / "octomap.grid.npz"
    if INSTALLED:
        write_octomap(read_grid(count), task.log, octomap, **SETS[task.scans])
    first, second, third, fourth = np.diff([*times, time.monotonic()]).tolist()
    peers = [Map("OctoMap", octomap, None, fourth)] if INSTALLED else []
    return [
        Map("count grid", count, None, first),
        Map("log-odds grid", odds, None, second),
        Map("count grid, contours", contours, corners, first + third),
        *peers,
    ]


def scored(task: Task, one: Map, seed: int) -> dict[str, Any]:
    """Return the scores of a map on the held-out scans."""
    found = prf("score", one.path, laser=task.log, scans=HELD_OUT, max_range=MAX_RANGE[task.name], seed=seed)
    return {"map": one.name, "vertices": one.vertices, "seconds": one.seconds, **found}


def table(task: Task, rows: list[dict[str, Any]]) -> str:
    """Return the scores as Markdown."""
    lines = [f"| {task.name}, {task.scans} | " + " | ".join(COLUMNS) + " |", "|---" * (len(COLUMNS) + 1) + "|"]
    lines += ["| " + " | ".join([row["map"], *(cell(name, row[name]) for name in COLUMNS)]) + " |" for row in rows]
    return "\n".join(lines) + "\n"


def cell(column: str, value: float | None) -> str:
    """Return one figure in as many digits as mean something."""
    if value is None:
        return "–"
    if column in ("vertices", "seconds"):
        return f"{value:,.0f}"
    return f"{value:.2f}" if column in ("beam_nll", "rmse") else f"{value:.3f}"


def main() -> int:
    """Make and score all maps, table by table."""
    asked = commands.parser(__doc__, SECONDS)
    asked.add_argument("--logs", nargs="+", choices=list(MAX_RANGE), default=list(MAX_RANGE))
    asked.add_argument("--sets", nargs="+", choices=list(SETS), default=list(SETS))
    asked.add_argument("--every-beam", type=int, default=1, help="for the sampler, which thins besides; grids take all")
    options = commands.parse(asked)
    for name in options.logs:
        log = commands.log_path(options.data, name)
        if log is None:
            continue
        for scans in options.sets:
            task = Task(name, log, scans, options.output / "scores" / f"{name}-{scans}")
            task.folder.mkdir(parents=True, exist_ok=True)
            rows = [scored(task, one, options.seed) for one in [*sampled(task, options), *grids(task)]]
            print(table(task, rows), flush=True)
            how = {"log": name, "scans": scans, "seconds": options.seconds, "laser": commands.LASER, "scale": SCALE}
            how["every_beam"] = options.every_beam
            commands.write_table(task.folder / "scores.json", {"schema": "prf.benchmark.scores/1", **how, "rows": rows})
    return 0


if __name__ == "__main__":
    sys.exit(main())
