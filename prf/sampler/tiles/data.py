"""What the tiles of every round need of the readings: made once, the same whatever the map."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from prf.driven import way_guards
from prf.kernels import constants as c
from prf.kernels.cones import MAX_DISTANCE
from prf.kernels.sonar_features import BORDER, POSE_COS, POSE_SIN, POSE_X, POSE_Y
from prf.kernels.targets import Targets
from prf.layout import make_targets
from prf.posterior import LaserData, Settings, SonarData, return_points, white_places
from prf.sensors.laser import LaserModel, make_rays
from prf.sensors.sonar import SonarModel, make_poses

Floats = NDArray[np.float64]

HAIR = 1e-6
"""Regions within which an obstacle matters are enlarged by this share: rounding must not let one slip through."""


@dataclasses.dataclass(frozen=True)
class TileData:
    """Readings laid out for tiles."""

    settings: Settings
    laser: LaserModel  # models; of no consequence without readings
    sonar: SonarModel  # models; of no consequence without readings
    ray: Floats  # (n, N_RAY): beams as :func:`prf.sensors.laser.make_rays` lays them out
    influence: Floats  # (n,): distance beyond which no obstacle changes the likelihood of the beam, metres
    end: Floats  # (n, 2): point whose tile answers for the beam: where the return lies, or half way without one
    pose: Floats  # (m, N_POSE): sonar readings
    triangle: Floats  # (m, 6): corners of a triangle that holds the cone of each
    returns: Floats  # (k, 2): where readings say that something stands
    targets: Targets  # the squares that hold these
    # (s, 2): places that must be white, metres: those of sensors, and the ends of pieces of the way driven
    sensors: Floats
    ways: Floats  # (w, N_SHAPE): guards of the way that was driven


def make_tile_data(settings: Settings) -> TileData:
    """Lay out the readings of a run for its tiles."""
    nothing = np.zeros((0, 2)), np.zeros(0), np.zeros(0)
    laser = settings.laser or LaserData(*nothing, LaserModel(1.0))
    sonar = settings.sonar or SonarData(*nothing, np.zeros(0), SonarModel())
    ray = make_rays(settings.window, laser.model, laser.origin, laser.angle, laser.readings)
    pose = make_poses(sonar.model, sonar.origin, sonar.angle, sonar.cone, sonar.readings, settings.window)
    reach = ray[:, c.MAX_DISTANCE]
    influence = np.minimum(reach, laser.model.influence(ray[:, c.RANGE]))
    returned = (ray[:, c.RANGE] >= 0.0) & np.isfinite(ray[:, c.RANGE])
    answered = np.where(returned, np.minimum(ray[:, c.RANGE], (1.0 - HAIR) * reach), 0.5 * reach)
    returns = return_points(settings)
    return TileData(
        settings=settings,
        laser=laser.model,
        sonar=sonar.model,
        ray=ray,
        influence=influence,
        end=ray[:, :2] + answered[:, None] * ray[:, c.DIRECTION_X : c.DIRECTION_Y + 1],
        pose=pose,
        triangle=cone_triangles(pose),
        returns=returns,
        targets=make_targets(settings.window, settings.target_side(), returns),
        sensors=white_places(settings),
        ways=way_guards(settings.way, settings.driven_radius),
    )


def cone_triangles(pose: Floats) -> Floats:
    """Return triangles (m, 6) that hold all of each cone up to its reach."""
    far, across = pose[:, [MAX_DISTANCE]] * (1.0 + HAIR), pose[:, BORDER] * (1.0 + HAIR)
    corners = [pose[:, [POSE_X, POSE_Y]] - HAIR * far * pose[:, [POSE_COS, POSE_SIN]]]
    for side in (-1.0, 1.0):
        x = pose[:, POSE_COS] - side * across * pose[:, POSE_SIN]
        y = pose[:, POSE_SIN] + side * across * pose[:, POSE_COS]
        corners.append(pose[:, [POSE_X, POSE_Y]] + far * np.stack([x, y], axis=1))
    return np.concatenate(corners, axis=1)
