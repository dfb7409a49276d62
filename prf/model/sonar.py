"""Sonar: the parameters of its likelihood, and its cones laid out for a chain (paper, section 2.3)."""

from __future__ import annotations

import dataclasses
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from prf.kernels import constants as c
from prf.kernels.readings import cones as k
from prf.kernels.readings import sonar as m
from prf.kernels.readings import sonar_features as v
from prf.kernels.state.cell_lists import room_of_cells
from prf.kernels.state.grid import Grid
from prf.model.domain import MIN_PROBABILITY, check_factor, check_length
from prf.model.laser import MAX_SLOTS, unit_vectors, window_exit
from prf.model.window import Window
from prf.shell.errors import ConfigError

Floats = NDArray[np.float64]


@dataclasses.dataclass(frozen=True)
class SonarModel:
    """Parameters of the density of a sonar reading given the surfaces and corners in its cone.

    The defaults suit the Polaroid ring of a Pioneer indoors.

    Parameters
    ----------
    max_range : float
        Metres. A reading at or above it is "no return".
    noise, noise_relative : float
        Standard deviation in metres, and as a share of the distance; the larger of the two counts.
    corner_bias, corner_distance : float
        Log odds that a corner at no distance returns a pulse; loss of log odds a metre.
    surface_bias, surface_distance, surface_oblique, surface_subtended : float
        Log odds that a surface at no distance, face on, returns a pulse; loss a metre; loss a radian away from
        face on; gain a radian of the field of view that it fills.
    uniform_probability, short_probability : float
        Shares of the readings that no feature returned which are uniform on [0, max_range], and exponential;
        the others are "no return".
    short_length : float
        Mean of the exponential, metres.
    """

    max_range: float = 3.5
    noise: float = 0.03
    noise_relative: float = 0.02
    corner_bias: float = 1.0
    corner_distance: float = 0.5
    surface_bias: float = 2.4
    surface_distance: float = 0.5
    surface_oblique: float = 16.0
    surface_subtended: float = 6.0
    uniform_probability: float = 0.2
    short_probability: float = 0.05
    short_length: float = 0.5

    def __post_init__(self) -> None:
        """Refuse parameters that make no density."""
        for name in ("max_range", "noise", "short_length"):
            check_length(f"sonar-{name.replace('_', '-')}", getattr(self, name))
        for field in dataclasses.fields(self):
            check_factor(f"sonar-{field.name.replace('_', '-')}", getattr(self, field.name))
        check_factor("sonar-noise-relative", self.noise_relative, 0.0)
        if not MIN_PROBABILITY <= self.uniform_probability < 1.0:
            raise ConfigError(
                f"sonar-uniform-probability {self.uniform_probability}: must lie in (0, 1), else no map could explain "
                "a stray reading"
            )
        if not 0.0 <= self.short_probability < 1.0 - self.uniform_probability:
            raise ConfigError("sonar-short-probability + sonar-uniform-probability: their sum must stay below 1")

    def to_array(self) -> Floats:
        """Return the parameters as the kernels take them, (N_SONAR_MODEL,)."""
        model = np.zeros(m.N_SONAR_MODEL)
        model[m.SONAR_MAX] = self.max_range
        model[m.SONAR_NOISE] = self.noise
        model[m.SONAR_NOISE_RELATIVE] = self.noise_relative
        model[m.CORNER_BIAS] = self.corner_bias
        model[m.CORNER_DISTANCE] = self.corner_distance
        model[m.SURFACE_BIAS] = self.surface_bias
        model[m.SURFACE_DISTANCE] = self.surface_distance
        model[m.SURFACE_OBLIQUE] = self.surface_oblique
        model[m.SURFACE_SUBTENDED] = self.surface_subtended
        model[m.OUTLIER_UNIFORM] = self.uniform_probability
        model[m.OUTLIER_SHORT] = self.short_probability
        model[m.SHORT_RATE] = 1.0 / self.short_length
        return model


class Returns(NamedTuple):
    """Who returns a pulse."""

    alone: Floats  # (n,) q: probability that a feature would return it if there were no other
    share: Floats  # (n,) r: probability that it does; what nearer features return does not reach it
    none: float  # r_0: probability that no feature returns it


def return_probabilities(model: SonarModel, feature: Floats) -> Returns:
    """Return what the features in one cone do with a pulse (docs/sensor-models.md, "Likelihood").

    `feature` (n, N_FEATURE): nearest first, columns as in ``prf.kernels.readings.sonar_features``.
    """
    depth = feature[:, v.DEPTH]
    corner = model.corner_bias - model.corner_distance * depth
    surface = model.surface_bias - model.surface_distance * depth + model.surface_subtended * feature[:, v.SUBTENDED]
    surface -= model.surface_oblique * (0.5 * math.pi - feature[:, v.PROJECTION])
    alone = 1.0 / (1.0 + np.exp(-np.where(feature[:, v.KIND] == v.CORNER, corner, surface)))
    left = np.cumprod(np.append(1.0, 1.0 - alone))
    return Returns(alone, left[:-1] * alone, float(left[-1]))


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
    outside: the sonar reaches up to there, and farther readings are no returns (docs/sensor-models.md). None: no end.
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
        model=model.to_array(),
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
