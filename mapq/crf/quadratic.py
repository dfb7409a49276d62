"""Small convex quadratic programs by a primal-dual interior point method."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

MOST_STEPS = 100
ACCURACY = 1e-10
"""Of the complementarity and of the residuals, in units of the largest number of the problem."""
PATIENCE = 3
"""Steps without a gain after which the best point is returned: at the limit of float64 more of them lose it again."""
BOUNDARY = 0.995
"""Share of the way to the boundary that a step goes at most."""
RIDGE = 1e-13
"""Of the largest entry of the matrix, added to its diagonal: constraints that nearly agree make it singular."""


def solve_quadratic(curvature: Floats, slope: Floats, left: Floats, right: Floats) -> tuple[Floats, Floats]:
    """Return z (n,) of least ``z . diag(curvature) z / 2 + slope . z`` with ``left z <= right``, and multipliers (m,).

    Mehrotra's predictor and corrector (1992, "On the implementation of a primal-dual interior point method"). All
    multipliers are positive; the program must have a point inside and a bounded optimum.

    Parameters
    ----------
    curvature : (n,) float64
        Not negative.
    slope : (n,) float64
    left : (m, n) float64
    right : (m,) float64

    Notes
    -----
    Numbers should be of order 1, as the caller makes them: it starts from ones, and of programs whose units lie up to
    six orders of magnitude apart one in eleven ends beyond 1e-6 of the largest number.
    """
    z = np.zeros(len(slope))
    s = np.maximum(right - left @ z, 1.0)
    multiplier = np.ones(len(right))
    size = 1.0 + max(float(np.abs(slope).max()), float(np.abs(right).max(initial=0.0)))
    best, least, idle = (z, multiplier), np.inf, 0
    for _ in range(MOST_STEPS):
        dual = curvature * z + slope + left.T @ multiplier
        primal = left @ z + s - right
        gap = float(s @ multiplier) / len(s)
        error = max(gap, float(np.abs(dual).max()), float(np.abs(primal).max()))
        idle += 1
        if error < least:
            best, least, idle = (z, multiplier), error, 0
        if least < ACCURACY * size or idle > PATIENCE:
            break
        matrix = (left.T * (multiplier / s)) @ left + np.diag(curvature)
        matrix[np.diag_indices_from(matrix)] += RIDGE * float(np.diag(matrix).max())
        aim = s * multiplier
        step = _step(matrix, left, dual, primal, aim, s, multiplier)
        length = _length(s, multiplier, step, 1.0)
        ahead = float((s + length * step[1]) @ (multiplier + length * step[2])) / len(s)
        aim = aim + step[1] * step[2] - (ahead / gap) ** 3 * gap
        step = _step(matrix, left, dual, primal, aim, s, multiplier)
        length = _length(s, multiplier, step, BOUNDARY)
        z, s, multiplier = z + length * step[0], s + length * step[1], multiplier + length * step[2]
    return best


def _step(
    matrix: Floats, left: Floats, dual: Floats, primal: Floats, aim: Floats, s: Floats, multiplier: Floats
) -> tuple[Floats, Floats, Floats]:
    """Return the Newton step of z, slack and multiplier that takes slack times multiplier down by `aim` (m,)."""
    dz = np.asarray(np.linalg.solve(matrix, -dual - left.T @ ((multiplier * primal - aim) / s)), np.float64)
    ds = -primal - left @ dz
    return dz, ds, -(aim + multiplier * ds) / s


def _length(s: Floats, multiplier: Floats, step: tuple[Floats, Floats, Floats], share: float) -> float:
    """Return the longest step, at most 1, that goes at most a share of the way to where a number becomes 0."""
    shortest = 1.0 / share
    for value, change in ((s, step[1]), (multiplier, step[2])):
        falling = change < 0.0
        if falling.any():
            shortest = min(shortest, float((-value[falling] / change[falling]).min()))
    return share * shortest
