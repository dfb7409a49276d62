"""The three kinds of map that can be scored, seen alike: draws of a RUN, cells of a GRID, polygons of a file."""

from __future__ import annotations

import math
import os
from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from prf.kernels.score.laser import add_densities, grid_beams
from prf.kernels.score.sonar import Scene, add_sonar_densities, grid_cones
from prf.model.coloring import Coloring, Draws, black_at_draws
from prf.model.ranges import laser_array, sonar_array
from prf.model.sensors import LaserModel
from prf.model.window import Window
from prf.results import PosteriorImage, estimate, names, read_run_data
from prf.results.geojson import OccupiedArea, area_of_cells, read_occupied_area
from prf.results.occupancy import OccupancyGrid, is_grid, read_grid
from prf.results.occupancy import occupied_probability as cells_occupied
from prf.results.score.heldout import HeldOut, HeldOutSonar
from prf.results.score.returns import Returns, return_probability, returns_of_run, spread_over
from prf.results.score.scene import enclosing_window, first_edges, outline, scene_of_coloring, scene_of_region
from prf.shell.cli.storage import describe_input
from prf.shell.errors import InputError

POSE_SETTINGS = ("poses", "pose_mount", "pose_gap", "pose_offset", "pose_quaternion")

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

BIN = 0.1  # metres of range that take the probability of one cell, or of one arc of cells
OCCUPIED = 0.5  # cells above are walls of a GRID's contours


class PolygonalMaps(ABC):
    """Polygonal maps of equal weight: densities are averaged over them. Without a window `region` is all occupied."""

    kind: str  # "run" or "map"
    window: Window | None  # where the maps are known; None: everywhere
    n_draws: int = 1
    region: BaseGeometry = shapely.MultiPolygon()

    @abstractmethod
    def occupied(self, xy: Floats, square: float) -> Floats:
        """Return the probability that the square of this side round each point (n, 2) is not completely white.

        0: the very point; nan for a point outside the window.
        """

    def singles(self, most: int) -> Sequence[ScoredMap]:
        """Return the maps of equal weight one by one, at most this many of them, spread evenly."""
        return [self]

    def best_alone(self) -> ScoredMap | None:
        """Return the best map, by which distances are scored; None if there is none yet."""
        return self

    def seen(self, xy: Floats) -> Bools | None:
        """Return which points (n, 2) lie in cells that a reading of the map's own log crossed; None if not known."""
        return np.ones(len(xy), np.bool_)

    @abstractmethod
    def _black(self, xy: Floats) -> Bools:
        """Return which points are occupied in each map, (n_draws, n)."""

    @abstractmethod
    def _segments(self) -> Iterable[Floats]:
        """Return the edges of each map, (n_edges, 4)."""

    @abstractmethod
    def _scenes(self, cones: HeldOutSonar) -> Iterable[Scene]:
        """Return each map as cones look at it."""

    @abstractmethod
    def _best_distance(self, beams: HeldOut, rays: Floats, window: Window) -> Floats:
        """Return the distances (n,) of the best map, as of :meth:`predict`."""

    def predict(self, beams: HeldOut) -> tuple[Floats, Floats, float]:
        """Return what the maps predict of beams whose sensors are inside the window.

        The density (n,) of each reading averaged over maps, 1/m, of a censored one the probability to end beyond the
        window; the distance (n,) to the first obstacle in the best map: inf for none before the maximum range, 0 in
        occupied space, nan if there is no best map; and the share of pairs of a draw and a beam in which the sensor is
        in occupied space.
        """
        rays, black = beams.rays(self.window), self._black(beams.origin)
        density = self._density(beams.model, rays, beams.readings(rays), black)
        distance = self._best_distance(beams, rays, self._box(beams.model, rays))
        return density, distance, float(black.mean())

    def density(self, model: LaserModel, rays: Floats, readings: Floats) -> Floats:
        """Return the density (n,) of readings as the kernels take them, of rays that begin in the window."""
        return self._density(model, rays, readings, self._black(rays[:, :2]))

    def _density(self, model: LaserModel, rays: Floats, readings: Floats, black: Bools) -> Floats:
        window, total = self._box(model, rays), np.zeros(len(rays))
        for segments, occupied in zip(self._segments(), black, strict=True):
            add_densities(laser_array(model), readings, first_edges(rays, segments, window), occupied, total)
        return total / self.n_draws

    def _box(self, model: LaserModel, rays: Floats) -> Window:
        return self.window or enclosing_window(rays[:, :2], model.limit, self.region)

    def predict_sonar(self, cones: HeldOutSonar) -> tuple[dict[str, Floats], float]:
        """Return the density (n,) of each sonar reading, 1/m, averaged over maps, for no return its probability.

        It is by the name of the way to find it, "" being the only one. Beside it the share of pairs of a draw and a
        reading in which the sensor is in occupied space.
        """
        model, black = sonar_array(cones.model), self._black(cones.origin)
        total = np.zeros(len(cones.pose))
        for scene, occupied in zip(self._scenes(cones), black, strict=True):
            add_sonar_densities(scene, model, cones.pose, occupied, total)
        return {"": total / self.n_draws}, float(black.mean())


