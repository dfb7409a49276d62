"""The noise of a cloud, from the distances of points to robust planes through their neighbourhoods.

Half of a neighbourhood may be another copy of the surface. A standard deviation is therefore raised from below until it
agrees with the distances within two of it: between copies 5 standard deviations apart or more there is a gap at which
that stops.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

CUT, KEPT_STD = 2.0, 0.8796
"""Distances up to `CUT` standard deviations, and the standard deviation of a normal law cut there (as a share)."""
START = 1.5
"""Times the scale of the nearest half, which is 0.4 standard deviations of one surface and 1 of two."""
MOST_ROUNDS = 200


def pooled_noise(scale: NDArray[np.float64], residual: NDArray[np.float64]) -> float:
    """Return the noise of the smoother surfaces from all neighbourhoods together, 0 if there is none.

    `scale` (s,): root mean square of the half of each neighbourhood that its plane fits best, nan where there is no
    plane. `residual` (s, k): distances of all its points, nan where there are fewer.
    """
    known = np.isfinite(scale)
    if not known.any():
        return 0.0
    low, usual = np.quantile(scale[known], (0.1, 0.25))
    pooled = residual[known][scale[known] <= 3.0 * usual].reshape(1, -1)
    return float(_raise(np.array([low]), pooled)[0])


def usual_noise(scale: NDArray[np.float64], residual: NDArray[np.float64]) -> float:
    """Return the noise that at least half of the surfaces keep to, 0 if there is none.

    That of all neighbourhoods together or, where surfaces differ, the median of each by itself, whichever is more: the
    first is drawn to the smooth ones, the second lies low by a third where all are alike. Parameters as of
    :func:`pooled_noise`.
    """
    known = np.isfinite(scale)
    if not known.any():
        return 0.0
    single = _raise(START * scale[known], residual[known])
    return max(pooled_noise(scale, residual), float(np.median(single)))


def _raise(noise: NDArray[np.float64], residual: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the standard deviations (s,), raised from those given, that agree with the distances (s, k) below them."""
    ordered = np.sort(np.where(np.isfinite(residual), residual, np.inf), axis=1)
    squares = np.cumsum(np.where(np.isfinite(ordered), ordered, 0.0) ** 2, axis=1)
    rows = np.arange(len(noise))
    for _ in range(MOST_ROUNDS):
        n_within = np.maximum(np.count_nonzero(ordered <= CUT * noise[:, None], axis=1), 1)
        raised = np.sqrt(squares[rows, n_within - 1] / n_within) / KEPT_STD
        if (raised <= noise * 1.0005).all():
            break
        noise = np.maximum(noise, raised)
    return noise
