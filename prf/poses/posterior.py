"""A trajectory that was sampled: the draws of each pose, and figures to judge it by."""

from __future__ import annotations

import dataclasses
import math
from functools import cached_property
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from prf.poses.model import NO_CLOSURES, Closures, PosePrior
from prf.poses.plane import Floats, compose, in_words, length_in_words, seen_from, wrapped
from prf.readings import Readings

CHI2_95 = 5.991464547107979
"""Quantile 0.95 of chi-squared with two degrees of freedom."""
NORMAL_975 = 1.959963984540054
"""Quantile 0.975 of the normal distribution."""
APART, LEAST_APART = 2.0, 0.03
"""Chains disagree on a place if their means lie so many times as far apart as the draws of each, and so many metres."""
MOST_NAMED = 3
"""Steps in which the robot slipped, in words."""
MAX_RHAT = 1.1
"""R-hat of the poses before and after a step below which chains agree on whether the robot slipped in it."""
FEW = 0.05
"""Share of the poses on which they may."""


class Spread(NamedTuple):
    """Covariances (n, 3, 3) within chains, and of the means of chains, in squares of the units of what varies."""

    within: Floats
    between: Floats
    n_chains: int

    @classmethod
    def of(cls, error: Floats, chain: NDArray[np.int32]) -> Self:
        """Return those of errors (n_draws, n, 3) of draws of these chains (n_draws,)."""
        parts = [error[chain == each] for each in np.unique(chain)]
        means = np.array([part.mean(axis=0, dtype=np.float64) for part in parts])
        within = sum(
            np.einsum("dni,dnj->nij", part - mean, part - mean) for part, mean in zip(parts, means, strict=True)
        )
        off = means - means.mean(axis=0)
        between = np.einsum("cni,cnj->nij", off, off) / max(len(parts) - 1, 1)
        return cls(np.asarray(within) / len(error), between, len(parts))

    def covariance(self) -> Floats:
        """Return covariances (n, 3, 3) that allow for how few chains there are.

        Of m chains with means of covariance B, each W within, it is W + (1 + 1/m) B, widened as Student's distribution
        is at the degrees of freedom of Satterthwaite, so that 1.96 standard deviations hold 95 %.
        """
        if self.n_chains == 1:
            return self.within
        total = self.within + (1.0 + 1.0 / self.n_chains) * self.between
        inside, all_in_all = (np.diagonal(each, axis1=1, axis2=2) for each in (self.within, total))
        share = 1.0 - np.mean(inside / np.maximum(all_in_all, 1e-300), axis=1)
        degrees = (self.n_chains - 1) / np.maximum(share, 1e-3) ** 2
        return np.asarray(total * np.square(stdtrit(degrees, 0.975) / NORMAL_975)[:, None, None])


