"""Small worlds with sonar in them: maps drawn exactly from the prior, office-like ones, readings from the density."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import shapely

from prf.model.coloring import Coloring
from prf.model.coloring.polygons import from_polygons
from prf.model.sensors import SonarModel
from prf.model.window import Window
from prf.sampler.target import SonarData, sonar_data
from tests.reference.slow_sonar import Cone, Floats, Ring, draw_reading, features, reach_in
from tests.reference.worlds import draw_white


class SonarWorld(NamedTuple):
    """A map and what a sonar read in it."""

    coloring: Coloring
    data: SonarData


def model_of(ring: Ring) -> SonarModel:
    return SonarModel(
        max_range=ring.max,
        noise=ring.noise,
        noise_relative=ring.relative,
        corner_bias=ring.corner[0],
        corner_distance=ring.corner[1],
        surface_bias=ring.surface[0],
        surface_distance=ring.surface[1],
        surface_oblique=ring.surface[2],
        surface_subtended=ring.surface[3],
        uniform_probability=ring.uniform,
        short_probability=ring.short,
        short_length=ring.short_length,
    )


def ring_all_round(place: Floats, n_cones: int, view: float, rng: np.random.Generator) -> list[Cone]:
    """Cones all round each place, turned at random."""
    step = 2.0 * math.pi / n_cones
    return [
        Cone(float(x), float(y), turn + step * k, view)
        for (x, y), turn in zip(place, rng.uniform(-math.pi, math.pi, len(place)), strict=True)
        for k in range(n_cones)
    ]


def data_of(ring: Ring, cones: list[Cone], readings: Floats) -> SonarData:
    rows = np.array(cones).reshape(-1, 4)
    return sonar_data(rows[:, :2].copy(), rows[:, 2].copy(), rows[:, 3].copy(), readings, model_of(ring))


def draw_data(coloring: Coloring, ring: Ring, cones: list[Cone], rng: np.random.Generator) -> SonarData:
    """Readings at random from the written density: nothing is heard from where a cone leaves the window."""
    reach = [reach_in(coloring.window, cone, ring.max) for cone in cones]
    seen = [features(coloring, *there) for there in zip(cones, reach, strict=True)]
    readings = [draw_reading(ring, found, rng, end) for found, end in zip(seen, reach, strict=True)]
    return data_of(ring, cones, np.array(readings))


def draw_sonar_world(
    scale: float, window: Window, ring: Ring, n_sensors: int, n_cones: int, view: float, rng: np.random.Generator
) -> SonarWorld:
    """Sensors uniform in the window, then maps until all stand in white, then cones all round and their readings."""
    place = rng.uniform(window[:2], window[2:], (n_sensors, 2))
    coloring = draw_white(scale, window, place, rng)
    return SonarWorld(coloring, draw_data(coloring, ring, ring_all_round(place, n_cones, view, rng), rng))


def random_office(window: Window, n_walls: int, n_boxes: int, rng: np.random.Generator) -> Coloring:
    """Walls along the axes and turned boxes, united where they overlap."""
    parts = []
    for k in range(n_walls + n_boxes):
        x, y = rng.uniform(window[:2], window[2:])
        length, width = rng.uniform(1.0, 6.0), 0.15 if k < n_walls else rng.uniform(0.2, 1.0)
        turn = 90.0 * rng.integers(2) if k < n_walls else rng.uniform(0.0, 180.0)
        box = shapely.box(x, y, x + (length if k < n_walls else width), y + width)
        parts.append(shapely.affinity.rotate(box, turn, origin=(x, y)))
    return from_polygons(shapely.union_all(parts), window)
