"""Where chains start, and ground that no reading concerns, which is drawn from the prior.

A chain starts from the empty map, the contour of an occupancy grid, or where a draw of the prior leads; or from the
last map of a run that it goes on from (:mod:`prf.sampler.continued`).
Chains that start alike may agree for lack of time to separate. Contours differ from chain to chain in the readings that
they use, draws of the prior in everything. No step on the way to a start is a step of the chain.

**Ground that no reading concerns** is kept at the prior given what is seen (docs/driven-way.md).
There the posterior is the prior given the rest of the map, by its spatial Markov property. The moves of a chain are as
small as walls and doors ask for, and would take hours to redraw shapes of ten metres where nothing was seen. So at
the end of each block proposals are made there alone, with moves as large as the prior's own shapes and without a look
at any reading. No edge may cross a beam, nor pass a cell that a sonar reading concerns, which makes them a
Metropolis-Hastings chain on all other edges, with the prior for its law. They count as no steps.

A beam concerns the ground up to the obstacle that it meets in the present map, for what lies behind changes nothing for
it; so the ground behind a wall is free, though some beams passed where the wall stands. Obstacles that beams meet stay:
steps there change neither what beams meet nor which edges may be changed.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from prf.configuration import Start
from prf.kernels import constants as c
from prf.kernels.readings.cones import MAX_DISTANCE
from prf.kernels.score.occupancy import Cells, update_beams
from prf.kernels.score.passed_cells import count_passes, mark_cones
from prf.kernels.state.build import fill_index, recompute_sums
from prf.kernels.state.chain import Chain
from prf.kernels.state.frozen import freeze, retrace, thaw
from prf.kernels.state.grid import Grid, make_grid, most_cells
from prf.kernels.state.guards import GUARD_BOX, GUARD_RAY, N_SHAPE, Guards
from prf.kernels.step import run
from prf.model.arak import exact_draws
from prf.model.coloring import Coloring, from_polygons, occupied_polygons
from prf.model.layout import grow, make_guards, make_index, read_coloring
from prf.model.ranges import beam_influence, unit_vectors, window_exit
from prf.model.window import Window
from prf.readings.way import cleared, way_guards
from prf.sampler.lines import lines_map
from prf.sampler.target import (
    LaserData,
    Target,
    make_chain,
    occupied_cost,
    one_colour_map,
    repaint,
    run_chain,
    settle_image,
    white_places,
)
from prf.shell.errors import ConfigError, InputError

LOWEST_POWER = 0.003
"""Power of the likelihood with which a chain leaves a draw of the prior."""
RISE = 30
"""Looks over which the power rises to 1."""
LOOK = 10_000
"""Steps between two looks."""
MOST_DOUBLINGS = 20
"""How often, from look to look, the cost of an occupied sensor doubles if one still is."""
CELL = 0.03
"""Side of the cells of the grid, metres; larger where ranges are noisier than that, or the window would have too many.
A contour as fine as the noise is nearly as likely as what chains arrive at; one of 0.1 m costs them minutes."""
MOST_CELLS = 10_000_000
GRID_SHARE = 0.5
"""Share of the readings that a chain's grid is made of."""
CLOSED = 0.1
"""Cells that are no more than twice this apart are joined, metres: returns along a wall are."""
OCCUPIED = 0.35
"""Share of hits among hits and misses above which a cell is taken to be black."""
CLEAR = 1.2
"""Sides of a cell round every sensor that are kept white."""
BORDER = 0.05
"""Black keeps away from the border of the window by this, metres."""
SEAM = 0.005
"""Metres that black loses all round: parts that touch in a point come apart."""
LEAST_PART = 2.0
"""Smallest area of a part that is kept, in cells."""
TOLERANCES = (0.7, 0.3, 0.1)
"""Sides of a cell by which corners may be straightened; the next is tried where the one before makes no map."""


def find_start_map(
    start: Start, target: Target, rng: np.random.Generator, stop_requested: Callable[[], bool]
) -> Coloring:
    """Return a map to start from, every sensor in white."""
    if target.walls is not None:
        return lines_map(target, rng) if start == "grid" else one_colour_map(target)
    if start == "grid":
        return contour_map(target, rng)
    return from_prior(target, rng, stop_requested) if start == "prior" else one_colour_map(target)


