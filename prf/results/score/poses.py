"""Held-out scans whose poses are uncertain: their densities, the poses integrated out (docs/scores.md)."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from prf.results.score.heldout import HeldOut
from prf.results.score.importance import Integrals, Ints, Normals, integrate, pooled
from prf.results.score.maps import ScoredMap
from prf.shell.cli.progress import progress

Floats = NDArray[np.float64]

MOST_MAPS = 50
"""Draws of a RUN that scans are scored by, at most."""
ERROR = 0.005
"""Monte Carlo error of beam_nll that is aimed at."""
LEAST_ESS, EFFORT, MOST_ESS = 10.0, 40.0, 100.0
"""Effective samples of an integral after which no more are drawn: at least so many, on all maps together, at most."""
BATCH = 500_000
"""Beams at once, about; each takes some 200 bytes."""


class Marginal(NamedTuple):
    """Scans on each of several maps."""

    maps: Sequence[ScoredMap]
    placed: list[HeldOut]  # the beams of all scans, these being at their mean poses on each map
    distance: (
        Floats  # (n_beams,) to the first obstacle, where the beams are so placed on the best map; nan: there is none
    )
    beam_nll: float  # nats
    ess: float  # effective samples of an integral, the median


def marginalise(scored: ScoredMap, beams: HeldOut, rng: np.random.Generator) -> Marginal:
    """Integrate the poses of scans out, on each map by itself.

    `beams`: of sensors inside the window, with uncertain poses. The density of a scan is that of all its beams together
    averaged over maps; ``beam_nll`` is the mean of -log over beams.
    """
    beams, best = beams.as_censored(scored.window), scored.best_alone()
    maps = scored.singles(MOST_MAPS)
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
        distance = best.predict(placed[0]).distance
    else:
        own = integrate_poses(best, beams, pooled([one.posterior for one in found]), least, rng)
        distance = best.predict(at_mean_poses(best, beams, own)).distance
    ess = float(np.median([one.ess for one in found]))
    return Marginal(maps, placed, distance, -float(log_density.sum()) / len(beams.range), ess)


def search_poses(one: ScoredMap, beams: HeldOut, rng: np.random.Generator) -> Normals | None:
    """Return where the poses of scans may lie; None: anywhere that the prior has them, which is near enough.

    Far from the pose all beams miss their walls, and a likelihood says nothing of the way there. So readings are first
    taken to be as uncertain as the poses make them, then half as uncertain, and so on.
    """
    assert beams.poses is not None
    noise, start = float(np.hypot(beams.poses.noise[0], beams.poses.noise[2] * np.median(beams.range))), None
    while noise > beams.model.noise:
        blurred = beams._replace(model=dataclasses.replace(beams.model, noise=noise))
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
    density = np.where(moved.censored, 1.0, moved.model.outlier_probability / moved.model.max_range)
    known = moved.select(inside)
    rays = known.rays(one.window)
    readings = known.readings(rays)
    rays[:, 4] = np.minimum(rays[:, 4], moved.model.influence(readings))  # what is beyond changes no density
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
