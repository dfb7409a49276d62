"""The laser experiments of the paper's figure 4 again, on public logs: see README.md beside this file.

Run it from the repository's root::

    python -m benchmarks.figure4 [--quick] [-o FOLDER]

A hallway from one scan of 180 degrees (a to c), and a lobby from some 5,500 beams (d to g): two pictures, and
figure4.json with the sizes of grid and map. Everything is made by the public commands.
"""

from __future__ import annotations

import argparse
import csv
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from benchmarks import commands, panels
from benchmarks.commands import made, say
from prf.output.run import Run, read_run
from prf.readings import read_readings, thin
from prf.results.geojson import read_map_feature
from prf.results.occupancy import read_grid

SCALE = 0.1
SECONDS = 600.0

HALLWAY, HALLWAY_SCAN = "aces", 395
HALLWAY_WINDOW = [-6.0, -1.0, 6.0, 24.0]
"""Metres; the robot stands at the origin and looks up: walls on both sides, and a piece of the wall at the end."""
HALLWAY_CELL = 0.1

LOBBY = "freiburg-101"
LOBBY_WINDOW = [-37.0, -8.0, 10.0, 20.0]
LOBBY_CELL = 0.1
LOBBY_READINGS: dict[str, Any] = {"window": LOBBY_WINDOW, "max_range": 8.0, "every_scan": 4, "every_beam": 4}


def hallway(log: Path, options: argparse.Namespace) -> dict[str, Any]:
    """Make grid and posterior of one scan, and their picture."""
    folder = options.output
    table = upright_scan(log, HALLWAY_SCAN, folder / "hallway.csv")
    say(f"hallway: one scan, {options.seconds:g} s")
    made("grid", folder / "hallway.grid.npz", laser=table, window=HALLWAY_WINDOW, resolution=HALLWAY_CELL, max_range=40)
    result = made(
        "sample",
        folder / "hallway.run",
        laser=table,
        window=HALLWAY_WINDOW,
        max_range=40,
        scale=SCALE,
        resolution=HALLWAY_CELL / 2,
        seed=options.seed,
        threads=options.threads,
        time_budget=options.seconds,
    )
    run, grid = read_run(folder / "hallway.run"), read_grid(folder / "hallway.grid.npz")
    assert run.image is not None
    assert run.laser is not None
    n_beams = len(run.laser.range)
    panels.save_page(
        folder / "figure4-hallway.png",
        [
            panels.impacts(run.laser, "(a) laser scan", rays=True),
            panels.image(grid.image(), "(b) occupancy grid"),
            panels.image(run.image, "(c) PRF posterior"),
        ],
        run.draws.window,
        columns=3,
        height=6.0,
        title="A hallway from one laser scan",
        subtitle=f"{HALLWAY}, scan {HALLWAY_SCAN}  ·  {n_beams} beams  ·  p = {SCALE:g}/m  ·  {words(run)}",
    )
    return {"n_beams": n_beams, "run": result}


def upright_scan(log: Path, number: int, target: Path) -> Path:
    """Write one scan as a table, moved to the origin and turned so that the sensor looks along +y."""
    scan = thin(read_readings(str(log)), scans=f"{number}:{number + 1}")
    step = float(np.median(np.diff(scan.angle)))
    angle = scan.angle - scan.angle[0] - scan.beam[0] * step
    target.parent.mkdir(parents=True, exist_ok=True)
    with target.open("w", newline="") as stream:
        rows = csv.writer(stream)
        rows.writerow(["x", "y", "theta", "range"])
        rows.writerows((0.0, 0.0, turned, reading) for turned, reading in zip(angle, scan.range, strict=True))
    return target


