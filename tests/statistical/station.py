"""A laser, a sonar ring and point observations at fixed places, whose readings can be drawn anew for any map."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from prf.model.coloring import Coloring, black_at
from prf.model.window import Window
from prf.sampler.posterior import LaserData, Settings
from tests.reference import beams, slow_points, slow_sonar
from tests.reference.sonar_worlds import draw_data
from tests.reference.worlds import draw_white, model_of

Floats = NDArray[np.float64]


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

    def read(self, coloring: Coloring, rng: np.random.Generator) -> Settings:
        """Return the posterior of readings that are drawn in this map."""
        distance = beams.impacts(coloring, self.origin, self.angle, self.laser.max)
        readings = beams.draw_readings(self.laser, distance, rng)
        laser = LaserData.from_arrays(self.origin, self.angle, readings, model_of(self.laser))
        sonar = draw_data(coloring, self.ring, self.cones, rng)
        points = slow_points.observe(coloring, self.flips, self.xy, rng)
        return Settings(self.window, self.scale, laser, resolution=self.resolution, sonar=sonar, points=points)

    def log_likelihood(self, settings: Settings, coloring: Coloring) -> float:
        """Return what readings say of a map, by the slow oracles; -inf where a sensor stands in black."""
        if black_at(coloring, self.sensors).any():
            return -math.inf
        assert settings.laser is not None
        assert settings.sonar is not None
        assert settings.points is not None
        total = slow_points.log_likelihood(coloring, self.flips, settings.points)
        total += sum(
            beams.log_likelihoods_in(coloring, self.laser, self.origin, self.angle, settings.laser.readings.range)
        )
        for reading, cone in zip(settings.sonar.readings.range.tolist(), self.cones, strict=True):
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
