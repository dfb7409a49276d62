"""Which beams a proposal touches, what becomes of their impacts, and the change of their log likelihood.

Only beams whose impact lies on an edge that goes, and beams that a new edge cuts before their impact, change. For
the second kind the new impact is on the new edge. For the first it is the nearest of the new edges, or else the
beam walks on from its old impact: nothing stood before it.

Beams are asked by levels, so that a proposal which few beams refuse never meets the many (delayed acceptance). The
caller says what the change must exceed for the proposal to be accepted. After every beam the change so far and the
most that the beams not yet asked can gain (:mod:`prf.kernels.bounds`) are compared with it: most proposals lose so
much at the first few beams that the others cannot make up for it. The decision is the same as after all beams.
"""

import numpy as np

from prf.kernels import constants as c
from prf.kernels._jit import spine
from prf.kernels.beams import Beams, first_hit, link_beam, slot_at, unlink_beam
from prf.kernels.bounds import gap, most_cut, most_freed, shift_cells
from prf.kernels.edge_index import EdgeIndex
from prf.kernels.geometry import ray_hit
from prf.kernels.graph import Graph
from prf.kernels.laser import beam_log_likelihood
from prf.kernels.proposal import N_NEW_EDGES, N_OLD_EDGES, Proposal
from prf.kernels.slots import list_slot, unlist_slot

NEW_EDGE = -2
"""Impact on the new edge k is written NEW_EDGE - k until the edge has a slot."""


@spine
def nearest_new_edge(ray: np.ndarray, proposal: Proposal) -> tuple[int, float]:
    """The new edge that a beam meets first within its reach, as NEW_EDGE - k, or NONE and its reach."""
    ox = ray[c.ORIGIN_X]
    oy = ray[c.ORIGIN_Y]
    ux = ray[c.DIRECTION_X]
    uy = ray[c.DIRECTION_Y]
    best = ray[c.REACH]
    best_edge = c.NONE
    for k in range(proposal.counts[N_NEW_EDGES]):
        xy = proposal.new_xy[k]
        t = ray_hit(ox, oy, ux, uy, xy[0], xy[1], xy[2], xy[3])
        if t < best:
            best = t
            best_edge = NEW_EDGE - k
    return best_edge, best


@spine
def enter_touched(beams: Beams, n: int, beam: int, edge: int, distance: float) -> float:
    """Enter a beam with its new impact as the n-th touched one; return the change of its log likelihood."""
    ray = beams.ray[beam]
    new = beam_log_likelihood(beams.model, ray[c.RANGE], distance)
    beams.mark[beam] = n
    beams.touched[n] = beam
    beams.touched_edge[n] = edge
    beams.touched_distance[n] = distance
    beams.touched_log_likelihood[n] = new
    return new - ray[c.BEAM_LOG_LIKELIHOOD]


@spine
def is_touched(beams: Beams, beam: int, n: int) -> bool:
    """Whether a beam is one of the first `n` touched."""
    place = beams.mark[beam]
    return place < n and beams.touched[place] == beam


@spine
def freed_impact(graph: Graph, index: EdgeIndex, beams: Beams, proposal: Proposal, beam: int) -> tuple[int, float]:
    """New impact of a beam that ends on an edge that goes: edge (NONE: none) and distance."""
    edge, distance = nearest_new_edge(beams.ray[beam], proposal)
    if distance > beams.ray[beam, c.DISTANCE]:
        gone = proposal.old_edges
        last = beams.last_slot[beam]
        old, nearer = first_hit(graph, index, beams, beam, last, distance, gone, proposal.counts[N_OLD_EDGES])
        if old != c.NONE:
            return old, nearer
    return edge, distance if edge != c.NONE else beams.beyond[beam]


