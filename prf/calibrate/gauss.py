"""A Gaussian cut at zero: what a range reads that was returned from a known distance, and how that changes with s."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy import special

Floats = NDArray[np.float64]

ROOT_TWO_PI = math.sqrt(2.0 * math.pi)
POWER = 16.0
LEAST = 1e-9
"""Metres: a distance below is taken as this."""


def hit(reading: Floats, depth: Floats, s: Floats, max_range: float) -> tuple[Floats, Floats]:
    """Return the density N(r; d, s^2) / Phi(d / s), where there was no return its mass beyond the maximum range.

    Parameters
    ----------
    reading, depth, s : arrays that broadcast
        Metres; readings are inf for no return.
    max_range : float
        Metres.

    Returns
    -------
    density, by_s : arrays
        And its derivative by s.
    """
    returned = np.isfinite(reading)
    z = (np.where(returned, reading, max_range) - depth) / s
    positive = special.ndtr(depth / s)
    bell = np.exp(-0.5 * z * z) / (ROOT_TWO_PI * positive)
    tail = special.ndtr(-z) / positive
    cut = depth / (s * s) * np.exp(-0.5 * (depth / s) ** 2) / (ROOT_TWO_PI * positive)
    density = np.where(returned, bell / s, tail)
    by_s = np.where(returned, bell / s * ((z * z - 1.0) / s), bell * z / s) + density * cut
    return density, by_s


def spread(noise: float, noise_relative: float, depth: Floats, is_sharp: bool) -> tuple[Floats, Floats]:
    """Return the standard deviation, and the share of it that is the first of the two parameters'.

    Parameters
    ----------
    noise, noise_relative : float
        Metres; a share of the distance. Both positive.
    depth : array
        Distances, metres.
    is_sharp : bool
        s = max(noise, noise_relative d), as the models have it. Else (a^16 + b^16)^(1/16), at most 4.4 % more where
        both are equal: smooth, so that a search cannot get stuck where one overtakes the other.

    Returns
    -------
    s, first : arrays
        d log s = first d log noise + (1 - first) d log noise_relative.
    """
    fixed, relative = math.log(noise), np.log(noise_relative * np.maximum(depth, LEAST))
    larger = np.maximum(fixed, relative)
    if is_sharp:
        return np.exp(larger), (fixed >= relative).astype(np.float64)
    gap = POWER * (fixed - relative)
    return np.exp(larger + np.log1p(np.exp(-np.abs(gap))) / POWER), special.expit(gap)


def shares(log_odds: Floats) -> Floats:
    """Return the shares (n + 1,) whose log odds against the last one are given, (n,)."""
    weights = np.exp(np.append(log_odds, 0.0) - max(0.0, float(log_odds.max())))
    return np.asarray(weights / weights.sum(), dtype=np.float64)


def mixed(columns: Floats, weights: Floats) -> Floats:
    """Return ``columns @ weights`` without BLAS, whose threads take longer to wake than this takes.

    Parameters
    ----------
    columns : (n, k) array
    weights : (k,) or (k, m) array
    """
    total: Floats = np.einsum("nk,k...->n...", columns, weights)
    return total


def share_slopes(share: Floats) -> Floats:
    """Return the derivatives (n + 1, n) of all shares by the log odds against the last."""
    slopes: Floats = np.diag(share)[:, :-1] - np.outer(share, share[:-1])
    return slopes
