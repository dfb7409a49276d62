"""The three kinds of map that can be scored, seen alike: draws of a RUN, cells of a GRID, polygons of a file."""

from __future__ import annotations

import os
from pathlib import Path
from typing import NamedTuple, Protocol

import numpy as np
import shapely
from numpy.typing import NDArray

from prf import estimate
from prf.coloring import Coloring, Draws, black_at_draws
from prf.kernels.laser_score import add_densities, grid_beams
from prf.occupancy import OccupancyGrid, is_grid, read_grid
from prf.occupancy import occupied_probability as cells_occupied
from prf.run import PosteriorImage, names, read_run
from prf.score.cones import HeldOutSonar, SonarPrediction, predict_by_cells, predict_by_draws, predict_by_region
from prf.score.heldout import HeldOut
from prf.score.polygons import OccupiedArea, read_occupied_area
from prf.score.scene import enclosing_window, first_edges, outline
from prf.shell.errors import InputError
from prf.window import Window

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

BIN = 0.1
"""Metres of a beam that take the probability of one cell."""


class Prediction(NamedTuple):
    """What a map predicts of beams.

    Attributes
    ----------
    density : (n,) float64
        Predictive density of each reading, 1/m; of a censored one the probability to end beyond the window.
    distance : (n,) float64
        Distance to the first obstacle in the best map; inf for none before the maximum range, 0 in occupied space,
        nan if there is no best map.
    share_occupied : float
        Share of pairs of a draw and a beam in which the sensor is in occupied space.
    """

    density: Floats
    distance: Floats
    share_occupied: float


class ScoredMap(Protocol):
    """What a score needs of a map; `kind` is run, grid or map, `window` where it is known (None: everywhere)."""

    @property
    def kind(self) -> str: ...  # noqa: D102
    @property
    def window(self) -> Window | None: ...  # noqa: D102
    @property
    def n_draws(self) -> int: ...  # noqa: D102

    def predict(self, beams: HeldOut) -> Prediction:
        """Return the prediction for beams whose sensors are inside the window."""

    def predict_sonar(self, cones: HeldOutSonar) -> SonarPrediction:
        """Return the prediction for sonar readings whose sensors are inside the window."""

    def occupied(self, xy: Floats, square: float) -> Floats:
        """Return the probability that the square of this side round each point (n, 2) is not completely white.

        0 asks for the very point, of a GRID for its cell; nan for a point outside the window.
        """

    def seen(self, xy: Floats) -> Bools | None:
        """Return which points (n, 2) lie in cells that a reading of the map's own log crossed; None if not known."""


class DrawsMap:
    """The draws of a RUN, every one a possible map, and its best map.

    Parameters
    ----------
    draws : Draws
        At least one.
    image : PosteriorImage or None
        Holds which cells readings saw; None: not known.
    """

    kind = "run"

    def __init__(self, draws: Draws, best: Coloring | None, image: PosteriorImage | None = None) -> None:
        if len(draws) == 0:
            raise InputError("no draws yet: nothing can be scored. Go on with prf sample --resume.")
        self.draws = draws
        self.best = best
        self.image = image
        self.window: Window = draws.window
        self.n_draws = len(draws)

    def predict(self, beams: HeldOut) -> Prediction:
        """Return the density averaged over draws, and the distances of the best map."""
        rays, model = beams.rays(self.window), beams.model.to_array()
        readings = beams.readings(rays)
        sensors, sensor = np.unique(beams.origin, axis=0, return_inverse=True)
        black = np.ascontiguousarray(black_at_draws(self.draws, sensors)[:, sensor.reshape(-1)])
        total = np.zeros(len(rays))
        for draw, occupied in zip(self.draws, black, strict=True):
            distance = first_edges(rays, draw.segments(), self.window)
            add_densities(model, readings, distance, occupied, total)
        return Prediction(total / self.n_draws, self._best_distance(beams, rays), float(black.mean()))

    def predict_sonar(self, cones: HeldOutSonar) -> SonarPrediction:
        """Return the density averaged over draws."""
        return predict_by_draws(self.draws, cones)

    def occupied(self, xy: Floats, square: float) -> Floats:
        """Return the share of draws in which the square round each point is not completely white."""
        return estimate.occupied_probability(self.draws, xy, square)

    def seen(self, xy: Floats) -> Bools | None:
        """Return which points lie in cells of the image that a reading crossed or ended in."""
        return None if self.image is None else self.image.seen_at(xy)

    def _best_distance(self, beams: HeldOut, rays: Floats) -> Floats:
        if self.best is None:
            return np.full(len(rays), np.nan)
        black = black_at_draws(Draws.from_colorings([self.best]), beams.origin)[0]
        return np.where(black, 0.0, first_edges(rays, self.best.segments(), self.window))