def from_prior(target: Target, rng: np.random.Generator, stop_requested: Callable[[], bool]) -> Coloring:
    """Return where a chain from an exact draw of the prior arrives.

    The power of its likelihood rises from next to nothing to 1, so that colours settle before walls. An occupied sensor
    costs a finite number of nats; in the end that number rises until there is none. What is black round a sensor even
    then, or when the search is cut short, is cut out.
    """
    draw = exact_draws(target.scale, target.window, 1, rng, target.orientation)[0]
    chain = make_chain(target.with_execution(resolution=None), draw)
    cost = occupied_cost(target, len(chain.sensors.xy))
    for look in range(1, RISE + MOST_DOUBLINGS + 1):
        if stop_requested() or (look > RISE and chain.graph.counts[c.OCCUPIED] == 0):
            break
        chain.density[c.LIKELIHOOD_POWER] = LOWEST_POWER ** (1.0 - min(look, RISE) / RISE)
        chain.density[c.OCCUPIED_COST] = cost * 2.0 ** max(0, look - RISE)
        chain = run_chain(chain, rng, look * LOOK)
        recompute_sums(chain)
    coloring = read_coloring(chain.graph)
    return map_of_region(occupied_polygons(coloring), target) if chain.graph.counts[c.OCCUPIED] else coloring


def contour_map(target: Target, rng: np.random.Generator) -> Coloring:
    """Return the contour of an occupancy grid of a random half of the laser readings."""
    if target.laser is None:
        raise ConfigError("sampler.start grid: needs the readings of a laser. Choose another start.")
    window = target.window
    cell = max(CELL, target.laser.model.noise, float(np.sqrt(window.area / MOST_CELLS)))
    chosen = rng.random(target.laser.readings.n_beams) < GRID_SHARE
    return map_of_region(occupied_region(window, target.laser, chosen, cell), target, cell)


def map_of_region(region: BaseGeometry, target: Target, cell: float = CELL) -> Coloring:
    """Return a map that is black on a region as far as a map can be, and white round every sensor and on the way.

    Corners are straightened by about a cell. Where no straightening makes a valid map, it is the empty one.
    """
    places = shapely.points(np.unique(white_places(target), axis=0))
    clear = shapely.union_all(shapely.buffer(places, CLEAR * cell, quad_segs=2))
    clear = shapely.union(clear, cleared(target.way, target.driven_radius))
    x0, y0, x1, y1 = target.window
    inner = shapely.box(x0 + BORDER, y0 + BORDER, x1 - BORDER, y1 - BORDER)
    for tolerance in TOLERANCES:
        smooth = shapely.simplify(region, tolerance * cell)
        black = shapely.intersection(shapely.difference(shapely.make_valid(smooth), clear), inner)
        parts = shapely.get_parts(shapely.buffer(black, -SEAM, join_style="mitre"))
        kept = parts[(shapely.get_dimensions(parts) == 2) & (shapely.area(parts) > LEAST_PART * cell**2)]
        try:
            return from_polygons(shapely.MultiPolygon(list(kept)), target.window)
        except InputError:
            continue
    return one_colour_map(target)


