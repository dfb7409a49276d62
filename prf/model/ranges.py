"""Laser and sonar: their beams and cones laid out for a chain (paper, sections 2.2 and 2.3)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from prf.kernels import constants as c
from prf.kernels.readings import cones as k
from prf.kernels.readings import sonar as m
from prf.kernels.readings import sonar_features as v
from prf.kernels.readings.beams import Beams, find_aims, find_exits
from prf.kernels.readings.laser_change import FADED
from prf.kernels.state.cell_lists import cells_of_segments, room_of_cells
from prf.kernels.state.grid import Grid, most_cells
from prf.model.sensors import LaserModel, SonarModel
from prf.model.window import Window
from prf.shell.errors import ConfigError

Floats = NDArray[np.float64]

MAX_SLOTS = 2**31  # slots are numbered by 32-bit integers

FIRST_LEVEL = 5_000  # beams at least that are tested at first, where there are further levels
LEVEL_GROWTH = 4  # how many times as many beams there are with a further level as without it
ORDER = 19530921  # seed of the order in which beams are dealt to levels

BELOW_ONE_BIT = 2.0**-54  # what is added to a number and is smaller than this share of it leaves no trace
INFLUENCE_MARGIN = 1e-6  # share by which an influence is enlarged: rounding must not let an obstacle slip through
MARGIN = 1e-3  # metres by which the ends of an aim are moved outwards: more than slots are rounded by


def unit_vectors(angle: Floats) -> Floats:
    """Return the directions (n, 2) of beams at angles (n,), radians counter-clockwise from +x."""
    return np.stack([np.cos(angle), np.sin(angle)], axis=1)


def window_exit(window: Window, origin: Floats, direction: Floats) -> Floats:
    """Return the distance (n,) at which rays from inside the window leave it.

    `origin`, `direction` (n, 2): metres; unit vectors.
    """
    corner = np.where(direction > 0.0, [window.x_max, window.y_max], [window.x_min, window.y_min])
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = np.where(direction != 0.0, (corner - origin) / direction, np.inf)
    return np.minimum(distance[:, 0], distance[:, 1])


def make_rays(window: Window, model: LaserModel, origin: Floats, angle: Floats, readings: Floats) -> Floats:
    """Return the (n, N_RAY) array of beams that the kernels keep, with no impact yet.

    `origin` (n, 2): sensor positions inside the window, metres. `angle` (n,): directions in the world frame, radians.
    `readings` (n,): metres; inf or at least the maximum range: no return. One that ends beyond the window is censored
    at its border: the map only determines that nothing stopped the beam before (docs/sensor-models.md).
    """
    ray = np.zeros((len(angle), c.N_RAY))
    ray[:, c.ORIGIN_X : c.ORIGIN_Y + 1] = origin
    ray[:, c.DIRECTION_X] = np.cos(angle)
    ray[:, c.DIRECTION_Y] = np.sin(angle)
    direction = ray[:, c.DIRECTION_X : c.DIRECTION_Y + 1]
    leaves = window_exit(window, ray[:, :2], direction)
    ray[:, c.MAX_DISTANCE] = np.minimum(leaves, model.limit)
    beyond = np.where(leaves < model.limit, -leaves, np.inf)
    ray[:, c.RANGE] = np.where(readings < ray[:, c.MAX_DISTANCE], readings, beyond)
    ray[:, c.DISTANCE] = np.inf
    return ray


def deal_levels(n: int, n_levels: int) -> NDArray[np.uint8]:
    """Return the stage (n,) of the decision at which each beam is tested: a fourth of them before the last, and so on.

    Drawn at random, the same for all chains: beams of a scan differ little, and so do scans that follow each other.
    """
    level = np.zeros(n, np.uint8)
    order = np.random.default_rng(ORDER).permutation(n)
    for stage in range(1, n_levels):
        level[order[math.ceil(n / LEVEL_GROWTH ** (n_levels - stage)) :]] = stage
    return level


def number_of_levels(n: int, first: int = FIRST_LEVEL) -> int:
    """Return in how many stages so many beams are tested, `first` at least at first."""
    return 1 + max(0, int(math.log(max(n, 1) / first, LEVEL_GROWTH)))


def empty_lists(beams: Beams, edge_capacity: int) -> Beams:
    """Return the beams with empty lists for so many edges; they must be listed anew."""
    shape = (edge_capacity, beams.first_beam.shape[1])
    return beams._replace(first_beam=np.full(shape, c.NONE, np.int32), edge_shortfall=np.zeros(shape))


def laser_array(model: LaserModel) -> Floats:
    """Return the parameters as the kernels take them, (N_LASER_MODEL,)."""
    array = np.zeros(c.N_LASER_MODEL)
    array[c.MAX_RANGE] = model.limit
    array[c.NOISE] = model.noise
    array[c.NOISE_RELATIVE] = model.noise_relative
    array[c.HIT] = model.hit_probability
    array[c.OUTLIER_DENSITY] = model.outlier_probability / model.limit
    array[c.MISS] = model.miss_probability
    array[c.LOG_OUTLIER] = math.log(model.outlier_probability / model.limit)
    array[c.LOG_MISS] = math.log(model.miss_probability + model.hit_probability)
    array[c.WEIGHT] = model.weight
    array[c.VANISHING] = model.deviation_where_hits_are(BELOW_ONE_BIT) ** 2
    return array


def best_log_density(model: LaserModel, readings: Floats) -> Floats:
    """Return a bound (n,) that the log density of each reading exceeds at no distance.

    Readings are those of :func:`make_rays`: metres; inf for no return, -m for one that is censored at m.

    At r = d with s = max(noise, noise_relative r) the Gaussian is highest but for noise_relative^2 nats, because s
    grows with d. What is cut off below 0 at most doubles it, and matters only near 0 unless the noise is wide.
    """
    has_return = np.isfinite(readings) & (readings >= 0.0)
    spread = np.maximum(model.noise, model.noise_relative * np.where(has_return, readings, 0.0))
    near = readings < 20.0 * spread
    if model.is_wide:
        spread, near = np.full(len(readings), model.noise), has_return
    peak = np.where(near, 2.0, 1.0) * math.exp(model.noise_relative**2) / (spread * math.sqrt(2.0 * math.pi))
    hit = np.log(model.hit_probability * peak + model.outlier_probability / model.limit)
    censored_at = np.where(readings < 0.0, -readings, model.limit)
    outliers = model.outlier_probability * (1.0 - censored_at / model.limit)
    missed = np.log(model.miss_probability + model.hit_probability + outliers)
    return np.asarray(np.where(has_return, hit, missed) + 1e-9)


def beam_influence(model: LaserModel, readings: Floats) -> Floats:
    """Return the distance (n,) beyond which an obstacle is no more likely to return a reading than none at all.

    There ``beam_log_likelihood`` gives the density of an outlier, to the last bit. Infinite
    for readings without return, and for censored ones (:func:`make_rays`): any obstacle in reach concerns these.
    """
    returned = np.where(readings < 0.0, np.inf, readings)
    sigmas = model.deviation_where_hits_are(BELOW_ONE_BIT)
    share = 1.0 - sigmas * model.noise_relative
    far = np.maximum(returned + sigmas * model.noise, returned / share if share > 0.0 else np.inf)
    return np.asarray((1.0 + INFLUENCE_MARGIN) * far, np.float64)


def aims_of(model: LaserModel, readings: Floats, weight: Floats) -> tuple[Floats, Floats]:
    """Return the distances (n,) between which an obstacle can explain a reading better than none before its own.

    Outside of them a beam that is cut, and counts as so many (n,), gains less than ``FADED`` of the kernels; one
    without return, or that is censored (readings as of :func:`make_rays`), nowhere.
    """
    if model.is_wide:
        return np.full(len(readings), -np.inf), np.full(len(readings), np.inf)
    readings = np.where(readings < 0.0, np.inf, readings)
    z = np.sqrt(2.0 * np.maximum(0.0, model.log_peak - np.log(FADED / np.maximum(weight, 1.0))))
    shrunk = 1.0 - z * model.noise_relative
    beyond = np.where(shrunk > 0.0, readings / np.where(shrunk > 0.0, shrunk, 1.0), np.inf)
    near = np.minimum(readings - z * model.noise, readings / (1.0 + z * model.noise_relative))
    far = np.maximum(readings + z * model.noise, beyond)
    return near, far


def make_beams(
    grid: Grid,
    model: LaserModel,
    ray: Floats,
    weight: Floats,
    edge_capacity: int,
    n_levels: int | None = None,
    first_level: int = FIRST_LEVEL,
) -> Beams:
    """Lay out beams and the index of their cells, with room for the longest possible lists.

    `ray` (n, N_RAY). `weight` (n,): readings that each stands for, itself among them. `n_levels`: stages of a decision;
    None: by the number of beams, `first_level` of them at least in the first.
    """
    n = len(ray)
    n_cells = grid.nx * grid.ny
    n_levels = number_of_levels(n, first_level) if n_levels is None else n_levels
    level = deal_levels(n, n_levels)
    slot_start, slot_cell, slot_exit, cell_start = _make_slots(grid, ray, level, n_levels)
    n_slots = len(slot_cell)
    aim = np.zeros((n, 2), np.int32)
    weight = model.weight * weight
    near, far = aims_of(model, ray[:, c.RANGE], weight)
    find_aims(near - MARGIN, far + MARGIN, slot_start, slot_exit, aim)
    return Beams(
        model=laser_array(model),
        ray=ray.copy(),
        beyond=np.full(n, np.inf),
        impact_edge=np.full(n, c.NONE, np.int32),
        last_slot=np.zeros(n, np.int32),
        next_beam=np.full(n, c.NONE, np.int32),
        previous_beam=np.full(n, c.NONE, np.int32),
        first_beam=np.full((edge_capacity, n_levels), c.NONE, np.int32),
        level=level,
        slot_start=slot_start,
        slot_cell=slot_cell,
        slot_exit=slot_exit,
        slot_place=np.full(n_slots, c.NONE, np.int32),
        cell_start=cell_start,
        cell_count=np.zeros(n_levels * n_cells, np.int32),
        entries=np.zeros((n_slots, 2), np.int32),
        weight=weight,
        best=weight * best_log_density(model, ray[:, c.RANGE]),
        aim=aim,
        edge_shortfall=np.zeros((edge_capacity, n_levels)),
        cell_shortfall=np.zeros(n_levels * n_cells),
        mark=np.zeros(n, np.int32),
        touched=np.zeros(n, np.int32),
        touched_edge=np.zeros(n, np.int32),
        touched_distance=np.zeros(n),
        touched_log_likelihood=np.zeros(n),
        n_touched=np.zeros(1, np.int64),
    )


def _make_slots(
    grid: Grid, ray: Floats, level: NDArray[np.uint8], n_levels: int
) -> tuple[NDArray[np.int64], NDArray[np.int32], NDArray[np.float32], NDArray[np.int64]]:
    """Return the cells that each beam passes, where it leaves them, and where the beams of each cell begin."""
    n = len(ray)
    path, slot_start = np.empty(most_cells(grid), np.int32), np.zeros(n + 1, np.int64)
    end = ray[:, :2] + ray[:, [c.MAX_DISTANCE]] * ray[:, c.DIRECTION_X : c.DIRECTION_Y + 1]
    segments = np.column_stack([ray[:, :2], end])
    n_slots = cells_of_segments(grid, segments, path, slot_start, np.empty(0, np.int32))
    if n_slots >= MAX_SLOTS:
        raise ConfigError(
            f"{n} beams pass {n_slots} cells, too many for one index. Thin them: --every-scan, --every-beam."
        )
    slot_cell, slot_exit = np.empty(n_slots, np.int32), np.empty(n_slots, np.float32)
    cells_of_segments(grid, segments, path, slot_start, slot_cell)
    find_exits(grid, ray, slot_start, slot_cell, slot_exit)
    slot_cell += np.repeat(level.astype(np.int32) * (grid.nx * grid.ny), np.diff(slot_start))
    return slot_start, slot_cell, slot_exit, room_of_cells(slot_cell, n_levels * grid.nx * grid.ny)


def sonar_array(model: SonarModel) -> Floats:
    """Return the parameters as the kernels take them, (N_SONAR_MODEL,)."""
    array = np.zeros(m.N_SONAR_MODEL)
    array[m.SONAR_MAX] = model.max_range
    array[m.SONAR_NOISE] = model.noise
    array[m.SONAR_NOISE_RELATIVE] = model.noise_relative
    array[m.CORNER_BIAS] = model.corner_bias
    array[m.CORNER_DISTANCE] = model.corner_distance
    array[m.SURFACE_BIAS] = model.surface_bias
    array[m.SURFACE_DISTANCE] = model.surface_distance
    array[m.SURFACE_OBLIQUE] = model.surface_oblique
    array[m.SURFACE_SUBTENDED] = model.surface_subtended
    array[m.OUTLIER_UNIFORM] = model.uniform_probability
    array[m.OUTLIER_SHORT] = model.short_probability
    array[m.SHORT_RATE] = 1.0 / model.short_length
    return array


def return_probabilities(model: SonarModel, feature: Floats) -> tuple[Floats, Floats, float]:
    """Return what the features in one cone do with a pulse (docs/sensor-models.md, "Likelihood").

    `feature` (n, N_FEATURE): nearest first, columns as in ``prf.kernels.readings.sonar_features``. Returns q (n,), how
    probably each would return the pulse if there were no other; r (n,), how probably it does, since what nearer
    features return does not reach it; and r_0, how probably none does.
    """
    depth = feature[:, v.DEPTH]
    corner = model.corner_bias - model.corner_distance * depth
    surface = model.surface_bias - model.surface_distance * depth + model.surface_subtended * feature[:, v.SUBTENDED]
    surface -= model.surface_oblique * (0.5 * math.pi - feature[:, v.PROJECTION])
    alone = 1.0 / (1.0 + np.exp(-np.where(feature[:, v.KIND] == v.CORNER, corner, surface)))
    left = np.cumprod(np.append(1.0, 1.0 - alone))
    return alone, left[:-1] * alone, float(left[-1])


def cone_exit(window: Window, origin: Floats, angle: Floats, cone: Floats) -> Floats:
    """Return the distance (n,) at which cones from inside the window first leave it, metres.

    `origin` (n, 2): metres. `angle`, `cone` (n,): directions of the axes and full fields of view, radians.
    """
    leaves = [window_exit(window, origin, unit_vectors(angle + side * cone)) for side in (-0.5, 0.5)]
    for direction in 0.5 * math.pi * np.arange(4):
        # A side of the window is nearest face on, if that direction lies in the cone.
        faces = np.abs(np.angle(np.exp(1j * (angle - direction)))) <= 0.5 * cone
        ahead = window_exit(window, origin, unit_vectors(np.full(len(angle), direction)))
        leaves.append(np.where(faces, ahead, np.inf))
    return np.asarray(np.min(leaves, axis=0), np.float64)


def make_poses(
    model: SonarModel, origin: Floats, angle: Floats, cone: Floats, readings: Floats, window: Window | None = None
) -> Floats:
    """Return the (n, N_POSE) array of cones that the kernels keep, with no extent yet.

    `origin` (n, 2): sensor positions inside the window, metres. `angle` (n,): directions in the world frame, radians.
    `cone` (n,): full fields of view, radians. `readings` (n,): metres; inf or at least the maximum range: no return.
    `window`: where the map ends. What returns a pulse from beyond the distance at which the cone leaves it may be
    outside: the sonar reaches up to there, and farther readings are no return (docs/sensor-models.md). None: no end.
    """
    if np.any(~(cone > 0.0) | ~(cone < math.pi)):
        raise ConfigError("sonar cone: the field of view must lie between 0 and pi radians")
    pose = np.zeros((len(angle), k.N_POSE))
    pose[:, v.POSE_X : v.POSE_Y + 1] = origin
    pose[:, v.POSE_COS] = np.cos(angle)
    pose[:, v.POSE_SIN] = np.sin(angle)
    pose[:, v.BORDER] = np.tan(0.5 * cone)
    leaves = np.full(len(angle), np.inf) if window is None else cone_exit(window, origin, angle, cone)
    pose[:, k.MAX_DISTANCE] = np.minimum(leaves, model.max_range)
    pose[:, k.READING] = np.where(readings < pose[:, k.MAX_DISTANCE], readings, np.inf)
    pose[:, k.EXTENT] = pose[:, k.MAX_DISTANCE]
    return pose


def make_sight(room: int) -> v.Sight:
    """Return scratch for the edges and features in one cone, with room for this many edges."""
    return v.Sight(
        line=np.zeros((room, 4)),
        slope=np.zeros((room, 2)),
        corner=np.zeros((room, 2), np.int32),
        bound=np.zeros(2 * room),
        feature=np.zeros((4 * room, v.N_FEATURE)),
        rank=np.zeros(4 * room, np.int32),
        counts=np.zeros(v.N_SIGHT_COUNTS, np.int64),
    )


def make_cones(grid: Grid, model: SonarModel, pose: Floats, edge_capacity: int) -> k.Cones:
    """Lay out cones and the index of their cells, with room for the longest possible lists."""
    n, n_cells = len(pose), grid.nx * grid.ny
    side = min(2 * math.ceil(model.max_range / grid.cell) + 3, max(grid.nx, grid.ny))
    cells, near = np.empty(side * side, np.int32), np.empty(side * side)
    slot_start = np.zeros(n + 1, np.int64)
    n_slots = k.find_slots(grid, pose, cells, near, slot_start, np.empty(0, np.int32), np.empty(0, np.float32))
    if n_slots >= MAX_SLOTS:
        raise ConfigError(
            f"{n} sonar readings pass {n_slots} cells, too many for one index. Thin them: --every-scan, --every-beam."
        )
    slot_cell, slot_near = np.empty(n_slots, np.int32), np.empty(n_slots, np.float32)
    k.find_slots(grid, pose, cells, near, slot_start, slot_cell, slot_near)
    return k.Cones(
        model=sonar_array(model),
        pose=pose.copy(),
        last_slot=np.zeros(n, np.int32),
        slot_start=slot_start,
        slot_cell=slot_cell,
        slot_near=slot_near,
        slot_place=np.full(n_slots, c.NONE, np.int32),
        cell_start=room_of_cells(slot_cell, n_cells),
        cell_count=np.zeros(n_cells, np.int32),
        entries=np.zeros((n_slots, 2), np.int32),
        mark=np.zeros(n, np.int64),
        proposals=np.zeros(1, np.int64),
        touched=np.zeros(n, np.int32),
        touched_extent=np.zeros(n),
        touched_log_likelihood=np.zeros(n),
        n_touched=np.zeros(1, np.int64),
        sight=make_sight(edge_capacity + c.MOST_CHANGES),
    )
