"""The state of one chain, and how an accepted proposal becomes part of it."""

import math
from typing import NamedTuple

from prf.kernels import constants as c
from prf.kernels._jit import Array, spine
from prf.kernels.readings.beams import Beams
from prf.kernels.readings.cones import Cones
from prf.kernels.readings.laser_change import apply_touched, release_touched
from prf.kernels.readings.points import Points, gain_inside
from prf.kernels.readings.sonar_change import apply_cones
from prf.kernels.state.edge_index import EdgeIndex, index_edge, unindex_edge
from prf.kernels.state.geometry import inside_loop
from prf.kernels.state.graph import (
    Graph,
    classify_vertex,
    delete_edge,
    delete_vertex,
    insert_edge,
    insert_vertex,
    other_end,
)
from prf.kernels.state.guards import Guards, blocked_change
from prf.kernels.state.image import Image, count_edge, recolor_inside
from prf.kernels.state.proposal import (
    N_AFFECTED,
    N_LOOP,
    N_NEW_EDGES,
    N_NEW_VERTICES,
    N_OLD_EDGES,
    N_OLD_VERTICES,
    Proposal,
)
from prf.kernels.state.sites import Sites, occupied_change
from prf.kernels.state.targets import Targets


class Chain(NamedTuple):
    """Everything that one chain reads and writes."""

    graph: Graph
    edge_index: EdgeIndex
    beams: Beams
    cones: Cones
    points: Points
    sensors: Sites
    targets: Targets
    image: Image
    guards: Guards
    proposal: Proposal
    density: Array  # (N_DENSITY,) f8 what is sampled: scale of the prior, powers, costs
    lines: Array  # (N_LINES,) f8 the directions that edges prefer
    tuning: Array  # (N_TUNING,) f8 scales of the proposals
    move_probabilities: Array  # (N_MOVES,) f8
    outcomes: Array  # (N_MOVES, N_OUTCOMES) i8


@spine
def apply_edges(graph: Graph, index: EdgeIndex, proposal: Proposal) -> None:
    """Remove and add edges and vertices, in the graph and in the edge index."""
    for k in range(proposal.counts[N_OLD_EDGES]):
        edge = proposal.old_edges[k]
        unindex_edge(index, edge, graph.edge_xy[edge])
        delete_edge(graph, edge)
        graph.sums[c.TOTAL_LENGTH] -= graph.edge_length[edge]
    graph.counts[c.FREE_VERTICES] -= proposal.counts[N_NEW_VERTICES]
    for k in range(proposal.counts[N_NEW_VERTICES]):
        insert_vertex(graph, proposal.new_vertices[k])
    for k in range(proposal.counts[N_OLD_VERTICES]):
        delete_vertex(graph, proposal.old_vertices[k])
    for k in range(proposal.counts[N_NEW_EDGES]):
        length = proposal.new_length[k]
        edge = insert_edge(graph, proposal.new_edges[k, 0], proposal.new_edges[k, 1], length)
        proposal.new_slot[k] = edge
        graph.sums[c.TOTAL_LENGTH] += length
        if index_edge(index, edge, graph.edge_xy[edge]):
            graph.counts[c.NEEDS_ROOM] = 1
    if min(graph.counts[c.FREE_EDGES], graph.counts[c.FREE_VERTICES]) < c.MOST_CHANGES:
        graph.counts[c.NEEDS_ROOM] = 1


@spine
def refresh_vertices(graph: Graph, proposal: Proposal) -> None:
    """Store the new angles, and bring the sets of triangles up to date round the change."""
    for k in range(proposal.counts[N_AFFECTED]):
        v = proposal.affected[k]
        graph.vertex_sine[v] = proposal.affected_sine[k]
        classify_vertex(graph, v)
        for side in range(2):
            edge = graph.vertex_edges[v, side]
            if edge != c.NONE:
                classify_vertex(graph, other_end(graph, edge, v))


@spine
def update_image(chain: Chain, step: int) -> None:
    """Update the image by the edges removed and added and by the recoloured loop, before slots are reused."""
    proposal = chain.proposal
    for k in range(proposal.counts[N_OLD_EDGES]):
        count_edge(chain.image, chain.graph.edge_xy[proposal.old_edges[k]], -1, step)
    for k in range(proposal.counts[N_NEW_EDGES]):
        count_edge(chain.image, proposal.new_xy[k], 1, step)
    recolor_inside(chain.image, proposal.loop, proposal.counts[N_LOOP], step)


@spine
def apply(chain: Chain, log_prior_change: float, log_likelihood_change: float) -> None:
    """Make an accepted proposal the state of the chain."""
    graph = chain.graph
    proposal = chain.proposal
    if chain.image.black.size > 0:
        update_image(chain, graph.counts[c.STEP])
    if chain.density[c.OCCUPIED_COST] != math.inf:
        graph.counts[c.OCCUPIED] += occupied_change(chain.sensors, proposal.loop, proposal.counts[N_LOOP], True)
        graph.counts[c.OCCUPIED] += blocked_change(graph, chain.edge_index, chain.guards, proposal)
    release_touched(chain.beams)
    apply_edges(graph, chain.edge_index, proposal)
    refresh_vertices(graph, proposal)
    apply_touched(chain.beams, proposal)
    apply_cones(chain.cones)
    if chain.points.column.shape[1] > 0:
        gain_inside(chain.points, proposal.loop, proposal.counts[N_LOOP], chain.image.crossings, True)
    window = graph.window
    if inside_loop(
        0.5 * (window[0] + window[2]), 0.5 * (window[1] + window[3]), proposal.loop, proposal.counts[N_LOOP]
    ):
        graph.counts[c.ANCHOR_BLACK] = 1 - graph.counts[c.ANCHOR_BLACK]
    graph.sums[c.LOG_PRIOR] += log_prior_change
    graph.sums[c.LOG_LIKELIHOOD] += log_likelihood_change
