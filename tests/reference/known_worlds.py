"""Offices with sensors in them, and readings drawn from the written densities with parameters that are known."""

from __future__ import annotations

import functools
import math
from typing import NamedTuple

import numpy as np

from prf.model.coloring import Coloring, black_at, occupied_polygons
from prf.model.ranges import make_poses, window_exit
from prf.model.window import Window
from prf.readings import Readings
from prf.results.score import OccupiedArea
from prf.results.score.scene import features_seen, first_edges, scene_of_coloring
from tests.reference.beams import Sensor, draw_readings
from tests.reference.slow_sonar import Feature, Ring, draw_reading
from tests.reference.sonar_worlds import model_of, random_office

HALL = Window(0.0, 0.0, 14.0, 10.0)
TRUE_RING = Ring(3.5, 0.05, 0.03, (0.5, 0.8), (1.5, 0.25, 9.0, 4.0), 0.35, 0.15, 0.3)
TRUE_LASER = Sensor(8.0, 0.04, 0.02, 0.1, 0.06)
"""Unlike the defaults in every parameter."""


class Known(NamedTuple):
    """A map and a log of it."""

    area: OccupiedArea
    readings: Readings


def office(seed: int) -> Coloring:
    return random_office(HALL, 9, 7, np.random.default_rng(seed))


def free_places(coloring: Coloring, n: int, rng: np.random.Generator) -> np.ndarray:
    places = rng.uniform(HALL[:2], HALL[2:], (3 * n, 2))
    return places[~black_at(coloring, places)][:n]


@functools.cache
def sonar_log(seed: int, n_scans: int, ring: Ring = TRUE_RING) -> Known:
    """Rings of 16 cones of 0.4 rad at random places and headings."""
    rng = np.random.default_rng([seed, 1])  # not the one that drew the office
    coloring = office(seed)
    places = free_places(coloring, n_scans, rng)
    angle = (rng.uniform(-math.pi, math.pi, (len(places), 1)) + 2.0 * math.pi * np.arange(16) / 16).ravel()
    origin, cone = np.repeat(places, 16, axis=0), np.full(len(angle), 0.4)
    pose = make_poses(model_of(ring), origin, angle, cone, np.ones(len(angle)))
    start, rows = features_seen(scene_of_coloring(coloring, ring.max), pose, ring.max)
    readings = [
        draw_reading(ring, [Feature(*row[:3].tolist(), bool(row[3])) for row in rows[start[k] : start[k + 1]]], rng)
        for k in range(len(angle))
    ]
    log = Readings.from_arrays(origin, angle, readings, cone=cone, scan=np.repeat(np.arange(len(places)), 16))
    return Known(OccupiedArea(occupied_polygons(coloring), HALL), log)


@functools.cache
def laser_log(seed: int, n_scans: int, sensor: Sensor = TRUE_LASER) -> Known:
    rng = np.random.default_rng([seed, 1])  # not the one that drew the office
    coloring = office(seed)
    places = free_places(coloring, n_scans, rng)
    angle = (rng.uniform(-math.pi, math.pi, (len(places), 1)) + 2.0 * math.pi * np.arange(60) / 60).ravel()
    origin = np.repeat(places, 60, axis=0)
    window = coloring.window
    direction = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    reach = np.minimum(window_exit(window, origin, direction), sensor.max)
    rays = np.ascontiguousarray(np.column_stack([origin, direction, reach]))
    distance = first_edges(rays, coloring.segments(), window)
    log = Readings.from_arrays(
        origin, angle, draw_readings(sensor, distance, rng), scan=np.repeat(np.arange(len(places)), 60)
    )
    return Known(OccupiedArea(occupied_polygons(coloring), HALL), log)
