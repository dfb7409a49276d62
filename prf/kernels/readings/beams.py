"""The beams of one chain: where each meets the map, and the dynamic index from cells to beams (section 2.2).

The cells that a beam can ever pass are known from the start ("slots", in order along the beam). A slot is listed in
its cell only as far as the beam now reaches, so that a change of the map behind the impact touches no beam.
All room is laid out once: a cell can never list more beams than have a slot there.
"""

from typing import NamedTuple

import numpy as np

from prf.kernels import constants as c
from prf.kernels._jit import Array, core, core_entry
from prf.kernels.readings.laser import beam_log_likelihood
from prf.kernels.state.edge_index import EdgeIndex
from prf.kernels.state.geometry import ray_hit
from prf.kernels.state.graph import Graph
from prf.kernels.state.grid import ABS_TOL, REL_TOL, Grid, exit_distance
from prf.kernels.state.slots import list_from_start


class Beams(NamedTuple):
    """Readings, their present impacts, and the index; slots are numbered over all beams."""

    model: Array  # (N_LASER_MODEL,) f8
    ray: Array  # (n, N_RAY) f8 one cache line a beam: columns ORIGIN_X ... BEAM_LOG_LIKELIHOOD
    beyond: Array  # (n,) f8 distance of what is beyond the maximum distance, which nothing moves; inf for nothing
    impact_edge: Array  # (n,) i4 edge that the beam meets, or NONE
    last_slot: Array  # (n,) i4 slot in which the impact lies: the last that is listed
    next_beam: Array  # (n,) i4 beams that meet the same edge, linked
    previous_beam: Array  # (n,) i4
    first_beam: Array  # (edge capacity, n_levels) i4 heads of those lists, one a level
    level: Array  # (n,) u1 stage of the decision at which a beam counts
    slot_start: Array  # (n + 1,) i8
    slot_cell: Array  # (slots,) i4 list of the slot: cell + level * cells of the grid
    slot_exit: Array  # (slots,) f4 distance at which the beam leaves the slot, rounded down
    slot_place: Array  # (slots,) i4 place in the cell's list, NONE while not listed
    cell_start: Array  # (n_levels * n_cells + 1,) i8
    cell_count: Array  # (n_levels * n_cells,) i4
    entries: Array  # (slots, 2) i4 beam and slot, listed by cell
    weight: Array  # (n,) f8 independent readings that each counts as
    best: Array  # (n,) f8 log likelihood that no distance exceeds
    aim: Array  # (n, 2) i4 slots in which the reading lies: the first, and the one after the last
    edge_shortfall: Array  # (edge capacity, n_levels) f8 of the beams that meet an edge, summed (laser_change)
    cell_shortfall: Array  # (n_levels * n_cells,) f8 the same for the beams whose readings lie in a cell
    mark: Array  # (n,) i4 place among the touched beams in the proposal of that mark
    touched: Array  # (n,) i4 beams that the proposal touches
    touched_edge: Array  # (n,) i4 their new impact: edge slot, or -2 - k for the new edge k, or NONE
    touched_distance: Array  # (n,) f8
    touched_log_likelihood: Array  # (n,) f8
    n_touched: Array  # (1,) i8


@core
def slot_at(beams: Beams, beam: int, distance: float, near: int) -> int:
    """Slot of a beam in which it lies at `distance`, searched from the slot `near` on."""
    slot = near
    first = beams.slot_start[beam]
    last = beams.slot_start[beam + 1] - 1
    while slot > first and beams.slot_exit[slot - 1] >= distance:
        slot -= 1
    while slot < last and beams.slot_exit[slot] < distance:
        slot += 1
    return slot


@core
def shortfall(beams: Beams, beam: int) -> float:
    """What the log likelihood of a beam lacks to its highest, nats."""
    return beams.best[beam] - beams.ray[beam, c.BEAM_LOG_LIKELIHOOD]


@core
def shift_cells(beams: Beams, beam: int, change: float) -> None:
    """Add the change of a beam's shortfall to the cells in which its reading lies."""
    for slot in range(beams.aim[beam, 0], beams.aim[beam, 1]):
        beams.cell_shortfall[beams.slot_cell[slot]] += change


@core
def link_beam(beams: Beams, beam: int, edge: int) -> None:
    """Enter a beam, its log likelihood as it will be, into the list of those that meet `edge` (NONE: no list)."""
    beams.impact_edge[beam] = edge
    beams.previous_beam[beam] = c.NONE
    beams.next_beam[beam] = c.NONE
    if edge != c.NONE:
        level = beams.level[beam]
        head = beams.first_beam[edge, level]
        beams.next_beam[beam] = head
        if head != c.NONE:
            beams.previous_beam[head] = beam
        beams.first_beam[edge, level] = beam
        beams.edge_shortfall[edge, level] += shortfall(beams, beam)


