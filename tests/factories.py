"""Small runs whose maps are draws from the prior: no sampler is needed to test what comes after it."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import shapely

from prf.configuration import IN_MANIFEST, SCORE_DEFAULTS, Configuration
from prf.model.arak import exact_draws
from prf.model.coloring import Coloring, Draws, feature_lines, from_polygons
from prf.model.ranges import unit_vectors
from prf.model.sensors import SonarModel
from prf.model.window import Window
from prf.output.run import Run
from prf.poses.posterior import Trajectory
from prf.readings import Readings
from prf.results import PosteriorImage
from prf.results.estimate import occupied_probability
from prf.results.score.scene import first_edges
from prf.shell.cli.settings import load_options

WINDOW = Window(-10.0, -5.0, 30.0, 20.0)


def score_settings(sonar: SonarModel | None = None, **options: object) -> Configuration:
    """Return the configuration of a score with these values, by the names that manifests have."""
    model = {} if sonar is None else {f"sonar_{name}": value for name, value in dict(sonar).items()}
    return load_options(Configuration, {**model, **options}, IN_MANIFEST, SCORE_DEFAULTS).settings


def grid_settings(**options: object) -> Configuration:
    """Return the configuration of a grid with these values, by the names that its file has."""
    return load_options(Configuration, options, ("prior", "laser", "sonar", "readings", "grid")).settings


def write_draws(path: Path | str, draws: Draws) -> None:
    """Write DRAWS as `prf prior` does."""
    Path(path).write_text("".join(f"{line}\n" for line in feature_lines(draws)))


def random_draws(seed: int, n_draws: int, window: Window = WINDOW, scale: float = 0.2) -> Draws:
    return exact_draws(scale, window, n_draws, np.random.default_rng(seed))


def make_beams(window: Window, n_scans: int = 5, n_beams: int = 40) -> Readings:
    rng = np.random.default_rng(7)
    along = np.linspace(0.3, 0.7, n_scans)[:, None]
    path = np.array(window[:2]) + along * np.array([window.width, window.height])
    angle = np.tile(np.linspace(-np.pi, np.pi, n_beams, endpoint=False), n_scans)
    measured = rng.uniform(0.05, 0.4, n_scans * n_beams) * min(window.width, window.height)
    measured[::9] = np.inf
    scan = np.repeat(10 * np.arange(n_scans, dtype=np.int64), n_beams)
    readings = Readings.from_arrays(np.repeat(path, n_beams, axis=0), angle, measured, scan=scan)
    return readings.within(0.8 * max(window.width, window.height))


def make_image(draws: Draws, resolution: float) -> PosteriorImage:
    window = draws.window
    n_columns, n_rows = int(np.ceil(window.width / resolution)), int(np.ceil(window.height / resolution))
    x = window.x_min + resolution * (np.arange(n_columns) + 0.5)
    y = window.y_min + resolution * (np.arange(n_rows) + 0.5)
    cells = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    point = occupied_probability(draws, cells).reshape(n_rows, n_columns)
    square = occupied_probability(draws, cells, resolution).reshape(n_rows, n_columns)
    origin = np.array([window.x_min, window.y_min])
    seen = np.arange(point.size).reshape(point.shape) % 5 > 0
    differs = (0.1 * point).astype(np.float32)
    return PosteriorImage(point.astype(np.float32), square.astype(np.float32), origin, resolution, seen, differs)


def make_trajectory(readings: Readings, n_draws: int) -> Trajectory:
    """Return the poses of scans, each 5 cm to the right of the given one, with 1 cm and 0.01 rad of noise."""
    path = readings.sensor_path()
    given = np.column_stack([path, np.linspace(-3.0, 3.0, len(path))])
    noise = np.random.default_rng(3).normal(0.0, 0.01, (n_draws, *given.shape))
    draws = (noise + np.array([0.05, 0.0, 0.0])).astype(np.float32)
    scan, owner = np.unique(readings.scan, return_inverse=True)
    return Trajectory(scan, 100.0 + np.arange(len(path)), given, draws, owner.astype(np.int32))


def make_run(seed: int = 1, n_draws: int = 12, window: Window = WINDOW, resolution: float = 1.0) -> Run:
    draws = random_draws(seed, n_draws, window)
    rng = np.random.default_rng(seed)
    probe_xy = rng.uniform(window[:2], window[2:], (3, 2))
    return Run(
        manifest={"status": "finished", "seed": seed, "configuration": {"scale": 0.1}},
        draws=draws,
        chain=(np.arange(n_draws) % 4).astype(np.int32),
        step=(1000 * (np.arange(n_draws, dtype=np.int64) // 4 + 1)),
        functionals={
            "n_edges": draws.n_edges.astype(np.float64),
            "total_length": draws.total_length(),
            "log_posterior": rng.normal(size=n_draws),
        },
        probe_xy=probe_xy,
        probe_black=rng.random((n_draws, 3)) < 0.5,
        image=make_image(draws, resolution) if n_draws else None,
        laser=make_beams(window),
        best=draws[n_draws // 2] if n_draws else None,
        best_log_posterior=-123.25,
        diagnostics={"converged": True, "reason": "n_edges: R-hat 1.010, ESS 300"},
    )


ROOM = Window(0.0, 0.0, 10.0, 6.0)
SCREEN = (5.0, 2.0, 5.4, 5.5)
CUPBOARD = (7.0, 3.6, 9.5, 5.5)


def room_with(*boxes: tuple[float, float, float, float], window: Window = ROOM) -> Coloring:
    """Return a room half a metre inside its window, with black boxes x0, y0, x1, y1 in it, metres."""
    room = shapely.box(window.x_min + 0.5, window.y_min + 0.5, window.x_max - 0.5, window.y_max - 0.5)
    walls = shapely.difference(shapely.box(*window), room)
    return from_polygons(shapely.union_all([walls, *(shapely.box(*box) for box in boxes)]), window)


def room_scan(coloring: Coloring, place: tuple[float, float], number: int = 0, n_beams: int = 60) -> Readings:
    """Return what a laser without errors reads all round from a place, with a range of 8 m."""
    angle = np.linspace(-np.pi, np.pi, n_beams, endpoint=False)
    rays = np.column_stack([np.tile(place, (n_beams, 1)), unit_vectors(angle), np.full(n_beams, 8.0)])
    found = first_edges(rays, coloring.segments(), coloring.window)
    return Readings.from_arrays(np.tile(place, (n_beams, 1)), angle, found, scan=number).within(8.0)


def make_room_run(n_draws: int = 48, seed: int = 1) -> Run:
    """Return a run of a room half of which a screen hides: there stands a cupboard in half of the draws, or nothing."""
    run = make_run(n_draws=n_draws, window=ROOM, resolution=0.25)
    there = np.random.default_rng(seed).random(n_draws) < 0.5
    maps = [room_with(SCREEN, CUPBOARD) if is_there else room_with(SCREEN) for is_there in there.tolist()]
    draws = Draws.from_colorings(maps, ROOM)
    parts = {"draws": draws, "image": make_image(draws, 0.25), "laser": room_scan(maps[0], (2.0, 4.0))}
    return dataclasses.replace(run, **parts, best=maps[0], chain=np.sort(run.chain))
