"""Log likelihood of one laser beam (paper, section 2.2, in the form that the documentation gives)."""

import math

import numpy as np

from prf.kernels import constants as c
from prf.kernels._jit import core

ROOT_TWO_PI = math.sqrt(2.0 * math.pi)
ROOT_HALF = math.sqrt(0.5)
WHOLE = 9.0
"""Phi(x) is 1 to the last bit of a double for x above this."""


@core
def normal_cdf(x: float) -> float:
    """Phi(x), the standard normal distribution function."""
    if x > WHOLE:
        return 1.0
    return 0.5 * math.erfc(-x * ROOT_HALF)


@core
def beam_log_likelihood(model: np.ndarray, reading: float, distance: float) -> float:
    """Log density of a reading (metres, inf: no return) if the first obstacle lies at `distance` (inf: none).

    w_hit N(r; d, s^2) / Phi(d/s) + w_outlier / max below the maximum range, else the point mass
    w_miss + w_hit Phi((d - max)/s) / Phi(d/s), with s = max(noise, noise_relative d); the total is 1 for every d.
    """
    maximum = model[c.MAX_RANGE]
    if distance >= maximum:
        return model[c.LOG_OUTLIER] if reading < maximum else model[c.LOG_MISS]
    s = max(model[c.NOISE], model[c.NOISE_RELATIVE] * distance)
    if reading < maximum:
        z = (reading - distance) / s
        if z * z > model[c.VANISHING]:
            return model[c.LOG_OUTLIER]
        peak = math.exp(-0.5 * z * z) / (s * ROOT_TWO_PI * normal_cdf(distance / s))
        return math.log(model[c.HIT] * peak + model[c.OUTLIER_DENSITY])
    missed = model[c.MISS] + model[c.HIT] * normal_cdf((distance - maximum) / s) / normal_cdf(distance / s)
    return math.log(missed) if missed > 0.0 else -math.inf
