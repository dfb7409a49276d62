"""The paper's sonar experiment (figure 5) again, in a simulated office: see README.md beside this file.

Run it from the repository's root::

    python -m benchmarks.figure5 [--quick] [--size W H] [--readings N] [--shares 5 100] [-o FOLDER]

A ring of sonars is driven through a floor whose plan is known. Scans 5, 15, 25 ... are held out; maps are made from
shares of the others, by the public commands, and scored against the held-out readings and against the plan: the PRF
posterior, its best map and two occupancy grids. With the sonar's default parameters, and with those that
`prf calibrate` fits in another floor. Leaves figure5-NAME.png and figure5-shares-NAME.png of both, and figure5.json.
"""

from __future__ import annotations

import argparse
import gzip
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.collections import LineCollection

from benchmarks import commands, panels
from benchmarks.commands import made, prf, say
from prf.output.run import read_run
from prf.readings import Readings
from prf.results import names
from prf.results.geojson import read_map_feature
from prf.results.occupancy import read_grid
from prf.shell.cli import pictures as style

SCALE = 0.1
SECONDS = 600.0
SIZE = [60.0, 40.0]
READINGS = 29120
"""As many as the paper's."""
SHARES = [5.0, 10.0, 25.0, 50.0, 100.0]
"""Percent of the scans that are not held out."""
HELD_OUT = "5::10"
CELL = 0.1
OTHER_WORLD: dict[str, Any] = {"size": [30.0, 20.0], "readings": 6000}
"""Where the parameters of the sonar are fitted: another floor, another seed, no reading of the one that is mapped."""
OTHER_SEED = 1000
GRIDS = {"count grid": "count", "log-odds grid": "log-odds"}
POSTERIOR, BEST = "PRF posterior", "PRF best map"
SCORES = {"iou_occupied": 1, "iou_free": 1, "sonar_nll": -1}
"""What is compared, and whether more is better (1) or less (-1)."""
COLUMNS = (*SCORES, "cell_brier")


class World(NamedTuple):
    """The simulated readings, the true plan, and the settings under which maps are made and scored."""

    log: Path
    plan: Path
    window: list[float]
    settings: dict[str, Path | None]


class Rows(NamedTuple):
    """The lines of a log: its header and, scan by scan, its readings."""

    header: str
    scans: dict[int, list[str]]


def make_world(folder: Path, options: argparse.Namespace) -> World:
    """Simulate the floor to be mapped, and fit the sonar's parameters in another."""
    say(f"a floor of {options.size[0]:g} x {options.size[1]:g} m, about {options.readings:,} readings")
    floor, other, fitted = folder / "floor", folder / "other-floor", folder / "sonar.toml"
    simulate(floor, options.seed, options.size, options.readings)
    plan = floor / "truth.geojson"
    settings: dict[str, Path | None] = {"defaults": None}
    if "fitted" in options.settings:
        simulate(other, options.seed + OTHER_SEED, **OTHER_WORLD)
        made("calibrate", fitted, sonar=other / "sonar.csv.gz", map=other / "truth.geojson")
        settings["fitted"] = fitted
    _, properties = read_map_feature(plan)
    return World(
        floor / "sonar.csv.gz", plan, list(properties["window"]), {name: settings[name] for name in options.settings}
    )


def simulate(folder: Path, seed: int, size: list[float], readings: int) -> None:
    """Drive a ring of sonars through an office."""
    folder.parent.mkdir(parents=True, exist_ok=True)
    prf("simulate", "--sonar", "--no-laser", "--force", size=size, readings=readings, seed=seed, output=folder)


def read_rows(log: Path) -> Rows:
    """Return the rows of a simulated log, which has the number of the scan last."""
    header, *lines = gzip.decompress(log.read_bytes()).decode().splitlines()
    scans: dict[int, list[str]] = {}
    for line in lines:
        scans.setdefault(int(line.rpartition(",")[2]), []).append(line)
    return Rows(header, scans)


def mapping_scans(scans: list[int], percent: float) -> list[int]:
    """Return a share of the scans that are not held out, spread evenly over the drive."""
    first, _, step = HELD_OUT.split(":")
    others = [scan for scan in scans if scan % int(step) != int(first)]
    return [scan for k, scan in enumerate(others) if int((k + 1) * percent / 100) > int(k * percent / 100)]


def write_share(rows: Rows, percent: float, target: Path) -> int:
    """Write the readings of a share; return their number."""
    kept = [line for scan in mapping_scans(sorted(rows.scans), percent) for line in rows.scans[scan]]
    target.parent.mkdir(parents=True, exist_ok=True)
    target.write_text("\n".join([rows.header, *kept]) + "\n")
    return len(kept)


def share(world: World, rows: Rows, percent: float, options: argparse.Namespace) -> Iterator[dict[str, Any]]:
    """Make all maps from one share of the readings; yield their scores, row by row."""
    folder = options.output / f"{percent:g}"
    log = folder / "sonar.csv"
    n_readings = write_share(rows, percent, log)
    what = {"sonar": log, "window": world.window}
    for method in GRIDS.values():
        made("grid", grid_path(folder, method), resolution=CELL, **what, **{"grid.method": method})
    for name, config in world.settings.items():
        say(f"{percent:g} % of the scans, {n_readings:,} readings, {name}: {options.seconds:g} s")
        run = folder / f"{name}.run"
        result = made(
            "sample",
            run,
            **what,
            config=config,
            scale=SCALE,
            resolution=CELL,
            chains=options.chains,
            seed=options.seed,
            threads=options.threads,
            time_budget=options.seconds,
        )
        maps = {POSTERIOR: run, BEST: run / names.MAP}
        maps |= {grid: grid_path(folder, method) for grid, method in GRIDS.items()}
        for kind, path in maps.items():
            found = prf("score", path, sonar=world.log, scans=HELD_OUT, truth=world.plan, config=config)
            row = {"share": percent, "settings": name, "map": kind, "n_readings": n_readings, **found}
            yield {**row, "run": result} if kind == POSTERIOR else row


