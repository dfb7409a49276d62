"""Sampled poses beside the true ones: absolute and relative errors, and whether they are as large as was stated."""

from __future__ import annotations

import math
from typing import NamedTuple, Self

import numpy as np

from prf.poses.graph import Ints
from prf.poses.plane import Floats, compose, in_words, length_in_words, seen_from, wrapped
from prf.poses.posterior import CHI2_95, Trajectory

FEWEST = 3
"""Poses that must have a true one."""


class TrueErrors(NamedTuple):
    """Errors of posterior means, which are moved and turned as a whole to where their places fit best."""

    scan: Ints  # (k,) number of the scan in its log
    place: Floats  # (k,) metres, absolute
    radius: Floats  # (k,) metres: long half axis of the ellipse that was to hold the place at 95 %
    step: Floats  # (k - 1,) metres, of the pose seen from the one before
    turn: Floats  # (k - 1,) radians, of the same
    nees: Floats  # (k - 1,) squares of both in standard deviations, over the three degrees of freedom
    source: str  # of the true poses

    @classmethod
    def of(cls, found: Trajectory, true: Floats, source: str) -> Self:
        """Return the errors beside true poses (n, 3), m, m, rad, nan where unknown; `source`: their file."""
        known = np.flatnonzero(np.isfinite(true).all(axis=1))
        is_next = np.diff(known) == 1
        mean, true = found.mean[known], true[known]
        off = seen_from(true[:-1], true[1:]) - seen_from(mean[:-1], mean[1:])
        off[:, 2] = wrapped(off[:, 2])
        error, covariance = off[is_next], found.steps()[1][known[:-1][is_next]]
        squares = np.einsum("ki,ki->k", error, np.linalg.solve(covariance, error[:, :, None])[:, :, 0])
        place = np.hypot(*(_aligned(mean, true)[:, :2] - true[:, :2]).T)
        radius = math.sqrt(CHI2_95) * np.sqrt(np.linalg.eigvalsh(found.covariance[known][:, :2, :2])[:, 1])
        return cls(
            found.scan[known], place, radius, np.hypot(off[:, 0], off[:, 1]), np.abs(off[:, 2]), squares / 3.0, source
        )

    def figures(self) -> dict[str, float]:
        """Return root mean squares: ATE (m), RPE from scan to scan (m, rad); the largest ATE, and the mean NEES."""
        ate, rpe, turn = (math.sqrt(float(np.mean(np.square(each)))) for each in (self.place, self.step, self.turn))
        largest, nees = float(self.place.max()), float(np.mean(self.nees)) if len(self.nees) else math.nan
        return {"n": len(self.place), "ate_m": ate, "largest_m": largest, "rpe_m": rpe, "rpe_rad": turn, "nees": nees}

    def words(self) -> str:
        """Return in words what :meth:`figures` has."""
        n, ate, largest, rpe, turn, nees = self.figures().values()
        return (
            f"ATE {length_in_words(ate)} (rms of {n} poses; the largest {length_in_words(largest)}), "
            f"RPE {in_words(rpe, turn)} from scan to scan, NEES of these steps {nees:.2g} (1 if as stated)"
        )


def _aligned(mean: Floats, true: Floats) -> Floats:
    """Return poses (k, 3) moved and turned as a whole so that their places fit true ones best (Umeyama, no scale)."""
    centre, to = mean[:, :2].mean(axis=0), true[:, :2].mean(axis=0)
    a, b = mean[:, :2] - centre, true[:, :2] - to
    turn = math.atan2(float((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum()), float((a * b).sum()))
    local = seen_from(np.array([*centre, 0.0]), mean)
    return compose(np.array([*to, turn]), local)