@spine
def touch_freed_beams(
    graph: Graph, index: EdgeIndex, beams: Beams, proposal: Proposal, level: int, needed: float, spare: float
) -> tuple[float, float]:
    """Touch every beam of a level that ends on an edge that goes; return the change and what others can still gain.

    It stops where the sum of both falls below `needed`.
    """
    n = beams.n_touched[0]
    change = 0.0
    for k in range(proposal.counts[N_OLD_EDGES]):
        beam = beams.first_beam[proposal.old_edges[k], level]
        while beam != c.NONE:
            spare -= gap(beams, beam)
            edge, distance = freed_impact(graph, index, beams, proposal, beam)
            change += enter_touched(beams, n, beam, edge, distance)
            n += 1
            if change + spare < needed:
                return change, spare
            beam = beams.next_beam[beam]
    beams.n_touched[0] = n
    return change, spare


@spine
def touch_in_cell(beams: Beams, proposal: Proposal, k: int, cell: int, least: float) -> float:
    """Touch the beams listed in a cell that the new edge k cuts before their impact; return the change.

    It stops where the change falls below `least`: no other beam can then save the proposal.
    """
    xy = proposal.new_xy[k]
    ax = xy[0]
    ay = xy[1]
    bx = xy[2]
    by = xy[3]
    n = beams.n_touched[0]
    change = 0.0
    start = beams.cell_start[cell]
    for at in range(start, start + beams.cell_count[cell]):
        beam = beams.entries[at, 0]
        ray = beams.ray[beam]
        t = ray_hit(ray[c.ORIGIN_X], ray[c.ORIGIN_Y], ray[c.DIRECTION_X], ray[c.DIRECTION_Y], ax, ay, bx, by)
        if t < ray[c.DISTANCE] and t < ray[c.REACH] and not is_touched(beams, beam, n):
            edge, distance = nearest_new_edge(ray, proposal)
            change += enter_touched(beams, n, beam, edge, distance)
            n += 1
            if change < least:
                break
    beams.n_touched[0] = n
    return change


@spine
def touch_beams(
    graph: Graph, index: EdgeIndex, beams: Beams, proposal: Proposal, level: int, needed: float
) -> tuple[bool, float]:
    """List the touched beams of a level with their new impacts; return whether their change may exceed `needed`.

    The second value is the change of their log likelihood; if the first is False, it is that of a part of them, and
    the list is not complete. With ``needed = -inf`` all are asked. Level 0 begins the list, the others go on with it.
    """
    if level == 0:
        beams.n_touched[0] = 0
    before = level * index.cell_count.shape[0]
    spare = most_freed(beams, proposal, level) + most_cut(beams, proposal, before)
    if spare < needed:
        return False, 0.0
    change, spare = touch_freed_beams(graph, index, beams, proposal, level, needed, spare)
    if change + spare < needed:
        return False, change
    for k in range(proposal.counts[N_NEW_EDGES]):
        for i in range(proposal.n_cells[k]):
            cell = before + proposal.cells[k, i]
            change += touch_in_cell(beams, proposal, k, cell, needed - change - spare)
            if change + spare < needed:
                return False, change
            spare -= beams.cell_gap[cell]
    return True, change


@spine
def release_touched(beams: Beams) -> None:
    """Take the touched beams out of the lists of their old impacts, before edge slots change hands."""
    for i in range(beams.n_touched[0]):
        unlink_beam(beams, beams.touched[i])


@spine
def apply_touched(beams: Beams, proposal: Proposal) -> None:
    """Move the touched beams to their new impacts once the new edges have slots."""
    for i in range(beams.n_touched[0]):
        beam = beams.touched[i]
        edge = beams.touched_edge[i]
        if edge <= NEW_EDGE:
            edge = proposal.new_slot[NEW_EDGE - edge]
        ray = beams.ray[beam]
        shift_cells(beams, beam, ray[c.BEAM_LOG_LIKELIHOOD] - beams.touched_log_likelihood[i])
        ray[c.DISTANCE] = beams.touched_distance[i]
        ray[c.BEAM_LOG_LIKELIHOOD] = beams.touched_log_likelihood[i]
        link_beam(beams, beam, edge)
        old = beams.last_slot[beam]
        new = slot_at(beams, beam, beams.touched_distance[i], old)
        for slot in range(old + 1, new + 1):
            list_slot(beams, beam, slot)
        for slot in range(new + 1, old + 1):
            unlist_slot(beams, slot)
        beams.last_slot[beam] = new
