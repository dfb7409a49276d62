"""The likelihood of laser readings as a function of the laser's parameters, the first obstacle on each beam given."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from prf.calibrate.fit import Family
from prf.calibrate.gauss import hit, mixed, share_slopes, shares, spread
from prf.sensors.laser import LaserModel

Floats = NDArray[np.float64]

NAMES = ("noise", "noise_relative", "outlier_probability", "miss_probability")
WIDTH = np.array([1.0, 1.0, 2.0, 2.0])


def natural(theta: Floats) -> Floats:
    """Return the parameters in the order of :data:`NAMES`."""
    return np.concatenate([np.exp(theta[:2]), shares(theta[2:])[:2]])


def to_scale(model: LaserModel) -> Floats:
    """Return the point on the scale of the fit whose :func:`natural` parameters are those of `model`."""
    odds = (model.outlier_probability / model.hit_probability, model.miss_probability / model.hit_probability)
    return np.log([model.noise, model.noise_relative, *odds])


class LaserProblem(NamedTuple):
    """Readings and the distances at which their beams meet the map.

    Attributes
    ----------
    reading, distance : (n,) float64
        Metres; inf for no return, and for no obstacle below the maximum range.
    max_range : float
        Metres.
    """

    reading: Floats
    distance: Floats
    max_range: float

    @property
    def family(self) -> Family:
        """Return the four parameters; the maximum range is given."""
        return Family(NAMES, to_scale(LaserModel(self.max_range)), WIDTH, natural, (0, 1))

    @property
    def n(self) -> int:
        """Return how many readings there are."""
        return len(self.reading)

    def select(self, rows: NDArray[np.bool_]) -> LaserProblem:
        """Return the readings that a mask (n,) picks."""
        return LaserProblem(self.reading[rows], self.distance[rows], self.max_range)

    def without_map(self) -> LaserProblem:
        """Return the same readings with nothing in view."""
        return self._replace(distance=np.full(self.n, math.inf))

    def loss(self, theta: Floats, is_sharp: bool = False) -> tuple[float, Floats]:
        """Return -log likelihood, nats, and its gradient (4,); see :class:`prf.calibrate.fit.Problem`."""
        noise, relative = np.exp(theta[:2]).tolist()
        share = shares(theta[2:])
        met, returned = self.distance < self.max_range, np.isfinite(self.reading)
        depth = np.where(met, self.distance, self.max_range)
        s, first = spread(noise, relative, depth, is_sharp)
        echo, by_s = hit(self.reading, depth, s, self.max_range)
        echo = np.where(met, echo, np.where(returned, 0.0, 1.0))
        uniform = np.where(returned, 1.0 / self.max_range, 0.0)
        columns = np.stack([uniform, np.where(returned, 0.0, 1.0), echo], axis=1)
        density = mixed(columns, share)
        by_log_s = np.where(met, share[2] * by_s * s / density, 0.0)
        by_odds = (mixed(columns, share_slopes(share)) / density[:, None]).sum(axis=0)
        gradient = np.array([(by_log_s * first).sum(), (by_log_s * (1.0 - first)).sum(), *by_odds])
        return -float(np.log(density).sum()), -gradient