class DrawsMap(PolygonalMaps):
    """The draws of a RUN, every one a possible map, and its best map.

    `draws`: at least one. `image`: holds which cells readings saw; None: not known. `returns`: likewise what beams met
    beside walls.
    """

    kind = "run"

    def __init__(
        self,
        draws: Draws,
        best: Coloring | None,
        image: PosteriorImage | None = None,
        returns: Returns | None = None,
    ) -> None:
        if len(draws) == 0:
            raise InputError("no draws yet: nothing can be scored. Resume with prf sample --resume.")
        self.draws = draws
        self.best = best
        self.image = image
        self.returns = returns
        self.window: Window = draws.window
        self.n_draws = len(draws)

    def singles(self, most: int) -> Sequence[ScoredMap]:
        """Return draws, spread evenly over the chains, which follow one another."""
        return [_alone(self.draws[i]) for i in spread_over(len(self.draws), most).tolist()]

    def best_alone(self) -> ScoredMap | None:
        """Return the best map as a run of one draw."""
        return None if self.best is None else _alone(self.best)

    def _black(self, xy: Floats) -> Bools:
        if len(xy) == 0:
            return np.zeros((len(self.draws), 0), np.bool_)
        x, y = np.ascontiguousarray(xy.T)
        first = np.r_[True, (x[1:] != x[:-1]) | (y[1:] != y[:-1])]  # beams of a scan follow one another
        return np.ascontiguousarray(black_at_draws(self.draws, xy[first])[:, np.cumsum(first) - 1])

    def _segments(self) -> Iterable[Floats]:
        return (draw.segments() for draw in self.draws)

    def _scenes(self, cones: HeldOutSonar) -> Iterable[Scene]:
        return (scene_of_coloring(draw, cones.model.max_range) for draw in self.draws)

    def _best_distance(self, beams: HeldOut, rays: Floats, window: Window) -> Floats:
        if self.best is None:
            return np.full(len(rays), np.nan)
        black = black_at_draws(Draws.from_colorings([self.best]), beams.origin)[0]
        return np.where(black, 0.0, first_edges(rays, self.best.segments(), window))

    def occupied(self, xy: Floats, square: float) -> Floats:
        """Return the share of draws in which the square round each point is not completely white."""
        return estimate.occupied_probability(self.draws, xy, square)

    def returned(self, xy: Floats, square: float) -> Floats:
        """Return the probability that a beam that reaches the square round each point ends in it."""
        return return_probability(self.draws, self.returns, xy, square)

    def seen(self, xy: Floats) -> Bools | None:
        """Return which points lie in cells of the image that a reading crossed or ended in."""
        return None if self.image is None else self.image.seen_at(xy)


def _alone(coloring: Coloring) -> DrawsMap:
    return DrawsMap(Draws.from_colorings([coloring]), coloring)


class PolygonMap(PolygonalMaps):
    """One map as polygons of occupied area, which have no record of what was seen."""

    kind = "map"

    def __init__(self, area: OccupiedArea) -> None:
        self.region = area.region
        self.window = area.window
        shapely.prepare(self.region)

    def _black(self, xy: Floats) -> Bools:
        return np.asarray(shapely.contains_xy(self.region, xy))[None]

    def _segments(self) -> Iterable[Floats]:
        return [outline(self.region, self.window)[0]]

    def _scenes(self, cones: HeldOutSonar) -> Iterable[Scene]:
        return [scene_of_region(self.region, self.window, cones.origin, cones.model.max_range)]

    def _best_distance(self, beams: HeldOut, rays: Floats, window: Window) -> Floats:
        (segments,) = self._segments()
        return np.where(self._black(beams.origin)[0], 0.0, first_edges(rays, segments, window))

    def occupied(self, xy: Floats, square: float) -> Floats:
        """Return 1 where the square round a point is not completely white, 0 elsewhere."""
        known = np.ones(len(xy), np.bool_) if self.window is None else self.window.contains(xy)
        if square == 0.0:
            return np.where(known, self._black(xy)[0].astype(np.float64), np.nan)
        low, high = xy - 0.5 * square, xy + 0.5 * square
        black = shapely.intersects(self.region, shapely.box(low[:, 0], low[:, 1], high[:, 0], high[:, 1]))
        return np.where(known, black.astype(np.float64), np.nan)


