"""Point observations in plain Python: densities as they are written, values drawn from them."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize
from scipy.special import expit

from prf.model.coloring import Coloring, black_at
from prf.model.sensors import PointModel
from prf.sampler.target import PointData, point_data


class Normal(NamedTuple):
    """Equation 5: a normal round the mean of the colour."""

    black: float = 1.0
    white: float = 0.0
    sigma: float = 0.7

    @property
    def model(self) -> PointModel:
        return PointModel("gaussian", self.black, self.white, self.sigma)

    def log_density(self, value: float, black: bool) -> float:
        off = (value - (self.black if black else self.white)) / self.sigma
        return -0.5 * off * off - math.log(self.sigma) - 0.5 * math.log(2.0 * math.pi)

    def draw(self, black: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        return rng.normal(np.where(black, self.black, self.white), self.sigma)


class Flips(NamedTuple):
    """The colour, flipped with a probability."""

    probability: float = 0.25

    @property
    def model(self) -> PointModel:
        return PointModel("binary", flip_probability=self.probability)

    def log_density(self, value: float, black: bool) -> float:
        return math.log(1.0 - self.probability if value == float(black) else self.probability)

    def draw(self, black: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        return (black ^ (rng.random(len(black)) < self.probability)).astype(float)


Law = Normal | Flips


def observe(coloring: Coloring, law: Law, xy: np.ndarray, rng: np.random.Generator) -> PointData:
    """Draw the values at some places of a map."""
    return point_data(xy, law.draw(black_at(coloring, xy), rng), law.model)


def log_likelihood(coloring: Coloring, law: Law, data: PointData) -> float:
    colours = black_at(coloring, data.readings.xy).tolist()
    return sum(
        law.log_density(value, black) for value, black in zip(data.readings.value.tolist(), colours, strict=True)
    )


def most_likely_sigma(values: np.ndarray, black: float, white: float) -> float:
    """Of a mixture of two normals of these means and of one sigma, their share free; by a generic search."""

    def loss(x: np.ndarray) -> float:
        law, share = Normal(black, white, math.exp(x[0])), expit(x[1])
        density = [[math.exp(law.log_density(value, colour)) for colour in (True, False)] for value in values.tolist()]
        return -sum(math.log(share * in_black + (1.0 - share) * in_white) for in_black, in_white in density)

    start = np.array([math.log(np.std(values)), 0.0])
    found = minimize(loss, start, method="Nelder-Mead", options={"xatol": 1e-9, "fatol": 1e-12, "maxiter": 2000})
    return math.exp(found.x[0])


def lattice(n: int, low: float, high: float) -> np.ndarray:
    """Middles of n x n squares between `low` and `high`, row by row."""
    middles = low + (np.arange(n) + 0.5) / n * (high - low)
    return np.column_stack([np.tile(middles, n), np.repeat(middles, n)])
