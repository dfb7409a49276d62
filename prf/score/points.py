"""Labelled points from beams, and how well probabilities tell the two labels apart."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from prf.score.heldout import HeldOut

Floats = NDArray[np.float64]

FREE_UP_TO = 0.95
"""Share of a beam on which free points lie."""
METRES_PER_FREE_POINT = 2.0
CLIP = 1e-3
"""Probabilities are kept so far from 0 and 1 before their logarithm is taken."""
OUTSIDE = 0.5
"""Probability of a point of which a map says nothing."""


class LabelledPoints(NamedTuple):
    """Points of known state.

    Attributes
    ----------
    xy : (n, 2) float64
        Metres.
    occupied : (n,) bool
    """

    xy: Floats
    occupied: NDArray[np.bool_]


def draw_points(beams: HeldOut, rng: np.random.Generator) -> LabelledPoints:
    """Return one occupied point at each return r, and int(r / 2) free points uniform on [0, 0.95 r] of its beam."""
    n_free = (beams.range / METRES_PER_FREE_POINT).astype(np.int64)
    beam = np.repeat(np.arange(len(n_free)), n_free)
    along = rng.random(len(beam)) * FREE_UP_TO * beams.range[beam]
    free = beams.origin[beam] + along[:, None] * beams.direction[beam]
    occupied = np.arange(len(n_free) + len(beam)) < len(n_free)
    return LabelledPoints(np.concatenate([beams.returns(), free]), occupied)


def classification_scores(probability: Floats, occupied: NDArray[np.bool_]) -> dict[str, float]:
    """Return ``auc``, ``nll`` (nats, mean) and ``brier`` (mean) of probabilities (n,) against states (n,)."""
    if len(occupied) == 0:
        return dict.fromkeys(("auc", "nll", "brier"), math.nan)
    known = np.where(np.isnan(probability), OUTSIDE, probability)
    clipped = np.clip(known, CLIP, 1.0 - CLIP)
    return {
        "auc": ranking_area(known, occupied),
        "nll": float(-np.log(np.where(occupied, clipped, 1.0 - clipped)).mean()),
        "brier": float(((known - occupied) ** 2).mean()),
    }


def ranking_area(values: Floats, positive: NDArray[np.bool_]) -> float:
    """Return the area under the ROC curve: how often a positive outranks a negative, a tie counting half.

    Parameters
    ----------
    values : (n,) array
    positive : (n,) bool array

    Returns
    -------
    float
        nan if one of the two kinds is absent.
    """
    n_positive = int(np.count_nonzero(positive))
    n_negative = len(positive) - n_positive
    if n_positive == 0 or n_negative == 0:
        return float("nan")
    _, place, counts = np.unique(values, return_inverse=True, return_counts=True)
    middle_rank = np.cumsum(counts) - 0.5 * (counts - 1)
    rank_sum = float(middle_rank[place.reshape(-1)[positive]].sum())
    return (rank_sum - 0.5 * n_positive * (n_positive + 1)) / (n_positive * n_negative)
