"""Integrals over uncertain poses by adaptive importance sampling, many at once.

Cornuet, Marin, Mira and Robert (2012), Adaptive multiple importance sampling, Scandinavian Journal of Statistics 39:
every sample of every stage counts, its weight being the target over the mixture of all proposals. Errors are in units
of their prior, a standard normal in three dimensions, which is one of the proposals: no weight exceeds the likelihood
by much. A likelihood is tempered until some samples share its weight, so that proposals close in on a narrow one.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Target = Callable[[Ints, Floats], Floats]
"""Log likelihoods (k, n) of errors (k, n, 3) of the scans with these numbers (n,)."""

SEARCH, WIDE = 256, 9.0
"""Samples where nothing else is known, and how much wider than the prior: stated errors may be too small."""
FROM_PRIOR, AT_ONCE = 16, 24
"""Samples from the prior, and from each further proposal."""
MOST_STAGES = 12
TEMPERED = 25.0
"""Effective samples that the likelihood is tempered to have before a normal is fitted."""
WIDER = 3.0
"""Factor of fitted covariances: beams that jump from wall to wall make a likelihood rough, with modes side by side."""
RIDGE = 1e-3
"""Added to the normal equations of a fit."""
FARTHEST = 4.0
"""Standard deviations of the samples by which the mode of a fit may lie beyond their mean."""
LEAST = 1e-12
"""Variance that a fit has at least, in units of the prior's."""


class Normals(NamedTuple):
    """A normal of errors for each of n scans."""

    mean: Floats  # (n, 3)
    covariance: Floats  # (n, 3, 3)

    @classmethod
    def prior(cls, n: int) -> Normals:
        """Return standard normals."""
        return cls(np.zeros((n, 3)), np.broadcast_to(np.eye(3), (n, 3, 3)))

    def of(self, some: Ints | NDArray[np.bool_]) -> Normals:
        """Return those of some scans."""
        return Normals(self.mean[some], self.covariance[some])

    def draw(self, k: int, rng: np.random.Generator) -> Floats:
        """Return errors (k, n, 3)."""
        factor = np.linalg.cholesky(self.covariance)
        return np.asarray(self.mean + np.einsum("nij,knj->kni", factor, rng.standard_normal((k, len(self.mean), 3))))

    def log_density(self, errors: Floats) -> Floats:
        """Return the log densities (k, n) of errors (k, n, 3)."""
        factor = np.linalg.cholesky(self.covariance)
        z = np.linalg.solve(factor, np.moveaxis(errors - self.mean, 0, -1))  # (n, 3, k)
        scale = np.log(np.diagonal(factor, axis1=1, axis2=2)).sum(axis=1) + 1.5 * np.log(2.0 * np.pi)
        return np.asarray((-0.5 * (z**2).sum(axis=1) - scale[:, None]).T)


class Integrals(NamedTuple):
    """Of each of n scans: the likelihood integrated over the prior, and the posterior of its error."""

    log_value: Floats  # (n,)
    posterior: Normals
    ess: Floats  # (n,) effective samples


class _Samples:
    """Samples of some scans, and the proposals that they are from."""

    def __init__(self, scans: Ints) -> None:
        n = len(scans)
        self.scans = scans
        self.errors, self.log_target, self.log_mixture = np.empty((0, n, 3)), np.empty((0, n)), np.empty((0, n))
        self.proposals: list[tuple[int, Normals]] = []

    def add(self, k: int, proposal: Normals, target: Target, rng: np.random.Generator) -> None:
        """Draw k samples from a proposal."""
        fresh = proposal.draw(k, rng)
        log_target = target(self.scans, fresh) + Normals.prior(len(self.scans)).log_density(fresh)
        self.log_target = np.concatenate([self.log_target, log_target])
        mixed = np.logaddexp(self.log_mixture, np.log(k) + proposal.log_density(self.errors))
        self.proposals.append((k, proposal))
        own = [np.log(size) + each.log_density(fresh) for size, each in self.proposals]
        self.log_mixture = np.concatenate([mixed, np.logaddexp.reduce(own)])
        self.errors = np.concatenate([self.errors, fresh])

    def integrals(self) -> Integrals:
        """Return what the samples say."""
        log_weight = self.log_target - self.log_mixture
        total = logsumexp(log_weight, axis=0)
        weight = np.exp(log_weight - total)
        return Integrals(np.asarray(total), _fitted(self.errors, weight), 1.0 / (weight**2).sum(axis=0))

    def next_proposal(self) -> Normals:
        """Return normals round the modes, as a quadratic has them that is fitted to the best samples so far."""
        weight = _tempered(self.log_target - self.log_mixture)
        middle = _fitted(self.errors, weight)
        factor = np.linalg.cholesky(middle.covariance)
        z = np.moveaxis(np.linalg.solve(factor, np.moveaxis(self.errors - middle.mean, 0, -1)), 1, -1)  # (n, k, 3)
        slope, precision = _quadratic(z, self.log_target.T, weight.T)
        value, axes = np.linalg.eigh(precision)
        spread = (axes / np.maximum(value, 1.0)[:, None]) @ np.moveaxis(axes, 1, 2)  # never beyond that of the samples
        step = np.einsum("nij,nj->ni", spread, slope)
        step *= np.minimum(1.0, FARTHEST / np.maximum(np.linalg.norm(step, axis=1, keepdims=True), FARTHEST))
        mean = middle.mean + np.einsum("nij,nj->ni", factor, step)
        return Normals(mean, WIDER * factor @ spread @ np.moveaxis(factor, 1, 2) + LEAST * np.eye(3))

    def keep(self, some: NDArray[np.bool_]) -> None:
        """Go on with some of the scans."""
        self.scans, self.errors = self.scans[some], self.errors[:, some]
        self.log_target, self.log_mixture = self.log_target[:, some], self.log_mixture[:, some]
        self.proposals = [(k, each.of(some)) for k, each in self.proposals]


