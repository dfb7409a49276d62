"""What a chain samples from, and its state at a map.

Prior and sensors, how it proposes, and how its work is laid out; the state is built, copied, exchanged with another
chain's, and run.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from prf.kernels import constants as c
from prf.kernels.readings.points import Points, Y
from prf.kernels.state.build import recompute_sums, trace_all
from prf.kernels.state.chain import Chain
from prf.kernels.state.graph import Graph
from prf.kernels.state.grid import make_grid
from prf.kernels.state.image import settle_all
from prf.kernels.step import run
from prf.model.coloring import Coloring, black_at
from prf.model.layout import (
    grow,
    make_guards,
    make_image,
    make_index,
    make_proposal,
    make_sites,
    make_targets,
    paint_image,
    painted_sites,
    read_coloring,
)
from prf.model.orientation import PLAIN, Orientation
from prf.model.points import log_density, make_points, paint
from prf.model.ranges import empty_lists, make_beams, make_cones, make_poses, make_rays, make_sight
from prf.model.sensors import LaserModel, PointModel, SonarModel
from prf.model.walls import WallPrior, cover, first_level, graph_at, has_walls, moves_of, run_in_walls
from prf.model.window import Window
from prf.poses.model import PoseModel
from prf.readings import PointTable, Readings
from prf.readings.way import way_guards

Floats = NDArray[np.float64]
Table = TypeVar("Table", Readings, PointTable)
Model = TypeVar("Model", LaserModel, SonarModel, PointModel)

NATS_PER_CONE = 5.0
"""What a sonar reading may lose where nothing explains it."""
FIRST_STRENGTH = 1.0
"""Of the preference for the directions of the building, where it is sampled."""
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
    first_new_log: int = 0  # logs of the laser from this one on are aimed at more than the others

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
    # (k, 4): pieces of the way that was driven (:func:`prf.readings.way.way_of`), metres
    way: Floats = dataclasses.field(default_factory=lambda: np.zeros((0, 4)))
    driven_radius: float = 0.0  # of the disc that was free all along it, metres
    orientation: Orientation = PLAIN  # of edges
    free_space: float = 0.0  # what a square metre of black costs, nats
    walls: WallPrior | None = None  # the map is one of walls; None: of polygons, the Arak process
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
        density[c.FREE_SPACE] = self.free_space
        if self.walls is not None:
            density[c.WALL_DENSITY], density[c.WALL_LENGTH] = self.walls.density, self.walls.length
            density[c.FREE_END], density[c.CROSSING] = self.walls.free_end, self.walls.crossing
        return density

    def lines(self, strength: float | None = None, angle: float | None = None) -> Floats:
        """Return the law of directions as the kernels read it, with what is sampled at these values or at a start."""
        known = self.orientation
        strength = known.strength if known.strength is not None else FIRST_STRENGTH if strength is None else strength
        angle = known.angle if known.angle is not None else 0.0 if angle is None else angle
        if self.walls is not None:
            return self.walls.lines(known, strength, angle, self.walls.common())
        return known.lines(strength, angle, self.scale, self.window)

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
    if target.walls is not None or target.points is None or target.laser is not None or target.sonar is not None:
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


FIRST_CAPACITY, FIRST_CELL_ROOM = 256, 24
CELLS_A_LENGTH = 4.0 / np.pi
"""Cells that a beam in a random direction passes on a length of one cell's side."""
MOST_LISTED = 4e7
"""Entries of all lists of beams in all cells at most, more or less: 12 bytes each in every chain."""

STATE = ("graph", "edge_index", "beams", "cones", "points", "sensors", "lines")
"""Fields of a chain that are its map, or follow from it; the others belong to the temperature."""
SHARED = (
    "grid",
    "model",
    "cell_start",
    "slot_start",
    "slot_cell",
    "slot_exit",
    "slot_near",
    "targets",
    "xy",
    "weight",
    "best",
    "aim",
    "level",
    "beyond",
    "shape",
    "lists",
)
"""Fields, of a chain or of its parts, that no step writes to: copies of a chain hold the same arrays."""


