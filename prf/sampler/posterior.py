"""Prior and sensors together: what a chain samples from, and the state of a chain at a given map."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from prf.kernels import constants as c
from prf.kernels.readings.points import Points, Y
from prf.kernels.state.build import recompute_sums, trace_all
from prf.kernels.state.chain import Chain
from prf.kernels.state.grid import make_grid
from prf.model.coloring import Coloring, black_at
from prf.model.laser import make_beams, make_rays
from prf.model.layout import make_graph, make_guards, make_image, make_index, make_proposal, make_sites, make_targets
from prf.model.points import log_density, make_points, paint
from prf.model.sensors import LaserModel, PointModel, SonarModel
from prf.model.sonar import make_cones, make_poses
from prf.model.window import Window
from prf.poses.model import PoseModel
from prf.readings import PointTable, Readings
from prf.readings.ground import way_guards

Floats = NDArray[np.float64]

MOVE_WEIGHTS = {move: weight for move, (_, weight) in enumerate(c.MOVES)}
"""Weight of each move."""
BORDER_MOVES = (
    c.BOUNDARY_BIRTH,
    c.BOUNDARY_DEATH,
    c.CORNER_BIRTH,
    c.CORNER_DEATH,
    c.MOVE_BOUNDARY,
    c.PAST_CORNER,
    c.DOCK,
    c.UNDOCK,
)
"""Those that change vertices on the border of the window."""

FIRST_CAPACITY = 256
FIRST_CELL_ROOM = 24
CELLS_A_LENGTH = 4.0 / np.pi
"""Cells that a beam in a random direction passes on a length of one cell's side."""
MOST_LISTED = 4e7
"""Entries of all lists of beams in all cells at most, more or less: 12 bytes each in every chain."""


@dataclasses.dataclass(frozen=True)
class LaserData:
    """Readings of a laser, inf where there is no return, and their model."""

    readings: Readings
    model: LaserModel

    @classmethod
    def from_arrays(cls, origin: Floats, angle: Floats, ranges: Floats, model: LaserModel) -> LaserData:
        """Return beams at `origin` (n, 2) in metres along `angle` (n,) in radians, `ranges` (n,) in metres."""
        return cls(Readings.from_arrays(origin, angle, ranges), model)


@dataclasses.dataclass(frozen=True)
class SonarData:
    """Readings of a sonar, inf where there is no return, and their model."""

    readings: Readings
    model: SonarModel

    @classmethod
    def from_arrays(cls, origin: Floats, angle: Floats, cone: Floats, ranges: Floats, model: SonarModel) -> SonarData:
        """Return readings as those of a laser, each with its full field of view `cone` (n,) in radians."""
        return cls(Readings.from_arrays(origin, angle, ranges, cone=cone), model)


@dataclasses.dataclass(frozen=True)
class PointData:
    """Values at points inside the window, off its border, and their model."""

    table: PointTable
    model: PointModel

    @classmethod
    def from_arrays(cls, xy: Floats, value: Floats, model: PointModel) -> PointData:
        """Return values (n,) observed at places (n, 2) in metres."""
        return cls(PointTable(xy, value, np.arange(1, len(value) + 1), "arrays"), model)


NO_LASER = LaserData.from_arrays(np.zeros((0, 2)), np.zeros(0), np.zeros(0), LaserModel(max_range=1.0))
NO_SONAR = SonarData.from_arrays(np.zeros((0, 2)), np.zeros(0), np.zeros(0), np.zeros(0), SonarModel())
"""Stand for a sensor without readings; its model is of no consequence."""


@dataclasses.dataclass(frozen=True)
class Settings:
    """What a chain is built with, besides the map it starts from."""

    window: Window
    scale: float  # scale parameter p of the Arak process, 1/m
    laser: LaserData | None = None
    resolution: float | None = None  # side of the squares of the occupancy image in metres; None keeps no image
    cell: float | None = None  # side of the cells of the indexes in metres; None chooses it
    local_share: float = 0.8  # share of births whose further vertices lie near the first
    # reaches of the proposals (``prf.kernels.constants``), metres; None chooses it from the scale
    birth_reach: float | None = None
    split_reach: float | None = None
    move_reach: float | None = None
    cut_reach: float | None = None
    sonar: SonarData | None = None
    points: PointData | None = None  # without laser, sonar and points the chain draws from the prior
    aimed_share: float = 0.8  # share of births of triangles that are aimed at returns, where there are any
    aim_reach: float | None = None
    levels: int | None = None  # stages in which the beams of a laser are evaluated; None: by their number
    # tiles in which a chain is updated at once (docs/large-jobs.md); 0: it is updated in one place after the other
    tiles: int = 0
    join_reach: float | None = None
    # (ny, nx): cells of the image that readings crossed or ended in (:mod:`prf.readings.ground`); None: all
    seen: NDArray[np.bool_] | None = None
    # (k, 4): pieces of the way that was driven (:func:`prf.readings.ground.way_of`), metres
    way: Floats = dataclasses.field(default_factory=lambda: np.zeros((0, 4)))
    driven_radius: float = 0.0  # of the disc that was free all along it, metres
    poses: PoseModel | None = None  # uncertain ones; readings are then those at the poses where chains start

    def density(self) -> Floats:
        """Return what the kernels sample: the posterior (``prf.kernels.constants``), occupied sensors forbidden."""
        density = np.zeros(c.N_DENSITY)
        density[c.SCALE] = self.scale
        density[c.INVERSE_TEMPERATURE] = 1.0
        density[c.LIKELIHOOD_POWER] = 1.0
        density[c.OCCUPIED_COST] = np.inf
        return density

    def tuning(self) -> Floats:
        """Return the scales of the kernels' proposals (``prf.kernels.constants``)."""
        tuning = np.zeros(c.N_TUNING)
        tuning[c.REGION_TARGET] = c.NONE
        tuning[c.LOCAL_SHARE] = self.local_share
        tuning[c.BIRTH_REACH] = self.birth_reach or 0.1 / self.scale
        tuning[c.SPLIT_REACH] = self.split_reach or 0.02 / self.scale
        tuning[c.MOVE_REACH] = self.move_reach or 0.01 / self.scale
        tuning[c.CUT_REACH] = self.cut_reach or 0.0005 / self.scale
        tuning[c.JOIN_REACH] = self.join_reach or 0.03 / self.scale
        tuning[c.DOCK_REACH] = 0.25 / self.scale  # the mean length of an edge
        tuning[c.AIM_REACH] = self.aim_reach or 0.015 / self.scale
        return tuning

    def cell_size(self) -> float:
        """Return the side of the cells of the indexes, metres."""
        if self.cell is not None:
            return self.cell
        longest = max(self.window.width, self.window.height)
        share = 0.1 if self.laser is None and self.sonar is None else 0.04
        return max(share / self.scale, longest / 1000.0)

    def target_side(self) -> float:
        """Return the side of the targets, metres; wide without a laser: returns of a sonar lie anywhere on an arc."""
        share = 0.02 if self.laser is None else 0.005
        return max(share / self.scale, max(self.window.width, self.window.height) / 4000.0)


