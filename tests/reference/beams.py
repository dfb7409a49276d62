"""The laser as it is written down, in plain numpy and shapely: density, impacts, readings at random. No kernels."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy import special

from prf.model.coloring import Coloring
from prf.model.window import Window

Floats = NDArray[np.float64]


class Sensor(NamedTuple):
    """Parameters of the contract, by their short names."""

    max: float
    noise: float = 0.03
    relative: float = 0.01
    outlier: float = 0.05
    miss: float = 0.02
    weight: float = 1.0

    @property
    def hit(self) -> float:
        return 1.0 - self.outlier - self.miss

    def spread(self, d: float) -> float:
        return max(self.noise, self.relative * d)


def normal(r: Floats, mean: float, s: float) -> Floats:
    """Density of the normal; scipy's takes thirty times as long to check its arguments."""
    return np.exp(-0.5 * ((r - mean) / s) ** 2) / (s * math.sqrt(2.0 * math.pi))


def density(sensor: Sensor, r: Floats, d: float) -> Floats:
    """Density of returns r < max: w_hit [d < max] N(r; d, s^2) / Phi(d/s) + w_outlier / max."""
    flat = np.full(np.shape(r), sensor.outlier / sensor.max)
    if d >= sensor.max:
        return flat
    s = sensor.spread(d)
    return flat + sensor.hit * normal(r, d, s) / special.ndtr(d / s)


def mass_from(sensor: Sensor, bound: float, d: float) -> float:
    """w_miss + w_outlier (1 - m/max) + w_hit ([d >= m] + [d < m] Phi((d - m)/s) / Phi(d/s)): a reading of m or more."""
    beyond = sensor.miss + sensor.outlier * (1.0 - bound / sensor.max)
    if d >= bound:
        return beyond + sensor.hit
    s = sensor.spread(d)
    return beyond + sensor.hit * float(special.ndtr((d - bound) / s) / special.ndtr(d / s))


def mass_of_no_return(sensor: Sensor, d: float) -> float:
    """A reading of the maximum range or more."""
    return mass_from(sensor, sensor.max, d)


def log_likelihood(sensor: Sensor, r: float, d: float, leaves: float = math.inf) -> float:
    """Log density of a reading if the first obstacle lies at d; all that counts beyond `leaves` is that it is more."""
    bound = min(leaves, sensor.max)
    if r < bound:
        return math.log(float(density(sensor, np.array(r), d)))
    return math.log(mass_from(sensor, bound, d))


def draw_readings(sensor: Sensor, distance: Floats, rng: np.random.Generator) -> Floats:
    """Readings (n,), inf for no return, by inverting the distribution of the normal cut at 0."""
    kind = rng.random(len(distance))
    u = rng.random(len(distance))
    s = np.maximum(sensor.noise, sensor.relative * np.where(np.isfinite(distance), distance, 0.0))
    with np.errstate(invalid="ignore"):
        from_zero = special.ndtr(-distance / s)
        seen = distance + s * special.ndtri(from_zero + u * (1.0 - from_zero))
    seen = np.where((distance < sensor.max) & (seen < sensor.max), seen, np.inf)
    reading = np.where(kind < sensor.outlier, u * sensor.max, seen)
    return np.where((kind >= sensor.outlier) & (kind < sensor.outlier + sensor.miss), np.inf, reading)


def exit_by_shapely(window: Window, origin: Floats, direction: Floats) -> float:
    """Distance at which a ray from inside leaves the window."""
    far = origin + 3.0 * (window.width + window.height) * direction
    inside = shapely.intersection(shapely.LineString([origin, far]), shapely.box(*window))
    return float(np.hypot(*(np.array(inside.coords) - origin).T).max())


def impacts(coloring: Coloring, origin: Floats, angle: Floats, max_range: float) -> Floats:
    """Distance (n,) to the nearest edge that the ray meets inside the window and within `max_range`, inf for none."""
    edges = shapely.linestrings(coloring.xy[coloring.edges]) if coloring.n_edges else np.array([])
    found = np.full(len(angle), np.inf)
    for i, (start, turn) in enumerate(zip(origin, angle, strict=True)):
        direction = np.array([math.cos(turn), math.sin(turn)])
        reach = min(exit_by_shapely(coloring.window, start, direction), max_range)
        met = shapely.intersection(edges, shapely.LineString([start, start + reach * direction]))
        places = shapely.get_coordinates(met[~shapely.is_empty(met)] if len(edges) else [])
        if len(places):
            found[i] = float(np.hypot(*(places - start).T).min())
    return found


def log_likelihoods_in(
    coloring: Coloring, sensor: Sensor, origin: Floats, angle: Floats, readings: Floats
) -> list[float]:
    """Log density of each reading (n,) in a map; where its beam leaves the window, what is known of the world ends."""
    distance = impacts(coloring, origin, angle, sensor.max).tolist()
    direction = np.column_stack([np.cos(angle), np.sin(angle)])
    leaves = [exit_by_shapely(coloring.window, *ray) for ray in zip(origin, direction, strict=True)]
    rows = zip(readings.tolist(), distance, leaves, strict=True)
    return [log_likelihood(sensor, r, d, leave) for r, d, leave in rows]