def make_chain(target: Target, coloring: Coloring) -> Chain:
    """Build the state of a chain at `coloring`.

    Every sensor must be in white there, unless the density is given a finite cost of occupied ones before the first
    step; :func:`one_colour_map` is such a map.
    """
    window = target.window
    capacity = max(FIRST_CAPACITY, 2 * (len(coloring.xy) + c.MOST_CHANGES))
    graph = graph_at(target.walls, coloring, capacity)
    laser, ray = target.laser or NO_LASER, rays_of(target)
    levels, cell = (target.execution.levels, first_level(target.walls)), target.cell_size()
    if target.execution.cell is None:
        # So many beams that their lists would fill the memory get larger cells.
        cell = max(cell, CELLS_A_LENGTH * float(ray[:, c.MAX_DISTANCE].sum()) / MOST_LISTED)
    grid = make_grid(*window, cell)
    weights = np.array([weight for _, weight in moves_of(target.walls)])
    if target.walls is None and target.orientation.is_plain:
        weights[[c.BOX_BIRTH, c.BOX_DEATH]] = 0.0
    targets = make_targets(window, target.target_side(), return_points(target))
    tuning = target.tuning.array(target.scale)
    tuning[c.AIMED_SHARE] = target.tuning.aimed_share if len(targets.cell) > 0 else 0.0
    chain = Chain(
        graph=graph,
        edge_index=make_index(graph, grid, FIRST_CELL_ROOM),
        beams=make_beams(grid, laser.model, ray, laser.readings.weight, capacity, *levels),
        cones=make_cones(grid, (target.sonar or NO_SONAR).model, poses_of(target), capacity),
        points=painted_points(target.points, coloring),
        sensors=make_sites(grid, white_places(target), coloring),
        targets=targets,
        image=make_image(coloring, graph, target.execution.resolution),
        guards=make_guards(grid, np.zeros(0, np.int64), way_guards(target.way, target.driven_radius)),
        proposal=make_proposal(grid),
        density=target.density(),
        lines=target.lines(),
        tuning=tuning,
        move_probabilities=weights / weights.sum(),
        outcomes=np.zeros((len(weights), c.N_OUTCOMES), np.int64),
    )
    cover(chain)
    trace_all(chain)
    recompute_sums(chain)
    return chain


def painted_points(data: PointData | None, coloring: Coloring) -> Points:
    """Return point observations in the colours of a map."""
    if data is None:
        return make_points(np.zeros((0, 2)), np.zeros((0, 2)))
    points = make_points(data.readings.xy, log_density(data.model, data.readings.value))
    paint(points, black_at(coloring, points.column[: Y + 1].T))
    return points


def run_chain(chain: Chain, rng: np.random.Generator, step: int) -> Chain:
    """Run a chain up to `step`, making room on the way; return it."""
    while not (run_in_walls(chain, rng, step) if has_walls(chain) else run(chain, rng, step)):
        chain = grow(chain)
    return chain


def copied(part: Any) -> Any:
    """Return a copy of a chain, or of a part of one; what never changes is shared."""
    if isinstance(part, np.ndarray):
        return part.copy()
    if not isinstance(part, tuple):
        return part
    fields = part._asdict()  # type: ignore[attr-defined]
    return part._replace(  # type: ignore[attr-defined]
        **{name: value if name in SHARED else copied(value) for name, value in fields.items()}
    )


def without_image(chain: Chain) -> Chain:
    """Return a copy of a chain that keeps no image."""
    empty = make_image(read_coloring(chain.graph), chain.graph, None)
    found: Chain = copied(chain._replace(image=empty))
    return found


def exchanged(one: Chain, other: Chain) -> tuple[Chain, Chain]:
    """Return both chains, each with the map of the other. Images are left as they are."""
    return (
        one._replace(**{name: getattr(other, name) for name in STATE}),
        other._replace(**{name: getattr(one, name) for name in STATE}),
    )


def with_graph(chain: Chain, target: Target, graph: Graph) -> Chain:
    """Return the chain at another graph, all that follows from it recomputed. Its image is left as it is."""
    capacity, coloring = len(graph.edge_length), read_coloring(graph)
    placed = chain._replace(
        graph=graph,
        edge_index=make_index(graph, chain.edge_index.grid, chain.edge_index.cell_edges.shape[1]),
        beams=empty_lists(chain.beams, capacity),
        cones=chain.cones._replace(sight=make_sight(capacity + c.MOST_CHANGES)),
        points=painted_points(target.points, coloring),
        sensors=painted_sites(chain.sensors, coloring),
    )
    cover(placed)
    trace_all(placed)
    recompute_sums(placed)
    return placed


def with_map(chain: Chain, target: Target, coloring: Coloring) -> Chain:
    """Return the chain at another map and at the same step. Its image is left as it is."""
    graph = graph_at(target.walls, coloring, max(FIRST_CAPACITY, 2 * (len(coloring.xy) + c.MOST_CHANGES)))
    graph.counts[c.STEP] = chain.graph.counts[c.STEP]
    return with_graph(chain, target, graph)


def repaint(chain: Chain) -> None:
    """Let the image follow the map that the chain was given; the times of the old one must be settled."""
    if chain.image.black.size > 0:
        paint_image(chain.image, read_coloring(chain.graph), int(chain.graph.counts[c.STEP]))
        cover(chain)


def settle_image(chain: Chain) -> None:
    """Add up the times of the image up to the present step."""
    settle_all(chain.image, int(chain.graph.counts[c.STEP]))
