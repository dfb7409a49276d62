"""How well maps made from public logs predict held-out scans: see README.md beside this file.

Run it from the repository's root::

    python -m benchmarks.scores [--seconds 60] [--logs intel aces] [--sets tenth others] [-o FOLDER]

Of each log, scans 5, 15, 25 ... are held out. Maps are made from one scan in ten (0, 10, 20 ...) or from all others,
by the public commands, and `prf score` asks all of them for the same squares. Sampling and annealing take --seconds
each, log by log and set by set; the rest is a minute for each. Tables go to standard output as they are finished, and
to FOLDER/scores/, with the maps; the last one is a summary.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path
from typing import Any, NamedTuple

from benchmarks import commands
from benchmarks.commands import made, prf, say
from benchmarks.contours import write_contours
from benchmarks.octomap import INSTALLED, write_octomap
from benchmarks.regression import regression_scores
from prf.results import names
from prf.results.geojson import read_map_feature
from prf.results.occupancy import read_grid

SECONDS = 180.0
HELD_OUT = "5::10"
MAX_RANGE: dict[str, float | None] = {
    "intel": 40.0,
    **dict.fromkeys(("freiburg-101", "aces", "csail", "edmonton", "belgioioso", "fhw", "infinite-corridor")),
}
"""Metres; None: 0.97 of the largest range in the log."""
TUNED = ("intel", "freiburg-101", "aces")
"""Logs whose held-out scans were looked at while noise, thinning, moves and the probability of a return were chosen."""
SETS: dict[str, dict[str, Any]] = {"tenth": {"every_scan": 10}, "others": {"skip_scans": HELD_OUT}}
SCALE = 0.1
CELLS = (0.1, 0.2)
"""Metres, of the grids; contours and OctoMap have the first."""
POINTS = ("nll", "brier", "auc", "nll_unweighted", "brier_unweighted", "auc_unweighted")
COLUMNS = ("rhat", "beam_nll", *POINTS, "within_0.2m", "rmse", "vertices", "seconds")
SUMMARY = {
    **{"beam_nll": 1.0, "nll": 1.0, "brier": 1.0, "auc": -1.0, "within_0.2m": -1.0, "rmse": 1.0},
    **{"nll_unweighted": 1.0, "brier_unweighted": 1.0, "auc_unweighted": -1.0},
}
"""Scores of the summary, and the sign with which the least is the best."""
POSTERIOR = "PRF posterior"


class Task(NamedTuple):
    """One log and one choice of scans."""

    name: str
    log: Path
    scans: str
    folder: Path

    @property
    def title(self) -> str:
        """What the tables call it."""
        return f"{self.name}{' (tuned on)' if self.name in TUNED else ''}, {self.scans}"

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
    rhat: float | None = None


def sampled(task: Task, options: argparse.Namespace) -> list[Map]:
    """Return the posterior, with its own best map, and the annealed map."""
    run, best = task.folder / "posterior", task.folder / "annealed.geojson"
    how = {
        **task.readings,
        **commands.LASER_SETTINGS,
        "scale": SCALE,
        "seed": options.seed,
        "threads": options.threads,
        "time_budget": options.seconds,
    }
    say(f"{task.name}, {task.scans}: sampling and annealing, {options.seconds:g} s each")
    result = made("sample", run, **how)
    annealed = made("anneal", best, **how)
    coloring, _ = read_map_feature(run / names.MAP)
    return [
        Map(POSTERIOR, run, coloring.n_vertices, result["seconds"], commands.worst_rhat(run)),
        Map("PRF, its best draw alone", run / names.MAP, coloring.n_vertices, result["seconds"]),
        Map("PRF annealed", best, annealed["n_vertices"], options.seconds),
    ]


def grids(task: Task) -> list[Map]:
    """Return the baselines."""
    found = []
    for method in ("count", "log-odds"):
        for cell in CELLS:
            path, begun = task.folder / f"{method}-{cell:g}.grid.npz", time.monotonic()
            made("grid", path, resolution=cell, **task.readings, **{"grid.method": method})
            found.append(Map(f"{method} grid, {cell:g} m", path, None, time.monotonic() - begun))
    counts, contours, octomap = found[0], task.folder / "contours.geojson", task.folder / "octomap.grid.npz"
    begun = time.monotonic()
    corners = write_contours(read_grid(counts.path), contours)
    found.append(Map("contours of the count grid", contours, corners, counts.seconds + time.monotonic() - begun))
    if INSTALLED:
        begun = time.monotonic()
        write_octomap(read_grid(counts.path), task.log, octomap, **SETS[task.scans])
        found.append(Map(f"OctoMap, {CELLS[0]:g} m", octomap, None, time.monotonic() - begun))
    return found


def scored(task: Task, one: Map, seed: int) -> dict[str, Any]:
    """Return the scores of a map on the held-out scans."""
    found = prf("score", one.path, laser=task.log, scans=HELD_OUT, max_range=MAX_RANGE[task.name], seed=seed)
    return {"map": one.name, "vertices": one.vertices, "seconds": one.seconds, "rhat": one.rhat, **found}


def regressed(task: Task, seed: int) -> dict[str, Any]:
    """Return the scores of a regression on counts of beams, which gives probabilities of points alone."""
    begun = time.monotonic()
    found = regression_scores(task.log, HELD_OUT, MAX_RANGE[task.name], seed, SETS[task.scans])
    seconds = time.monotonic() - begun
    return {**dict.fromkeys(COLUMNS), "map": "regression on counts", "seconds": seconds, **found}


def table(task: Task, rows: list[dict[str, Any]]) -> str:
    """Return the scores as Markdown."""
    lines = [f"| {task.title} | " + " | ".join(COLUMNS) + " |", "|---" * (len(COLUMNS) + 1) + "|"]
    lines += ["| " + " | ".join([row["map"], *(cell(name, row[name]) for name in COLUMNS)]) + " |" for row in rows]
    return "\n".join(lines) + "\n"


def summary(tables: dict[str, list[dict[str, Any]]]) -> str:
    """Return the posterior of each table beside the best of all other ways to make a map, score by score."""
    head = ["posterior, best rival", "rhat", *SUMMARY]
    lines = ["| " + " | ".join(head) + " |", "|---" * len(head) + "|"]
    for title, rows in tables.items():
        own = next(row for row in rows if row["map"] == POSTERIOR)
        cells = [title, cell("rhat", own["rhat"])]
        for name, sign in SUMMARY.items():
            others = [row for row in rows if "PRF" not in row["map"] and row[name] is not None]
            rival = min(others, key=lambda row: sign * row[name])
            reported = f"{cell(name, rival[name])} ({rival['map']})"
            cells.append(f"{cell(name, own[name])}, {reported}")
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def cell(column: str, value: float | None) -> str:
    """Return one figure in as many digits as mean something."""
    if value is None or value != value:
        return "–"
    if column in ("vertices", "seconds"):
        return f"{value:,.0f}"
    return f"{value:.2f}" if column in ("beam_nll", "rmse", "rhat") else f"{value:.3f}"


def main() -> int:
    """Make and score all maps, table by table."""
    asked = commands.parser(__doc__, SECONDS)
    asked.add_argument("--logs", nargs="+", choices=list(MAX_RANGE), default=list(MAX_RANGE))
    asked.add_argument("--sets", nargs="+", choices=list(SETS), default=list(SETS))
    options = commands.parse(asked)
    if not INSTALLED:
        say("pyoctomap is not installed (extra bench): no rows of OctoMap")
    tables: dict[str, list[dict[str, Any]]] = {}
    for name in options.logs:
        log = commands.log_path(options.data, name)
        if log is None:
            continue
        for scans in options.sets:
            task = Task(name, log, scans, options.output / "scores" / f"{name}-{scans}")
            task.folder.mkdir(parents=True, exist_ok=True)
            rows = [scored(task, one, options.seed) for one in [*sampled(task, options), *grids(task)]]
            rows.append(regressed(task, options.seed))
            print(table(task, rows), flush=True)
            tables[task.title] = rows
            how = {"log": name, "scans": scans, "seconds": options.seconds, "laser": commands.LASER, "scale": SCALE}
            commands.write_table(task.folder / "scores.json", {"schema": "prf.benchmark.scores/2", **how, "rows": rows})
    if tables:
        print(summary(tables))
    return 0


if __name__ == "__main__":
    sys.exit(main())