class GridMap:
    """The cells of a GRID: to scores what :class:`PolygonalMaps` are."""

    kind = "grid"
    n_draws = 1

    def __init__(self, grid: OccupancyGrid) -> None:
        self.grid = grid
        self.window: Window = grid.window

    def predict(self, beams: HeldOut) -> tuple[Floats, Floats, float]:
        """Return the density that first hits among the cells give, and the distance of the first likely one."""
        rays = beams.rays(self.window)
        density, distance = self._beams(beams.model, rays, beams.readings(rays))
        at_sensor = cells_occupied(self.grid, beams.origin) > OCCUPIED
        return density, np.where(at_sensor, 0.0, distance), float(at_sensor.mean())

    def density(self, model: LaserModel, rays: Floats, readings: Floats) -> Floats:
        """Return the density that first hits among the cells give."""
        return self._beams(model, rays, readings)[0]

    def _beams(self, model: LaserModel, rays: Floats, readings: Floats) -> tuple[Floats, Floats]:
        density, distance = np.empty(len(rays)), np.empty(len(rays))
        occupancy = self.grid.occupancy.astype(np.float64)
        grid_beams(self.grid.cells, occupancy, laser_array(model), BIN, rays, readings, density, distance)
        return density, distance

    def predict_sonar(self, cones: HeldOutSonar) -> tuple[dict[str, Floats], float]:
        """Return the densities that the contours of the grid give, and that first hits among its cells give."""
        contours, share_occupied = PolygonMap(OccupiedArea(contours_of(self.grid), self.window)).predict_sonar(cones)
        first_hit = np.empty(len(cones.pose))
        occupancy, model = self.grid.occupancy.astype(np.float64), cones.model
        # A cell returns the pulse as surely as a wall at no distance, face on.
        outlier = 1.0 / (1.0 + math.exp(model.surface_bias))
        grid_cones(self.grid.cells, occupancy, sonar_array(model), outlier, BIN, cones.pose, first_hit)
        return {"contours": contours[""], "first_hit": first_hit}, share_occupied

    def occupied(self, xy: Floats, square: float) -> Floats:
        """Return the probability that not all cells whose centres lie in the square round each point are free."""
        return cells_occupied(self.grid, xy, square)

    def seen(self, xy: Floats) -> Bools:
        """Return which points lie in cells that a reading hit or missed."""
        return self.grid.image().seen_at(xy)

    def singles(self, most: int) -> Sequence[ScoredMap]:
        """Return the grid: it is one map."""
        return [self]

    def best_alone(self) -> ScoredMap:
        """Return the grid itself."""
        return self


ScoredMap = PolygonalMaps | GridMap
"""What can be scored."""


def contours_of(grid: OccupancyGrid) -> BaseGeometry:
    """Return the area of all cells above 0.5, its staircases straightened."""
    return area_of_cells(grid.occupancy > OCCUPIED, grid.origin, grid.resolution)


def poses_of_run(path: str | os.PathLike[str], logs: Sequence[str]) -> dict[str, Any]:
    """Return the settings, by name, of the files of poses with which the RUN `path` read the same logs, else {}."""
    if not Path(path).is_dir():
        return {}
    manifest = read_run_data(path, parts=()).manifest
    own = {name: manifest["configuration"].get(name) for name in POSE_SETTINGS}
    files = [own["poses"]] if isinstance(own["poses"], str) else own["poses"] or []
    if not files or "extends" in manifest:  # which has settings of the last logs alone
        return {}
    places = {row["sha256"]: place for place, row in enumerate(manifest["inputs"]) if row["sha256"] is not None}
    digests = [describe_input(log)["sha256"] for log in logs]
    if any(digest not in places for digest in digests):
        return {}
    # Logs come first among the inputs, in the order of their poses.
    return own | {"poses": [files[min(places[digest], len(files) - 1)] for digest in digests]}


def open_map(path: str | os.PathLike[str]) -> ScoredMap:
    """Return the map at `path`: a RUN directory, a GRID file, or else GeoJSON."""
    if Path(path).is_dir():
        run = read_run_data(path, parts=(names.MAP, names.POSTERIOR, names.READINGS, names.POSES))
        return DrawsMap(run.draws, run.best, run.image, returns_of_run(run))
    return GridMap(read_grid(path)) if is_grid(path) else PolygonMap(read_occupied_area(path))
