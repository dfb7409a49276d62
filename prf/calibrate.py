"""Parameters of the sensors from readings at known poses in a known map (docs/calibration.md).

Maximum likelihood with weak priors: every parameter is fitted on an unbounded scale, positive ones by their
logarithm, shares by their log odds, and has there a Gaussian prior round its default. What the readings do not show
then keeps its default, with a standard error that shows it.
"""

from __future__ import annotations

import logging
import math
import os
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy import optimize, special

from prf.configuration import Configuration
from prf.kernels.readings.sonar_features import CORNER, DEPTH, KIND, PROJECTION, SUBTENDED
from prf.model.ranges import make_poses, unit_vectors, window_exit
from prf.model.sensors import LaserModel, SonarModel
from prf.readings import Readings, thin
from prf.readings.describe import default_max_range
from prf.readings.readings import fields_of_view
from prf.results.score import HeldOutSonar, OccupiedArea, read_occupied_area
from prf.results.score.scene import enclosing_window, features_seen, first_edges, outline, scene_of_region
from prf.shell.cli.settings_file import settings_text
from prf.shell.errors import InputError
from prf.simulate.world import YAML_SUFFIXES, area_of_map, read_cell_map

Floats = NDArray[np.float64]
Density = Callable[[dict[str, float], float], Floats]
"""The density (n,) of every reading, by the parameters and the power of the mean in place of the larger noise."""

logger = logging.getLogger(__name__)

GAIN = 0.01  # nats a reading by which a map must explain readings better than no map, else the two do not fit
PLAIN = frozenset({"corner_bias", "surface_bias"})  # parameters that are fitted as they are
LIMIT = 5.0  # widths of its prior by which a parameter may leave its default
STEP = 1e-3  # of the differences that give the Hessian, on the scale of the fit
INFORMED = 0.5
"""A parameter is the prior's rather than the data's if its error is more than this share of the prior's width."""
SMOOTH, SHARP = 16.0, math.inf
"""Powers of that mean: at most 4.4 % more than the larger noise, so that searches pass its kink; and as the models."""


class Family(NamedTuple):
    """The parameters of a model with their defaults, in order; `shares` are fitted by log odds against their rest."""

    default: dict[str, float]
    shares: tuple[str, ...]

    def width(self) -> Floats:
        """Return the standard deviations of the priors on the scale of the fit."""
        return np.array([2.0 if name in PLAIN or name in self.shares else 1.0 for name in self.default])

    def to_scale(self, values: dict[str, float]) -> Floats:
        """Return the point on the scale of the fit for these parameters."""
        rest = 1.0 - sum(values[name] for name in self.shares)
        return np.array(
            [
                value if name in PLAIN else math.log(value / (rest if name in self.shares else 1.0))
                for name, value in values.items()
            ]
        )

    def natural(self, theta: Floats) -> dict[str, float]:
        """Return the parameters at a point on the scale of the fit."""
        found = {
            name: at if name in PLAIN else math.exp(at) for name, at in zip(self.default, theta.tolist(), strict=True)
        }
        whole = 1.0 + sum(found[name] for name in self.shares)
        return {name: value / whole if name in self.shares else value for name, value in found.items()}


class Calibrated(NamedTuple):
    """The parameters of one sensor that explain its readings best."""

    kind: str  # sonar or laser
    family: Family
    theta: Floats  # (k,) the fit on its scale
    # value, error: (k,) as people write them, and standard errors (nan where the Hessian is not positive definite)
    value: Floats
    error: Floats
    informed: NDArray[np.bool_]  # (k,) whether the readings determine a parameter better than its prior
    # loss_before, loss, no_map: -log likelihood in nats: at the defaults, at the fit, and fitted without any map
    loss_before: float
    loss: float
    no_map: float
    converged: bool
    # max_range, cone: metres; full field of view of most sonars in radians, nan for a laser
    max_range: float
    cone: float
    # n_readings, n_scans, n_outside, n_occupied, n_in_view: used; their scans; dropped because the sensor is outside
    # the map, or in a wall; used with a wall in view
    n_readings: int
    n_scans: int
    n_outside: int
    n_occupied: int
    n_in_view: int


