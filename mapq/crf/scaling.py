"""Robust standardisation, fitted on training maps and kept in the model."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mapq.model import CLIP, Scaling

RELATIVE_FLOOR = 1e-9
"""A column that varies by less than this share of its size is constant but for rounding."""


def fit_scaling(values: NDArray[np.float64], names: tuple[str, ...]) -> Scaling:
    """Return the standardisation of columns (n, k).

    The scale is the interquartile range, but at least so large that the clip cuts no more than one value in a hundred
    on either side: most pairs of a good map have the same x_ij, and the few others are the ones that matter. A
    constant column gets scale 1.
    """
    if values.size == 0:
        return Scaling(names, np.zeros(len(names)), np.ones(len(names)))
    # Of a column that is not known at all anything will do: it is 0 once standardised.
    values = np.where(np.isnan(values).all(axis=0), 0.0, values)
    low, quarter, median, three_quarters, high = np.nanquantile(values, (0.01, 0.25, 0.5, 0.75, 0.99), axis=0)
    reach = np.maximum(high - median, median - low) / CLIP
    scale = np.maximum(three_quarters - quarter, reach)
    constant = scale <= RELATIVE_FLOOR * np.maximum(np.abs(median), RELATIVE_FLOOR)
    return Scaling(names, median, np.where(constant, 1.0, scale))


def fit_range(x: NDArray[np.float64]) -> tuple[float, float]:
    """Return the range of x_ij (n,): what was seen, but not beyond the clip of its standardisation."""
    if len(x) == 0:
        return 0.0, 0.0
    scaling = fit_scaling(x[:, None], ("x",))
    median, reach = float(scaling.median[0]), CLIP * float(scaling.scale[0])
    return max(float(x.min()), median - reach), min(float(x.max()), median + reach)