def make_chain(settings: Settings, coloring: Coloring) -> Chain:
    """Build the state of a chain at `coloring`.

    Every sensor must be in white there, unless the density is given a finite cost of occupied ones before the first
    step; :func:`one_colour_map` is such a map.
    """
    window = settings.window
    capacity = max(FIRST_CAPACITY, 2 * (len(coloring.xy) + c.MOST_CHANGES))
    graph = make_graph(coloring, capacity)
    ray = rays_of(settings)
    cell = settings.cell_size()
    if settings.cell is None:
        # So many beams that their lists would fill the memory get larger cells.
        cell = max(cell, CELLS_A_LENGTH * float(ray[:, c.MAX_DISTANCE].sum()) / MOST_LISTED)
    grid = make_grid(*window, cell)
    weights = np.array([MOVE_WEIGHTS[move] for move in range(c.N_MOVES)])
    targets = make_targets(window, settings.target_side(), return_points(settings))
    tuning = settings.tuning()
    tuning[c.AIMED_SHARE] = settings.aimed_share if len(targets.cell) > 0 else 0.0
    chain = Chain(
        graph=graph,
        edge_index=make_index(graph, grid, FIRST_CELL_ROOM),
        beams=make_beams(grid, (settings.laser or NO_LASER).model, ray, capacity, settings.levels),
        cones=make_cones(grid, (settings.sonar or NO_SONAR).model, poses_of(settings), capacity),
        points=painted_points(settings.points, coloring),
        sensors=make_sites(grid, white_places(settings), coloring),
        targets=targets,
        image=make_image(coloring, graph, settings.resolution),
        guards=make_guards(grid, np.zeros(0, np.int64), way_guards(settings.way, settings.driven_radius)),
        proposal=make_proposal(grid),
        density=settings.density(),
        tuning=tuning,
        move_probabilities=weights / weights.sum(),
        outcomes=np.zeros((c.N_MOVES, c.N_OUTCOMES), np.int64),
    )
    trace_all(chain)
    recompute_sums(chain)
    return chain


def rays_of(settings: Settings) -> Floats:
    """Return the beams (n, N_RAY) as the kernels want them."""
    laser = settings.laser or NO_LASER
    readings = laser.readings
    return make_rays(settings.window, laser.model, readings.origin, readings.angle, readings.range)


def poses_of(settings: Settings) -> Floats:
    """Return the sonar readings (n, N_POSE) as the kernels want them."""
    sonar = settings.sonar or NO_SONAR
    found = sonar.readings
    return make_poses(sonar.model, found.origin, found.angle, found.cone, found.range, settings.window)


def painted_points(data: PointData | None, coloring: Coloring) -> Points:
    """Return point observations in the colours of a map."""
    if data is None:
        return make_points(np.zeros((0, 2)), np.zeros((0, 2)))
    points = make_points(data.table.xy, log_density(data.model, data.table.value))
    paint(points, black_at(coloring, points.column[: Y + 1].T))
    return points


def one_colour_map(settings: Settings) -> Coloring:
    """Return the map of one colour that a chain starts from: white, or what points prefer if there is no sensor."""
    empty = Coloring.empty(settings.window)
    if settings.points is None or settings.laser is not None or settings.sonar is not None:
        return empty
    white, black = log_density(settings.points.model, settings.points.table.value).sum(axis=0)
    return empty._replace(anchor_black=bool(black > white))


def white_places(settings: Settings) -> Floats:
    """Return the places (n, 2) that must be white, metres: those of sensors, and the ends of pieces of the way."""
    sensors = [sensor.readings.origin for sensor in (settings.laser, settings.sonar) if sensor is not None]
    return np.concatenate([np.zeros((0, 2)), *sensors, settings.way[:, :2], settings.way[:, 2:]])


def return_points(settings: Settings) -> Floats:
    """Return the impacts of the readings (n, 2), metres: for a sonar on its axis."""
    laser, sonar = settings.laser or NO_LASER, settings.sonar or NO_SONAR
    within = (laser.readings.within(laser.model.limit), sonar.readings.within(sonar.model.max_range))
    return np.concatenate([readings.impacts() for readings in within])
