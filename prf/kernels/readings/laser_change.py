"""Change of the laser's log likelihood by a proposal: the beams that it touches, and their new impacts.

Only beams whose impact lies on a removed edge, and beams that a new edge cuts before their impact, change. For the
second kind the new impact is on the new edge. For the first it is the nearest of the new edges, or else the beam walks
on from its old impact: nothing was before it.

Most proposals lose so much at the first few beams that the others cannot make up for it. The caller gives what the
change must exceed for the proposal to be accepted; after every beam this is compared with the change so far and the
most that the other beams can gain. The decision is the same as after all beams. The shortfall of a beam is what its log
likelihood lacks to the highest that any distance gives. Summed over the beams that end on an edge it is the most that
they gain when the edge is removed. A beam that is cut gains only where the cut lies about its reading; elsewhere an
obstacle explains the reading no better than none. Hence shortfalls are summed as well over the cells in which the
reading of a beam lies.

The change is `touch_beams`; `apply_touched` keeps it, `release_touched` takes it back.

Beams come in levels, so that a proposal which few beams reject is never computed for the many (delayed acceptance).
"""

from prf.kernels import constants as c
from prf.kernels._jit import Array, core, spine
from prf.kernels.readings.beams import Beams, first_hit, link_beam, shift_cells, shortfall, slot_at, unlink_beam
from prf.kernels.readings.laser import beam_log_likelihood
from prf.kernels.state.edge_index import EdgeIndex
from prf.kernels.state.geometry import ray_hit
from prf.kernels.state.graph import Graph
from prf.kernels.state.proposal import N_NEW_EDGES, N_OLD_EDGES, Proposal
from prf.kernels.state.slots import list_up_to

NEW_EDGE = -2
"""Impact on the new edge k is written NEW_EDGE - k until the edge has a slot."""
FADED = 1e-6
"""Nats: the most that a beam gains where it is cut off its reading."""
ROUNDING = 1e-6
"""Nats: more than the rounding of all sums here between two times that they are made anew."""


@core
def most_freed(beams: Beams, proposal: Proposal, level: int) -> float:
    """The most that the beams of a level on removed edges can gain, nats."""
    most = ROUNDING
    for k in range(proposal.counts[N_OLD_EDGES]):
        most += beams.edge_shortfall[proposal.old_edges[k], level]
    return most


@core
def most_cut(beams: Beams, proposal: Proposal, before: int) -> float:
    """The most that the beams cut by new edges can gain, nats; `before`: lists of the levels before theirs."""
    most = 0.0
    for k in range(proposal.counts[N_NEW_EDGES]):
        for i in range(proposal.n_cells[k]):
            cell = before + proposal.cells[k, i]
            most += beams.cell_shortfall[cell] + FADED * beams.cell_count[cell]
    return most


@spine
def nearest_new_edge(ray: Array, proposal: Proposal) -> tuple[int, float]:
    """The new edge that a beam meets first within its reach, as NEW_EDGE - k, or NONE and its reach."""
    best = ray[c.MAX_DISTANCE]
    best_edge = c.NONE
    for k in range(proposal.counts[N_NEW_EDGES]):
        t = ray_hit(ray, proposal.new_xy[k])
        if t < best:
            best = t
            best_edge = NEW_EDGE - k
    return best_edge, best


@spine
def enter_touched(beams: Beams, n: int, beam: int, edge: int, distance: float) -> float:
    """Enter a beam with its new impact as the n-th touched one; return the change of its log likelihood."""
    ray = beams.ray[beam]
    new = beam_log_likelihood(beams.model, beams.weight[beam], ray[c.RANGE], distance)
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
    """New impact of a beam that ends on a removed edge: edge (NONE: none) and distance."""
    edge, distance = nearest_new_edge(beams.ray[beam], proposal)
    if distance > beams.ray[beam, c.DISTANCE]:
        last = beams.last_slot[beam]
        old, nearer = first_hit(
            graph, index, beams, beam, last, distance, proposal.old_edges, proposal.counts[N_OLD_EDGES]
        )
        if old != c.NONE:
            return old, nearer
    return edge, distance if edge != c.NONE else beams.beyond[beam]


@spine
def touch_freed_beams(
    graph: Graph, index: EdgeIndex, beams: Beams, proposal: Proposal, level: int, needed: float, spare: float
) -> tuple[float, float]:
    """Touch every beam of a level that ends on a removed edge; return the change and what others can still gain.

    It stops where the sum of both falls below `needed`.
    """
    n = beams.n_touched[0]
    change = 0.0
    for k in range(proposal.counts[N_OLD_EDGES]):
        beam = beams.first_beam[proposal.old_edges[k], level]
        while beam != c.NONE:
            spare -= shortfall(beams, beam)
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
    n = beams.n_touched[0]
    change = 0.0
    start = beams.cell_start[cell]
    for at in range(start, start + beams.cell_count[cell]):
        beam = beams.entries[at, 0]
        ray = beams.ray[beam]
        t = ray_hit(ray, xy)
        if t < ray[c.DISTANCE] and t < ray[c.MAX_DISTANCE] and not is_touched(beams, beam, n):
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
    the list is not complete. With ``needed = -inf`` all are computed. Level 0 begins the list, the others continue it.
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
            spare -= beams.cell_shortfall[cell]
    return True, change


@spine
def release_touched(beams: Beams) -> None:
    """Take the touched beams out of the lists of their old impacts, before edge slots are reused."""
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
        list_up_to(beams, beam, slot_at(beams, beam, beams.touched_distance[i], beams.last_slot[beam]))
