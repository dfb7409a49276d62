"""What is in a simulated map, in numbers."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.cloud import PointCloud
from mapq.simulate.kinds import Kind
from mapq.simulate.robot import Trajectory
from mapq.simulate.scene import NO_SURFACE, World
from mapq.simulate.settings import Settings
from mapq.simulate.truth import Truth

UPRIGHT = 0.1
"""Largest upward component of the normal of what counts as a vertical surface."""


SEEN = 20
"""Points from which on a surface counts as seen."""


class Report(NamedTuple):
    """What is in a simulated map.

    Attributes
    ----------
    points, passes : int
    path_length, duration : float
        Metres and seconds of the drive.
    final_drift, final_drift_deg : float
        Error of odometry at the end: metres, degrees.
    suspicious_points : float
        Share of all points.
    suspicious_wall_points : float
        Share of the points on vertical surfaces.
    suspicious_cells : float
        Share of the cells of vertical surfaces that hold a suspicious point.
    surfaces : int
        Vertical planar surfaces with 20 points or more.
    look_alike_points, look_alike_surfaces : float
        Share of the points on vertical surfaces, and of `surfaces`, that look like an error of the map and are none.
    points_by_kind : dict of str to int
    """

    points: int
    passes: int
    path_length: float
    duration: float
    final_drift: float
    final_drift_deg: float
    suspicious_points: float
    suspicious_wall_points: float
    suspicious_cells: float
    surfaces: int
    look_alike_points: float
    look_alike_surfaces: float
    points_by_kind: dict[str, int]


def summarise(
    cloud: PointCloud, world: World, truth: Truth, way: Trajectory, believed: Trajectory, settings: Settings
) -> Report:
    """Return the numbers of one map."""
    surface = cloud.fields["surface"]
    upright = (surface != NO_SURFACE) & (np.abs(world.normal[np.maximum(surface, 0), 2]) < UPRIGHT)
    kinds = np.bincount(cloud.fields["kind"], minlength=len(Kind))
    sizes = np.bincount(surface[upright], minlength=len(world.normal))
    bad_cells = np.unique(truth.cell[upright & truth.suspicious])
    return Report(
        len(cloud),
        int(cloud.fields["pass_id"].max(initial=-1)) + 1,
        way.length,
        way.length / settings.speed,
        float(np.hypot(*(believed.xy[-1] - way.xy[-1]))),
        float(np.degrees(abs(believed.heading[-1] - way.heading[-1]))),
        _share(truth.suspicious),
        _share(truth.suspicious[upright]),
        len(bad_cells) / max(len(np.unique(truth.cell[upright])), 1),
        int(np.count_nonzero(sizes >= SEEN)),
        _share(cloud.fields["look_alike"][upright]),
        _share(find_look_alikes(world, surface)[sizes >= SEEN]),
        {kind.name.lower(): int(kinds[kind]) for kind in Kind},
    )


def find_look_alikes(world: World, surface: NDArray[np.int32]) -> NDArray[np.bool_]:
    """Return which surfaces (n_surfaces,) look like an error and are none, given the surface (n,) of each point.

    Of two walls close to each other both must be seen: one face of a gap between buildings is a wall like any other.
    """
    seen = np.bincount(surface[surface != NO_SURFACE], minlength=len(world.normal)) >= SEEN
    return np.asarray((world.partner != NO_SURFACE) & seen & seen[world.partner])


def _share(flags: np.ndarray) -> float:
    return float(flags.mean()) if len(flags) else 0.0
