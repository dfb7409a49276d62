"""Log likelihood of a sonar reading, given the features in its cone (section 2.3, as the documentation reads it)."""

import math

from prf.kernels._jit import Array, core
from prf.kernels.readings.laser import ROOT_TWO_PI, normal_cdf
from prf.kernels.readings.sonar_features import CORNER, DEPTH, KIND, N_FEATURES, PROJECTION, SUBTENDED, Sight

# Entries of the sonar model's array.
SONAR_MAX = 0  # maximum range, m
SONAR_NOISE = 1  # m
SONAR_NOISE_RELATIVE = 2
CORNER_BIAS = 3  # log odds of a return from a corner at no distance
CORNER_DISTANCE = 4  # loss of log odds a metre
SURFACE_BIAS = 5  # log odds of a return from a surface at no distance, face on, seen under no angle
SURFACE_DISTANCE = 6  # loss of log odds a metre
SURFACE_OBLIQUE = 7  # loss of log odds a radian away from face on
SURFACE_SUBTENDED = 8  # gain of log odds a radian of the field of view
OUTLIER_UNIFORM = 9  # share of stray readings that are uniform
OUTLIER_SHORT = 10  # share that are exponential
SHORT_RATE = 11  # of the exponential, 1/m
N_SONAR_MODEL = 12


@core
def return_probability(model: Array, feature: Array) -> float:
    """q_f: probability that a feature alone would return the pulse (logistic)."""
    if feature[KIND] == CORNER:
        log_odds = model[CORNER_BIAS] - model[CORNER_DISTANCE] * feature[DEPTH]
    else:
        oblique = 0.5 * math.pi - feature[PROJECTION]
        log_odds = model[SURFACE_BIAS] - model[SURFACE_DISTANCE] * feature[DEPTH]
        log_odds += model[SURFACE_SUBTENDED] * feature[SUBTENDED] - model[SURFACE_OBLIQUE] * oblique
    return 1.0 / (1.0 + math.exp(-log_odds))


@core
def hit_density(model: Array, reading: float, reach: float, depth: float) -> float:
    """Density at a reading of a pulse that came back from `depth`; from `reach` on the probability to read so much.

    A Gaussian cut at 0 and renormalised.
    """
    s = max(model[SONAR_NOISE], model[SONAR_NOISE_RELATIVE] * depth)
    positive = normal_cdf(depth / s)
    if reading >= reach:
        return normal_cdf((depth - reach) / s) / positive
    z = (reading - depth) / s
    return math.exp(-0.5 * z * z) / (s * ROOT_TWO_PI * positive)


@core
def stray_density(model: Array, reading: float, reach: float) -> float:
    """Density at a reading of a pulse that no feature returned; from `reach` on the probability to read so much."""
    if reading >= reach:
        beyond = 1.0 - model[OUTLIER_SHORT] - model[OUTLIER_UNIFORM] * reach / model[SONAR_MAX]
        return beyond + model[OUTLIER_SHORT] * math.exp(-model[SHORT_RATE] * reach)
    short = model[SHORT_RATE] * math.exp(-model[SHORT_RATE] * reading)
    return model[OUTLIER_UNIFORM] / model[SONAR_MAX] + model[OUTLIER_SHORT] * short


@core
def sonar_log_likelihood(model: Array, sight: Sight, reading: float, reach: float) -> float:
    """Log density of a reading (metres; from `reach` on, no return) given the features of `sight`, all within `reach`.

    Feature f returns the pulse with probability r_f = q_f prod over closer g of (1 - q_g); with what is left none does.
    """
    left = 1.0
    density = 0.0
    for i in range(sight.counts[N_FEATURES]):
        feature = sight.feature[sight.rank[i]]
        q = return_probability(model, feature)
        density += left * q * hit_density(model, reading, reach, feature[DEPTH])
        left *= 1.0 - q
    density += left * stray_density(model, reading, reach)
    return math.log(density) if density > 0.0 else -math.inf
