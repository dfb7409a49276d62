"""Which beams a proposal touches, and what becomes of their impacts and likelihoods.

Only beams whose impact lies on an edge that goes, and beams that a new edge cuts before their impact, change. For
the second kind the new impact is on the new edge. For the first it is the nearest of the new edges, or else the
beam walks on from its old impact: nothing stood before it.
"""

from prf.kernels import constants as c
from prf.kernels._jit import core
from prf.kernels.beams import Beams, first_hit, link_beam, slot_at, unlink_beam
from prf.kernels.edge_index import EdgeIndex
from prf.kernels.geometry import ray_hit
from prf.kernels.graph import Graph
from prf.kernels.laser import beam_log_likelihood
from prf.kernels.proposal import N_NEW_EDGES, N_OLD_EDGES, Proposal, goes
from prf.kernels.slots import list_slot, unlist_slot

NEW_EDGE = -2
"""Impact on the new edge k is written NEW_EDGE - k until the edge has a slot."""


@core
def nearest_new_edge(beams: Beams, proposal: Proposal, beam: int) -> tuple[int, float]:
    """The new edge that a beam meets first within its reach, as NEW_EDGE - k, or NONE and its reach."""
    ray = beams.ray[beam]
    best = ray[c.REACH]
    best_edge = c.NONE
    for k in range(proposal.counts[N_NEW_EDGES]):
        xy = proposal.new_xy[k]
        t = ray_hit(
            ray[c.ORIGIN_X], ray[c.ORIGIN_Y], ray[c.DIRECTION_X], ray[c.DIRECTION_Y], xy[0], xy[1], xy[2], xy[3]
        )
        if t < best:
            best = t
            best_edge = NEW_EDGE - k
    return best_edge, best


@core
def touch_freed_beams(graph: Graph, index: EdgeIndex, beams: Beams, proposal: Proposal) -> None:
    """Find the new impact of every beam that ends on an edge that goes."""
    n = 0
    for k in range(proposal.counts[N_OLD_EDGES]):
        beam = beams.first_beam[proposal.old_edges[k]]
        while beam != c.NONE:
            edge, distance = nearest_new_edge(beams, proposal, beam)
            if distance > beams.ray[beam, c.DISTANCE]:
                old_edge, old_distance = first_hit(
                    graph,
                    index,
                    beams,
                    beam,
                    beams.last_slot[beam],
                    distance,
                    proposal.old_edges,
                    proposal.counts[N_OLD_EDGES],
                )
                if old_edge != c.NONE:
                    edge = old_edge
                    distance = old_distance
            beams.touched[n] = beam
            beams.touched_edge[n] = edge
            beams.touched_distance[n] = distance if edge != c.NONE else beams.beyond[beam]
            n += 1
            beam = beams.next_beam[beam]
    beams.n_touched[0] = n


@core
def touch_in_cell(beams: Beams, proposal: Proposal, k: int, cell: int, n_freed: int) -> None:
    """Find the beams listed in one cell that the new edge k cuts before their impact."""
    xy = proposal.new_xy[k]
    n = beams.n_touched[0]
    start = beams.cell_start[cell]
    for at in range(start, start + beams.cell_count[cell]):
        beam = beams.entries[at, 0]
        ray = beams.ray[beam]
        t = ray_hit(
            ray[c.ORIGIN_X], ray[c.ORIGIN_Y], ray[c.DIRECTION_X], ray[c.DIRECTION_Y], xy[0], xy[1], xy[2], xy[3]
        )
        if t < ray[c.DISTANCE] and t < ray[c.REACH]:
            place = beams.mark[beam]
            if n_freed <= place < n and beams.touched[place] == beam:
                if t < beams.touched_distance[place]:
                    beams.touched_distance[place] = t
                    beams.touched_edge[place] = NEW_EDGE - k
            elif not goes(proposal, beams.impact_edge[beam]):
                beams.mark[beam] = n
                beams.touched[n] = beam
                beams.touched_edge[n] = NEW_EDGE - k
                beams.touched_distance[n] = t
                n += 1
    beams.n_touched[0] = n


@core
def touch_beams(graph: Graph, index: EdgeIndex, beams: Beams, proposal: Proposal) -> None:
    """List the touched beams with their new impacts."""
    touch_freed_beams(graph, index, beams, proposal)
    n_freed = beams.n_touched[0]
    for k in range(proposal.counts[N_NEW_EDGES]):
        for i in range(proposal.n_cells[k]):
            touch_in_cell(beams, proposal, k, proposal.cells[k, i], n_freed)


@core
def log_likelihood_change(beams: Beams) -> float:
    """Change of the log likelihood over the touched beams."""
    change = 0.0
    for i in range(beams.n_touched[0]):
        ray = beams.ray[beams.touched[i]]
        new = beam_log_likelihood(beams.model, ray[c.RANGE], beams.touched_distance[i])
        beams.touched_log_likelihood[i] = new
        change += new - ray[c.BEAM_LOG_LIKELIHOOD]
    return change


@core
def release_touched(beams: Beams) -> None:
    """Take the touched beams out of the lists of their old impacts, before edge slots change hands."""
    for i in range(beams.n_touched[0]):
        unlink_beam(beams, beams.touched[i])


@core
def apply_touched(beams: Beams, proposal: Proposal) -> None:
    """Move the touched beams to their new impacts once the new edges have slots."""
    for i in range(beams.n_touched[0]):
        beam = beams.touched[i]
        edge = beams.touched_edge[i]
        if edge <= NEW_EDGE:
            edge = proposal.new_slot[NEW_EDGE - edge]
        link_beam(beams, beam, edge)
        beams.ray[beam, c.DISTANCE] = beams.touched_distance[i]
        beams.ray[beam, c.BEAM_LOG_LIKELIHOOD] = beams.touched_log_likelihood[i]
        old = beams.last_slot[beam]
        new = slot_at(beams, beam, beams.touched_distance[i], old)
        for slot in range(old + 1, new + 1):
            list_slot(beams, beam, slot)
        for slot in range(new + 1, old + 1):
            unlist_slot(beams, slot)
        beams.last_slot[beam] = new