@core
def unlink_beam(beams: Beams, beam: int) -> None:
    """Remove a beam, its log likelihood as it was, from the list of those that meet its edge."""
    edge = beams.impact_edge[beam]
    if edge == c.NONE:
        return
    level = beams.level[beam]
    beams.edge_shortfall[edge, level] -= shortfall(beams, beam)
    before = beams.previous_beam[beam]
    after = beams.next_beam[beam]
    if before == c.NONE:
        beams.first_beam[edge, level] = after
    else:
        beams.next_beam[before] = after
    if after != c.NONE:
        beams.previous_beam[after] = before


@core
def first_hit(
    graph: Graph, index: EdgeIndex, beams: Beams, beam: int, slot: int, limit: float, removed: Array, n_removed: int
) -> tuple[int, float]:
    """First edge that remains on a beam from `slot` on, before `limit`; (NONE, `limit`) if there is none."""
    ray = beams.ray[beam]
    best = limit
    best_edge = c.NONE
    before = np.int64(beams.level[beam]) * index.cell_count.shape[0]
    for at in range(slot, beams.slot_start[beam + 1]):
        cell = beams.slot_cell[at] - before
        for place in range(index.cell_count[cell]):
            edge = index.cell_edges[cell, place]
            t = ray_hit(ray, graph.edge_xy[edge])
            if t < best:
                remains = True
                for k in range(n_removed):
                    if removed[k] == edge:
                        remains = False
                if remains:
                    best = t
                    best_edge = edge
        if best <= beams.slot_exit[at]:
            break
    return best_edge, best


@core
def trace_beam(graph: Graph, index: EdgeIndex, beams: Beams, beam: int) -> None:
    """Find the impact of a beam from its origin on, and its log likelihood (lists are not touched)."""
    reach = beams.ray[beam, c.MAX_DISTANCE]
    removed = index.neighbors
    edge, distance = first_hit(graph, index, beams, beam, beams.slot_start[beam], reach, removed, 0)
    if edge == c.NONE:
        distance = beams.beyond[beam]
    beams.impact_edge[beam] = edge
    beams.ray[beam, c.DISTANCE] = distance
    ray = beams.ray[beam]
    ray[c.BEAM_LOG_LIKELIHOOD] = beam_log_likelihood(beams.model, beams.weight[beam], ray[c.RANGE], distance)


@core
def relist_beams(beams: Beams) -> float:
    """Lay out the lists anew from the impacts, in the order of beams; return the sum of log likelihoods.

    The order within a list decides the order of floating-point sums. Done at fixed steps it makes that order a
    function of the impacts alone, so that a resumed chain repeats an uninterrupted one bit for bit.
    """
    beams.cell_count[:] = 0
    beams.first_beam[:, :] = c.NONE
    beams.edge_shortfall[:, :] = 0.0
    beams.cell_shortfall[:] = 0.0
    total = 0.0
    for beam in range(beams.ray.shape[0]):
        last = slot_at(beams, beam, beams.ray[beam, c.DISTANCE], beams.slot_start[beam])
        list_from_start(beams, beam, last)
        link_beam(beams, beam, beams.impact_edge[beam])
        shift_cells(beams, beam, shortfall(beams, beam))
        total += beams.ray[beam, c.BEAM_LOG_LIKELIHOOD]
    return total


@core_entry
def find_exits(grid: Grid, ray: Array, slot_start: Array, slot_cell: Array, slot_exit: Array) -> None:
    """Write where each beam leaves its slots, rounded down: one may be searched in vain, but never missed."""
    for beam in range(ray.shape[0]):
        ox, oy, ux, uy = ray[beam, 0], ray[beam, 1], ray[beam, 2], ray[beam, 3]
        last = slot_start[beam + 1] - 1
        latest = 0.0
        for slot in range(slot_start[beam], last):
            latest = max(latest, exit_distance(grid, slot_cell[slot], ox, oy, ux, uy) * (1.0 - REL_TOL) - ABS_TOL)
            slot_exit[slot] = latest
        slot_exit[last] = ray[beam, c.MAX_DISTANCE]


@core_entry
def find_aims(near: Array, far: Array, slot_start: Array, slot_exit: Array, aim: Array) -> None:
    """Set `aim` (n, 2) to the slots, from the first to before the second, between the distances `near` and `far`."""
    for beam in range(near.shape[0]):
        first = slot_start[beam]
        last = slot_start[beam + 1]
        while first < last and slot_exit[first] < near[beam]:
            first += 1
        end = first
        while end < last and (end == first or slot_exit[end - 1] <= far[beam]):
            end += 1
        aim[beam, 0] = first
        aim[beam, 1] = end