def calibrate_sonar(readings: Readings, area: OccupiedArea, config: Configuration) -> Calibrated:
    """Return the sonar's parameters that explain the readings of a whole log in a known map best."""
    model = SonarModel(max_range=config.sonar.max_range)
    used, counts = _usable(readings, area, config)
    view = fields_of_view(used, config.sonar.cone)
    cones = HeldOutSonar(make_poses(model, used.origin, used.angle, view, used.range), model)
    scene = scene_of_region(area.region, area.window, cones.origin, model.max_range)
    start, feature = features_seen(scene, cones.pose, model.max_range)
    count = np.diff(start)
    there = np.arange(max(1, int(count.max(initial=0)))) < count[:, None]
    rows = np.zeros((*there.shape, feature.shape[1]))
    rows[there] = feature
    default = model.model_dump(exclude={"max_range", "cone"})
    family = Family(default, ("uniform_probability", "short_probability"))
    density = sonar_density(cones.range, rows, there, model.max_range)
    blind = sonar_density(cones.range, rows, np.zeros_like(there), model.max_range)
    return _fitted(
        "sonar", family, (density, blind), used, count > 0, (model.max_range, float(np.median(view))), counts
    )


def calibrate_laser(readings: Readings, area: OccupiedArea, config: Configuration) -> Calibrated:
    """Return the laser's parameters that explain the readings of a whole log in a known map best."""
    max_range = default_max_range(readings) if config.laser.max_range is None else config.laser.max_range
    if not math.isfinite(max_range):
        raise InputError(f"{readings.source}: no reading has a finite range. Give --max-range.")
    default = LaserModel().model_dump(exclude={"max_range", "beam_weight"})
    used, counts = _usable(readings, area, config)
    direction, reach = unit_vectors(used.angle), np.full(used.n_beams, max_range)
    if area.window is not None:
        reach = np.minimum(reach, window_exit(area.window, used.origin, direction))
    window = area.window or enclosing_window(used.origin, max_range, area.region)
    rays = np.ascontiguousarray(np.column_stack([used.origin, direction, reach]))
    distance = first_edges(rays, outline(area.region, area.window)[0], window)
    family = Family(default, ("outlier_probability", "miss_probability"))
    both = tuple(laser_density(used.range, at, reach, max_range) for at in (distance, np.full_like(distance, np.inf)))
    return _fitted("laser", family, (both[0], both[1]), used, np.isfinite(distance), (max_range, math.nan), counts)


def laser_density(reading: Floats, distance: Floats, reach: Floats, max_range: float) -> Density:
    """Return the density of readings of beams whose first obstacle lies at a distance (inf: none), all (n,).

    A reading of `reach` or more, which is the maximum range or where the beam leaves the map, is censored there.
    """
    met, returned = distance < reach, reading < reach
    depth, beyond = np.where(met, distance, reach), 1.0 - reach / max_range

    def density(value: dict[str, float], power: float) -> Floats:
        outlier, miss = value["outlier_probability"], value["miss_probability"]
        hit = np.where(met, _hit(reading, depth, value, power, reach), ~returned)
        rest = np.where(returned, outlier / max_range, miss + outlier * beyond)
        total: Floats = (1.0 - outlier - miss) * hit + rest
        return total

    return density


def sonar_density(reading: Floats, feature: Floats, there: NDArray[np.bool_], max_range: float) -> Density:
    """Return the density of readings (n,) given the features (n, m, N_FEATURE) in their cones, nearest first."""
    returned = np.isfinite(reading)
    z = np.where(returned, reading, max_range)
    depth = np.where(there, feature[..., DEPTH], 1.0)
    oblique, is_corner = 0.5 * math.pi - feature[..., PROJECTION], feature[..., KIND] == CORNER

    def density(value: dict[str, float], power: float) -> Floats:
        corner = value["corner_bias"] - value["corner_distance"] * depth
        surface = value["surface_bias"] - value["surface_distance"] * depth
        surface += value["surface_subtended"] * feature[..., SUBTENDED] - value["surface_oblique"] * oblique
        q = np.where(there, special.expit(np.where(is_corner, corner, surface)), 0.0)
        left = np.cumprod(np.column_stack([np.ones(len(q)), 1.0 - q]), axis=1)
        uniform, short = value["uniform_probability"], value["short_probability"]
        decay = np.exp(-z / value["short_length"])
        missed = 1.0 - uniform - short + short * decay
        outlier = np.where(returned, uniform / max_range + short / value["short_length"] * decay, missed)
        hit = _hit(np.broadcast_to(reading[:, None], depth.shape), depth, value, power, max_range)
        total: Floats = (left[:, :-1] * q * hit).sum(axis=1) + left[:, -1] * outlier
        return total

    return density


