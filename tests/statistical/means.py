"""Means of what is compared, with their standard errors: of weighted exact draws, and of batches of chains."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


class Mean(NamedTuple):
    """Means of what is compared, (..., k), and their standard errors."""

    mean: Floats
    error: Floats


def weighted_mean(values: Floats, log_weight: Floats) -> Mean:
    """Of draws (n, k) with these logs of weights (n,), as self-normalised importance sampling has it."""
    weight = np.exp(log_weight - log_weight.max())
    weight /= weight.sum()
    mean = weight @ values
    return Mean(mean, np.sqrt(weight**2 @ (values - mean) ** 2))


def batch_mean(chains: Sequence[Floats], n_batches: int) -> Mean:
    """Of chains of values (n_draws, ..., k) in the order of their steps; the last, incomplete batch is left out."""
    batches = [
        values[: len(values) // n_batches * n_batches].reshape(n_batches, -1, *values.shape[1:]).mean(axis=1)
        for values in chains
    ]
    return plain_mean(np.concatenate(batches))


def plain_mean(values: Floats) -> Mean:
    """Of independent draws (n, ..., k)."""
    return Mean(values.mean(axis=0), values.std(axis=0, ddof=1) / np.sqrt(len(values)))


def z_scores(found: Mean, expected: Mean) -> Floats:
    """Differences of means over their standard errors: 0 where they are equal, infinite where they err without any."""
    difference = found.mean - expected.mean
    with np.errstate(divide="ignore", invalid="ignore"):
        z: Floats = np.where(difference == 0.0, 0.0, difference / np.hypot(found.error, expected.error))
    return z


def largest(z: dict[str, float]) -> tuple[str, float]:
    """The name and the size of the z-score that is farthest from 0; not a number is farther than all."""
    name = max(z, key=lambda each: np.nan_to_num(abs(z[each]), nan=np.inf))
    return name, abs(z[name])
