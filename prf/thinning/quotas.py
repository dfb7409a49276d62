"""How many beams of each kind to keep: strata of place, direction and outcome, and an even draw from each.

Beams of one stratum end in one square, come from one of eight directions, and all have a return or all have none. They
say nearly the same, so their number counts for less than in proportion: of n beams some n^EVENNESS are kept. With
the exponent 1 that is plain subsampling; with 0 every place has the same number, and what is rare (people who
walked by, the fringe of a wall blurred by errors of the poses) weighs as much as the wall itself.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from prf.window import Window

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

PLACE = 0.5
"""Side of a square in metres: wide beside the blur of a wall, so that all across it is thinned alike."""
DIRECTIONS = 8
"""Sectors of the direction that a beam comes from."""
EVENNESS = 0.75
"""Exponent of the number of beams; measured in docs/thinning.md."""
RARE = 2.0
"""Beams with a return that each square keeps at least, if it has as many, and beams without one likewise."""
HALVINGS = 60
"""Of the interval that holds the factor common to all quotas."""


class Strata(NamedTuple):
    """Beams sorted by stratum, in their own order within each; neighbouring squares follow one another.

    Attributes
    ----------
    order : (n,) int64
        The beams, stratum by stratum.
    size : (k,) int64
        Beams of each stratum, at least 1.
    alike : (k,) int64
        Beams that end in the same square with the same outcome, whatever their direction.
    """

    order: Ints
    size: Ints
    alike: Ints


def strata_of(window: Window, origin: Floats, end: Floats, returned: Bools) -> Strata:
    """Return the strata of beams.

    Parameters
    ----------
    window : Window
    origin, end : (n, 2) arrays
        Metres, inside the window.
    returned : (n,) bool array
    """
    column, row = (np.maximum(end - np.array(window[:2]), 0.0) // PLACE).astype(np.int64).T
    across = int(window.width // PLACE) + 2
    # Every other row runs backward, so that rounding at the end of one is made good at its neighbour's.
    square = row * across + np.where(row % 2 == 0, column, across - 1 - column)
    toward = np.arctan2(end[:, 1] - origin[:, 1], end[:, 0] - origin[:, 0])
    sector = ((toward + np.pi) * (DIRECTIONS / (2.0 * np.pi))).astype(np.int64) % DIRECTIONS
    group = 2 * square + returned
    key = DIRECTIONS * group + sector
    order = np.argsort(key, kind="stable")
    _, first, size = np.unique(key[order], return_index=True, return_counts=True)
    _, member = np.unique(group[order[first]], return_inverse=True)
    return Strata(order, size, np.bincount(member, weights=size).astype(np.int64)[member])


def weights(strata: Strata, budget: float) -> Floats:
    """Return the share (k,) of each stratum to keep: `budget` beams in all, more only if the rare ask for it."""
    least = np.minimum(1.0, RARE / strata.alike)
    falling = strata.size.astype(np.float64) ** (EVENNESS - 1.0)

    def shares(factor: float) -> Floats:
        found: Floats = np.minimum(1.0, np.maximum(least, factor * falling))
        return found

    low, high = 0.0, 1.0 / falling.min()
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if strata.size @ shares(middle) > budget else (middle, high)
    return shares(high)


def draw_evenly(strata: Strata, share: Floats) -> Bools:
    """Return which beams (n,) to keep: every 1/w-th of a stratum whose share is w, rounding carried on to the next."""
    each = np.repeat(share, strata.size)
    # Those kept for certain stand outside the count, which rounding could make miss one of them.
    filled = 0.5 + np.cumsum(np.where(each < 1.0, each, 0.0))
    taken = (np.diff(np.floor(filled), prepend=0.0) > 0.0) | (each >= 1.0)
    kept = np.zeros(len(each), np.bool_)
    kept[strata.order[taken]] = True
    return kept
