"""Sonar: its cones laid out for a chain (paper, section 2.3)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from prf.kernels import constants as c
from prf.kernels.readings import cones as k
from prf.kernels.readings import sonar as m
from prf.kernels.readings import sonar_features as v
from prf.kernels.state.cell_lists import room_of_cells
from prf.kernels.state.grid import Grid
from prf.model.laser import MAX_SLOTS, unit_vectors, window_exit
from prf.model.sensors import SonarModel
from prf.model.window import Window
from prf.shell.errors import ConfigError

Floats = NDArray[np.float64]


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