@dataclasses.dataclass(frozen=True, eq=False)
class Trajectory:
    """Poses that were sampled with the map.

    Attributes
    ----------
    scan : (n,) int64
        Number in its log of the scan that has the pose.
    time : (n,) float64
        Seconds; nan where unknown.
    given : (n, 3) float64
        Poses as they were given: x, y in metres, heading in radians counter-clockwise.
    draws : (n_draws, n, 3) float32
        Poses of each draw, less the given ones; headings in [-pi, pi).
    laser, sonar : (n_readings,) int32 or None
        Number of the pose of each reading of the run; None where there are none of the kind.
    chain : (n_draws,) int32 or None
        Chain of each draw; None: not known, so that nothing is said of whether chains agree.
    prior : PosePrior or None
        What was known of the poses; None: not known, so that nothing is said of steps in which the robot slipped.
    disputed : Closures
        Loops of which it was open whether they close when chains were started.
    body : Trajectory or None
        One pose more, by the number -1: that of readings of runs that were let go of (:mod:`prf.poses.body`).
    """

    scan: NDArray[np.int64]
    time: Floats
    given: Floats
    draws: NDArray[np.float32]
    laser: NDArray[np.int32] | None = None
    sonar: NDArray[np.int32] | None = None
    chain: NDArray[np.int32] | None = None
    prior: PosePrior | None = None
    disputed: Closures = NO_CLOSURES
    body: Trajectory | None = None

    @cached_property
    def correction(self) -> Floats:
        """Posterior mean less the given poses (n, 3), of headings the circular mean; 0 where there are no draws."""
        if not len(self.draws):
            return np.zeros_like(self.given)
        mean: Floats = self.draws.mean(axis=0, dtype=np.float64)
        turn = self.draws[:, :, 2].astype(np.float64)
        mean[:, 2] = np.arctan2(np.sin(turn).mean(axis=0), np.cos(turn).mean(axis=0))
        return mean

    @property
    def mean(self) -> Floats:
        """Posterior mean of each pose (n, 3); headings in [-pi, pi)."""
        mean = self.given + self.correction
        mean[:, 2] = wrapped(mean[:, 2])
        return mean

    @cached_property
    def _error(self) -> Floats:
        """Poses of each draw (n_draws, n, 3) less their means, headings as turns."""
        error = self.draws - self.correction
        error[:, :, 2] = wrapped(error[:, :, 2])
        return error

    @property
    def _chains(self) -> NDArray[np.int32]:
        return np.zeros(len(self.draws), np.int32) if self.chain is None else self.chain

    @cached_property
    def covariance(self) -> Floats:
        """Covariance of each pose (n, 3, 3) round its mean, m2, m rad and rad2, headings as turns; nan without draws.

        It is the posterior's where chains agree, and allows for how few they are where not (:class:`Spread`).
        """
        if not len(self.draws):
            return np.full((len(self.given), 3, 3), np.nan)
        return Spread.of(self._error, self._chains).covariance()

    def steps(self) -> tuple[Floats, Floats]:
        """Return the means (n - 1, 3) of each pose in the frame of the one before, and their covariances (n - 1, 3, 3).

        Metres and radians; covariances as of :attr:`covariance`.
        """
        poses = self.given + self.draws.astype(np.float64)
        steps = seen_from(poses[:, :-1], poses[:, 1:])
        middle = seen_from(self.mean[:-1], self.mean[1:])
        error = steps - middle
        error[:, :, 2] = wrapped(error[:, :, 2])
        mean = middle + error.mean(axis=0)
        return mean, Spread.of(error - error.mean(axis=0), self._chains).covariance()

    @property
    def sd(self) -> Floats:
        """Standard deviation of each pose (n, 3), see :attr:`covariance`: metres, metres, radians."""
        return np.sqrt(np.diagonal(self.covariance, axis1=1, axis2=2))

    @cached_property
    def slips(self) -> Floats:
        """Probability (n - 1,) that the robot slipped or was carried, by steps from each pose to the next."""
        if self.prior is None or not len(self.prior.motion) or not len(self.draws):
            return np.zeros(max(len(self.given) - 1, 0))
        return np.asarray(np.mean([self.prior.slipped(self.given + draw) for draw in self.draws], axis=0))

    @cached_property
    def closed(self) -> Floats:
        """Probability (k,) of each disputed closure: the share of draws whose poses it holds at."""
        if not len(self.disputed.tail) or not len(self.draws):
            return np.zeros(len(self.disputed.tail))
        return np.asarray(np.mean([self.disputed.hold(self.given + draw) for draw in self.draws], axis=0))

    @cached_property
    def _settled(self) -> NDArray[np.bool_]:
        """Which poses (n,) chains agree on: split R-hat of each coordinate below :data:`MAX_RHAT`."""
        half = np.zeros(len(self.draws), np.int32)
        for chain in np.unique(self._chains):
            own = np.flatnonzero(self._chains == chain)
            half[own] = 2 * chain + (2 * np.arange(len(own)) >= len(own))
        within, between, n_halves = Spread.of(self._error, half)
        inside, apart = (np.diagonal(each, axis1=1, axis2=2) for each in (within, between))
        share = 1.0 - n_halves / len(self.draws)
        return np.asarray((share * (1.0 + apart / np.maximum(inside, 1e-300)) < MAX_RHAT**2).all(axis=1))

    def _slipped(self, settled: bool) -> NDArray[np.int64]:
        """Return the steps in which the robot probably slipped, where chains agree on the poses, or where they do not.

        Of chains that disagree each may have a place of its own, and then a slip that no other has.
        """
        found = np.flatnonzero(self.slips > 0.5)
        return found[(self._settled[found] & self._settled[found + 1]) == settled] if len(found) else found

    def slip_rows(self) -> list[dict[str, Any]]:
        """Return the steps, settled ones, in which the robot probably slipped or was carried, the largest first.

        scan, t: of the pose before the step; metres, radians: by how much it differs from the odometry's; probability.
        """
        found = self._slipped(settled=True)
        if self.prior is None or not len(found):
            return []
        off = seen_from(self.mean[found], self.mean[found + 1]) - self.prior.motion[found]
        size, turn = np.hypot(off[:, 0], off[:, 1]), np.abs(wrapped(off[:, 2]))
        return [
            {
                "scan": int(self.scan[found[k]]),
                "t": float(self.time[found[k]]),
                "metres": float(size[k]),
                "radians": float(turn[k]),
                "probability": float(self.slips[found[k]]),
            }
            for k in np.argsort(-size)
        ]

    def closure_rows(self) -> list[dict[str, Any]]:
        """Return the loops of which it is open whether they close: scans (earlier, later), x, y (m), probability."""
        tail, head = self.disputed.tail, self.disputed.head
        place = self.mean[tail, :2] if len(tail) else np.zeros((0, 2))
        return [
            {"scans": [int(self.scan[a]), int(self.scan[b])], "x": float(x), "y": float(y), "probability": float(share)}
            for a, b, (x, y), share in zip(tail, head, place, self.closed, strict=True)
        ]

    def slips_in_words(self) -> str:
        """Return where the robot slipped or was carried, how far, and with what probability; empty where nowhere."""
        rows = self.slip_rows()
        parts = []
        for row in rows[:MOST_NAMED]:
            when = "" if math.isnan(row["t"]) else f" (t {row['t']:.1f} s)"
            by = in_words(row["metres"], row["radians"])
            parts.append(f"after scan {row['scan']}{when} by {by}, probability {row['probability']:.2f}")
        more = f", and {len(rows) - len(parts)} more" if len(rows) > len(parts) else ""
        return f"slipped or was carried {'; '.join(parts)}{more}" if rows else ""

    def closures_in_words(self) -> str:
        """Return which loops it is open of whether they close, and in how many draws each does; empty where none."""
        return "; ".join(
            f"whether scans {earlier} and {later} saw the same place, ({row['x']:.1f}, {row['y']:.1f}): "
            f"{_share_in_words(row['probability'])}"
            for row in self.closure_rows()
            for earlier, later in [row["scans"]]
        )

    def dispute(self) -> str:
        """Return in words where the poses are not settled: loops, chains that do not agree; empty where they are."""
        if not len(self.draws):
            return ""
        if len(self.disputed.tail):
            return self.closures_in_words()
        within, between, _ = Spread.of(self._error, self._chains)
        inside, apart = (np.sqrt(each[:, 0, 0] + each[:, 1, 1]) for each in (within, between))
        differs = apart > np.maximum(APART * inside, LEAST_APART)
        if differs.mean() <= FEW:
            return self._open_slips()
        worst = self.scan[int(np.argmax(apart))]
        return (
            f"chains differ by {length_in_words(apart.max())} at scan {worst}, and on {differs.mean():.0%} of the poses"
        )

    def _open_slips(self) -> str:
        """Return in words where it is open whether the robot slipped, as chains do not agree; empty where nowhere."""
        found = self._slipped(settled=False)
        if not len(found):
            return ""
        steps = f"{len(found)} steps, the first" if len(found) > 1 else "a step"
        return f"whether the robot slipped in {steps} after scan {self.scan[found[0]]}, where chains do not agree"

    def ellipses(self) -> Floats:
        """Return the half axes (n, 2, 2), metres, of ellipses round the means that hold each place at 95 %."""
        length2, direction = np.linalg.eigh(self.covariance[:, :2, :2])
        return np.asarray(np.sqrt(CHI2_95 * np.maximum(length2, 0.0))[:, :, None] * direction.transpose(0, 2, 1))

    def moved(self, readings: Readings, owner: NDArray[np.int32]) -> Readings:
        """Return readings at the given poses, numbered by `owner`, where the posterior means have them."""
        parts = [self] if self.body is None else [self, self.body]
        mean, start = (np.concatenate([getattr(part, name) for part in parts])[owner] for name in ("mean", "given"))
        found = compose(mean, seen_from(start, np.column_stack([readings.origin, readings.angle])))
        return dataclasses.replace(readings, origin=found[:, :2].copy(), angle=found[:, 2].copy())

    def figures(self) -> dict[str, float]:
        """Return the number of poses, how far the means are from the given poses (rms), and how well they are known.

        `mean_sd_m`: mean over the poses of the root mean square distance of draws from the mean.
        """
        moved, turned = np.hypot(*self.correction[:, :2].T), self.correction[:, 2]
        return {
            "n": len(self.given),
            "rms_correction_m": math.sqrt((moved**2).mean()),
            "rms_correction_rad": math.sqrt((turned**2).mean()),
            "mean_sd_m": float(np.hypot(*self.sd[:, :2].T).mean()),
            "mean_sd_rad": float(self.sd[:, 2].mean()),
        }

    def words(self) -> str:
        """Return in words what :meth:`figures` has."""
        n, moved, turned, *known = self.figures().values()
        corrected = f"{n} pose{'s' * (n > 1)} corrected by {in_words(moved, turned)} (rms)"
        if not len(self.draws) or self.chain is None:
            return corrected
        dispute = self.dispute()
        settled = f"; not settled: {dispute}" if dispute else f", known to {in_words(*known)}"
        slips = self.slips_in_words()
        return corrected + settled + (f"; the robot {slips}" if slips else "")


def pose_functionals(poses: Floats, given: Floats) -> dict[str, Floats]:
    """Return what a trajectory is watched by for convergence, by name, of poses (..., n, 3): values (...).

    How far it is from the given poses (n, 3), rms in metres, and of the first, the middle and the last pose each
    coordinate less the given one.
    """
    offset = poses - given
    found = {"pose_correction": np.sqrt((offset[..., :2] ** 2).sum(axis=-1).mean(axis=-1))}
    for i in sorted({0, len(given) // 2, len(given) - 1}):
        found |= {f"pose_{i}_x": offset[..., i, 0], f"pose_{i}_y": offset[..., i, 1]}
        found[f"pose_{i}_heading"] = wrapped(offset[..., i, 2])
    return found


def _share_in_words(share: float) -> str:
    """Return in how many draws a loop closes: chains that all started one way do not show that it is the right one."""
    if 0.005 <= share < 0.995:
        return f"probability {share:.2f}"
    return f"in {'all draws' if share > 0.5 else 'no draw'}, as all chains started"
