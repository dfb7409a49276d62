"""What a chain on a part of the map must leave as it is: edges that stay, and places where no edge may come.

A chain in a tile (``prf.sampler.tiles``) holds edges that do not lie inside the tile, and readings that other tiles
answer for pass through it. The first must stay; the second must see the same obstacles as before. A chain on the whole
window has no guards.
"""

from typing import NamedTuple

import numpy as np

from prf.kernels._jit import core, core_entry
from prf.kernels.edge_index import EdgeIndex, index_edge
from prf.kernels.geometry import orientation, ray_hit, segments_meet
from prf.kernels.graph import Graph, is_drawn
from prf.kernels.grid import Grid, axis_index, walk
from prf.kernels.proposal import N_NEW_EDGES, N_OLD_EDGES, Proposal

# Columns of ``Guards.shape``.
KIND = 0  # GUARD_RAY or GUARD_TRIANGLE
GUARD_RAY = 0.0  # then origin (2), unit direction (2), distance up to which it is clear, distance from which it counts
GUARD_TRIANGLE = 1.0  # then three corners
N_SHAPE = 7


class Guards(NamedTuple):
    """Frozen edges, and rays and triangles that no new edge may meet, by cells of the edge index.

    Two arrays and no more: each array of a chain costs one or two per cent of the steps, with guards or without.
    """

    shape: np.ndarray  # (n, N_SHAPE) f8
    lists: np.ndarray  # i4: number of frozen edges, these; without guards no more. Else starts of cells, their guards


@core_entry
def index_frozen(graph: Graph, index: EdgeIndex, guards: Guards) -> bool:
    """Enter the frozen edges into the index; return False if a cell is short of room."""
    has_room = True
    for k in range(1, 1 + guards.lists[0]):
        edge = guards.lists[k]
        if index_edge(index, edge, graph.edge_xy[edge]):
            has_room = False
    return has_room


@core
def meets_triangle(xy: np.ndarray, corner: np.ndarray) -> bool:
    """Whether the segment `xy` (4,) has a point in common with the triangle of the corners (6,)."""
    left = 0
    right = 0
    for k in range(3):
        i = 2 * k
        j = (2 * k + 2) % 6
        if segments_meet(xy[0], xy[1], xy[2], xy[3], corner[i], corner[i + 1], corner[j], corner[j + 1]):
            return True
        if orientation(corner[i], corner[i + 1], corner[j], corner[j + 1], xy[0], xy[1]) > 0.0:
            left += 1
        else:
            right += 1
    return left == 3 or right == 3


@core
def meets_guard(shape: np.ndarray, xy: np.ndarray) -> bool:
    """Whether an edge `xy` (4,) would stand in the way of a guarded reading; rays as the beams themselves see it."""
    if shape[KIND] == GUARD_TRIANGLE:
        return meets_triangle(xy, shape[1:])
    return ray_hit(shape[1], shape[2], shape[3], shape[4], xy[0], xy[1], xy[2], xy[3]) < shape[5]


@core
def is_barred(graph: Graph, guards: Guards, proposal: Proposal) -> bool:
    """Whether a proposal takes a frozen edge away, or a new edge meets a guard."""
    if guards.lists.shape[0] == 1:
        return False
    for k in range(proposal.counts[N_OLD_EDGES]):
        if not is_drawn(graph, proposal.old_edges[k]):
            return True
    first = 1 + guards.lists[0]
    for k in range(proposal.counts[N_NEW_EDGES]):
        xy = proposal.new_xy[k]
        for i in range(proposal.n_cells[k]):
            cell = proposal.cells[k, i]
            for at in range(guards.lists[first + cell], guards.lists[first + cell + 1]):
                if meets_guard(guards.shape[guards.lists[at]], xy):
                    return True
    return False


@core
def cells_of_guard(grid: Grid, shape: np.ndarray, path: np.ndarray) -> int:
    """Write the cells in which a guard may be met; return their number."""
    if shape[KIND] == GUARD_RAY:
        ox = shape[1]
        oy = shape[2]
        ux = shape[3]
        uy = shape[4]
        return walk(grid, ox + shape[6] * ux, oy + shape[6] * uy, ox + shape[5] * ux, oy + shape[5] * uy, path)
    i0 = axis_index((min(shape[1], shape[3], shape[5]) - grid.x0) / grid.cell, grid.nx)
    i1 = axis_index((max(shape[1], shape[3], shape[5]) - grid.x0) / grid.cell, grid.nx)
    k0 = axis_index((min(shape[2], shape[4], shape[6]) - grid.y0) / grid.cell, grid.ny)
    k1 = axis_index((max(shape[2], shape[4], shape[6]) - grid.y0) / grid.cell, grid.ny)
    n = 0
    for iy in range(k0, k1 + 1):
        for ix in range(i0, i1 + 1):
            path[n] = ix + grid.nx * iy
            n += 1
    return n


@core_entry
def count_guards(grid: Grid, shape: np.ndarray, path: np.ndarray, start: np.ndarray) -> None:
    """Fill `start` (n_cells + 1,) with the numbers of guards in the cells, summed, the first 0."""
    start[:] = 0
    for guard in range(shape.shape[0]):
        for k in range(cells_of_guard(grid, shape[guard], path)):
            start[path[k] + 1] += 1
    for cell in range(start.size - 1):
        start[cell + 1] += start[cell]


@core_entry
def list_guards(grid: Grid, shape: np.ndarray, path: np.ndarray, place: np.ndarray, entries: np.ndarray) -> None:
    """Write the guards of each cell from its `place` (n_cells,) in `entries` on; places move to the ends."""
    for guard in range(shape.shape[0]):
        for k in range(cells_of_guard(grid, shape[guard], path)):
            entries[place[path[k]]] = guard
            place[path[k]] += 1
