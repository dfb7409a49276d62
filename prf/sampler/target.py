"""What a chain samples from: prior and sensors, how it proposes, and how its work is laid out."""

from __future__ import annotations

import dataclasses
import math
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from prf.kernels import constants as c
from prf.model.coloring import Coloring
from prf.model.laser import make_rays
from prf.model.points import log_density
from prf.model.sensors import LaserModel, PointModel, SonarModel
from prf.model.sonar import make_poses
from prf.model.window import Window
from prf.poses.model import PoseModel
from prf.readings import PointTable, Readings

Floats = NDArray[np.float64]
Table = TypeVar("Table", Readings, PointTable)
Model = TypeVar("Model", LaserModel, SonarModel, PointModel)

NATS_PER_CONE = 5.0
"""What a sonar reading may lose where nothing explains it, about."""
LEAST_COST = 5.0
"""Nats that an occupied sensor costs at least."""


@dataclasses.dataclass(frozen=True)
class Observed(Generic[Table, Model]):
    """Readings of one kind and their model.

    Ranges are inf where there is no return; cones have their full field of view; points lie inside the window.
    """

    readings: Table
    model: Model


LaserData = Observed[Readings, LaserModel]
SonarData = Observed[Readings, SonarModel]
PointData = Observed[PointTable, PointModel]


def laser_data(origin: Floats, angle: Floats, ranges: Floats, model: LaserModel) -> LaserData:
    """Return beams at `origin` (n, 2) in metres along `angle` (n,) in radians, `ranges` (n,) in metres."""
    return Observed(Readings.from_arrays(origin, angle, ranges), model)


def sonar_data(origin: Floats, angle: Floats, cone: Floats, ranges: Floats, model: SonarModel) -> SonarData:
    """Return readings as those of a laser, each with its full field of view `cone` (n,) in radians."""
    return Observed(Readings.from_arrays(origin, angle, ranges, cone=cone), model)


def point_data(xy: Floats, value: Floats, model: PointModel) -> PointData:
    """Return values (n,) observed at places (n, 2) in metres."""
    return Observed(PointTable(xy, value, np.arange(1, len(value) + 1), "arrays"), model)


NO_LASER = laser_data(np.zeros((0, 2)), np.zeros(0), np.zeros(0), LaserModel(max_range=1.0))
NO_SONAR = sonar_data(np.zeros((0, 2)), np.zeros(0), np.zeros(0), np.zeros(0), SonarModel())
"""Stand for a sensor without readings; its model is of no consequence."""


@dataclasses.dataclass(frozen=True)
class Tuning:
    """Scales and shares of the proposals (``prf.kernels.constants``); they change no law. Reaches: metres or None."""

    local_share: float = 0.8  # share of births whose further vertices lie near the first
    birth_reach: float | None = None
    split_reach: float | None = None
    move_reach: float | None = None
    cut_reach: float | None = None
    join_reach: float | None = None
    aimed_share: float = 0.8  # share of births of triangles that are aimed at returns, where there are any
    aim_reach: float | None = None

    def array(self, scale: float) -> Floats:
        """Return what the kernels read, of a prior of this scale (1/m), from which reaches follow that are None."""
        tuning = np.zeros(c.N_TUNING)
        tuning[c.REGION_TARGET] = c.NONE
        tuning[c.LOCAL_SHARE] = self.local_share
        tuning[c.BIRTH_REACH] = self.birth_reach or 0.1 / scale
        tuning[c.SPLIT_REACH] = self.split_reach or 0.02 / scale
        tuning[c.MOVE_REACH] = self.move_reach or 0.01 / scale
        tuning[c.CUT_REACH] = self.cut_reach or 0.0005 / scale
        tuning[c.JOIN_REACH] = self.join_reach or 0.03 / scale
        tuning[c.DOCK_REACH] = 0.25 / scale  # the mean length of an edge
        tuning[c.AIM_REACH] = self.aim_reach or 0.015 / scale
        return tuning


@dataclasses.dataclass(frozen=True)
class Execution:
    """How the work is laid out: it changes no law either."""

    resolution: float | None = None  # side of the squares of the occupancy image in metres; None keeps no image
    cell: float | None = None  # side of the cells of the indexes in metres; None chooses it
    levels: int | None = None  # stages in which the beams of a laser are evaluated; None: by their number
    # tiles in which a chain is updated at once (docs/large-jobs.md); 0: it is updated in one place after the other
    tiles: int = 0