class PolygonMap:
    """One map as polygons of occupied area."""

    kind = "map"
    n_draws = 1

    def __init__(self, area: OccupiedArea) -> None:
        self.region = area.region
        self.window = area.window
        shapely.prepare(self.region)

    def predict(self, beams: HeldOut) -> Prediction:
        """Return density and distances of the one map."""
        rays = beams.rays(self.window)
        black = shapely.contains_xy(self.region, beams.origin)
        window = self.window or enclosing_window(beams.origin, beams.model.max_range, self.region)
        distance = first_edges(rays, outline(self.region, self.window)[0], window)
        density = np.zeros(len(rays))
        add_densities(beams.model.to_array(), beams.readings(rays), distance, black, density)
        return Prediction(density, np.where(black, 0.0, distance), float(black.mean()))

    def predict_sonar(self, cones: HeldOutSonar) -> SonarPrediction:
        """Return the density of the one map."""
        return predict_by_region(self.region, self.window, cones)

    def occupied(self, xy: Floats, square: float) -> Floats:
        """Return 1 where the square round a point is not completely white, 0 elsewhere."""
        known = np.ones(len(xy), np.bool_) if self.window is None else self.window.contains(xy)
        if square == 0.0:
            black = shapely.contains_xy(self.region, xy)
        else:
            low, high = xy - 0.5 * square, xy + 0.5 * square
            black = shapely.intersects(self.region, shapely.box(low[:, 0], low[:, 1], high[:, 0], high[:, 1]))
        return np.where(known, black.astype(np.float64), np.nan)

    def seen(self, xy: Floats) -> Bools:
        """Return that all points are: polygons do not say which readings they were made from."""
        return np.ones(len(xy), np.bool_)


class GridMap:
    """The cells of a GRID."""

    kind = "grid"
    n_draws = 1

    def __init__(self, grid: OccupancyGrid) -> None:
        self.grid = grid
        self.window: Window = grid.window

    def predict(self, beams: HeldOut) -> Prediction:
        """Return the density that first hits among the cells give, and the distance of the first likely one."""
        density, distance = np.empty(len(beams.range)), np.empty(len(beams.range))
        occupancy = self.grid.occupancy.astype(np.float64)
        rays, model = beams.rays(self.window), beams.model.to_array()
        grid_beams(self.grid.cells, occupancy, model, BIN, rays, beams.readings(rays), density, distance)
        at_sensor = cells_occupied(self.grid, beams.origin) > 0.5
        return Prediction(density, np.where(at_sensor, 0.0, distance), float(at_sensor.mean()))

    def predict_sonar(self, cones: HeldOutSonar) -> SonarPrediction:
        """Return the densities that contours and cells give."""
        return predict_by_cells(self.grid, cones)

    def occupied(self, xy: Floats, square: float) -> Floats:
        """Return the probability that not all cells whose centres lie in the square round each point are free."""
        return cells_occupied(self.grid, xy, square)

    def seen(self, xy: Floats) -> Bools:
        """Return which points lie in cells that a reading hit or missed."""
        return self.grid.image().seen_at(xy)


def open_map(path: str | os.PathLike[str]) -> ScoredMap:
    """Return the map at `path`: a RUN directory, a GRID file, or else GeoJSON.

    Raises
    ------
    InputError
        If there is none, or it is damaged.
    """
    if Path(path).is_dir():
        run = read_run(path, parts=(names.MAP, names.POSTERIOR))
        return DrawsMap(run.draws, run.best, run.image)
    return GridMap(read_grid(path)) if is_grid(path) else PolygonMap(read_occupied_area(path))
