"""The sonar readings of one chain: their cones, present likelihoods, and the dynamic index from cells to cones.

The cells that a cone can ever touch are known from the start ("slots", nearest first). A slot is listed in its cell
while it lies within the cone's extent: up to its farthest contact where the whole field of view is covered, else up to
its reach (section 2.3). A change of the map beyond it concerns no cone.
"""

import math
from typing import NamedTuple

from prf.kernels import constants as c
from prf.kernels._jit import Array, core, core_entry
from prf.kernels.readings.sonar import sonar_log_likelihood
from prf.kernels.readings.sonar_features import (
    BORDER,
    N_LINES,
    POSE_COS,
    POSE_SIN,
    POSE_X,
    POSE_Y,
    Sight,
    see_edge,
    sweep,
)
from prf.kernels.state.edge_index import EdgeIndex
from prf.kernels.state.graph import Graph, ends_of
from prf.kernels.state.grid import ABS_TOL, REL_TOL, Grid, cells_of_box
from prf.kernels.state.proposal import N_NEW_EDGES, Proposal, is_edge_removed
from prf.kernels.state.slots import list_from_start

# Columns of ``Cones.pose`` after those that place the sonar.
READING = 5  # m; inf for no return within the reach
MAX_DISTANCE = 6  # nothing farther is heard: the maximum range, or where the cone leaves the window, m
EXTENT = 7  # up to where the map matters now, m
CONE_LOG_LIKELIHOOD = 8
N_POSE = 9

SLACK = 1.0 + REL_TOL
"""Extents are raised by this factor: rounding may then test a cone in vain, but never miss one."""


class Cones(NamedTuple):
    """Sonar readings and their index; slots are numbered over all cones."""

    model: Array  # (N_SONAR_MODEL,) f8
    pose: Array  # (n, N_POSE) f8
    last_slot: Array  # (n,) i4 last slot that is listed
    slot_start: Array  # (n + 1,) i8
    slot_cell: Array  # (slots,) i4
    slot_near: Array  # (slots,) f4 distance at which the cone enters the slot, rounded down; ascending in a cone
    slot_place: Array  # (slots,) i4 place in the cell's list, NONE while not listed
    cell_start: Array  # (n_cells + 1,) i8
    cell_count: Array  # (n_cells,) i4
    entries: Array  # (slots, 2) i4 cone and slot, listed by cell
    mark: Array  # (n,) i8 the last proposal that touched the cone
    proposals: Array  # (1,) i8 number of the proposal in work
    touched: Array  # (n,) i4 cones whose likelihood the proposal may change
    touched_extent: Array  # (n,) f8
    touched_log_likelihood: Array  # (n,) f8
    n_touched: Array  # (1,) i8
    sight: Sight


@core
def last_within(cones: Cones, cone: int, extent: float, near: int) -> int:
    """Last slot that a cone enters within `extent`, searched from the slot `near` on."""
    slot = near
    first = cones.slot_start[cone]
    last = cones.slot_start[cone + 1] - 1
    while slot > first and cones.slot_near[slot] > extent:
        slot -= 1
    while slot < last and cones.slot_near[slot + 1] <= extent:
        slot += 1
    return slot


@core
def see_indexed(
    graph: Graph, index: EdgeIndex, cones: Cones, cone: int, first: int, end: int, proposal: Proposal, with_change: bool
) -> None:
    """Enter the edges of the slots from `first` to before `end` that remain and were not entered yet."""
    pose = cones.pose[cone]
    for slot in range(first, end):
        cell = cones.slot_cell[slot]
        for place in range(index.cell_count[cell]):
            edge = index.cell_edges[cell, place]
            if index.marks[edge] == index.mark[0]:
                continue
            index.marks[edge] = index.mark[0]
            if with_change and is_edge_removed(proposal, edge):
                continue
            a, b = ends_of(graph, edge)
            see_edge(
                cones.sight, pose, pose[MAX_DISTANCE], graph.edge_xy[edge], corner_at(graph, a), corner_at(graph, b)
            )


@core
def corner_at(graph: Graph, vertex: int) -> int:
    """The vertex if it lies inside the window, NONE on its border: there the window ends, not a wall."""
    return vertex if graph.vertex_side[vertex] == c.INTERIOR else c.NONE


@core
def see_new(graph: Graph, cones: Cones, cone: int, proposal: Proposal) -> None:
    """Enter the new edges."""
    pose = cones.pose[cone]
    for k in range(proposal.counts[N_NEW_EDGES]):
        a = corner_at(graph, proposal.new_edges[k, 0])
        b = corner_at(graph, proposal.new_edges[k, 1])
        see_edge(cones.sight, pose, pose[MAX_DISTANCE], proposal.new_xy[k], a, b)


