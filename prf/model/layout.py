"""Arrays of a chain: laid out for a map, grown when they run short on a run, read back as a coloring."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from prf.kernels import constants as c
from prf.kernels.state.build import fill_graph, fill_index
from prf.kernels.state.cell_lists import owners_by_cell, room_of_cells
from prf.kernels.state.chain import Chain
from prf.kernels.state.edge_index import EdgeIndex
from prf.kernels.state.graph import Graph
from prf.kernels.state.grid import Grid, cells_of, make_grid, most_cells
from prf.kernels.state.guards import N_SHAPE, Guards, find_guard_cells
from prf.kernels.state.image import Image, count_edges
from prf.kernels.state.proposal import N_PROPOSAL_COUNTS, Proposal
from prf.kernels.state.sites import Sites
from prf.kernels.state.targets import NEAR, Targets
from prf.model.coloring import Coloring, Draws, black_at, count_black
from prf.model.ranges import make_sight
from prf.model.window import Window

Floats = NDArray[np.float64]


def make_graph(coloring: Coloring, capacity: int) -> Graph:
    """Return the graph of a coloring with room for `capacity` vertices and edges."""
    graph = bare_graph(coloring, capacity)
    fill_graph(graph, len(coloring.xy), coloring.edges, np.ones(len(coloring.edges), np.bool_))
    return graph


def bare_graph(coloring: Coloring, capacity: int) -> Graph:
    """Return the graph with the vertices of a coloring in the first slots, none of them nor an edge alive."""
    graph = Graph(
        window=np.array(coloring.window, np.float64),
        vertex_xy=np.zeros((capacity, 2)),
        vertex_side=np.zeros(capacity, np.int32),
        vertex_edges=np.full((capacity, 2), c.NONE, np.int32),
        vertex_sine=np.ones(capacity),
        edge_vertices=np.zeros((capacity, 2), np.int32),
        edge_xy=np.zeros((capacity, 4)),
        edge_length=np.zeros(capacity),
        members=np.zeros((c.N_SETS, capacity), np.int32),
        positions=np.full((c.N_SETS, capacity), c.NONE, np.int32),
        free_vertices=np.arange(capacity, dtype=np.int32)[::-1].copy(),
        free_edges=np.arange(capacity, dtype=np.int32)[::-1].copy(),
        counts=np.zeros(c.N_COUNTS, np.int64),
        sums=np.zeros(c.N_SUMS),
    )
    n_vertices = len(coloring.xy)
    graph.counts[c.FREE_VERTICES] = capacity - n_vertices
    graph.counts[c.FREE_EDGES] = capacity
    graph.counts[c.ANCHOR_BLACK] = int(coloring.anchor_black)
    graph.vertex_xy[:n_vertices] = coloring.xy
    graph.vertex_side[:n_vertices] = coloring.side
    return graph


def make_index(graph: Graph, grid: Grid, room: int, frozen: NDArray[np.int32] | None = None) -> EdgeIndex:
    """Return the index of the graph's edges, and of `frozen` ones, with at least `room` places a cell."""
    capacity = len(graph.edge_length)
    while True:
        index = EdgeIndex(
            grid=grid,
            cell_count=np.zeros(grid.nx * grid.ny, np.int32),
            cell_edges=np.zeros((grid.nx * grid.ny, room), np.int32),
            path=np.zeros(most_cells(grid), np.int32),
            neighbors=np.zeros(capacity, np.int32),
            marks=np.zeros(capacity, np.int64),
            mark=np.zeros(1, np.int64),
        )
        if fill_index(graph, index, np.zeros(0, np.int32) if frozen is None else frozen):
            return index
        room *= 2


def make_proposal(grid: Grid) -> Proposal:
    """Return empty scratch arrays."""
    most = c.MOST_CHANGES
    return Proposal(
        counts=np.zeros(N_PROPOSAL_COUNTS, np.int64),
        old_edges=np.zeros(most, np.int32),
        new_edges=np.zeros((most, 2), np.int32),
        new_xy=np.zeros((most, 4)),
        new_length=np.zeros(most),
        new_slot=np.zeros(most, np.int32),
        old_vertices=np.zeros(most, np.int32),
        new_vertices=np.zeros(most, np.int32),
        loop=np.zeros((2 * most, 2)),
        affected=np.zeros(4 * most, np.int32),
        affected_sine=np.zeros(4 * most),
        cells=np.zeros((most, most_cells(grid)), np.int32),
        n_cells=np.zeros(most, np.int64),
    )