@dataclasses.dataclass(frozen=True)
class Target:
    """What a chain samples, with how it proposes and how its work is laid out."""

    window: Window
    scale: float  # scale parameter p of the Arak process, 1/m
    laser: LaserData | None = None
    sonar: SonarData | None = None
    points: PointData | None = None  # without laser, sonar and points the chain draws from the prior
    # (k, 4): pieces of the way that was driven (:func:`prf.readings.ground.way_of`), metres
    way: Floats = dataclasses.field(default_factory=lambda: np.zeros((0, 4)))
    driven_radius: float = 0.0  # of the disc that was free all along it, metres
    poses: PoseModel | None = None  # uncertain ones; readings are then those at the poses where chains start
    # (ny, nx): cells of the image that readings crossed or ended in (:mod:`prf.readings.ground`); None: all
    seen: NDArray[np.bool_] | None = None
    tuning: Tuning = Tuning()
    execution: Execution = Execution()

    def with_execution(self, **changes: Any) -> Target:
        """Return the same target laid out in another way."""
        return dataclasses.replace(self, execution=dataclasses.replace(self.execution, **changes))

    def density(self) -> Floats:
        """Return what the kernels sample: the posterior (``prf.kernels.constants``), occupied sensors forbidden."""
        density = np.zeros(c.N_DENSITY)
        density[c.SCALE] = self.scale
        density[c.INVERSE_TEMPERATURE] = 1.0
        density[c.LIKELIHOOD_POWER] = 1.0
        density[c.OCCUPIED_COST] = np.inf
        return density

    def cell_size(self) -> float:
        """Return the side of the cells of the indexes, metres."""
        if self.execution.cell is not None:
            return self.execution.cell
        longest = max(self.window.width, self.window.height)
        share = 0.1 if self.laser is None and self.sonar is None else 0.04
        return max(share / self.scale, longest / 1000.0)

    def target_side(self) -> float:
        """Return the side of the squares that births are aimed at, metres.

        Wide without a laser: returns of a sonar lie anywhere on an arc.
        """
        share = 0.02 if self.laser is None else 0.005
        return max(share / self.scale, max(self.window.width, self.window.height) / 4000.0)


def rays_of(target: Target) -> Floats:
    """Return the beams (n, N_RAY) as the kernels want them."""
    laser = target.laser or NO_LASER
    readings = laser.readings
    return make_rays(target.window, laser.model, readings.origin, readings.angle, readings.range)


def poses_of(target: Target) -> Floats:
    """Return the sonar readings (n, N_POSE) as the kernels want them."""
    sonar = target.sonar or NO_SONAR
    found = sonar.readings
    return make_poses(sonar.model, found.origin, found.angle, found.cone, found.range, target.window)


def one_colour_map(target: Target) -> Coloring:
    """Return the map of one colour that a chain starts from: white, or what points prefer if there is no sensor."""
    empty = Coloring.empty(target.window)
    if target.points is None or target.laser is not None or target.sonar is not None:
        return empty
    white, black = log_density(target.points.model, target.points.readings.value).sum(axis=0)
    return empty._replace(anchor_black=bool(black > white))


def white_places(target: Target) -> Floats:
    """Return the places (n, 2) that must be white, metres: those of sensors, and the ends of pieces of the way."""
    sensors = [sensor.readings.origin for sensor in (target.laser, target.sonar) if sensor is not None]
    return np.concatenate([np.zeros((0, 2)), *sensors, target.way[:, :2], target.way[:, 2:]])


def return_points(target: Target) -> Floats:
    """Return the impacts of the readings (n, 2), metres: for a sonar on its axis."""
    laser, sonar = target.laser or NO_LASER, target.sonar or NO_SONAR
    within = (laser.readings.within(laser.model.limit), sonar.readings.within(sonar.model.max_range))
    return np.concatenate([readings.impacts() for readings in within])


def occupied_cost(target: Target, n_sites: int) -> float:
    """Return the nats that an occupied sensor position costs by default.

    As much as if all its readings went unexplained: less, and a map that is black where it should be white would be as
    good as the right one, since beams see edges and not colours.
    """
    total = 0.0
    if target.laser is not None:
        model = target.laser.model
        peak = 1.0 / (math.sqrt(2.0 * math.pi) * model.noise)
        total += target.laser.readings.n_beams * math.log(1.0 + peak * model.limit / model.outlier_probability)
    if target.sonar is not None:
        total += NATS_PER_CONE * target.sonar.readings.n_beams
    return max(LEAST_COST, total / max(n_sites, 1))
