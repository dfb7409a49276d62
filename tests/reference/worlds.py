"""Small worlds with a laser in them: maps drawn exactly from the prior, readings drawn from the written density."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from prf.model.arak import exact_draws
from prf.model.coloring import Coloring, black_at
from prf.model.sensors import LaserModel
from prf.model.window import Window
from prf.sampler.target import LaserData, laser_data
from tests.reference.beams import Sensor, draw_readings, impacts


class World(NamedTuple):
    """A map and what a laser read in it."""

    coloring: Coloring
    data: LaserData


def model_of(sensor: Sensor) -> LaserModel:
    return LaserModel(sensor.max, sensor.noise, sensor.relative, sensor.outlier, sensor.miss, sensor.weight)


def draw_white(scale: float, window: Window, place: np.ndarray, rng: np.random.Generator) -> Coloring:
    """A draw of the prior in which all these places (n, 2) are white."""
    while True:
        coloring = exact_draws(scale, window, 1, rng)[0]
        if not black_at(coloring, place).any():
            return coloring


def draw_world(
    scale: float, window: Window, sensor: Sensor, n_sensors: int, n_beams: int, rng: np.random.Generator
) -> World:
    """Sensors uniform in the window, then maps until all stand in white, then beams all round and their readings."""
    place = rng.uniform(window[:2], window[2:], (n_sensors, 2))
    return read_world(draw_white(scale, window, place, rng), place, sensor, n_beams, rng)


def read_world(coloring: Coloring, place: np.ndarray, sensor: Sensor, n_beams: int, rng: np.random.Generator) -> World:
    """Beams all round from each of these places (n, 2), and their readings."""
    angle = np.concatenate([rng.uniform(-np.pi, np.pi) + 2.0 * np.pi / n_beams * np.arange(n_beams) for _ in place])
    origin = np.repeat(place, n_beams, axis=0)
    readings = draw_readings(sensor, impacts(coloring, origin, angle, sensor.max), rng)
    return World(coloring, laser_data(origin, angle, readings, model_of(sensor)))


def office(data_dir: Path, every_scan: int, every_beam: int) -> tuple[Window, LaserData]:
    """The demo log, thinned, in the window of the demo office."""
    from prf.readings.ground import thin
    from prf.readings.open import read_readings

    readings = thin(read_readings(str(data_dir / "demo-office.log.gz")), every_scan=every_scan, every_beam=every_beam)
    return Window(-1.0, -1.0, 23.0, 15.0), laser_data(readings.origin, readings.angle, readings.range, LaserModel(29.0))
