"""The likelihood of sonar readings as a function of the sonar's parameters, the features in each cone given."""

from __future__ import annotations

import dataclasses
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import special

from prf.calibrate.fit import Family
from prf.calibrate.gauss import hit, mixed, share_slopes, shares, spread
from prf.kernels.sonar_features import CORNER, DEPTH, KIND, PROJECTION, SUBTENDED
from prf.sensors.sonar import SonarModel

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

NAMES = tuple(field.name for field in dataclasses.fields(SonarModel) if field.name != "max_range")
N = {name: i for i, name in enumerate(NAMES)}
PLAIN = {"corner_bias", "surface_bias"}
SHARES = ("uniform_probability", "short_probability")
WIDTH = {**dict.fromkeys(NAMES, 1.0), **dict.fromkeys(PLAIN, 2.0), **dict.fromkeys(SHARES, 2.0)}
"""Of the priors: a factor of e either way; 2 in log odds."""

LEAST = 1e-300
"""Densities are kept above, so that a step of the search too far still has a likelihood."""


def natural(theta: Floats) -> Floats:
    """Return the parameters in the order of :data:`NAMES`."""
    value = np.array([theta[N[name]] if name in PLAIN else math.exp(theta[N[name]]) for name in NAMES])
    both = [N[name] for name in SHARES]
    value[both] = shares(theta[both])[:2]
    return value


def to_scale(model: SonarModel) -> Floats:
    """Return the point on the scale of the fit whose :func:`natural` parameters are those of `model`."""
    missed = 1.0 - model.uniform_probability - model.short_probability
    plain = [getattr(model, name) / (missed if name in SHARES else 1.0) for name in NAMES]
    return np.array([x if name in PLAIN else math.log(x) for name, x in zip(NAMES, plain, strict=True)])


def model_at(theta: Floats, max_range: float) -> SonarModel:
    """Return the sonar model at a point on the scale of the fit."""
    return SonarModel(max_range, **dict(zip(NAMES, natural(theta).tolist(), strict=True)))


class _Seen(NamedTuple):
    """The features of all readings in a row; columns as in :class:`SonarProblem`."""

    depth: Floats
    oblique: Floats
    subtended: Floats
    corner: Bools

    def log_odds(self, value: dict[str, float]) -> Floats:
        """Return the log odds of a return from each feature alone."""
        corner = value["corner_bias"] - value["corner_distance"] * self.depth
        surface = value["surface_bias"] - value["surface_distance"] * self.depth
        surface += value["surface_subtended"] * self.subtended - value["surface_oblique"] * self.oblique
        return np.where(self.corner, corner, surface)

    def add_slopes(self, gradient: Floats, value: dict[str, float], slope: Floats) -> None:
        """Add what the changes of the features' log odds, of this `slope` each, come to."""
        for kind, mask in (("corner", self.corner), ("surface", ~self.corner)):
            gradient[N[f"{kind}_bias"]] += slope[mask].sum()
            gradient[N[f"{kind}_distance"]] -= value[f"{kind}_distance"] * (slope * self.depth)[mask].sum()
        wall = slope * ~self.corner
        gradient[N["surface_oblique"]] -= value["surface_oblique"] * (wall * self.oblique).sum()
        gradient[N["surface_subtended"]] += value["surface_subtended"] * (wall * self.subtended).sum()


