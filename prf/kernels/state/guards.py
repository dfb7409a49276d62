"""Edges that must remain, and places that no new edge may meet.

A chain in a tile (``prf.sampler.tiles``) holds edges that do not lie inside the tile, and readings that belong to other
tiles pass through it. The first must remain; the second must see the same obstacles as before. Any chain may hold the
way driven (``prf.readings.driven``), to which no edge may be nearer than the radius of the robot: under a finite cost
of occupied sensors each edge that does costs as much for each piece of the way.
"""

from typing import NamedTuple

from prf.kernels import constants as c
from prf.kernels._jit import Array, core, core_entry
from prf.kernels.state.edge_index import EdgeIndex
from prf.kernels.state.geometry import (
    orientation,
    point_segment_distance2,
    ray_hit,
    segment_distance2,
    segment_meets_box,
    segments_meet,
)
from prf.kernels.state.graph import Graph, is_drawn
from prf.kernels.state.grid import Grid, cells_of_box, walk
from prf.kernels.state.proposal import N_NEW_EDGES, N_OLD_EDGES, Proposal

# Columns of ``Guards.shape``.
KIND = 0  # one of the following
GUARD_RAY = 0.0  # then origin (2), unit direction (2), distance up to which it is clear, distance from which it counts
GUARD_TRIANGLE = 1.0  # then three corners
GUARD_WAY = 2.0  # then two ends of a piece of the way (one place: both the same), and the radius
GUARD_BOX = 3.0  # then x_min, y_min, x_max, y_max of ground that is closed to all edges
N_SHAPE = 7


class Guards(NamedTuple):
    """Frozen edges, and rays, triangles, ways and boxes that no new edge may meet, by cells of the edge index.

    Two arrays and no more: each array of a chain costs one or two per cent of the steps, with guards or without.
    """

    shape: Array  # (n, N_SHAPE) f8
    lists: Array  # i4: number of frozen edges, these; without guards no more. Else starts of cells, their guards


@core
def meets_triangle(xy: Array, corner: Array) -> bool:
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


@core_entry
def mark_met(triangles: Array, segments: Array, is_met: Array) -> None:
    """Mark the segments (n, 4) that meet one of the triangles (m, 6)."""
    for k in range(segments.shape[0]):
        for i in range(triangles.shape[0]):
            if is_met[k] == 0 and meets_triangle(segments[k], triangles[i]):
                is_met[k] = 1


@core
def meets_guard(shape: Array, xy: Array) -> bool:
    """Whether an edge `xy` (4,) would block a guarded reading; rays as the beams themselves see it."""
    if shape[KIND] == GUARD_TRIANGLE:
        return meets_triangle(xy, shape[1:])
    if shape[KIND] == GUARD_WAY:
        radius = shape[5]
        return segment_distance2(xy[0], xy[1], xy[2], xy[3], shape[1], shape[2], shape[3], shape[4]) <= radius * radius
    if shape[KIND] == GUARD_BOX:
        return segment_meets_box(xy[0], xy[1], xy[2], xy[3], shape[1], shape[2], shape[3], shape[4])
    return ray_hit(shape[1:], xy) < shape[5]


@core
def meets_any(guards: Guards, xy: Array, cells: Array, n: int, way_is_hard: bool) -> bool:
    """Whether an edge `xy` (4,), which passes the first `n` of `cells`, meets a guard."""
    first = 1 + guards.lists[0]
    for i in range(n):
        for at in range(guards.lists[first + cells[i]], guards.lists[first + cells[i] + 1]):
            shape = guards.shape[guards.lists[at]]
            if (way_is_hard or shape[KIND] != GUARD_WAY) and meets_guard(shape, xy):
                return True
    return False


@core
def is_barred(graph: Graph, guards: Guards, proposal: Proposal, way_is_hard: bool) -> bool:
    """Whether a proposal takes a frozen edge away, or a new edge meets a guard; the way counts if it `is_hard`."""
    if guards.lists.shape[0] == 1:
        return False
    for k in range(proposal.counts[N_OLD_EDGES]):
        if not is_drawn(graph, proposal.old_edges[k]):
            return True
    for k in range(proposal.counts[N_NEW_EDGES]):
        if meets_any(guards, proposal.new_xy[k], proposal.cells[k], proposal.n_cells[k], way_is_hard):
            return True
    return False