def make_sites(grid: Grid, origin: Floats, coloring: Coloring | None = None) -> Sites:
    """Return the distinct positions (n, 2), sorted by cell, in the colours of a map, or all in white."""
    xy = np.unique(origin.reshape(-1, 2), axis=0)
    cells = cells_of(grid, xy)
    starts = room_of_cells(cells, grid.nx * grid.ny)
    sites = Sites(grid, xy[np.argsort(cells, kind="stable")], starts, np.zeros(len(xy), np.uint8))
    return sites if coloring is None else painted_sites(sites, coloring)


def painted_sites(sites: Sites, coloring: Coloring) -> Sites:
    """Return the sites in the colours of a map."""
    return sites._replace(black=black_at(coloring, sites.xy).astype(np.uint8))


def make_targets(window: Window, side: float, xy: Floats) -> Targets:
    """Return the squares of side `side` (metres) that hold one of the points (n, 2) inside the window, all alike."""
    grid = make_grid(*window, side)
    targets = np.unique(cells_of(grid, xy[window.contains(xy, strictly=True)]))
    cumulative = np.arange(1, len(targets) + 1) / max(len(targets), 1)
    number = np.full(grid.nx * grid.ny, c.NONE, np.int32)
    number[targets] = np.arange(len(targets), dtype=np.int32)
    start, near = _near_targets(grid, targets, number)
    return Targets(grid, targets.astype(np.int32), cumulative, number, start, near)


def _near_targets(
    grid: Grid, targets: NDArray[np.int64], number: NDArray[np.int32]
) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
    """Return starts (n + 1,) and the targets near each, in the order of their cells."""
    ix, iy = targets % grid.nx, targets // grid.nx
    reach = range(-NEAR, NEAR + 1)
    found = []
    for dy, dx in ((dy, dx) for dy in reach for dx in reach if dx * dx + dy * dy <= NEAR * NEAR):
        x, y = ix + dx, iy + dy
        (inside,) = np.nonzero((x >= 0) & (x < grid.nx) & (y >= 0) & (y < grid.ny))
        other = number[x[inside] + grid.nx * y[inside]]
        found.append(np.stack([inside[other != c.NONE], other[other != c.NONE]]))
    owner, near = np.concatenate(found, axis=1)
    order = np.argsort(owner, kind="stable")
    starts = np.searchsorted(owner[order], np.arange(len(targets) + 1))
    return starts.astype(np.int64), near[order].astype(np.int32)


def make_guards(grid: Grid, frozen: NDArray[np.int64], shape: Floats) -> Guards:
    """Lay out frozen edges (slots) and guards (n, N_SHAPE) by the cells of a grid; without any there are no lists."""
    if len(frozen) + len(shape) == 0:
        return Guards(np.zeros((0, N_SHAPE)), np.zeros(1, np.int32))
    path, start = np.zeros(max(most_cells(grid), grid.nx * grid.ny), np.int32), np.zeros(len(shape) + 1, np.int64)
    cells = np.empty(find_guard_cells(grid, shape, path, start, np.empty(0, np.int32)), np.int32)
    find_guard_cells(grid, shape, path, start, cells)
    room = room_of_cells(cells, grid.nx * grid.ny)
    lists = ([len(frozen)], frozen, 1 + len(frozen) + len(room) + room, owners_by_cell(start, cells))
    return Guards(shape, np.concatenate(lists).astype(np.int32))


def image_grid(window: Window, resolution: float) -> Grid:
    """Return the grid of square pixels that covers the window from its lower left corner."""
    nx = max(1, int(np.ceil(window.width / resolution - 1e-9)))
    ny = max(1, int(np.ceil(window.height / resolution - 1e-9)))
    return Grid(float(window.x_min), float(window.y_min), float(resolution), nx, ny)


def pixel_centres(grid: Grid) -> Floats:
    """Return the centres (nx * ny, 2) of the pixels, row by row from the lowest."""
    x = grid.x0 + (np.arange(grid.nx) + 0.5) * grid.cell
    y = grid.y0 + (np.arange(grid.ny) + 0.5) * grid.cell
    return np.stack([np.tile(x, grid.ny), np.repeat(y, grid.nx)], axis=1)


def make_image(coloring: Coloring, graph: Graph, resolution: float | None) -> Image:
    """Return the occupancy image of a chain at its start, or an empty one."""
    grid = Grid(0.0, 0.0, 1.0, 0, 0) if resolution is None else image_grid(coloring.window, resolution)
    image = white_image(grid)
    if len(image.black) > 0:
        paint_image(image, coloring, int(graph.counts[c.STEP]))
    return image


