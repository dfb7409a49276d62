"""Small worlds whose posteriors chains explore in a second: maps of the prior, readings from the written densities.

Every sensor stands in white, and a way driven is free where there is one: worlds of which that is not so are drawn
again, and the posterior is of the prior under that condition, as in the sampler. Noise is blunter than that of real
sensors, so that maps stay unsure.
"""

from __future__ import annotations

import dataclasses
import math
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from prf.model.arak import exact_draws
from prf.model.coloring import Coloring, Draws, black_areas, black_at, black_at_draws
from prf.model.layout import make_graph
from prf.model.window import Window
from prf.sampler.target import Execution, Target, laser_data, make_chain, with_graph
from tests.reference import beams, slow_points, slow_sonar
from tests.reference.beams import Sensor, draw_readings, impacts
from tests.reference.free_way import is_free
from tests.reference.slow_sonar import Ring
from tests.reference.sonar_worlds import draw_data, draw_sonar_world
from tests.reference.worlds import draw_white, draw_world, model_of

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

    target: Target
    truth: Coloring


class DrawProblem(Protocol):
    """Draws a world and its readings."""

    def __call__(self, rng: np.random.Generator) -> Problem: ...


def laser_problem(rng: np.random.Generator) -> Problem:
    """Two lasers at random, twelve beams each."""
    world = draw_world(SCALE, ROOM, SENSOR, N_SENSORS, N_BEAMS, rng)
    return Problem(Target(ROOM, SCALE, world.data, execution=Execution(resolution=RESOLUTION)), world.coloring)


def sonar_problem(rng: np.random.Generator) -> Problem:
    """Two sonar rings at random, six cones each."""
    world = draw_sonar_world(SCALE, ROOM, RING, N_SENSORS, N_CONES, VIEW, rng)
    return Problem(Target(ROOM, SCALE, sonar=world.data, execution=Execution(resolution=RESOLUTION)), world.coloring)


def driven_problem(rng: np.random.Generator) -> Problem:
    """Two lasers at random, each driven on for two metres."""
    place, to = rng.uniform(0.5, 3.5, (N_SENSORS, 2)), rng.uniform(-np.pi, np.pi, N_SENSORS)
    way = np.hstack([place, np.clip(place + 2.0 * np.column_stack([np.cos(to), np.sin(to)]), 0.1, 3.9)])
    origin, angle = np.repeat(place, N_BEAMS, axis=0), rng.uniform(-np.pi, np.pi, N_SENSORS * N_BEAMS)
    unread = laser_data(origin, angle, np.full(len(angle), np.inf), model_of(SENSOR))
    target = Target(
        ROOM, SCALE, unread, way=way, driven_radius=DRIVEN_RADIUS, execution=Execution(resolution=RESOLUTION)
    )
    while True:
        world = exact_draws(SCALE, ROOM, 1, rng)[0]
        if is_free(target, world):
            break
    readings = draw_readings(SENSOR, impacts(world, origin, angle, SENSOR.max), rng)
    laser = laser_data(origin, angle, readings, model_of(SENSOR))
    return Problem(dataclasses.replace(target, laser=laser), world)


PROBLEMS: dict[str, DrawProblem] = {"laser": laser_problem, "sonar": sonar_problem}


def from_map(draws: Draws, places: Floats = PLACES) -> Floats:
    """Return what does not look at readings or prior, (n_draws, len(places) + 3)."""
    colours = black_at_draws(draws, places)
    return np.column_stack([draws.n_edges, draws.total_length(), black_areas(draws), colours]).astype(np.float64)


def values(target: Target, draws: Draws) -> Floats:
    """Return all that is compared, (n_draws, len(NAMES)); densities by the kernels, from the map alone."""
    chain = make_chain(target, Coloring.empty(target.window))
    sums = []
    for draw in draws:
        graph = make_graph(draw, 2 * draw.n_vertices + 64)
        sums.append(with_graph(chain, target, graph).graph.sums[1:].copy())
    return np.column_stack([from_map(draws), np.array(sums).reshape(len(draws), 2)])


