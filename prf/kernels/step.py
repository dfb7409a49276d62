"""One Metropolis-Hastings step, and runs of many."""

import math

from prf.kernels import constants as c
from prf.kernels._jit import Array, Rng, core, loop, spine
from prf.kernels.accept import accept
from prf.kernels.moves import (
    boundary_triangle,
    corner_cut,
    cut_wall,
    dock,
    interior_triangle,
    join_wall,
    move_vertex,
    notch,
    recolor,
    split_edge,
    square,
)
from prf.kernels.state.chain import Chain, apply
from prf.kernels.state.crossing import is_valid
from prf.kernels.state.frozen import leaves_region
from prf.kernels.state.proposal import Densities, clear


@core
def choose_move(move_probabilities: Array, rng: Rng) -> int:
    """Move drawn with these probabilities."""
    u = rng.random()
    for move in range(c.N_MOVES - 1):
        u -= move_probabilities[move]
        if u < 0.0:
            return move
    return c.N_MOVES - 1


@spine
def propose(chain: Chain, move: int, rng: Rng) -> Densities:
    """Fill the proposal; return whether it is legal, log_forward and log_reverse (see ``moves``)."""
    graph, index, targets = chain.graph, chain.edge_index, chain.targets
    proposal, tuning, lines = chain.proposal, chain.tuning, chain.lines
    clear(proposal)
    if move == c.TRIANGLE_BIRTH:
        return interior_triangle.propose_birth(graph, targets, proposal, tuning, rng)
    if move == c.TRIANGLE_DEATH:
        return interior_triangle.propose_death(graph, targets, proposal, tuning, rng)
    if move == c.BOUNDARY_BIRTH:
        return boundary_triangle.propose_birth(graph, proposal, tuning, rng)
    if move == c.BOUNDARY_DEATH:
        return boundary_triangle.propose_death(graph, proposal, tuning, rng)
    if move == c.CORNER_BIRTH:
        return corner_cut.propose_birth(graph, proposal, tuning, rng)
    if move == c.CORNER_DEATH:
        return corner_cut.propose_death(graph, proposal, tuning, rng)
    if move == c.SPLIT:
        return split_edge.propose_split(graph, proposal, tuning, lines, rng)
    if move == c.MERGE:
        return split_edge.propose_merge(graph, proposal, tuning, lines, rng)
    if move == c.RECOLOR:
        return recolor.propose_global(graph, proposal, rng)
    if move == c.LOCAL_RECOLOR:
        return recolor.propose_local(graph, index, proposal, rng)
    if move == c.CUT_WALL:
        return cut_wall.propose_cut(graph, index, proposal, tuning, rng)
    if move == c.MEND_WALL:
        return cut_wall.propose_mend(graph, index, proposal, tuning, rng)
    if move == c.JOIN_WALL:
        return join_wall.propose_join(graph, index, proposal, tuning, rng)
    if move == c.PART_WALL:
        return join_wall.propose_part(graph, index, proposal, tuning, rng)
    if move == c.DOCK:
        return dock.propose_dock(graph, proposal, tuning, rng)
    if move == c.UNDOCK:
        return dock.propose_undock(graph, proposal, tuning, rng)
    if move == c.NOTCH:
        return notch.propose_notch(graph, index, targets, proposal, tuning, rng)
    if move == c.FILL:
        return notch.propose_fill(graph, index, targets, proposal, tuning, rng)
    if move == c.BEND:
        return split_edge.propose_bend(graph, index, targets, proposal, tuning, rng)
    if move == c.UNBEND:
        return split_edge.propose_unbend(graph, index, targets, proposal, tuning, rng)
    if move == c.BOX_BIRTH:
        return square.propose_birth(graph, targets, proposal, tuning, lines, rng)
    if move == c.BOX_DEATH:
        return square.propose_death(graph, targets, proposal, tuning, lines, rng)
    return move_vertex.propose_vertex_move(graph, proposal, tuning, lines, move, rng)


@spine
def step(chain: Chain, rng: Rng) -> bool:
    """One step: pick a move, propose, accept or reject, apply. An illegal proposal counts as a rejected step."""
    graph, proposal, outcomes = chain.graph, chain.proposal, chain.outcomes
    graph.counts[c.STEP] += 1
    move = choose_move(chain.move_probabilities, rng)
    outcomes[move, c.PROPOSED] += 1
    legal, log_forward, log_reverse = propose(chain, move, rng)
    if not legal:
        return False
    log_u = math.log(1.0 - rng.random())
    if not is_valid(graph, chain.edge_index, proposal):
        return False
    if chain.tuning[c.REGION_TARGET] != c.NONE and leaves_region(graph, proposal, chain.tuning):
        return False
    outcomes[move, c.VALID] += 1
    accepted, prior, likelihood = accept(chain, move, log_forward, log_reverse, log_u, rng)
    if accepted:
        apply(chain, prior, likelihood)
        outcomes[move, c.ACCEPTED] += 1
    return accepted


@core
def run_steps(chain: Chain, rng: Rng, until: int) -> bool:
    """The loop of :func:`run`, without reference counts."""
    counts = chain.graph.counts
    while counts[c.STEP] < until:
        if counts[c.NEEDS_ROOM] != 0:
            return False
        step(chain, rng)
    return True


@loop
def run(chain: Chain, rng: Rng, until: int) -> bool:
    """Step until the step counter reaches `until`; False if the chain needs room first (``prf.model.layout``)."""
    return run_steps(chain, rng, until)
