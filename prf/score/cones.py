"""Held-out sonar readings, and what the kinds of map say of them (docs/scores.md)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from prf.coloring import Draws, black_at_draws
from prf.kernels.cones import READING
from prf.kernels.sonar_score import add_sonar_densities, grid_cones
from prf.logs import Readings, thin
from prf.logs.poses import fields_of_view
from prf.occupancy import OccupancyGrid
from prf.score.config import ScoreConfig
from prf.score.polygons import area_of_cells
from prf.score.scene import places, scene_of_coloring, scene_of_region
from prf.sensors.sonar import SonarModel, make_poses
from prf.window import Window

Floats = NDArray[np.float64]

BIN = 0.1
"""Metres of range that take the probability of one arc of a GRID's cells."""
OCCUPIED = 0.5
"""Cells above are walls of a GRID's contours."""


class HeldOutSonar(NamedTuple):
    """Sonar readings, those without return included.

    Attributes
    ----------
    pose : (n, N_POSE) float64
        As the kernels take them; the reading is inf where there was no return below the maximum range.
    """

    pose: Floats
    model: SonarModel

    @property
    def origin(self) -> Floats:
        """Where the sensors are, (n, 2) in metres."""
        return places(self.pose)

    @property
    def range(self) -> Floats:
        """Metres, (n,); inf for no return."""
        return self.pose[:, READING]

    def select(self, mask: NDArray[np.bool_]) -> HeldOutSonar:
        """Return the readings that `mask` (n,) picks."""
        return HeldOutSonar(np.ascontiguousarray(self.pose[mask]), self.model)


class SonarPrediction(NamedTuple):
    """What a map predicts of sonar readings.

    Attributes
    ----------
    density : dict of str to (n,) float64
        Predictive density of each reading in 1/m, for no return its probability, by the name of the way to find it;
        "" where there is one way only.
    share_occupied : float
        Share of pairs of a draw and a reading in which the sensor is in occupied space.
    """

    density: Mapping[str, Floats]
    share_occupied: float


def hold_out_sonar(readings: Readings, config: ScoreConfig) -> HeldOutSonar:
    """Return the readings to score.

    Parameters
    ----------
    readings : Readings
        The whole log.
    """
    kept = thin(readings, config.every_scan, config.every_beam, config.scans, config.skip_scans)
    view = fields_of_view(kept, config.sonar_cone)
    return HeldOutSonar(make_poses(config.sonar, kept.origin, kept.angle, view, kept.range), config.sonar)


def predict_by_draws(draws: Draws, cones: HeldOutSonar) -> SonarPrediction:
    """Return the density averaged over draws."""
    model = cones.model.to_array()
    sensors, sensor = np.unique(cones.origin, axis=0, return_inverse=True)
    black = np.ascontiguousarray(black_at_draws(draws, sensors)[:, sensor.reshape(-1)])
    total = np.zeros(len(cones.pose))
    for draw, occupied in zip(draws, black, strict=True):
        add_sonar_densities(scene_of_coloring(draw, cones.model.max_range), model, cones.pose, occupied, total)
    return SonarPrediction({"": total / len(draws)}, float(black.mean()))


def predict_by_region(region: BaseGeometry, window: Window | None, cones: HeldOutSonar) -> SonarPrediction:
    """Return the density of the one map whose occupied area is `region`."""
    black = shapely.contains_xy(region, cones.origin)
    scene = scene_of_region(region, window, cones.origin, cones.model.max_range)
    density = np.zeros(len(cones.pose))
    add_sonar_densities(scene, cones.model.to_array(), cones.pose, black, density)
    return SonarPrediction({"": density}, float(black.mean()))


def predict_by_cells(grid: OccupancyGrid, cones: HeldOutSonar) -> SonarPrediction:
    """Return the densities that the contours of a grid give, and that first hits among its cells give."""
    contours = predict_by_region(contours_of(grid), grid.window, cones)
    first_hit = np.empty(len(cones.pose))
    occupancy, model = grid.occupancy.astype(np.float64), cones.model
    # A cell returns the pulse as surely as a wall at no distance, face on.
    stray = 1.0 / (1.0 + math.exp(model.surface_bias))
    grid_cones(grid.cells, occupancy, model.to_array(), stray, BIN, cones.pose, first_hit)
    return SonarPrediction({"contours": contours.density[""], "first_hit": first_hit}, contours.share_occupied)


def contours_of(grid: OccupancyGrid) -> BaseGeometry:
    """Return the area of all cells above 0.5, its staircases straightened."""
    return area_of_cells(grid.occupancy > OCCUPIED, grid.origin, grid.resolution)


def sonar_scores(prediction: SonarPrediction, cones: HeldOutSonar, n_outside: int) -> dict[str, Any]:
    """Return ``sonar_nll`` (nats) and its companions; the better one where there are several ways."""
    with np.errstate(divide="ignore"):
        found = {way: -float(np.log(density).mean()) for way, density in prediction.density.items()}
    ways = {f"sonar_nll_{way}": value for way, value in found.items() if way}
    return {
        "n_readings": len(cones.pose),
        "n_readings_outside": n_outside,
        "n_readings_no_return": int(np.count_nonzero(np.isinf(cones.range))),
        "sonar_nll": min(found.values()),
        **ways,
        "sonar_sensor_occupied": prediction.share_occupied,
        "sonar_max_range": cones.model.max_range,
    }
