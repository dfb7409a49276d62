"""From logs and a map to fitted parameters: which readings can be used, and what they say."""

from __future__ import annotations

import logging
import math
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from prf.calibrate.fit import Family, Fit, fit, held_out_loss
from prf.calibrate.laser import LaserProblem
from prf.calibrate.sonar import SonarProblem, sonar_problem
from prf.configuration import Configuration
from prf.logs import Readings, thin
from prf.logs.describe import default_max_range
from prf.logs.rings import fields_of_view
from prf.score import OccupiedArea, ScoreConfig, hold_out_sonar
from prf.score.scene import enclosing_window, features_seen, outline, scene_of_region
from prf.score.trace import first_edges
from prf.sensors.laser import LaserModel, unit_vectors, window_exit
from prf.sensors.sonar import SonarModel
from prf.shell.errors import InputError

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

logger = logging.getLogger(__name__)

FOLDS = 5
"""Parts of the scans that are held out in turn."""
GAIN = 0.01
"""Nats a reading by which a map must explain readings better than no map at all, else something does not fit."""


class Calibrated(NamedTuple):
    """What came of a log.

    Attributes
    ----------
    kind : str
        sonar or laser.
    family : Family
    fit : Fit
    max_range : float
        Metres.
    cone : float
        Full field of view of most of the sonars, radians; nan for a laser.
    n_readings, n_scans, n_outside, n_occupied, n_in_view : int
        Used; their scans; dropped because the sensor stands outside the map, or in a wall; used with a wall in view.
    no_map : float
        -log likelihood, nats, of the readings that are used, fitted without any map.
    held_out : (2,) float64
        Mean -log likelihood of readings that a fit had not seen, nats: with the defaults, with the fits.
    folds : int
    """

    kind: str
    family: Family
    fit: Fit
    max_range: float
    cone: float
    n_readings: int
    n_scans: int
    n_outside: int
    n_occupied: int
    n_in_view: int
    no_map: float
    held_out: Floats
    folds: int


class _Used(NamedTuple):
    """Readings whose sensor stands in the white of the map, and how many do not."""

    readings: Readings
    n_outside: int
    n_occupied: int


def calibrate_sonar(
    readings: Readings, area: OccupiedArea, config: Configuration, rng: np.random.Generator
) -> Calibrated:
    """Return the sonar's parameters that explain readings in a known map best.

    Parameters
    ----------
    readings : Readings
        The whole log.
    area : OccupiedArea
        The map.
    config : Configuration
    rng : numpy.random.Generator
        Of the folds.

    Raises
    ------
    InputError
        If no reading can be used.
    ConfigError
        If a maximum range or a field of view is none.
    """
    model = SonarModel(config.sonar.max_range)
    used = _usable(readings, area, config)
    cones = hold_out_sonar(used.readings, ScoreConfig(sonar=model, sonar_cone=config.sonar.cone))
    scene = scene_of_region(area.region, area.window, cones.origin, model.max_range)
    start, feature = features_seen(scene, cones.pose, model.max_range)
    problem = sonar_problem(cones.range, start, feature, model.max_range)
    view = fields_of_view(used.readings, config.sonar.cone)
    return _fitted("sonar", problem, used, np.any(problem.there, axis=1), float(np.median(view)), rng)


def calibrate_laser(
    readings: Readings, area: OccupiedArea, config: Configuration, rng: np.random.Generator
) -> Calibrated:
    """Return the laser's parameters that explain readings in a known map best; see :func:`calibrate_sonar`."""
    max_range = default_max_range(readings) if config.laser.max_range is None else config.laser.max_range
    if not math.isfinite(max_range):
        raise InputError(f"{readings.source}: no reading has a finite range. Give --max-range.")
    LaserModel(max_range)
    used = _usable(readings, area, config)
    direction = unit_vectors(used.readings.angle)
    origin = used.readings.origin
    reach = np.full(len(origin), max_range)
    if area.window is not None:
        reach = np.minimum(reach, window_exit(area.window, origin, direction))
    rays = np.ascontiguousarray(np.column_stack([origin, direction, reach]))
    window = area.window or enclosing_window(origin, max_range, area.region)
    distance = first_edges(rays, outline(area.region, area.window)[0], window)
    ranges = np.where(used.readings.range < max_range, used.readings.range, np.inf)
    problem = LaserProblem(ranges, distance, max_range)
    return _fitted("laser", problem, used, np.isfinite(distance), math.nan, rng)


def _usable(readings: Readings, area: OccupiedArea, config: Configuration) -> _Used:
    """Return the readings that the map says something of."""
    chosen = config.readings
    kept = thin(readings, chosen.every_scan, chosen.every_beam, chosen.scans, chosen.skip_scans)
    inside = np.ones(kept.n_beams, np.bool_)
    if area.window is not None:
        inside = area.window.contains(kept.origin, strictly=True)
    occupied = inside & shapely.contains_xy(area.region, kept.origin)
    used = kept.select(inside & ~occupied)
    n_outside, n_occupied = int(np.count_nonzero(~inside)), int(np.count_nonzero(occupied))
    if used.n_beams == 0:
        raise InputError(
            f"{readings.source}: none of {kept.n_beams} readings can be used: {n_outside} sensors stand outside the "
            f"map and {n_occupied} in its walls. Are log and map in one frame, metres and radians?"
        )
    for n, where in ((n_outside, "outside the map"), (n_occupied, "in a wall of the map")):
        if n:
            logger.warning(f"{n} of {kept.n_beams} readings dropped: their sensors stand {where}")
    return _Used(used, n_outside, n_occupied)


def _fitted(
    kind: str,
    problem: SonarProblem | LaserProblem,
    used: _Used,
    in_view: Bools,
    cone: float,
    rng: np.random.Generator,
) -> Calibrated:
    """Return the fit with its checks."""
    source, scan = used.readings.source, used.readings.scan
    if not in_view.any():
        raise InputError(
            f"{source}: no wall of the map is in view of any of {problem.n} readings. Are log and map in one frame?"
        )
    found = fit(problem)
    no_map = fit(problem.without_map()).loss
    if no_map - found.loss < GAIN * problem.n:
        logger.warning(f"{source}: the map explains the readings no better than no map at all. Are both in one frame?")
    if not found.converged:
        logger.warning(f"{source}: the search for the best parameters stopped early")
    n_scans = len(np.unique(scan))
    # Readings of one scan stay together, if there are scans enough to hold some out.
    group = scan if n_scans >= 2 else np.arange(problem.n)
    n_folds = min(FOLDS, len(np.unique(group)))
    held_out = held_out_loss(problem, found.theta, group, n_folds, rng) if n_folds >= 2 else np.full(2, math.nan)
    return Calibrated(
        kind,
        problem.family,
        found,
        problem.max_range,
        cone,
        problem.n,
        n_scans,
        used.n_outside,
        used.n_occupied,
        int(np.count_nonzero(in_view)),
        no_map,
        held_out,
        n_folds,
    )
