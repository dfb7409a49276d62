"""Log likelihood of one laser beam (paper, section 2.2, in the form that the documentation gives)."""

import math

from prf.kernels import constants as c
from prf.kernels._jit import Array, core

ROOT_TWO_PI = math.sqrt(2.0 * math.pi)
ROOT_HALF = math.sqrt(0.5)
CDF_SATURATION = 9.0
"""Phi(x) is 1 to the last bit of a double for x above this."""


@core
def normal_cdf(x: float) -> float:
    """Phi(x), the standard normal distribution function."""
    if x > CDF_SATURATION:
        return 1.0
    return 0.5 * math.erfc(-x * ROOT_HALF)


@core
def censored_log_likelihood(model: Array, bound: float, distance: float) -> float:
    """Log probability that a beam reads `bound` (metres, at most the maximum range) or more, an obstacle at `distance`.

    The point mass w_miss + w_outlier (1 - m/max) + w_hit ([d >= m] + [d < m] Phi((d - m)/s) / Phi(d/s)) for a bound m.
    """
    if bound == model[c.MAX_RANGE] and distance >= bound:
        return model[c.LOG_MISS]
    beyond = model[c.MISS] + model[c.OUTLIER_DENSITY] * (model[c.MAX_RANGE] - bound)
    if distance >= bound:
        return math.log(beyond + model[c.HIT])
    s = max(model[c.NOISE], model[c.NOISE_RELATIVE] * distance)
    beyond += model[c.HIT] * normal_cdf((distance - bound) / s) / normal_cdf(distance / s)
    return math.log(beyond) if beyond > 0.0 else -math.inf


@core
def beam_log_likelihood(model: Array, weight: float, reading: float, distance: float) -> float:
    """What a beam adds to the log likelihood: the log of its density (:func:`log_density`) times its weight."""
    return weight * log_density(model, reading, distance)


@core
def log_density(model: Array, reading: float, distance: float) -> float:
    """Log density of a reading if the first obstacle lies at `distance` (inf: none), metres.

    w_hit N(r; d, s^2) / Phi(d/s) + w_outlier / max for a return r, with s = max(noise, noise_relative d). inf is no
    return below the maximum range, -m a reading that is censored at m, where the beam leaves the window: both are point
    masses (:func:`censored_log_likelihood`), and the total over r < m and the mass at m is 1 for every d.
    """
    maximum = model[c.MAX_RANGE]
    if reading < 0.0 or reading >= maximum:
        return censored_log_likelihood(model, -reading if reading < 0.0 else maximum, distance)
    if distance >= maximum:
        return model[c.LOG_OUTLIER]
    s = max(model[c.NOISE], model[c.NOISE_RELATIVE] * distance)
    z = (reading - distance) / s
    if z * z > model[c.VANISHING]:
        return model[c.LOG_OUTLIER]
    peak = math.exp(-0.5 * z * z) / (s * ROOT_TWO_PI * normal_cdf(distance / s))
    return math.log(model[c.HIT] * peak + model[c.OUTLIER_DENSITY])