def _hit(reading: Floats, depth: Floats, value: dict[str, float], power: float, reach: Floats | float) -> Floats:
    """Return N(r; d, s^2) / Phi(d / s), and where there was no return up to `reach` its mass beyond."""
    larger = np.maximum(value["noise"], value["noise_relative"] * depth)
    smaller = np.minimum(value["noise"], value["noise_relative"] * depth)
    s = larger * (1.0 + (smaller / larger) ** power) ** (1.0 / power)
    returned = reading < reach
    z = (np.where(returned, reading, reach) - depth) / s
    bell = np.exp(-0.5 * z * z) / (math.sqrt(2.0 * math.pi) * s)
    found: Floats = np.where(returned, bell, special.ndtr(-z)) / special.ndtr(depth / s)
    return found


def _usable(readings: Readings, area: OccupiedArea, config: Configuration) -> tuple[Readings, tuple[int, int]]:
    """Return the readings whose sensor is in free space; how many are outside the map, and in a wall."""
    kept = thin(readings, **config.readings.selection())
    inside = np.ones(kept.n_beams, np.bool_)
    if area.window is not None:
        inside = area.window.contains(kept.origin, strictly=True)
    occupied = inside & shapely.contains_xy(area.region, kept.origin)
    n_outside, n_occupied = int(np.count_nonzero(~inside)), int(np.count_nonzero(occupied))
    if n_outside + n_occupied == kept.n_beams:
        raise InputError(
            f"{readings.source}: none of {kept.n_beams} readings can be used: {n_outside} sensors are outside the "
            f"map and {n_occupied} in its walls. Are log and map in one frame, metres and radians?"
        )
    for n, where in ((n_outside, "outside the map"), (n_occupied, "in a wall of the map")):
        if n:
            logger.warning(f"{n} of {kept.n_beams} readings dropped: their sensors are {where}")
    return kept.select(inside & ~occupied), (n_outside, n_occupied)


def _fitted(
    kind: str,
    family: Family,
    densities: tuple[Density, Density],
    used: Readings,
    in_view: NDArray[np.bool_],
    sensor: tuple[float, float],
    dropped: tuple[int, int],
) -> Calibrated:
    """Return the fit with its checks; `densities` are those with and without the map, `sensor` maximum range, cone."""
    if not in_view.any():
        raise InputError(
            f"{used.source}: no wall of the map is in view of any of {used.n_beams} readings. Are both in one frame?"
        )
    start = family.to_scale(family.default)
    theta, converged = fit(family, densities[0])
    before, loss = (loss_at(family, densities[0], at) for at in (start, theta))
    no_map = loss_at(family, densities[1], fit(family, densities[1])[0])
    if no_map - loss < GAIN * used.n_beams:
        logger.warning(f"{used.source}: the map explains the readings no better than no map at all. One frame?")
    if not converged:
        logger.warning(f"{used.source}: the search for the best parameters stopped early")
    value, error, informed = _standard_errors(family, densities[0], theta)
    n_scans, n_in_view = len(np.unique(used.scan)), int(np.count_nonzero(in_view))
    return Calibrated(
        kind, family, theta, value, error, informed, before, loss, no_map, converged, *sensor,
        used.n_beams, n_scans, *dropped, n_in_view,
    )  # fmt: skip


def loss_at(family: Family, density: Density, theta: Floats, power: float = SHARP) -> float:
    """Return -log likelihood in nats at a point on the scale of the fit."""
    return -float(np.log(np.maximum(density(family.natural(theta), power), 1e-300)).sum())


def penalised(family: Family, density: Density, theta: Floats) -> float:
    """Return -log (likelihood times prior) in nats."""
    off = (theta - family.to_scale(family.default)) / family.width()
    return loss_at(family, density, theta, SMOOTH) + 0.5 * float(off @ off)


def fit(family: Family, density: Density) -> tuple[Floats, bool]:
    """Return the most probable parameters on the scale of the fit, and whether the search converged.

    It starts from the defaults and from smaller noises, since either of the two noises may be the one that matters.
    """
    start, room = family.to_scale(family.default), LIMIT * family.width()
    starts = [start.copy() for _ in range(3)]
    for index in (0, 1):
        starts[1 + index][index] -= 1.5
    ends = [
        optimize.minimize(
            lambda theta: penalised(family, density, theta),
            at,
            method="L-BFGS-B",
            bounds=optimize.Bounds(start - room, start + room),
            options={"maxiter": 300, "maxfun": 20_000, "ftol": 1e-11, "gtol": 1e-3},
        )
        for at in starts
    ]
    best = min(ends, key=lambda end: float(end.fun))
    return np.asarray(best.x, dtype=np.float64), bool(best.success)