def grid_path(folder: Path, method: str) -> Path:
    """Return where the grid of a share stands."""
    return folder / f"{method}.grid.npz"


def lost(rows: list[dict[str, Any]]) -> list[str]:
    """Return where a map of the PRF is not ahead of both grids of the same share and settings."""
    found = []
    for row in rows:
        same = [other for other in rows if all(other[key] == row[key] for key in ("share", "settings"))]
        for score, sign in SCORES.items():
            rival = max(sign * other[score] for other in same if other["map"] in GRIDS)
            if row["map"] not in GRIDS and not sign * row[score] > rival:
                words = f"{row[score]:.3f} against {sign * rival:.3f}"
                found.append(f"{row['map']}, {row['settings']}, {row['share']:g} %, {score}: {words}")
    return found


def table(rows: list[dict[str, Any]], name: str) -> str:
    """Return the scores under one setting as Markdown."""
    lines = [f"| {name}: share | map | " + " | ".join(COLUMNS) + " |", "|---" * (len(COLUMNS) + 2) + "|"]
    for row in rows:
        if row["settings"] == name:
            figures = " | ".join(f"{row[column]:.3f}" for column in COLUMNS)
            lines.append(f"| {row['share']:g} % | {row['map']} | {figures} |")
    return "\n".join(lines) + "\n"


def arcs(cones: Readings, caption: str) -> panels.Panel:
    """Return a panel of the impact arcs: of every reading that returned, the arc of its cone at its range."""
    lines = cones.arcs()
    strength = float(np.clip(60.0 / len(lines) ** 0.5, 0.25, 1.0))

    def draw(axes: Any) -> None:
        axes.add_collection(LineCollection(list(lines), colors=style.INK, linewidths=0.25, alpha=strength))

    return panels.Panel(draw, caption)


def draw_figure(world: World, options: argparse.Namespace, percent: float, name: str) -> None:
    """Draw arcs, grids, posterior and best map of one share beside the true plan."""
    folder = options.output / f"{percent:g}"
    run = read_run(folder / f"{name}.run")
    truth, _ = read_map_feature(world.plan)
    assert run.image is not None
    assert run.sonar is not None
    assert run.best is not None
    n = len(run.sonar.range)
    length = f"{run.manifest['steps']:,} steps in each of {run.n_chains} chains"
    panels.save_page(
        options.output / f"figure5-{name}.png",
        [
            arcs(run.sonar, f"(a) impact arcs of the readings below {run.sonar.max_range:g} m"),
            panels.filled(truth, "the true plan"),
            panels.image(read_grid(grid_path(folder, "count")).image(), "(b) occupancy grid, counts"),
            panels.image(read_grid(grid_path(folder, "log-odds")).image(), "(b) occupancy grid, log odds"),
            panels.image(run.image, "(c) PRF posterior"),
            panels.filled(run.best, f"(c) PRF, its best map: {run.best.n_edges:,} edges"),
        ],
        run.draws.window,
        columns=2,
        height=4.6,
        title="An office from sonar",
        subtitle=f"{n:,} simulated readings  ·  p = {SCALE:g}/m  ·  parameters: {name}  ·  {length}",
    )


def draw_shares(world: World, options: argparse.Namespace, name: str) -> None:
    """Draw grid and posterior of every share, one row a share."""
    rows = []
    for percent in options.shares:
        folder = options.output / f"{percent:g}"
        run = read_run(folder / f"{name}.run", parts=[names.POSTERIOR])
        assert run.image is not None
        rows.append(panels.image(read_grid(grid_path(folder, "count")).image(), f"{percent:g} %: count grid"))
        rows.append(panels.image(run.image, f"{percent:g} %: PRF posterior"))
    panels.save_page(
        options.output / f"figure5-shares-{name}.png",
        rows,
        run.draws.window,
        columns=2,
        height=2.8,
        title="Shares of the readings",
        subtitle=f"p = {SCALE:g}/m  ·  parameters: {name}  ·  {options.seconds:g} s of sampling each",
    )


def main() -> int:
    """Make and score all maps, share by share, and draw them."""
    asked = commands.parser(__doc__, SECONDS)
    asked.add_argument("--size", type=float, nargs=2, default=SIZE, metavar=("W", "H"), help="of the office, metres")
    asked.add_argument("--readings", type=int, default=READINGS)
    asked.add_argument("--shares", type=float, nargs="+", default=SHARES, help="percent of the scans")
    asked.add_argument("--settings", nargs="+", choices=["defaults", "fitted"], default=["defaults", "fitted"])
    asked.add_argument("--chains", type=int, default=2, help="on two cores, two go furthest in a given time")
    options = commands.parse(asked)
    options.output = options.output / "figure5"
    world = make_world(options.output, options)
    log = read_rows(world.log)
    rows = [row for percent in options.shares for row in share(world, log, percent, options)]
    for name in options.settings:
        print(table(rows, name), flush=True)
    misses = lost(rows)
    print("\n".join(["not ahead of both grids:", *misses]) if misses else "ahead of both grids everywhere")
    how = {key: getattr(options, key) for key in ("size", "readings", "seed", "seconds", "chains")}
    result = {"schema": "prf.benchmark.figure5/1", **how, "scale": SCALE, "rows": rows, "lost": misses}
    commands.write_table(options.output / "figure5.json", result)
    for name in options.settings:
        draw_figure(world, options, max(options.shares), name)
        draw_shares(world, options, name)
    return 0


if __name__ == "__main__":
    sys.exit(main())
