"""Small worlds whose posteriors chains explore in a second: maps of the prior, readings from the written densities.

Every sensor stands in white, and a way driven is free where there is one: worlds of which that is not so are drawn
again, and the posterior is of the prior under that condition, as in the sampler. Noise is blunter than that of real
sensors, so that maps stay unsure.
"""

from __future__ import annotations

import dataclasses
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from prf.model.arak import exact_draws
from prf.model.coloring import Coloring, Draws, black_areas, black_at_draws
from prf.model.layout import make_graph
from prf.model.window import Window
from prf.sampler.chain_map import with_graph
from prf.sampler.posterior import LaserData, Settings, make_chain
from tests.reference.beams import Sensor, draw_readings, impacts
from tests.reference.free_way import is_free
from tests.reference.slow_sonar import Ring
from tests.reference.sonar_worlds import draw_sonar_world
from tests.reference.worlds import draw_world, model_of

Floats = NDArray[np.float64]

ROOM = Window(0.0, 0.0, 4.0, 4.0)
SCALE = 0.15
"""6.9 edges in the mean of the prior."""
SENSOR = Sensor(4.0, noise=0.2, outlier=0.15, miss=0.05)
N_SENSORS, N_BEAMS = 2, 10
DRIVEN_RADIUS = 0.5
RING = Ring(4.0, noise=0.15, surface=(3.0, 0.3, 6.0, 3.0))
N_CONES, VIEW = 6, 0.6
RESOLUTION = 0.25
PLACES = np.array([[0.8, 1.2], [2.0, 2.0], [3.3, 0.9], [1.5, 3.4]])


def names(places: Floats) -> tuple[str, ...]:
    """Return the names of what is compared, the colours at these places among it."""
    colours = [f"colour at ({x:g}, {y:g})" for x, y in places]
    return ("number of edges", "length", "black area", *colours, "log prior", "log likelihood")


NAMES = names(PLACES)
"""Only the log likelihood looks at the readings: without it draws of the prior would pass."""


class Problem(NamedTuple):
    """A posterior, and the map from which its readings were drawn."""

    settings: Settings
    truth: Coloring


class DrawProblem(Protocol):
    """Draws a world and its readings."""

    def __call__(self, rng: np.random.Generator) -> Problem: ...


def laser_problem(rng: np.random.Generator) -> Problem:
    """Two lasers at random, twelve beams each."""
    world = draw_world(SCALE, ROOM, SENSOR, N_SENSORS, N_BEAMS, rng)
    return Problem(Settings(ROOM, SCALE, world.data, resolution=RESOLUTION), world.coloring)


def sonar_problem(rng: np.random.Generator) -> Problem:
    """Two sonar rings at random, six cones each."""
    world = draw_sonar_world(SCALE, ROOM, RING, N_SENSORS, N_CONES, VIEW, rng)
    return Problem(Settings(ROOM, SCALE, sonar=world.data, resolution=RESOLUTION), world.coloring)


def driven_problem(rng: np.random.Generator) -> Problem:
    """Two lasers at random, each driven on for two metres."""
    place, to = rng.uniform(0.5, 3.5, (N_SENSORS, 2)), rng.uniform(-np.pi, np.pi, N_SENSORS)
    way = np.hstack([place, np.clip(place + 2.0 * np.column_stack([np.cos(to), np.sin(to)]), 0.1, 3.9)])
    origin, angle = np.repeat(place, N_BEAMS, axis=0), rng.uniform(-np.pi, np.pi, N_SENSORS * N_BEAMS)
    unread = LaserData.from_arrays(origin, angle, np.full(len(angle), np.inf), model_of(SENSOR))
    settings = Settings(ROOM, SCALE, unread, resolution=RESOLUTION, way=way, driven_radius=DRIVEN_RADIUS)
    while True:
        world = exact_draws(SCALE, ROOM, 1, rng)[0]
        if is_free(settings, world):
            break
    readings = draw_readings(SENSOR, impacts(world, origin, angle, SENSOR.max), rng)
    laser = LaserData.from_arrays(origin, angle, readings, model_of(SENSOR))
    return Problem(dataclasses.replace(settings, laser=laser), world)


PROBLEMS: dict[str, DrawProblem] = {"laser": laser_problem, "sonar": sonar_problem}


def from_map(draws: Draws, places: Floats = PLACES) -> Floats:
    """Return what does not look at readings or prior, (n_draws, len(places) + 3)."""
    colours = black_at_draws(draws, places)
    return np.column_stack([draws.n_edges, draws.total_length(), black_areas(draws), colours]).astype(np.float64)


def values(settings: Settings, draws: Draws) -> Floats:
    """Return all that is compared, (n_draws, len(NAMES)); densities by the kernels, from the map alone."""
    chain = make_chain(settings, Coloring.empty(settings.window))
    sums = []
    for draw in draws:
        graph = make_graph(draw, 2 * draw.n_vertices + 64)
        sums.append(with_graph(chain, settings, graph).graph.sums[1:].copy())
    return np.column_stack([from_map(draws), np.array(sums).reshape(len(draws), 2)])