def _standard_errors(family: Family, density: Density, theta: Floats) -> tuple[Floats, Floats, NDArray[np.bool_]]:
    """Return parameters, their standard errors by the inverse Hessian, and which the readings determine."""

    def natural(at: Floats) -> Floats:
        return np.array(list(family.natural(at).values()))

    steps, k = STEP * np.eye(len(theta)), len(theta)
    hessian = np.empty((k, k))
    for i in range(k):
        for j in range(i + 1):
            a, b = steps[i], steps[j]
            corners = [penalised(family, density, theta + x) for x in (a + b, a - b, b - a, -a - b)]
            hessian[i, j] = hessian[j, i] = (corners[0] - corners[1] - corners[2] + corners[3]) / (4.0 * STEP**2)
    if not np.isfinite(hessian).all() or np.linalg.eigvalsh(hessian).min() <= 0.0:
        unknown = np.full(k, np.nan)
        return natural(theta), unknown, np.zeros(k, np.bool_)
    covariance = np.linalg.inv(hessian)
    jacobian = np.stack([(natural(theta + step) - natural(theta - step)) / (2.0 * STEP) for step in steps], axis=1)
    error = np.sqrt(np.diag(jacobian @ covariance @ jacobian.T))
    return natural(theta), error, np.sqrt(np.diag(covariance)) < INFORMED * family.width()


def read_known_map(path: str | os.PathLike[str]) -> OccupiedArea:
    """Read the occupied area of a map file: .yaml and .yml are maps of ROS, others GeoJSON."""
    is_ros = Path(path).suffix.lower() in YAML_SUFFIXES
    area = area_of_map(read_cell_map(path)) if is_ros else read_occupied_area(path)
    if area.region.is_empty:
        raise InputError(f"{path}: nothing is occupied in this map. Calibration needs walls.")
    return area


def fitted_text(found: Iterable[Calibrated]) -> str:
    """Return a settings file of fitted parameters, with standard errors, and what stems from the prior alone."""
    tables: dict[str, dict[str, float]] = {}
    comments = {"": "Fitted by prf calibrate."}
    for part in found:
        cone = {} if math.isnan(part.cone) else {"cone": float(f"{part.cone:.5g}")}
        tables[part.kind] = {"max_range": part.max_range, **cone}
        n_view = f"{part.n_in_view} with a wall in view"
        comments[part.kind] = f"{part.n_readings} readings of {part.n_scans} scans, {n_view}"
        for name, value, error, informed in zip(
            part.family.default, part.value, part.error, part.informed, strict=True
        ):
            tables[part.kind][name] = float(f"{value:.5g}")
            comments[f"{part.kind}.{name}"] = f"+- {error:.2g}" + ("" if informed else ", hardly from the readings")
    return settings_text(tables, comments)


def report_of(part: Calibrated) -> dict[str, Any]:
    """Return everything about one sensor for ``--json``."""
    counts = ("n_readings", "n_scans", "n_outside", "n_occupied", "n_in_view", "max_range", "cone", "converged")
    rows = zip(part.family.default.items(), part.value, part.error, part.informed, strict=True)
    return {
        **{name: getattr(part, name) for name in counts},
        "log_likelihood_default": -part.loss_before,
        "log_likelihood": -part.loss,
        "log_likelihood_no_map": -part.no_map,
        "parameters": [
            {"name": name, "default": old, "value": float(new), "error": float(error), "informed": bool(informed)}
            for (name, old), new, error, informed in rows
        ],
    }


def lines_of(part: Calibrated, most: int | None = None) -> list[str]:
    """Return everything about one sensor for a person, or the `most` parameters that moved most beside their error."""
    rows = [f"{part.kind:22} {'default':>9} {'fitted':>9} {'+-':>9}"]
    parameters = report_of(part)["parameters"]
    by_change = sorted(parameters, key=lambda row: -abs(row["value"] - row["default"]) / max(row["error"], 1e-12))
    for row in (row for row in parameters if row in by_change[:most]):
        note = "" if row["informed"] else "   hardly from the readings"
        rows.append(f"{row['name']:22} {row['default']:9.4g} {row['value']:9.4g} {row['error']:9.2g}{note}")
    before, after, without = (-loss / part.n_readings for loss in (part.loss_before, part.loss, part.no_map))
    rows.append(f"{'readings':22} {part.n_readings} of {part.n_scans} scans, {part.n_in_view} with a wall in view")
    rows.append(
        f"{'log likelihood':22} {before:.4f} a reading before, {after:.4f} after, {without:.4f} without the map"
    )
    return rows
