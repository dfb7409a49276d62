"""What an export starts from: a run with its trajectory, an occupancy grid, or one map in a file."""

from __future__ import annotations

import json
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from prf.model.coloring import Coloring, from_polygons
from prf.model.walls import N_WALL
from prf.model.window import Window
from prf.poses.posterior import Trajectory
from prf.results import PosteriorImage, RunData, names, read_map_feature, read_run_data
from prf.results.occupancy import OccupancyGrid, is_grid, read_grid
from prf.results.plan import Plan, no_walls, plan_of, plan_of_walls
from prf.results.score import read_occupied_area
from prf.shell.cli.files import open_input
from prf.shell.errors import InputError, UsageError

PARTS = (names.POSTERIOR, names.POSES, names.MAP, names.DIAGNOSTICS)
KEPT = ("log_posterior", "draw", "chain", "step", "walls")
"""Properties of a map in a file that an export of it has too; the rest follows from the map."""
STEM_SUFFIXES = (".run", ".npz", ".grid", ".geojson", ".json")
CERTAIN = 1e-6
"""Metres and radians that nothing is known better than."""
MARGIN = 1.0  # metres of free space round the polygons of another program, which have no window


class Map(NamedTuple):
    """One map, the properties that go with it, and words for it."""

    coloring: Coloring
    properties: dict[str, Any]
    title: str


@dataclass(frozen=True, eq=False)
class Source:
    """A run, a grid or a map; the others are None."""

    path: Path
    run: RunData | None = None
    grid: OccupancyGrid | None = None
    map: Map | None = None  # also the best map of the run, if it has one yet

    def require_run(self, what: str) -> RunData:
        """Return the run (InputError if the source is a grid or one map, which has not `what`)."""
        if self.run is None:
            kind = "one map" if self.grid is None else "a grid"
            raise InputError(f"{self.path}: {kind} has no {what}. Give the RUN directory that prf sample wrote.")
        return self.run

    @property
    def image(self) -> PosteriorImage | None:
        """Which cells readings saw: those of the run or of the grid; None for one map."""
        if self.grid is not None:
            return self.grid.image()
        return None if self.run is None else self.run.image

    def choose_map(self, draw: int | None) -> Map:
        """Return draw number `draw` of the run, or for None the best map."""
        if draw is not None:
            return _draw_of(self.require_run("draws"), draw)
        if self.map is not None:
            return self.map
        raise self.require_run("polygons").missing(names.MAP)

    def choose_plan(self, draw: int | None) -> tuple[Plan, Window]:
        """Return walls and doors of the run, of one draw of it or of a map, and the window."""
        if self.run is not None and draw is None:
            return plan_of(self.run), self.run.draws.window
        if self.run is not None:
            if self.run.walls is None:
                raise no_walls(self.run.name)
            return plan_of_walls(self.run.walls[draw_number(self.run, draw or 0)]), self.run.draws.window
        walls = {} if self.map is None else self.map.properties
        if self.map is None or "walls" not in walls:
            raise no_walls(str(self.path))
        return plan_of_walls(walls_from(walls["walls"], self.path)), self.map.coloring.window


def walls_from(rows: Any, path: Path) -> NDArray[np.float64]:
    """Return the walls (n, N_WALL) that a map in a file names."""
    try:
        walls = np.array(rows, np.float64).reshape(-1, N_WALL)
    except (TypeError, ValueError) as error:
        raise InputError(f"{path}: walls must be rows of {N_WALL} numbers.") from error
    if not (
        np.isfinite(walls).all() and (walls[:, 4] > 0.0).all() and (walls[:, :2] != walls[:, 2:4]).any(axis=1).all()
    ):
        raise InputError(f"{path}: a wall has no length, or no thickness.")
    return walls


def stem_of(path: str | os.PathLike[str]) -> str:
    """Return the name of a source without the suffix of its kind."""
    name = Path(path).resolve().name
    for suffix in STEM_SUFFIXES:
        name = name.removesuffix(suffix)
    return name or "map"


def require_existing(path: str | os.PathLike[str]) -> None:
    """Raise InputError if nothing exists at `path`."""
    if not Path(path).exists():
        raise InputError(f"{path}: no such file or directory.")


