"""Held-out beams against finished maps: first edges on many beams, and first hits among the cells of a grid."""

import math

from prf.kernels import constants as c
from prf.kernels._jit import Array, core, core_entry
from prf.kernels.readings.laser import CDF_SATURATION, ROOT_TWO_PI, log_density, normal_cdf
from prf.kernels.state.grid import Grid, axis_index

LEAST_BIN = 1e-9
"""Share of a bin below which rounding, not the reach of a ray, made one more."""


@core
def outliers(model: Array, reading: float) -> float:
    """Density of an outlier, or its probability of ending beyond m where the reading is -m, censored at m."""
    if reading < 0.0:
        return model[c.OUTLIER_DENSITY] * (model[c.MAX_RANGE] + reading)
    return model[c.OUTLIER_DENSITY]


@core_entry
def add_densities(model: Array, readings: Array, distance: Array, occupied: Array, total: Array) -> None:
    """Add the density of each reading given its distance to ``total`` (n,); an occupied sensor leaves the outliers.

    A reading -m is censored at m: its probability takes the place of a density.
    """
    for beam in range(readings.size):
        if occupied[beam]:
            total[beam] += outliers(model, readings[beam])
        else:
            total[beam] += math.exp(log_density(model, readings[beam], distance[beam]))


@core
def cell_probability(grid: Grid, occupancy: Array, x: float, y: float) -> float:
    """Probability that the cell of (x, y), a place in the grid, is occupied."""
    row = axis_index((y - grid.y0) / grid.cell, grid.ny)
    return occupancy[row, axis_index((x - grid.x0) / grid.cell, grid.nx)]


@core
def cdf_integral(z: float) -> float:
    """Integral of Phi from -inf to z."""
    return z * normal_cdf(z) + math.exp(-0.5 * z * z) / ROOT_TWO_PI


@core
def blurred_bin(reading: float, near: float, far: float, s: float) -> float:
    """Density of a reading whose obstacle is uniform on [near, far]: the noise of deviation s, cut at 0."""
    spread = normal_cdf((far - reading) / s) - normal_cdf((near - reading) / s)
    if near > CDF_SATURATION * s:
        return spread / (far - near)
    return spread / (s * (cdf_integral(far / s) - cdf_integral(near / s)))


@core
def blurred_tail(bound: float, near: float, far: float, s: float) -> float:
    """Probability of a reading beyond a bound, the obstacle uniform on [near, far]; see ``blurred_bin``."""
    whole = (far - near) / s if near > CDF_SATURATION * s else cdf_integral(far / s) - cdf_integral(near / s)
    return (cdf_integral((far - bound) / s) - cdf_integral((near - bound) / s)) / whole


@core
def grid_beam(
    grid: Grid, occupancy: Array, model: Array, width: float, ray: Array, reading: float
) -> tuple[float, float]:
    """Density of a return, and distance of the first bin more likely occupied than not (inf: none).

    Bins of `width` up to the reach of the ray take the probability of the cell at their middle; the weight of bin k is
    p_k prod_{j < k} (1 - p_j), and the reading spreads round an obstacle anywhere in its bin. A reading -m is censored
    at m, the reach: its probability takes the place of a density.
    """
    reach = ray[c.MAX_DISTANCE]
    density = outliers(model, reading)
    first = math.inf
    unmet = 1.0
    for k in range(math.ceil(reach / width - LEAST_BIN)):
        near = k * width
        far = min(near + width, reach)
        middle = 0.5 * (near + far)
        s = max(model[c.NOISE], model[c.NOISE_RELATIVE] * middle)
        p = cell_probability(grid, occupancy, ray[0] + middle * ray[2], ray[1] + middle * ray[3])
        if first == math.inf and p > 0.5:
            first = middle
        if reading < 0.0:
            density += model[c.HIT] * p * unmet * blurred_tail(reach, near, far, s)
        elif near - CDF_SATURATION * s < reading < far + CDF_SATURATION * s:
            density += model[c.HIT] * p * unmet * blurred_bin(reading, near, far, s)
        unmet *= 1.0 - p
    if reading < 0.0:
        density += model[c.MISS] + model[c.HIT] * unmet
    return density, first


@core_entry
def grid_beams(
    grid: Grid, occupancy: Array, model: Array, width: float, rays: Array, readings: Array, density: Array, first: Array
) -> None:
    """Set ``density`` and ``first`` (n,) of every beam: see :func:`grid_beam`."""
    for beam in range(readings.size):
        density[beam], first[beam] = grid_beam(grid, occupancy, model, width, rays[beam], readings[beam])