def occupied_region(window: Window, laser: LaserData, chosen: NDArray[np.bool_], cell: float) -> BaseGeometry:
    """Return the union of the cells that the chosen beams end in often enough, holes of a cell closed."""
    grid = make_grid(*window, cell)
    n = grid.nx * grid.ny
    cells = Cells(
        grid,
        np.zeros(n, np.int32),
        np.zeros(n, np.int32),
        np.zeros(n),
        np.zeros(4),
        np.empty(most_cells(grid), np.int32),
    )
    hit = laser.readings.select(chosen & (laser.readings.range < laser.model.limit))
    direction = unit_vectors(hit.angle)
    length = np.minimum(hit.range, window_exit(window, hit.origin, direction))
    segments = np.ascontiguousarray(np.hstack([hit.origin, hit.origin + length[:, None] * direction]))
    update_beams(cells, segments, np.ascontiguousarray(hit.range <= length))
    (black,) = np.nonzero((cells.hits > 0) & (cells.hits >= OCCUPIED * (cells.hits + cells.misses)))
    low = np.stack([grid.x0 + (black % grid.nx) * cell, grid.y0 + (black // grid.nx) * cell], axis=1)
    squares = shapely.union_all(shapely.box(*low.T, *(low + cell).T))
    wide = shapely.buffer(squares, CLOSED, join_style="mitre")
    closed: BaseGeometry = shapely.buffer(wide, -CLOSED, join_style="mitre")
    return closed


Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

PROPOSALS_PER_EDGE = 8e-3
MOST_PROPOSALS = 0.5
"""Proposals there for each step of the chain: so many for each edge that the prior has there in the mean, and at most.
Such a one takes a quarter of the time of a step, or less; with a tenth as many, chains that agree elsewhere differ
there after minutes."""
TILED_FACTOR = 4.0
"""Factor on their number under tiles, whose steps take longer."""
FIRST_PER_EDGE = 1000
MOST_FIRST = 3_000_000
"""Proposals before the first step, likewise: some eight times as many as it takes to forget a colour."""
FEWEST_EDGES = 2.0
"""Edges that the prior has in the window in the mean at least, if steps there can pay."""
ENLARGED = 20.0
"""Moves there reach so many times as far as elsewhere."""
REACHES = [c.BIRTH_REACH, c.SPLIT_REACH, c.MOVE_REACH, c.CUT_REACH, c.JOIN_REACH, c.AIM_REACH]
EDGE_CELL = 0.1
"""Side of the cells of the index of edges there, over the scale: which pairs are recoloured together."""
CELL_ROOM = 64
BEHIND = 1e-6
"""Metres behind an obstacle up to which a beam closes the ground, so that the obstacle itself stays."""


class PriorGround:
    """The ground that no reading concerns, and how a chain steps there."""

    def __init__(self, target: Target, chain: Chain) -> None:
        self.target = target
        bare = dataclasses.replace(target, laser=None, sonar=None, points=None).with_execution(resolution=None)
        self._bare = make_chain(bare.with_execution(cell=EDGE_CELL / target.scale), Coloring.empty(target.window))
        self._bare.tuning[REACHES] *= ENLARGED
        self.influence = influence_of(target, chain)
        self.n_edges = 0.0  # that the prior has on what the last guards left open

    def closed(self, chain: Chain) -> Guards:
        """Return guards of the ground that readings concern in the present map, and count edges on what is left.

        Let go of them afterwards: those of many beams take more room than all else of the ground.
        """
        target, grid = self.target, chain.edge_index.grid
        self.influence = influence_of(target, chain)
        rays, coned = closed_rays(chain, self.influence), coned_cells(target, chain)
        is_open = ~(coned | passed_cells(grid, rays))
        self.n_edges = edge_density(target.scale) * float(np.count_nonzero(is_open)) * grid.cell**2
        shapes = [rays, closed_boxes(grid, coned), way_guards(target.way, target.driven_radius)]
        return make_guards(self._bare.edge_index.grid, np.zeros(0, np.int64), np.concatenate(shapes))

    @property
    def first_proposals(self) -> int:
        """Proposals that lead to an approximate draw of the prior given what is seen."""
        return int(min(MOST_FIRST, FIRST_PER_EDGE * self.n_edges))

    def proposals(self, steps: int) -> int:
        """Return how many proposals go with so many steps of the chain."""
        rate = min(MOST_PROPOSALS, PROPOSALS_PER_EDGE * self.n_edges)
        return int(rate * steps * (TILED_FACTOR if self.target.execution.tiles else 1.0))

    def refresh(self, chain: Chain, guards: Guards, rng: np.random.Generator, proposals: int) -> Chain:
        """Make this many proposals on ground that :meth:`closed` left open in this map; they count as no steps.

        :meth:`settle` the chain afterwards.
        """
        bare, counts = self._bare, chain.graph.counts
        step = int(counts[c.STEP])
        settle_image(chain)
        while True:
            index = make_index(chain.graph, bare.edge_index.grid, CELL_ROOM)
            frozen = np.empty(len(chain.graph.edge_length), np.int32)
            n = freeze(chain.graph, index, guards, frozen)
            part = chain._replace(
                edge_index=index,
                beams=bare.beams,
                cones=bare.cones,
                targets=bare.targets,
                guards=guards,
                proposal=bare.proposal,
                density=bare.density,
                tuning=bare.tuning,
                outcomes=bare.outcomes,
                image=bare.image,
            )
            done = run(part, rng, step + proposals)
            thaw(chain.graph, frozen, n)
            if done:
                chain.graph.counts[c.STEP] = step
                repaint(chain)
                return chain
            chain = grow(chain)

    def settle(self, chain: Chain) -> Chain:
        """Return the chain with edges indexed, and impacts beyond the readings found again; sums are left."""
        index = chain.edge_index
        index.cell_count[:] = 0
        if not fill_index(chain.graph, index, np.zeros(0, np.int32)):
            index = make_index(chain.graph, index.grid, 2 * index.cell_edges.shape[1])
        retrace(chain.graph, index, chain.beams, self.influence)
        return chain._replace(edge_index=index)


def prior_ground(target: Target, chain: Chain) -> PriorGround | None:
    """Return the ground of a chain that no reading concerns; None if there can be hardly any.

    Values at points concern the colour of all ground between them, so that with them there is no such ground.
    """
    if target.walls is not None or target.points is not None or (target.laser is None and target.sonar is None):
        return None
    return PriorGround(target, chain) if edge_density(target.scale) * target.window.area >= FEWEST_EDGES else None


def edge_density(scale: float) -> float:
    """Return how many edges the prior has in a square metre, in the mean."""
    return 4.0 * math.pi * scale**2


def influence_of(target: Target, chain: Chain) -> Floats:
    """Return the distance (n,) beyond which no obstacle changes the likelihood of a beam, metres."""
    ray = chain.beams.ray
    if target.laser is None:
        return np.zeros(0)
    return np.asarray(np.minimum(ray[:, c.MAX_DISTANCE], beam_influence(target.laser.model, ray[:, c.RANGE])))


def closed_rays(chain: Chain, influence: Floats) -> Floats:
    """Return guards (n, N_SHAPE) of the beams up to the obstacle that they meet in the present map, or `influence`."""
    ray = chain.beams.ray
    found = np.zeros((len(ray), N_SHAPE))
    found[:, 0] = GUARD_RAY
    found[:, 1:5] = ray[:, [0, 1, c.DIRECTION_X, c.DIRECTION_Y]]
    found[:, 5] = np.minimum(influence, ray[:, c.DISTANCE] + BEHIND)
    return found


def passed_cells(grid: Grid, rays: Floats) -> Bools:
    """Return the cells (ny, nx) that guards of beams (n, N_SHAPE) pass."""
    passes = np.zeros((grid.ny, grid.nx), np.int64)
    start, path = np.ascontiguousarray(rays[:, 1:3]), np.empty(most_cells(grid), np.int32)
    count_passes(grid, start, start + rays[:, 5:6] * rays[:, 3:5], path, passes.reshape(-1))
    return np.asarray(passes > 0)


def coned_cells(target: Target, chain: Chain) -> Bools:
    """Return the cells (ny, nx) of the edge index in which an obstacle may concern a sonar reading."""
    grid, pose = chain.edge_index.grid, chain.cones.pose
    is_closed = np.zeros((grid.ny, grid.nx), np.bool_)
    if target.sonar is not None:
        room, reach = grid.nx * grid.ny, np.ascontiguousarray(pose[:, MAX_DISTANCE])
        mark_cones(grid, pose, reach, np.empty(room, np.int32), np.empty(room), is_closed.reshape(-1))
    return is_closed


def closed_boxes(grid: Grid, is_closed: Bools) -> Floats:
    """Return guards (n, N_SHAPE) of boxes that cover the closed cells: runs of a row, joined over rows where alike."""
    padded = np.pad(is_closed, ((0, 1), (1, 1))).astype(np.int8)
    begun: dict[tuple[int, int], int] = {}
    boxes = []
    for row, change in enumerate(np.diff(padded, axis=1)):
        runs = set(zip(np.flatnonzero(change == 1).tolist(), np.flatnonzero(change == -1).tolist(), strict=True))
        boxes += [(first, begun[first, last], last, row) for first, last in begun.keys() - runs]
        begun = {run: begun.get(run, row) for run in runs}
    found = np.zeros((len(boxes), N_SHAPE))
    found[:, 0] = GUARD_BOX
    corner = np.array([grid.x0, grid.y0, grid.x0, grid.y0])
    found[:, 1:5] = corner + grid.cell * np.array(sorted(boxes), np.float64).reshape(-1, 4)
    return found