@core
def sense(
    graph: Graph, index: EdgeIndex, cones: Cones, cone: int, proposal: Proposal, with_change: bool
) -> tuple[float, float]:
    """Extent and log likelihood of a cone in the present map, or in that which the proposal would make.

    The near slots are searched first: where they cover the field of view, the far ones cannot be seen.
    """
    reach = cones.pose[cone, MAX_DISTANCE]
    first = cones.slot_start[cone]
    end = cones.slot_start[cone + 1]
    near = cones.last_slot[cone] + 1
    index.mark[0] += 1
    cones.sight.counts[N_LINES] = 0
    if with_change:
        see_new(graph, cones, cone, proposal)
    see_indexed(graph, index, cones, cone, first, near, proposal, with_change)
    extent = min(reach, SLACK * sweep(cones.sight, cones.pose[cone, BORDER], reach))
    if near < end and cones.slot_near[near] <= extent:
        see_indexed(graph, index, cones, cone, near, end, proposal, with_change)
        extent = min(reach, SLACK * sweep(cones.sight, cones.pose[cone, BORDER], reach))
    return extent, sonar_log_likelihood(cones.model, cones.sight, cones.pose[cone, READING], reach)


@core
def sense_now(graph: Graph, index: EdgeIndex, cones: Cones, cone: int, proposal: Proposal) -> None:
    """Find extent and log likelihood of a cone from scratch (lists are not touched)."""
    cones.last_slot[cone] = cones.slot_start[cone + 1] - 1
    extent, log_likelihood = sense(graph, index, cones, cone, proposal, False)
    cones.pose[cone, EXTENT] = extent
    cones.pose[cone, CONE_LOG_LIKELIHOOD] = log_likelihood


@core
def relist_cones(cones: Cones) -> float:
    """Lay out the lists anew from the extents, in the order of cones; return the sum of log likelihoods."""
    cones.cell_count[:] = 0
    total = 0.0
    for cone in range(cones.pose.shape[0]):
        list_from_start(cones, cone, last_within(cones, cone, cones.pose[cone, EXTENT], cones.slot_start[cone]))
        total += cones.pose[cone, CONE_LOG_LIKELIHOOD]
    return total


@core
def enters_cell(grid: Grid, pose: Array, reach: float, ix: int, iy: int) -> float:
    """Distance at which a cone enters a cell, rounded down; inf if it surely does not."""
    x = grid.x0 + ix * grid.cell - pose[POSE_X]
    y = grid.y0 + iy * grid.cell - pose[POSE_Y]
    near_x = max(x, -(x + grid.cell), 0.0)
    near_y = max(y, -(y + grid.cell), 0.0)
    near = math.sqrt(near_x * near_x + near_y * near_y)
    if near > reach:
        return math.inf
    centre_x = x + 0.5 * grid.cell
    centre_y = y + 0.5 * grid.cell
    distance = math.sqrt(centre_x * centre_x + centre_y * centre_y)
    radius = 0.75 * grid.cell  # half a diagonal, and a little for what rounding puts into a cell's neighbour
    if distance > radius:
        along = pose[POSE_COS] * centre_x + pose[POSE_SIN] * centre_y
        across = pose[POSE_COS] * centre_y - pose[POSE_SIN] * centre_x
        if abs(math.atan2(across, along)) > math.atan(pose[BORDER]) + math.asin(radius / distance):
            return math.inf
    return max(0.0, near * (1.0 - REL_TOL) - ABS_TOL)


@core
def cells_of_cone(grid: Grid, pose: Array, reach: float, cells: Array, near: Array) -> int:
    """Write the cells of a cone, nearest first, and where it enters them; return their number."""
    x, y = pose[POSE_X], pose[POSE_Y]
    i0, i1, k0, k1 = cells_of_box(grid, x - reach, y - reach, x + reach, y + reach)
    n = 0
    for iy in range(k0, k1 + 1):
        for ix in range(i0, i1 + 1):
            entry = enters_cell(grid, pose, reach, ix, iy)
            if entry == math.inf:
                continue
            place = n
            while place > 0 and near[place - 1] > entry:
                near[place] = near[place - 1]
                cells[place] = cells[place - 1]
                place -= 1
            near[place] = entry
            cells[place] = ix + grid.nx * iy
            n += 1
    return n


@core_entry
def find_slots(
    grid: Grid, pose: Array, cells: Array, near: Array, slot_start: Array, slot_cell: Array, slot_near: Array
) -> int:
    """Write the cells of each cone and where it enters them, while there is room; return how many slots all need.

    `slot_start` (n + 1,) takes the first slot of each cone; `cells` and `near` have room for one cone.
    """
    n = 0
    for cone in range(pose.shape[0]):
        slot_start[cone] = n
        for k in range(cells_of_cone(grid, pose[cone], pose[cone, MAX_DISTANCE], cells, near)):
            if n < slot_cell.shape[0]:
                slot_cell[n] = cells[k]
                slot_near[n] = near[k] * (1.0 - REL_TOL)
            n += 1
    slot_start[pose.shape[0]] = n
    return n
