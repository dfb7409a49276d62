"""A map of ten thousand edges: drawn, read by a laser, sampled, pictured, exported, asked."""

from __future__ import annotations

import contextlib
import csv
import io
import math
from pathlib import Path

import numpy as np

import prf.cli
from prf.arak import exact_draws
from prf.coloring import Coloring, black_at
from prf.run import read_run
from prf.shell.run import run_app
from prf.simulate.laser import LaserPhysics, simulate_laser
from prf.simulate.world import World
from prf.window import Window
from tests.load.meter import Meter

SCALE = 0.1
EDGES_A_METRE = 4.0 * math.pi * SCALE**2
"""Edges a square metre, in the mean: 4 pi p^2."""
SCANS_A_METRE = 0.01
"""Scans a square metre of window, about."""
MAX_RANGE = 20.0


def run(n_edges: int, steps: int, folder: Path, meter: Meter) -> int:
    """Carry a map of about so many edges through every verb; return the edges of the best map of the run."""
    side = math.sqrt(n_edges / EDGES_A_METRE)
    window = Window(0.0, 0.0, side, side)
    with meter.stage("exact draw of the prior") as note:
        coloring = exact_draws(SCALE, window, 1, np.random.default_rng(1))[0]
        note.append(f"{coloring.n_edges:,} edges, window {side:.0f} m")
    with meter.stage("laser in it") as note:
        note.append(f"{write_log(folder / 'log.csv', coloring, int(SCANS_A_METRE * window.area)):,} beams")
    (folder / "points.csv").write_text(points_text(window, 10_000))
    (folder / "path.csv").write_text("x,y\n" + "".join(f"{s},{s}\n" for s in np.linspace(0.1, 0.9, 50) * side))
    place = f"--window 0 0 {side} {side} --scale {SCALE}"
    with contextlib.chdir(folder):
        said = call(meter, f"sample --start prior --chains 2 --steps {steps} --seed 1 --laser log.csv {place} -o run")
        best = read_run(folder / "run").best
        assert best is not None
        for command in (
            "inspect run",
            "render run -o run.png",
            *(f"export run --format {kind}" for kind in ("geojson", "ros-map", "svg", "dxf", "netcdf")),
            "query run --points points.csv",
            "query run --points points.csv --square 0.5",
            "query run --path path.csv --radius 0.2",
            "score run --laser log.csv --seed 1",
            f"sample --resume run --steps {steps + 20_000}",
        ):
            call(meter, command)
    return best.n_edges if said else 0


def call(meter: Meter, command: str) -> str:
    """Run a verb in this process as one stage; return what it printed."""
    out = io.StringIO()
    with (
        meter.stage(f"prf {command.partition(' --laser log.csv --window')[0].partition(' -o ')[0]}"),
        contextlib.redirect_stdout(out),
    ):
        code = run_app(prf.cli.app, "prf", [*command.split(), "-q"])
    if code != 0:
        raise SystemExit(f"prf {command}: exit code {code}")
    return out.getvalue()


def write_log(path: Path, coloring: Coloring, n_scans: int) -> int:
    """Write what a laser reads from free places, as a table; return the number of beams."""
    rng = np.random.default_rng(2)
    places = rng.uniform(coloring.window[:2], coloring.window[2:], (4 * n_scans + 100, 2))
    places = places[~black_at(coloring, places)][:n_scans]
    poses = np.column_stack([places, rng.uniform(-np.pi, np.pi, len(places))])
    physics = LaserPhysics(max_range=MAX_RANGE)
    readings = simulate_laser(World.from_coloring(coloring).walls, poses, physics, rng)
    with path.open("w") as stream:
        rows = csv.writer(stream)
        rows.writerow(("x", "y", "theta", "range", "scan"))
        for number, (pose, row) in enumerate(zip(poses.tolist(), readings.tolist(), strict=True)):
            angles = (pose[2] + physics.bearings).tolist()
            rows.writerows((*pose[:2], angle, r, number) for angle, r in zip(angles, row, strict=True) if r > 0.0)
    return int((readings > 0.0).sum())


def points_text(window: Window, n: int) -> str:
    """Return random points as CSV."""
    places = np.random.default_rng(3).uniform(window[:2], window[2:], (n, 2))
    return "x,y\n" + "".join(f"{x},{y}\n" for x, y in places.tolist())