def white_image(grid: Grid) -> Image:
    """Return an image without edges, its times at nothing."""
    n = grid.nx * grid.ny
    return Image(
        grid=grid,
        black=np.zeros(n, np.uint8),
        n_edges=np.zeros(n, np.int32),
        black_since=np.zeros(n, np.int64),
        black_time=np.zeros(n, np.int64),
        mixed_since=np.zeros(n, np.int64),
        mixed_time=np.zeros(n, np.int64),
        path=np.zeros(most_cells(grid), np.int32),
        crossings=np.zeros(2 * c.MOST_CHANGES),
    )


def paint_image(image: Image, coloring: Coloring, step: int) -> None:
    """Set colour and edges of every pixel from a map; times must be settled up to `step`."""
    image.black[:] = count_black(Draws.from_colorings([coloring]), image.grid)
    count_edges(image, coloring.segments(), step)


def read_coloring(graph: Graph) -> Coloring:
    """Return the map of a chain, vertices and edges in the order of the chain's sets."""
    interior = graph.members[c.INTERIOR_VERTICES, : graph.counts[c.INTERIOR_VERTICES]]
    boundary = graph.members[c.BOUNDARY_VERTICES, : graph.counts[c.BOUNDARY_VERTICES]]
    slots = np.concatenate([interior, boundary])
    number = np.zeros(len(graph.edge_length), np.int32)
    number[slots] = np.arange(len(slots), dtype=np.int32)
    edges = graph.members[c.EDGES, : graph.counts[c.EDGES]]
    return Coloring(
        window=Window(*graph.window.tolist()),
        xy=graph.vertex_xy[slots],
        side=graph.vertex_side[slots].astype(np.int8),
        edges=number[graph.edge_vertices[edges]].reshape(-1, 2),
        anchor_black=bool(graph.counts[c.ANCHOR_BLACK]),
    )


def lengthen(array: NDArray[Any], axis: int, size: int, fill: int) -> NDArray[Any]:
    """Return a copy of `array` that is `size` long along `axis`, new places holding `fill`."""
    shape = list(array.shape)
    shape[axis] = size
    longer = np.full(shape, fill, array.dtype)
    longer[tuple(slice(n) for n in array.shape)] = array
    return longer


def grow_graph(graph: Graph, capacity: int) -> Graph:
    """Return the graph with more slots; the new ones lie below the free ones, so that the order of use stays."""
    old = len(graph.edge_length)
    rows = {
        name: lengthen(getattr(graph, name), 0, capacity, fill)
        for name, fill in (
            ("vertex_xy", 0),
            ("vertex_side", 0),
            ("vertex_edges", c.NONE),
            ("vertex_sine", 1),
            ("edge_vertices", 0),
            ("edge_xy", 0),
            ("edge_length", 0),
        )
    }
    counts = graph.counts.copy()
    fresh = np.arange(capacity - 1, old - 1, -1, dtype=np.int32)
    stacks = {}
    for name, size in (("free_vertices", c.FREE_VERTICES), ("free_edges", c.FREE_EDGES)):
        stacks[name] = lengthen(np.concatenate([fresh, getattr(graph, name)[: counts[size]]]), 0, capacity, 0)
        counts[size] += capacity - old
    return graph._replace(
        members=lengthen(graph.members, 1, capacity, 0),
        positions=lengthen(graph.positions, 1, capacity, c.NONE),
        counts=counts,
        **rows,
        **stacks,
    )


def grow(chain: Chain) -> Chain:
    """Return the chain with twice the room where it is short, in the graph or in the cells; its state is unchanged.

    Not in both: the cells of a large window hold many times as much as its graph.
    """
    index, counts = chain.edge_index, chain.graph.counts
    capacity, room = len(chain.graph.edge_length), index.cell_edges.shape[1]
    if min(counts[c.FREE_EDGES], counts[c.FREE_VERTICES]) < c.MOST_CHANGES:
        capacity *= 2
    if index.cell_count.max() + c.MOST_CHANGES > room:
        room *= 2
    counts[c.NEEDS_ROOM] = 0
    return chain._replace(
        graph=grow_graph(chain.graph, capacity),
        edge_index=index._replace(
            cell_edges=lengthen(index.cell_edges, 1, room, 0),
            neighbors=lengthen(index.neighbors, 0, capacity, 0),
            marks=lengthen(index.marks, 0, capacity, 0),
        ),
        beams=chain.beams._replace(
            first_beam=lengthen(chain.beams.first_beam, 0, capacity, c.NONE),
            edge_shortfall=lengthen(chain.beams.edge_shortfall, 0, capacity, 0),
        ),
        cones=chain.cones._replace(sight=make_sight(capacity + c.MOST_CHANGES)),
    )