@core
def is_listed_before(guards: Guards, guard: int, cells: Array, n: int) -> bool:
    """Whether a guard is listed in one of the first `n` of `cells`."""
    first = 1 + guards.lists[0]
    for i in range(n):
        for at in range(guards.lists[first + cells[i]], guards.lists[first + cells[i] + 1]):
            if guards.lists[at] == guard:
                return True
    return False


@core
def pieces_met(guards: Guards, xy: Array, cells: Array, n: int) -> int:
    """Number of pieces of the way that an edge `xy` (4,), which passes the first `n` of `cells`, is too near to."""
    first = 1 + guards.lists[0]
    met = 0
    for i in range(n):
        for at in range(guards.lists[first + cells[i]], guards.lists[first + cells[i] + 1]):
            guard = guards.lists[at]
            shape = guards.shape[guard]
            if shape[KIND] == GUARD_WAY and meets_guard(shape, xy) and not is_listed_before(guards, guard, cells, i):
                met += 1
    return met


@core
def blocked_change(graph: Graph, index: EdgeIndex, guards: Guards, proposal: Proposal) -> int:
    """Change of the number of pairs of an edge and a piece of the way that it is too near to."""
    if guards.lists.shape[0] == 1:
        return 0
    change = 0
    for k in range(proposal.counts[N_OLD_EDGES]):
        xy = graph.edge_xy[proposal.old_edges[k]]
        change -= pieces_met(guards, xy, index.path, walk(index.grid, xy[0], xy[1], xy[2], xy[3], index.path))
    for k in range(proposal.counts[N_NEW_EDGES]):
        change += pieces_met(guards, proposal.new_xy[k], proposal.cells[k], proposal.n_cells[k])
    return change


@core
def count_blocked(graph: Graph, index: EdgeIndex, guards: Guards) -> int:
    """Number of such pairs in the present map."""
    if guards.lists.shape[0] == 1:
        return 0
    total = 0
    for i in range(graph.counts[c.EDGES]):
        xy = graph.edge_xy[graph.members[c.EDGES, i]]
        total += pieces_met(guards, xy, index.path, walk(index.grid, xy[0], xy[1], xy[2], xy[3], index.path))
    return total


@core
def is_near_way(grid: Grid, ix: int, iy: int, shape: Array) -> bool:
    """Whether a piece of the way may come near to an edge in a cell."""
    reach = shape[5] + 0.75 * grid.cell  # half a diagonal, and a little for what rounding puts into a cell's neighbour
    x, y = grid.x0 + (ix + 0.5) * grid.cell, grid.y0 + (iy + 0.5) * grid.cell
    return point_segment_distance2(x, y, shape[1], shape[2], shape[3], shape[4]) <= reach * reach


@core
def cells_of_guard(grid: Grid, shape: Array, path: Array) -> int:
    """Write the cells in which a guard may be met; return their number."""
    if shape[KIND] == GUARD_RAY:
        ox, oy, ux, uy = shape[1], shape[2], shape[3], shape[4]
        return walk(grid, ox + shape[6] * ux, oy + shape[6] * uy, ox + shape[5] * ux, oy + shape[5] * uy, path)
    pad = shape[5] if shape[KIND] == GUARD_WAY else 0.0
    last = 5 if shape[KIND] == GUARD_TRIANGLE else 3  # of the corners that span it
    x_min, x_max = min(shape[1], shape[3], shape[last]) - pad, max(shape[1], shape[3], shape[last]) + pad
    y_min, y_max = min(shape[2], shape[4], shape[last + 1]) - pad, max(shape[2], shape[4], shape[last + 1]) + pad
    i0, i1, k0, k1 = cells_of_box(grid, x_min, y_min, x_max, y_max)
    n = 0
    for iy in range(k0, k1 + 1):
        for ix in range(i0, i1 + 1):
            if shape[KIND] != GUARD_WAY or is_near_way(grid, ix, iy, shape):
                path[n] = ix + grid.nx * iy
                n += 1
    return n


@core_entry
def find_guard_cells(grid: Grid, shape: Array, path: Array, start: Array, cells: Array) -> int:
    """Write the cells of each guard while there is room, where each begins to `start` (n + 1,); how many all need."""
    n = 0
    for guard in range(shape.shape[0]):
        start[guard] = n
        for k in range(cells_of_guard(grid, shape[guard], path)):
            if n < cells.shape[0]:
                cells[n] = path[k]
            n += 1
    start[shape.shape[0]] = n
    return n
