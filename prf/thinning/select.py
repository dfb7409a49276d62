"""Which beams of a dense log to keep."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from prf.seen import beam_ends
from prf.shell.errors import ConfigError
from prf.thinning.cover import Passages
from prf.thinning.quotas import draw_evenly, strata_of, weights
from prf.window import Window

Floats = NDArray[np.float64]

BEAM_DENSITY = 16.0
"""Beams a square metre of seen ground, unless asked for otherwise."""
WORTH_IT = 0.75
"""A log is used whole, and exactly, where thinning would keep more than this share of it."""


def checked_density(density: float) -> float:
    """Return a density of beams, 1/m^2.

    Raises
    ------
    ConfigError
        If it is negative or not finite.
    """
    if not (math.isfinite(density) and density >= 0.0):
        raise ConfigError(f"beam-density {density}: must be a number of beams a square metre, or 0 to keep all")
    return density


def thin_beams(
    window: Window, origin: Floats, angle: Floats, ranges: Floats, max_range: float, density: float = BEAM_DENSITY
) -> NDArray[np.int64]:
    """Return the beams to keep, by index and in their order.

    Of a dense log about `density` beams a square metre of the ground that its beams pass stay, plus what it takes to
    have every passed cell passed (:mod:`prf.thinning.cover`). One with little more than that is kept whole. No random
    number is used: the same beams in the same order give the same choice.

    Parameters
    ----------
    window : Window
    origin : (n, 2) array
        Sensor positions inside the window, metres.
    angle : (n,) array
        Directions in the world frame, radians.
    ranges : (n,) array
        Metres; at or above `max_range`: no return.
    max_range : float
        Metres.
    density : float
        Beams a square metre; 0 keeps all.

    Returns
    -------
    (m,) int64 array
    """
    everything = np.arange(len(ranges), dtype=np.int64)
    if density == 0.0 or len(ranges) <= 1:
        return everything
    end, returned = beam_ends(window, origin, angle, ranges, max_range)
    passages = Passages(window, origin, end)
    budget = density * passages.seen_area()
    if budget > WORTH_IT * len(ranges):
        return everything
    strata = strata_of(window, origin, end, returned)
    kept = draw_evenly(strata, weights(strata, budget))
    passages.complete(kept)
    return everything[kept]
