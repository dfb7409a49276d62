"""Held-out scans whose poses are uncertain: their densities, the poses integrated out (docs/scores.md).

Many integrals at once, by adaptive importance sampling: Cornuet, Marin, Mira and Robert (2012), Adaptive multiple
importance sampling, Scandinavian Journal of Statistics 39: every sample of every stage counts, its weight being the
target over the mixture of all proposals. Errors are in units of their prior, a standard normal in three dimensions,
which is one of the proposals: no weight exceeds the likelihood by much. A likelihood is tempered until some samples
share its weight, so that proposals close in on a narrow one.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from prf.model.ranges import beam_influence
from prf.results.score.heldout import HeldOut
from prf.results.score.maps import ScoredMap
from prf.shell.cli.console import progress

Floats = NDArray[np.float64]

MOST_MAPS = 50
"""Draws of a RUN that scans are scored by, at most."""
ERROR = 0.005
"""Monte Carlo error of beam_nll that is aimed at."""
LEAST_ESS, EFFORT, MOST_ESS = 10.0, 40.0, 100.0
"""Effective samples of an integral after which no more are drawn: at least so many, on all maps together, at most."""
BATCH = 500_000
"""Beams at once, about; each takes some 200 bytes."""


def marginalise(
    scored: ScoredMap, maps: Sequence[ScoredMap], beams: HeldOut, rng: np.random.Generator
) -> tuple[list[HeldOut], Floats, float, float]:
    """Integrate the poses of scans out, on each of the maps of equal weight of `scored` by itself.

    `beams`: of sensors inside the window, with uncertain poses. The density of a scan is that of all its beams together
    averaged over maps.

    Returns the beams of all scans at their mean poses on each map; distances (n_beams,) to the first obstacle of the
    best map, the beams so placed on it (nan: there is none); the mean of -log density over beams, nats; and the
    effective samples of an integral, the median.
    """
    beams, best = beams.as_censored(scored.window), scored.best_alone()
    least = max(LEAST_ESS, EFFORT / len(maps))
    found: list[Integrals] = []
    with progress(len(maps), "integrating over poses") as bar:
        for each in maps:
            start = pooled([one.posterior for one in found]) if found else search_poses(each, beams, rng)
            found.append(integrate_poses(each, beams, start, least, rng))
            bar(len(found))
    log_density = logsumexp([one.log_value for one in found], axis=0) - np.log(len(maps))
    placed = [at_mean_poses(each, beams, one) for each, one in zip(maps, found, strict=True)]
    if best is None:
        distance = np.full(len(beams.range), np.nan)
    elif best is scored:
        distance = best.predict(placed[0])[1]
    else:
        own = integrate_poses(best, beams, pooled([one.posterior for one in found]), least, rng)
        distance = best.predict(at_mean_poses(best, beams, own))[1]
    ess = float(np.median([one.ess for one in found]))
    return placed, distance, -float(log_density.sum()) / len(beams.range), ess


def search_poses(one: ScoredMap, beams: HeldOut, rng: np.random.Generator) -> Normals | None:
    """Return where the poses of scans may lie; None: anywhere that the prior has them, which is near enough.

    Far from the pose all beams miss their walls, and a likelihood does not show the way there. So readings are first
    taken to be as uncertain as the poses make them, then half as uncertain, and so on.
    """
    assert beams.poses is not None
    noise, start = float(np.hypot(beams.poses.noise[0], beams.poses.noise[2] * np.median(beams.range))), None
    while noise > beams.model.noise:
        blurred = beams._replace(model=beams.model.replace(noise=noise))
        start = pooled([integrate_poses(one, blurred, start, LEAST_ESS, rng).posterior])
        noise *= 0.5
    return start


def integrate_poses(
    one: ScoredMap, beams: HeldOut, start: Normals | None, least: float, rng: np.random.Generator
) -> Integrals:
    """Return the densities of scans on one map, integrated over their poses; errors are in units of the noise.

    `start`: where they may lie, if known. `least`: effective samples that are wanted.
    """
    poses = beams.poses
    assert poses is not None

    def log_likelihood(scans: Ints, errors: Floats) -> Floats:
        some = beams if len(scans) == len(poses.given) else beams.select(np.isin(poses.local.owner, scans))
        at_once = max(1, BATCH // len(some.range))
        parts = np.array_split(poses.given[scans] + errors * poses.noise, -(-len(errors) // at_once))
        return np.concatenate([scan_log_densities(one, some, part) for part in parts])

    n = len(poses.given)
    enough = min(max(least, n / (ERROR * len(beams.range)) ** 2), MOST_ESS)
    return integrate(log_likelihood, n, start, enough, rng)


def scan_log_densities(one: ScoredMap, beams: HeldOut, poses: Floats) -> Floats:
    """Return the log density (k, n_scans) of each scan's beams together if these are its poses (k, n_scans, 3).

    A sensor outside the window leaves the density of outliers, or the certainty to end beyond.
    """
    moved = beams.at(poses)
    assert beams.poses is not None
    assert moved.censored is not None
    inside = _inside(one, moved)
    density = np.where(moved.censored, 1.0, moved.model.outlier_probability / moved.model.limit)
    known = moved.select(inside)
    rays = known.rays(one.window)
    readings = known.readings(rays)
    rays[:, 4] = np.minimum(rays[:, 4], beam_influence(moved.model, readings))  # what is beyond changes no density
    density[inside] = one.density(moved.model, rays, readings)
    scan = np.arange(len(poses))[:, None] * poses.shape[1] + beams.poses.local.owner
    total = np.bincount(scan.ravel(), np.log(density), poses.shape[0] * poses.shape[1])
    return total.astype(np.float64).reshape(poses.shape[:2])


def at_mean_poses(one: ScoredMap, beams: HeldOut, found: Integrals) -> HeldOut:
    """Return the beams with scans at their mean poses, at the given ones where a sensor would leave the window."""
    assert beams.poses is not None
    given, owner = beams.poses.given, beams.poses.local.owner
    mean = given + found.posterior.mean * beams.poses.noise
    leaves = np.bincount(owner, ~_inside(one, beams.at(mean[None])), len(given)) > 0
    return beams.at(np.where(leaves[:, None], given, mean)[None])


def _inside(one: ScoredMap, beams: HeldOut) -> NDArray[np.bool_]:
    """Return which sensors are inside the window."""
    if one.window is None:
        return np.ones(len(beams.range), np.bool_)
    return one.window.contains(beams.origin, strictly=True)


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
        """Return the estimate from the samples."""
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
