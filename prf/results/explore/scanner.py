"""The sensor with which a run looked, as far as its readings and settings show it: what the next scan is taken with."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from prf.model.ranges import unit_vectors, window_exit
from prf.model.sensors import LaserModel, SonarModel
from prf.model.window import Window
from prf.readings import Readings
from prf.results.run import RunData
from prf.results.score.scene import first_edges

WHOLE_TURN = 1.9 * math.pi
"""Field of view, radians, from which on a sensor looks all round."""

Floats = NDArray[np.float64]


class Scanner(NamedTuple):
    """A range sensor: what decides how much a scan shows.

    Attributes
    ----------
    field_of_view : float
        Radians; 2 pi: all round.
    n_beams : int
        Of a scan.
    max_range, noise, noise_relative : float
        Metres, and of the noise also as a share of the distance; the larger of the two counts.
    outlier_probability, miss_probability : float
        Shares of readings that no wall explains, and of walls that return nothing.
    cone : float
        Full opening angle of a beam, radians; 0 for a laser.
    """

    field_of_view: float
    n_beams: int
    max_range: float
    noise: float
    noise_relative: float
    outlier_probability: float
    miss_probability: float
    cone: float = 0.0

    @property
    def beams_a_turn(self) -> float:
        """How many beams a whole turn would have."""
        return self.n_beams * 2.0 * math.pi / self.field_of_view


def scanner_of(run: RunData) -> Scanner | None:
    """Return the laser of a run, or else its sonar ring; None of a run without readings."""
    settings = run.manifest.get("configuration") or {}
    if run.laser is not None and run.laser.n_beams:
        return _laser(run.laser, run.laser_model())
    return None if run.sonar is None or not run.sonar.n_beams else _ring(run.sonar, settings)


def _laser(laser: Readings, model: LaserModel) -> Scanner:
    view, n_beams = field_of_view(laser)
    errors = (model.noise, model.noise_relative, model.outlier_probability, model.miss_probability)
    return Scanner(view, n_beams, model.limit, *errors)


def _ring(sonar: Readings, settings: Mapping[str, Any]) -> Scanner:
    known = {name: settings[f"sonar_{name}"] for name in SonarModel.model_fields if f"sonar_{name}" in settings}
    model = SonarModel(**known)
    n_beams = int(np.unique(sonar.scan, return_counts=True)[1].max())
    errors = (model.noise, model.noise_relative, model.uniform_probability, model.short_probability)
    cone = float(np.median(sonar.cone)) or model.cone
    return Scanner(2.0 * math.pi, max(n_beams, 8), model.max_range, *errors, cone)


def field_of_view(readings: Readings) -> tuple[float, int]:
    """Return the field of view in radians and the number of beams of a scan: of thinned readings, from all scans.

    A scan leaves a gap in the circle of directions; the smallest gap of any is what the sensor does not see.
    """
    gaps, steps = [], []
    for scan in np.unique(readings.scan):
        angle = np.sort(np.mod(readings.angle[readings.scan == scan], 2.0 * math.pi))
        between = np.diff(angle, append=angle[0] + 2.0 * math.pi)
        gaps.append(float(between.max()))
        steps += np.sort(between)[:-1].tolist()
    step = max(float(np.quantile(steps, 0.05)) if steps else math.pi, 1e-3)
    view = 2.0 * math.pi - min(gaps)
    if view > WHOLE_TURN:
        view = 2.0 * math.pi
    return max(view, step), max(1, round(view / step))


def first_walls(
    segments: list[Floats], window: Window, places: Floats, n_beams: int, scanner: Scanner
) -> NDArray[np.float32]:
    """Return how far each beam of a whole turn sees from each place in each map, (n_maps, n_places, n_beams) float32.

    `segments`: of each map, (n_edges, 4). `places` (n_places, 2). Metres; inf: no wall within the range or the window.
    A cone sees what is nearest in it.
    """
    angle = 2.0 * math.pi * np.arange(n_beams) / n_beams
    origin, direction = np.repeat(places, n_beams, axis=0), np.tile(unit_vectors(angle), (len(places), 1))
    reach = np.minimum(scanner.max_range, window_exit(window, origin, direction))
    rays = np.ascontiguousarray(np.column_stack([origin, direction, reach]))
    found = np.empty((len(segments), len(places), n_beams), np.float32)
    for number, edges in enumerate(segments):
        found[number] = first_edges(rays, edges, window).reshape(len(places), n_beams)
    aside = int(0.5 * scanner.cone * n_beams / (2.0 * math.pi))
    within = [np.roll(found, shift, axis=2) for shift in range(-aside, aside + 1)]
    return np.asarray(np.minimum.reduce(within), np.float32)