class SonarProblem(NamedTuple):
    """Readings and the features in their cones, one row a reading, nearest feature first, short rows filled up.

    Attributes
    ----------
    reading : (n,) float64
        Metres; inf for no return.
    depth, oblique, subtended : (n, m) float64
        Metres; radians away from face on; radians.
    corner, there : (n, m) bool
        Kind of the feature; whether there is one.
    max_range : float
        Metres.
    """

    reading: Floats
    depth: Floats
    oblique: Floats
    subtended: Floats
    corner: Bools
    there: Bools
    max_range: float

    @property
    def family(self) -> Family:
        """Return the eleven parameters; the maximum range is given."""
        width = np.array([WIDTH[name] for name in NAMES])
        start = to_scale(SonarModel())
        return Family(NAMES, start, width, natural, (N["noise"], N["noise_relative"]))

    @property
    def n(self) -> int:
        """Return how many readings there are."""
        return len(self.reading)

    def select(self, rows: Bools) -> SonarProblem:
        """Return the readings that a mask (n,) picks."""
        return self._replace(
            reading=self.reading[rows],
            depth=self.depth[rows],
            oblique=self.oblique[rows],
            subtended=self.subtended[rows],
            corner=self.corner[rows],
            there=self.there[rows],
        )

    def without_map(self) -> SonarProblem:
        """Return the same readings with nothing in view."""
        return self._replace(there=np.zeros_like(self.there))

    def loss(self, theta: Floats, is_sharp: bool = False) -> tuple[float, Floats]:
        """Return -log likelihood, nats, and its gradient (11,); see :class:`prf.calibrate.fit.Problem`."""
        value = dict(zip(NAMES, natural(theta).tolist(), strict=True))
        there = self.there
        at = _Seen(self.depth[there], self.oblique[there], self.subtended[there], self.corner[there])
        s, first = spread(value["noise"], value["noise_relative"], at.depth, is_sharp)
        reading = np.broadcast_to(self.reading[:, None], there.shape)[there]
        hit_density, by_s = hit(reading, at.depth, s, self.max_range)
        q, echo = self._laid_out(special.expit(at.log_odds(value))), self._laid_out(hit_density)
        left = np.cumprod(np.column_stack([np.ones(self.n), 1.0 - q]), axis=1)
        stray, stray_slopes = self._stray(theta)
        part = left[:, :-1] * q * echo
        after = np.cumsum(part[:, ::-1], axis=1)[:, ::-1] - part + (left[:, -1] * stray)[:, None]
        density = np.maximum(part.sum(axis=1) + left[:, -1] * stray, LEAST)
        gradient = np.zeros(len(NAMES))
        share = 1.0 / density[:, None]
        at.add_slopes(gradient, value, (share * (part * (1.0 - q) - q * after))[there])
        by_log_s = (share * left[:, :-1] * q)[there] * by_s * s  # both noises are fitted by their logarithms
        gradient[N["noise"]] = (by_log_s * first).sum()
        gradient[N["noise_relative"]] = (by_log_s * (1.0 - first)).sum()
        stray_share = left[:, -1] / density
        for name, slope in stray_slopes.items():
            gradient[N[name]] = (stray_share * slope).sum()
        return -float(np.log(density).sum()), -gradient

    def _laid_out(self, values: Floats) -> Floats:
        """Return values of the features that there are as (n, m), 0 elsewhere."""
        rows = np.zeros(self.there.shape)
        rows[self.there] = values
        return rows

    def _stray(self, theta: Floats) -> tuple[Floats, dict[str, Floats]]:
        """Return the density of each reading if no feature returned the pulse, and its derivatives by theta."""
        both = [N[name] for name in SHARES]
        share = shares(theta[both])
        rate = math.exp(-theta[N["short_length"]])
        returned = np.isfinite(self.reading)
        z = np.where(returned, self.reading, self.max_range)
        decay = np.exp(-rate * z)
        uniform = np.where(returned, 1.0 / self.max_range, 0.0)
        short = np.where(returned, rate * decay, decay)
        columns = np.stack([uniform, short, np.where(returned, 0.0, 1.0)], axis=1)
        by_odds = mixed(columns, share_slopes(share))
        by_rate = np.where(returned, decay * (1.0 - rate * z), -z * decay)
        slopes = {name: by_odds[:, k] for k, name in enumerate(SHARES)}
        return mixed(columns, share), {**slopes, "short_length": -rate * share[1] * by_rate}


def sonar_problem(reading: Floats, start: NDArray[np.int64], feature: Floats, max_range: float) -> SonarProblem:
    """Return the problem of readings (n,) and their features as :func:`prf.score.scene.features_seen` lists them."""
    count = np.diff(start)
    there = np.arange(max(1, int(count.max(initial=0)))) < count[:, None]
    rows = np.zeros((*there.shape, feature.shape[1]))
    rows[there] = feature
    depth = np.where(there, rows[..., DEPTH], 1.0)
    return SonarProblem(
        reading=np.where(reading < max_range, reading, np.inf),
        depth=depth,
        oblique=np.where(there, 0.5 * math.pi - rows[..., PROJECTION], 0.0),
        subtended=rows[..., SUBTENDED],
        corner=rows[..., KIND] == CORNER,
        there=there,
        max_range=max_range,
    )
