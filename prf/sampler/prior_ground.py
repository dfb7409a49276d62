"""Ground that no reading concerns, kept at the prior given what is seen (docs/driven-way.md).

There the posterior is the prior given the rest of the map, by its spatial Markov property. The moves of a chain are as
small as walls and doors ask for, and would take hours to redraw shapes of ten metres where nothing was seen. So at
the end of each block proposals are made there alone, with moves as large as the prior's own shapes and without a look
at any reading. No edge may pass a cell that a reading concerns, which makes them a Metropolis-Hastings chain on what
lies in the other cells, with the prior for its law. They count as no steps.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

from prf.kernels import constants as c
from prf.kernels.readings.cones import MAX_DISTANCE
from prf.kernels.score.passed_cells import count_passes, mark_cones
from prf.kernels.state.build import fill_index
from prf.kernels.state.chain import Chain
from prf.kernels.state.frozen import freeze, retrace, thaw
from prf.kernels.state.grid import Grid, most_cells
from prf.kernels.state.guards import GUARD_BOX, N_SHAPE
from prf.kernels.step import run
from prf.model.coloring import Coloring
from prf.model.laser import beam_influence
from prf.model.layout import grow, make_guards, make_index
from prf.readings.ground import way_guards
from prf.sampler.state import make_chain, repaint, settle_image
from prf.sampler.target import Target

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

PROPOSALS_PER_EDGE = 5e-4
MOST_PROPOSALS = 1.0
"""Proposals there for each step of the chain: so many for each edge that the prior has there in the mean, and at most.
Such a one takes a quarter of the time of a step, or less."""
TILED_FACTOR = 4.0
"""Factor on their number under tiles, whose steps take longer."""
FIRST_PER_EDGE = 1000
MOST_FIRST = 3_000_000
"""Proposals before the first step, likewise: some eight times as many as it takes to forget a colour."""
FEWEST_EDGES = 2.0
"""Edges that the prior has there in the mean at least, if steps there pay."""
ENLARGED = 20.0
"""Moves there reach so many times as far as elsewhere."""
REACHES = [c.BIRTH_REACH, c.SPLIT_REACH, c.MOVE_REACH, c.CUT_REACH, c.JOIN_REACH]
CELL = 0.4
"""Side of the cells of the index of edges there, over the scale: which pairs are recoloured together."""
CELL_ROOM = 64


class PriorGround:
    """The ground that no reading concerns, and how a chain steps there."""

    def __init__(self, target: Target, chain: Chain) -> None:
        grid = chain.edge_index.grid
        is_closed = closed_cells(target, chain)
        self.influence = influence_of(target, chain)
        self.n_edges = edge_density(target.scale) * float(np.count_nonzero(~is_closed)) * grid.cell**2
        self.rate = min(MOST_PROPOSALS, PROPOSALS_PER_EDGE * self.n_edges) * (
            TILED_FACTOR if target.execution.tiles else 1.0
        )
        bare = dataclasses.replace(target, laser=None, sonar=None, points=None).with_execution(resolution=None)
        self._bare = make_chain(bare.with_execution(cell=CELL / target.scale), Coloring.empty(target.window))
        self._bare.tuning[REACHES] *= ENLARGED
        shapes = np.concatenate([closed_boxes(grid, is_closed), way_guards(target.way, target.driven_radius)])
        self._guards = make_guards(self._bare.edge_index.grid, np.zeros(0, np.int64), shapes)

    @property
    def first_proposals(self) -> int:
        """Proposals that lead to an approximate draw of the prior given what is seen."""
        return int(min(MOST_FIRST, FIRST_PER_EDGE * self.n_edges))

    def refresh(self, chain: Chain, rng: np.random.Generator, proposals: int) -> Chain:
        """Make this many proposals on this ground, not counted as steps; :meth:`settle` the chain first."""
        bare, counts = self._bare, chain.graph.counts
        step = int(counts[c.STEP])
        settle_image(chain)
        while True:
            index = make_index(chain.graph, bare.edge_index.grid, CELL_ROOM)
            frozen = np.empty(len(chain.graph.edge_length), np.int32)
            n = freeze(chain.graph, index, self._guards, frozen)
            part = chain._replace(
                edge_index=index,
                beams=bare.beams,
                cones=bare.cones,
                targets=bare.targets,
                guards=self._guards,
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
    """Return the ground of a chain that no reading concerns; None if there is hardly any.

    Values at points concern the colour of all ground between them, so that with them there is no such ground.
    """
    if target.points is not None or (target.laser is None and target.sonar is None):
        return None
    ground = PriorGround(target, chain)
    return ground if ground.n_edges >= FEWEST_EDGES else None


def edge_density(scale: float) -> float:
    """Return how many edges the prior has in a square metre, in the mean."""
    return 4.0 * math.pi * scale**2


def influence_of(target: Target, chain: Chain) -> Floats:
    """Return the distance (n,) beyond which no obstacle changes the likelihood of a beam, metres."""
    ray = chain.beams.ray
    if target.laser is None:
        return np.zeros(0)
    return np.asarray(np.minimum(ray[:, c.MAX_DISTANCE], beam_influence(target.laser.model, ray[:, c.RANGE])))


def closed_cells(target: Target, chain: Chain) -> Bools:
    """Return the cells (ny, nx) of the edge index in which an obstacle may concern a reading."""
    grid, ray, pose = chain.edge_index.grid, chain.beams.ray, chain.cones.pose
    passes = np.zeros((grid.ny, grid.nx), np.int64)
    end = ray[:, :2] + influence_of(target, chain)[:, None] * ray[:, c.DIRECTION_X : c.DIRECTION_Y + 1]
    path = np.empty(most_cells(grid), np.int32)
    count_passes(grid, np.ascontiguousarray(ray[:, :2]), end, path, passes.reshape(-1))
    is_closed: Bools = passes > 0
    if target.sonar is not None:
        room = grid.nx * grid.ny
        mark_cones(
            grid,
            pose,
            np.ascontiguousarray(pose[:, MAX_DISTANCE]),
            np.empty(room, np.int32),
            np.empty(room),
            is_closed.reshape(-1),
        )
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