def lobby(log: Path, options: argparse.Namespace) -> dict[str, Any]:
    """Make grid, posterior and best map of the lobby, their picture and their sizes."""
    folder = options.output
    say(f"lobby: posterior and annealed map, {options.seconds:g} s each")
    what = {"laser": log, **LOBBY_READINGS}
    how: dict[str, Any] = {
        **commands.LASER_SETTINGS,
        "scale": SCALE,
        "seed": options.seed,
        "threads": options.threads,
        "time_budget": options.seconds,
    }
    made("grid", folder / "lobby.grid.npz", resolution=LOBBY_CELL, **what, **{"grid.no_return": "free"})
    sampled = made("sample", folder / "lobby.run", resolution=LOBBY_CELL, **what, **how)
    annealed = made("anneal", folder / "lobby.geojson", **what, **how)
    run, grid = read_run(folder / "lobby.run"), read_grid(folder / "lobby.grid.npz")
    best, _ = read_map_feature(folder / "lobby.geojson")
    sizes = {**map_bytes(folder / "lobby.geojson"), "grid_cells": grid.occupancy.size}
    assert run.image is not None
    assert run.laser is not None
    n_beams = len(run.laser.range)
    panels.save_page(
        folder / "figure4-lobby.png",
        [
            panels.impacts(run.laser, "(d) laser data"),
            panels.image(grid.image(), f"(e) occupancy grid, {sizes['grid_cells']:,} bytes at one a cell"),
            panels.image(run.image, "(f) PRF posterior"),
            panels.filled(best, f"(g) annealed map: {best.n_edges} edges, {sizes['float64_bytes']:,} bytes as doubles"),
        ],
        run.draws.window,
        columns=2,
        height=2.9,
        title="A lobby",
        subtitle=f"{LOBBY}  ·  {n_beams:,} beams, no return beyond 8 m  ·  p = {SCALE:g}/m  ·  {words(run)}",
    )
    return {"n_beams": n_beams, "run": sampled, "annealed": annealed, "bytes": sizes}


def words(run: Run) -> str:
    """Return the length of a run."""
    return f"{run.manifest['steps'] / 1e6:.1f} million steps in each of {run.n_chains} chains"


def map_bytes(path: Path) -> dict[str, int]:
    """Return the size of a map in several forms.

    `geometry_mm`: the bare geometry with coordinates to the millimetre. Packed: for each ring its number of corners
    (2 bytes) and its corners, the repeated last one left out: two int16 centimetres from the window's lower left
    corner (4 bytes a corner), two float32 (8) or two float64 (16).
    """
    content = json.loads(path.read_text())
    rings = shapely.get_rings(shapely.get_parts(shapely.geometry.shape(content["geometry"])))
    n_corners = int(sum(shapely.get_num_coordinates(rings) - 1))
    sizes = {"geojson_bytes": path.stat().st_size, "geometry_mm_bytes": rounded_bytes(content["geometry"])}
    for name, each in (("int16_cm", 4), ("float32", 8), ("float64", 16)):
        sizes[f"{name}_bytes"] = 2 * len(rings) + each * n_corners
    return {"rings": len(rings), "corners": n_corners, **sizes}


def rounded_bytes(geometry: dict[str, Any]) -> int:
    """Return the size of a GeoJSON geometry with coordinates to the millimetre and no spaces."""

    def rounded(value: Any) -> Any:
        return [rounded(part) for part in value] if isinstance(value, list) else round(value, 3)

    return len(json.dumps({**geometry, "coordinates": rounded(geometry["coordinates"])}, separators=(",", ":")))


def report(result: dict[str, Any]) -> None:
    """Print the sizes."""
    if "lobby" in result:
        sizes = result["lobby"]["bytes"]
        print(f"lobby: {result['lobby']['n_beams']} beams, {sizes['corners']} corners in {sizes['rings']} rings")
        for name, size in sizes.items():
            if name.endswith("_bytes"):
                print(f"  {name.removesuffix('_bytes'):12} {size:9,} bytes")
        cells = sizes["grid_cells"]
        print(f"  {'grid':12} {cells:9,} bytes at one a cell: {cells / sizes['float64_bytes']:.0f} maps of doubles")


def main() -> int:
    """Make both figures."""
    options = commands.parse(commands.parser(__doc__, SECONDS))
    options.output = options.output / "figure4"
    result: dict[str, Any] = {"schema": "prf.benchmark.figure4/1", "seconds": options.seconds, "scale": SCALE}
    for name, source, work in (("hallway", HALLWAY, hallway), ("lobby", LOBBY, lobby)):
        log = commands.log_path(options.data, source)
        if log is not None:
            result[name] = work(log, options)
    commands.write_table(options.output / "figure4.json", result)
    report(result)
    return 0


if __name__ == "__main__":
    sys.exit(main())
