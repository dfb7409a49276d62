"""The state of a chain at a given map: built, copied, exchanged with another, and run."""

from __future__ import annotations

from typing import Any

import numpy as np

from prf.kernels import constants as c
from prf.kernels.readings.points import Points, Y
from prf.kernels.state.build import recompute_sums, trace_all
from prf.kernels.state.chain import Chain
from prf.kernels.state.graph import Graph
from prf.kernels.state.grid import make_grid
from prf.kernels.state.image import settle_all
from prf.kernels.step import run
from prf.model.coloring import Coloring, black_at
from prf.model.laser import empty_lists, make_beams
from prf.model.layout import (
    grow,
    make_graph,
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
from prf.model.points import log_density, make_points, paint
from prf.model.sonar import make_cones, make_sight
from prf.readings.ground import way_guards
from prf.sampler.target import NO_LASER, NO_SONAR, PointData, Target, poses_of, rays_of, return_points, white_places

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

STATE = ("graph", "edge_index", "beams", "cones", "points", "sensors")
"""Fields of a chain that follow from its map; the others belong to the temperature."""
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
    graph = make_graph(coloring, capacity)
    ray = rays_of(target)
    cell = target.cell_size()
    if target.execution.cell is None:
        # So many beams that their lists would fill the memory get larger cells.
        cell = max(cell, CELLS_A_LENGTH * float(ray[:, c.MAX_DISTANCE].sum()) / MOST_LISTED)
    grid = make_grid(*window, cell)
    weights = np.array([MOVE_WEIGHTS[move] for move in range(c.N_MOVES)])
    targets = make_targets(window, target.target_side(), return_points(target))
    tuning = target.tuning.array(target.scale)
    tuning[c.AIMED_SHARE] = target.tuning.aimed_share if len(targets.cell) > 0 else 0.0
    chain = Chain(
        graph=graph,
        edge_index=make_index(graph, grid, FIRST_CELL_ROOM),
        beams=make_beams(grid, (target.laser or NO_LASER).model, ray, capacity, target.execution.levels),
        cones=make_cones(grid, (target.sonar or NO_SONAR).model, poses_of(target), capacity),
        points=painted_points(target.points, coloring),
        sensors=make_sites(grid, white_places(target), coloring),
        targets=targets,
        image=make_image(coloring, graph, target.execution.resolution),
        guards=make_guards(grid, np.zeros(0, np.int64), way_guards(target.way, target.driven_radius)),
        proposal=make_proposal(grid),
        density=target.density(),
        tuning=tuning,
        move_probabilities=weights / weights.sum(),
        outcomes=np.zeros((c.N_MOVES, c.N_OUTCOMES), np.int64),
    )
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
    while not run(chain, rng, step):
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
    trace_all(placed)
    recompute_sums(placed)
    return placed


def with_map(chain: Chain, target: Target, coloring: Coloring) -> Chain:
    """Return the chain at another map and at the same step. Its image is left as it is."""
    graph = make_graph(coloring, max(FIRST_CAPACITY, 2 * (len(coloring.xy) + c.MOST_CHANGES)))
    graph.counts[c.STEP] = chain.graph.counts[c.STEP]
    return with_graph(chain, target, graph)


def repaint(chain: Chain) -> None:
    """Let the image follow the map that the chain was given; the times of the old one must be settled."""
    if chain.image.black.size > 0:
        paint_image(chain.image, read_coloring(chain.graph), int(chain.graph.counts[c.STEP]))


def settle_image(chain: Chain) -> None:
    """Add up the times of the image up to the present step."""
    settle_all(chain.image, int(chain.graph.counts[c.STEP]))


def penalised_log_likelihood(chain: Chain, cost: float) -> float:
    """Return E: the log likelihood less what occupied sensors cost, nats, which an inverse temperature multiplies."""
    occupied = int(chain.graph.counts[c.OCCUPIED])
    return float(chain.graph.sums[c.LOG_LIKELIHOOD]) - (cost * occupied if occupied else 0.0)