# A laser, a sonar ring and point observations at fixed places, whose readings can be drawn anew for any map.


class Station(NamedTuple):
    """Where things are measured, and how.

    Attributes
    ----------
    window : Window
        Lower left corner at 0.
    scale : float
        Of the prior, 1/m.
    laser : Sensor
    origin, angle : (n, 2) and (n,) arrays
        Of the beams.
    ring : Ring
    cones : list of Cone
    flips : Flips
    xy : (n, 2) array
        Places of the point observations.
    resolution : float or None
        Of the occupancy image.
    """

    window: Window
    scale: float
    laser: beams.Sensor
    origin: Floats
    angle: Floats
    ring: slow_sonar.Ring
    cones: list[slow_sonar.Cone]
    flips: slow_points.Flips
    xy: Floats
    resolution: float | None = None

    @property
    def sensors(self) -> Floats:
        """Positions (n, 2) that must stand in white."""
        cones = np.array([(cone.x, cone.y) for cone in self.cones]).reshape(-1, 2)
        return np.unique(np.concatenate([self.origin, cones]), axis=0)

    def draw_map(self, rng: np.random.Generator) -> Coloring:
        """Return an exact draw of the prior, given that every sensor stands in white."""
        return draw_white(self.scale, self.window, self.sensors, rng)

    def read(self, coloring: Coloring, rng: np.random.Generator) -> Target:
        """Return the posterior of readings that are drawn in this map."""
        distance = beams.impacts(coloring, self.origin, self.angle, self.laser.max)
        readings = beams.draw_readings(self.laser, distance, rng)
        laser = laser_data(self.origin, self.angle, readings, model_of(self.laser))
        sonar = draw_data(coloring, self.ring, self.cones, rng)
        points = slow_points.observe(coloring, self.flips, self.xy, rng)
        return Target(
            self.window, self.scale, laser, sonar=sonar, points=points, execution=Execution(resolution=self.resolution)
        )

    def log_likelihood(self, target: Target, coloring: Coloring) -> float:
        """Return what readings say of a map, by the slow oracles; -inf where a sensor stands in black."""
        if black_at(coloring, self.sensors).any():
            return -math.inf
        assert target.laser is not None
        assert target.sonar is not None
        assert target.points is not None
        total = slow_points.log_likelihood(coloring, self.flips, target.points)
        total += sum(
            beams.log_likelihoods_in(coloring, self.laser, self.origin, self.angle, target.laser.readings.range)
        )
        for reading, cone in zip(target.sonar.readings.range.tolist(), self.cones, strict=True):
            reach = slow_sonar.reach_in(self.window, cone, self.ring.max)
            seen = slow_sonar.features(coloring, cone, reach)
            total += slow_sonar.log_likelihood(self.ring, seen, reading, reach)
        return total


def small_station(resolution: float | None = None) -> Station:
    """Five beams, two cones and three points: little enough that maps stay unsure, and walls come and go."""
    beam_angles = np.linspace(-np.pi, np.pi, 5, endpoint=False) + 0.2
    return Station(
        window=Window(0.0, 0.0, 3.0, 3.0),
        scale=0.2,
        laser=beams.Sensor(3.0, noise=0.4, outlier=0.35, miss=0.1),
        origin=np.tile([0.9, 0.8], (5, 1)),
        angle=beam_angles,
        ring=slow_sonar.Ring(2.5, noise=0.3, surface=(2.0, 0.3, 6.0, 3.0), uniform=0.35),
        cones=[slow_sonar.Cone(1.9, 1.7, angle, 0.6) for angle in (-0.6, 1.7)],
        flips=slow_points.Flips(0.3),
        xy=np.array([[0.4, 2.5], [2.6, 0.5], [2.5, 2.7]]),
        resolution=resolution,
    )
