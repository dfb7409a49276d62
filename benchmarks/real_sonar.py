"""Real sonars: a ring calibrated in an arena whose walls are known, and maps of the arena and of two corridors.

Run it from the repository's root::

    python -m benchmarks.real_sonar [--quick] [-o FOLDER]

The arena: parameters fitted at four of five places and judged at the fifth, against the defaults; posteriors of all
readings with both, and grids, against the true walls. The corridors: a posterior and a grid, for the eye, and readings
that were held out. Everything is made by the public commands; pictures and real_sonar.json go to FOLDER.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import shapely

from benchmarks import commands
from benchmarks.commands import made, prf, say
from prf.readings import write_table
from tests.readings.sonar_sets import ARENA_WALLS, arena_readings, corridor8_readings

SECONDS = 60.0

ARENA_WINDOW = [-0.4, -0.4, 2.5, 2.5]
ARENA_MAX_RANGE = 2.5
"""Metres; the sonar itself gives up at 2.575 m."""
ARENA_SCALE = 0.5
"""1/m: the arena is small, and so are its walls."""
FIN = 0.02
"""Metres: width given to the one wall of the arena that is free on both sides; its own is not known."""
ARENA_CELL = 0.05

CORRIDOR_MAX_RANGE = 3.5
"""Metres, as in the paper."""
CORRIDOR_SCALE = 0.2
CORRIDOR_HELD_OUT = "5::10"


def arena_plan(target: Path) -> Path:
    """Write the true plan: all is occupied outside the walls, and the fin."""
    outer, fin = shapely.linestrings([wall for k, wall in enumerate(ARENA_WALLS) if k != 2]), ARENA_WALLS[2]
    inside = next(iter(shapely.get_parts(shapely.polygonize([*outer, shapely.LineString([(0.84, 1.68), fin[1]])]))))
    free_end = shapely.LineString([fin[0], (0.84, 1.68)]).buffer(0.5 * FIN, cap_style="flat")
    occupied = shapely.union(shapely.difference(shapely.box(*ARENA_WINDOW), inside), free_end)
    feature = {
        "type": "Feature",
        "geometry": shapely.geometry.mapping(occupied),
        "properties": {"window": ARENA_WINDOW},
    }
    target.parent.mkdir(parents=True, exist_ok=True)
    target.write_text(json.dumps(feature))
    return target


def draw(path: Path, target: Path, title: str) -> None:
    """Draw a run or a grid with `prf render`, which prints no JSON."""
    command = [sys.executable, "-m", "prf", "render", str(path), "-o", str(target), "-f", "-q", "--title", title]
    subprocess.run(command, cwd=commands.ROOT, check=True)


def calibrated(log: Path, plan: Path, folder: Path) -> dict[str, Any]:
    """Fit at four places and judge at the fifth, in turn; and fit at all of them."""
    rows = []
    for place in range(5):
        here, file = f"{place}:{place + 1}", folder / f"arena-but-{place}.toml"
        known: dict[str, Any] = {"sonar": log, "map": plan, "sonar.max_range": ARENA_MAX_RANGE}
        made("calibrate", file, **known, skip_scans=here)
        before = prf("score", plan, sonar=log, scans=here, **{"sonar.max_range": ARENA_MAX_RANGE})
        after = prf("score", plan, sonar=log, scans=here, config=file)
        rows.append({"place": place, "default": before["sonar_nll"], "fitted": after["sonar_nll"]})
        say(f"place {place}: {before['sonar_nll']:.3f} nats a reading by default, {after['sonar_nll']:.3f} fitted")
    whole = made("calibrate", folder / "arena.toml", **known)
    for row in whole["sonar"]["parameters"]:
        say(f"  {row['name']:20} {row['default']:8.3g} -> {row['value']:8.3g} +- {row['error']:.2g}")
    return {"held_out_places": rows, "all": whole["sonar"]}


def arena_maps(log: Path, plan: Path, options: argparse.Namespace) -> list[dict[str, Any]]:
    """Make posteriors and grids of all arena readings, and compare them with the walls."""
    folder = options.output
    known: dict[str, Any] = {"sonar": log, "window": ARENA_WINDOW}
    sampling: dict[str, Any] = {
        "scale": ARENA_SCALE,
        "resolution": 0.02,
        "chains": 4,
        "seed": options.seed,
        "threads": options.threads,
        "time_budget": options.seconds,
    }
    names = {}
    for name, how in (("default", {"sonar.max_range": ARENA_MAX_RANGE}), ("fitted", {"config": folder / "arena.toml"})):
        say(f"arena, {name} parameters, {options.seconds:g} s")
        made("sample", folder / f"arena-{name}.run", **known, **sampling, **how)
        names[f"PRF, {name} parameters"] = folder / f"arena-{name}.run"
    for method in ("count", "log-odds"):
        grid = folder / f"arena-{method}.grid.npz"
        how = {"resolution": ARENA_CELL, "sonar.max_range": ARENA_MAX_RANGE, "grid.method": method}
        made("grid", grid, **known, **how)
        names[f"grid, {method}"] = grid
    rows = []
    for name, path in names.items():
        found = prf("score", path, sonar=log, truth=plan, config=folder / "arena.toml")
        rows.append({"map": name, **found})
        draw(path, folder / f"{path.name.removesuffix('.npz')}.png", title=f"Arena: {name}")
        overlap = f"IoU occupied {found['iou_occupied']:.3f}, free {found['iou_free']:.3f}"
        say(f"{name:24} {overlap}, Brier {found['cell_brier']:.3f}")
    return rows


def corridors(log: Path, options: argparse.Namespace) -> list[dict[str, Any]]:
    """Make posterior and grid of the corridors, and score both on scans held out."""
    folder, seconds = options.output, 2.0 * options.seconds
    what: dict[str, Any] = {"sonar": log, "sonar.max_range": CORRIDOR_MAX_RANGE, "skip_scans": CORRIDOR_HELD_OUT}
    say(f"corridors, {seconds:g} s")
    how: dict[str, Any] = {"scale": CORRIDOR_SCALE, "seed": options.seed, "threads": options.threads}
    run, grid = folder / "corridors.run", folder / "corridors.grid.npz"
    made("sample", run, **what, **how, resolution=0.05, time_budget=seconds)
    made("grid", grid, **what)
    rows = []
    for name, path in (("PRF", run), ("grid, count", grid)):
        found = prf("score", path, sonar=log, scans=CORRIDOR_HELD_OUT, **{"sonar.max_range": CORRIDOR_MAX_RANGE})
        rows.append({"map": name, **found})
        draw(path, folder / f"{path.name.removesuffix('.npz')}.png", title=f"Two corridors: {name}")
        say(f"{name:24} {found['sonar_nll']:.3f} nats a held-out reading")
    return rows


def main() -> None:
    """Make everything and write the table."""
    options = commands.parse(commands.parser(__doc__, SECONDS))
    source = options.data.resolve() / "sonar"
    if not source.exists():
        raise SystemExit(f"{source}: not here, there are no real sonar readings to map")
    folder = options.output = options.output / "real-sonar"
    folder.mkdir(parents=True, exist_ok=True)
    write_table(folder / "arena.csv", arena_readings(source / "arena_known_map"))
    write_table(folder / "corridors.csv", corridor8_readings(source / "corridor8"))
    plan = arena_plan(folder / "arena.geojson")
    result = {
        "calibration": calibrated(folder / "arena.csv", plan, folder),
        "arena": arena_maps(folder / "arena.csv", plan, options),
        "corridors": corridors(folder / "corridors.csv", options),
    }
    commands.write_table(folder / "real_sonar.json", result)


if __name__ == "__main__":
    main()