def integrate(target: Target, n: int, start: Normals | None, enough: float, rng: np.random.Generator) -> Integrals:
    """Return the integrals of n likelihoods over the prior.

    `start`: where these may have their mass, if known. `enough`: effective samples of an integral after which no more
    are drawn; its logarithm then errs by about one over their square root.
    """
    samples = _Samples(np.arange(n))
    prior = Normals.prior(n)
    samples.add(FROM_PRIOR, prior, target, rng)
    if start is None:
        samples.add(SEARCH, prior._replace(covariance=WIDE * prior.covariance), target, rng)
    else:
        samples.add(AT_ONCE, start, target, rng)
    found = Integrals(np.empty(n), Normals(np.empty((n, 3)), np.empty((n, 3, 3))), np.empty(n))
    for _ in range(MOST_STAGES):
        samples.add(AT_ONCE, samples.next_proposal(), target, rng)
        now = samples.integrals()
        found.log_value[samples.scans], found.ess[samples.scans] = now.log_value, now.ess
        found.posterior.mean[samples.scans] = now.posterior.mean
        found.posterior.covariance[samples.scans] = now.posterior.covariance
        if (now.ess >= enough).all():
            break
        samples.keep(now.ess < enough)
    return found


def pooled(posteriors: Sequence[Normals]) -> Normals:
    """Return for each scan a normal with the mean and covariance of several posteriors together, widened."""
    mean = np.mean([each.mean for each in posteriors], axis=0)
    away = np.array([each.mean for each in posteriors]) - mean
    within = np.mean([each.covariance for each in posteriors], axis=0)
    return Normals(mean, WIDER * (within + np.einsum("mni,mnj->nij", away, away) / len(posteriors)))


def _fitted(errors: Floats, weight: Floats) -> Normals:
    """Return the mean and covariance of weighted samples (k, n, 3)."""
    mean = np.einsum("kn,kni->ni", weight, errors)
    away = errors - mean
    return Normals(mean, np.einsum("kn,kni,knj->nij", weight, away, away) + LEAST * np.eye(3))


def _quadratic(z: Floats, value: Floats, weight: Floats) -> tuple[Floats, Floats]:
    """Return the gradient (n, 3) at 0 and minus the second derivatives (n, 3, 3) of quadratics fitted to values (n, k).

    `z` (n, k, 3), `weight` (n, k): where they are, and how much each counts.
    """
    row, column = np.triu_indices(3)
    terms = np.concatenate([np.ones((*value.shape, 1)), z, z[..., row] * z[..., column]], axis=-1)
    heavy = np.moveaxis(terms * weight[..., None], 1, 2)
    away = value - value.max(axis=1, keepdims=True)
    found = np.linalg.solve(heavy @ terms + RIDGE * np.eye(10), heavy @ away[..., None])[..., 0]
    precision = np.zeros((len(z), 3, 3))
    precision[:, row, column] -= found[:, 4:]
    return found[:, 1:4], precision + np.moveaxis(precision, 1, 2)


def _tempered(log_weight: Floats) -> Floats:
    """Return weights (k, n) of sum 1, to the largest power up to 1 that leaves enough of them effective."""
    top = log_weight - log_weight.max(axis=0)
    low, high = np.zeros(top.shape[1]), np.ones(top.shape[1])
    power = high
    for _ in range(25):
        weight = np.exp(power * top)
        few = weight.sum(axis=0) ** 2 < TEMPERED * (weight**2).sum(axis=0)
        low, high = np.where(few, low, power), np.where(few, power, high)
        power = 0.5 * (low + high)
    weight = np.exp(low * top)
    return np.asarray(weight / weight.sum(axis=0))