def read_source(path: str | os.PathLike[str], with_readings: bool = False) -> Source:
    """Return the run in the directory, or the grid or the map in the file, `path`; of a run its readings if asked."""
    place = Path(path)
    if is_grid(place):
        return Source(place, grid=read_grid(place))
    if not place.is_dir():
        return Source(place, map=_read_map(place))
    run = read_run_data(place, (*PARTS, names.READINGS) if with_readings else PARTS)
    title = f"{stem_of(place)}, best map"
    best = None if run.best is None else Map(run.best, {"log_posterior": run.best_log_posterior}, title)
    return Source(place, run=run, map=best)


def _read_map(file: Path) -> Map:
    """Return the map of a GeoJSON file: as it is if prf wrote it, else in the window that it names or one round it."""
    area = read_occupied_area(file)
    with open_input(file) as stream:
        content = json.loads(stream.read())
    if content.get("schema") == names.SCHEMAS[names.MAP]:
        coloring, properties = read_map_feature(file)
        kept: dict[str, Any] = {key: properties[key] for key in KEPT if key in properties}
        return Map(coloring, kept, stem_of(file))
    if area.window is None and area.region.is_empty:
        raise InputError(f"{file}: expected polygons of the occupied area, or a property window.")
    window = area.window or Window.beyond(area.region.bounds, MARGIN)
    try:
        return Map(from_polygons(area.region, window), {}, stem_of(file))
    except InputError as error:
        raise InputError(f"{file}: {error}. Separate polygons that touch at a point.") from error


def draw_number(run: RunData, number: int) -> int:
    """Return the number of a draw from 0, of one that may be counted from the end (UsageError if there is none)."""
    n = len(run.draws)
    if not -n <= number < n:
        held = "no draws yet" if n == 0 else f"draws 0 to {n - 1}"
        raise UsageError(f"--draw {number}: {run.name} has {held}.")
    return number % n


def _draw_of(run: RunData, number: int) -> Map:
    number = draw_number(run, number)
    properties: dict[str, Any] = {
        "log_posterior": _log_posterior(run, number),
        "draw": number,
        "chain": int(run.chain[number]),
        "step": int(run.step[number]),
    }
    return Map(run.draws[number], properties, f"{run.name}, draw {number}")


def _log_posterior(run: RunData, number: int) -> float | None:
    """Return prior and likelihood of a draw together, as far as the run knows them."""
    if not {"log_prior", "log_likelihood"} <= run.functionals.keys():
        return None
    return float(run.functionals["log_prior"][number] + run.functionals["log_likelihood"][number])


def trajectory_of(source: Source) -> Trajectory:
    """Return the sampled poses of a run (InputError if it has none)."""
    run = source.require_run("trajectory")
    if run.trajectory is None:
        raise InputError(
            f"{source.path}: its poses were not sampled: they are those of the log. For a trajectory sample with "
            "--pose-noise METRES RADIANS or --odometry KIND."
        )
    if not len(run.trajectory.draws):
        raise InputError(f"{source.path}: no draws yet, so no trajectory. Resume with prf sample --resume.")
    return run.trajectory


def tum_text(source: Source, draw: int | None) -> str:
    """Return the posterior means of the poses of a run, or those of one draw: timestamp tx ty tz qx qy qz qw.

    evo and SLAM programs read this.

    Numbers of scans are the times where the time of any pose is unknown.
    """
    found = trajectory_of(source)
    poses = found.mean if draw is None else found.given + found.draws[draw_number(source.require_run("draws"), draw)]
    time = found.time if np.isfinite(found.time).all() else found.scan.astype(np.float64)
    flat, half = np.zeros(len(poses)), 0.5 * poses[:, 2]
    rows = np.column_stack([time, poses[:, :2], flat, flat, flat, np.sin(half), np.cos(half)])
    return "".join(" ".join(map(repr, row)) + "\n" for row in rows.tolist())


def g2o_text(source: Source) -> str:
    """Return the posterior means of the poses of a run, and each step between them with its information, as g2o has it.

    Poses are numbered from 0 in the order of trajectory.csv.
    """
    found = trajectory_of(source)
    lines = [f"VERTEX_SE2 {k} {' '.join(map(repr, pose))}" for k, pose in enumerate(found.mean.tolist())]
    mean, covariance = found.steps()
    information = np.linalg.inv(covariance + CERTAIN**2 * np.eye(3))[:, *np.triu_indices(3)]
    rows = np.column_stack([mean, information]).tolist()
    lines += ["FIX 0", *(f"EDGE_SE2 {k} {k + 1} {' '.join(map(repr, row))}" for k, row in enumerate(rows))]
    return "\n".join(lines) + "\n"
