"""Change of the sonar's log likelihood by a proposal: the cones that it touches, and their new features."""

from prf.kernels._jit import Array, core
from prf.kernels.readings.cones import CONE_LOG_LIKELIHOOD, EXTENT, Cones, last_within, sense
from prf.kernels.readings.sonar_features import clip_edge
from prf.kernels.state.edge_index import EdgeIndex
from prf.kernels.state.graph import Graph
from prf.kernels.state.grid import walk
from prf.kernels.state.proposal import N_NEW_EDGES, N_OLD_EDGES, Proposal
from prf.kernels.state.slots import list_up_to


@core
def touch_in_cell(cones: Cones, cell: int, xy: Array) -> None:
    """List the cones of a cell that the edge `xy` (4,) enters within their extent."""
    start = cones.cell_start[cell]
    for place in range(start, start + cones.cell_count[cell]):
        cone = cones.entries[place, 0]
        if cones.mark[cone] == cones.proposals[0]:
            continue
        pose = cones.pose[cone]
        low, high = clip_edge(pose, pose[EXTENT], xy, cones.sight.line[0])
        if low < high:
            cones.mark[cone] = cones.proposals[0]
            cones.touched[cones.n_touched[0]] = cone
            cones.n_touched[0] += 1


@core
def touch_cones(graph: Graph, index: EdgeIndex, cones: Cones, proposal: Proposal) -> None:
    """List the touched cones: those that see a removed edge, or whose view a new edge enters."""
    cones.n_touched[0] = 0
    cones.proposals[0] += 1
    for k in range(proposal.counts[N_OLD_EDGES]):
        xy = graph.edge_xy[proposal.old_edges[k]]
        n = walk(index.grid, xy[0], xy[1], xy[2], xy[3], index.path)
        for i in range(n):
            touch_in_cell(cones, index.path[i], xy)
    for k in range(proposal.counts[N_NEW_EDGES]):
        for i in range(proposal.n_cells[k]):
            touch_in_cell(cones, proposal.cells[k, i], proposal.new_xy[k])


@core
def sonar_change(graph: Graph, index: EdgeIndex, cones: Cones, proposal: Proposal) -> float:
    """Change of the log likelihood over the touched cones."""
    change = 0.0
    for i in range(cones.n_touched[0]):
        cone = cones.touched[i]
        extent, log_likelihood = sense(graph, index, cones, cone, proposal, True)
        cones.touched_extent[i] = extent
        cones.touched_log_likelihood[i] = log_likelihood
        change += log_likelihood - cones.pose[cone, CONE_LOG_LIKELIHOOD]
    return change


@core
def apply_cones(cones: Cones) -> None:
    """Make the new extents and likelihoods of the touched cones the present ones."""
    for i in range(cones.n_touched[0]):
        cone = cones.touched[i]
        cones.pose[cone, EXTENT] = cones.touched_extent[i]
        cones.pose[cone, CONE_LOG_LIKELIHOOD] = cones.touched_log_likelihood[i]
        list_up_to(cones, cone, last_within(cones, cone, cones.touched_extent[i], cones.last_slot[cone]))
