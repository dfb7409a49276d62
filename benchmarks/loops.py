"""Compiled loops to compare with the sampler's own: stopped after a stage, from scratch, with whole beams listed.

They are made of the sampler's kernels, which have no entry from Python. They are compiled anew in each process: their
machine code would go stale with an edit of a kernel, and nobody waits for them but a benchmark.
"""

import math
from typing import Any

import numba
import numpy as np

from prf.kernels import constants as c
from prf.kernels.accept import accept, log_proposal_ratio
from prf.kernels.readings.beams import Beams, first_hit, link_beam, shift_cells, slot_at
from prf.kernels.readings.laser import beam_log_likelihood
from prf.kernels.readings.laser_change import (
    NEW_EDGE,
    most_cut,
    most_freed,
    nearest_new_edge,
    release_touched,
    touch_beams,
    touch_freed_beams,
)
from prf.kernels.state.chain import Chain, apply_edges, refresh_vertices
from prf.kernels.state.crossing import is_valid
from prf.kernels.state.geometry import inside_loop
from prf.kernels.state.prior import log_prior_change
from prf.kernels.state.proposal import N_LOOP, N_OLD_EDGES
from prf.kernels.state.sites import any_inside
from prf.kernels.state.slots import list_slot
from prf.kernels.step import choose_move, propose, step

FLAGS: dict[str, Any] = {"nogil": True, "error_model": "numpy", "_nrt": False, "cache": False}
bench = numba.njit(**FLAGS)

# Stages of a step, in their order.
PROPOSE = 0
CROSSING = 1
PRIOR = 2
SENSORS = 3
FREED = 4  # beams that end on an edge that goes, with their likelihood
CUT = 5  # beams that a new edge cuts, with theirs


@bench
def run_to_stage(chain: Chain, rng: np.random.Generator, n: int, stage: int) -> float:
    """Make `n` proposals to the map as it stands, each followed up to `stage` and never applied.

    The generator is used alike for every stage: the same seed gives the same proposals.
    """
    graph, proposal = chain.graph, chain.proposal
    total = 0.0
    for _ in range(n):
        move = choose_move(chain.move_probabilities, rng)
        chain.outcomes[move, c.PROPOSED] += 1
        legal, log_forward, log_reverse = propose(chain, move, rng)
        if not legal:
            continue
        ratio = log_proposal_ratio(chain.move_probabilities, move, log_forward, log_reverse)
        needed = math.log(1.0 - rng.random())
        total += needed
        if stage == PROPOSE or not is_valid(graph, chain.edge_index, proposal):
            continue
        chain.outcomes[move, c.VALID] += 1
        if stage == CROSSING:
            continue
        if ratio == -math.inf:
            continue
        needed -= ratio
        needed -= log_prior_change(graph, proposal, chain.density[c.SCALE], chain.lines)
        if stage == PRIOR or any_inside(chain.sensors, proposal.loop, proposal.counts[N_LOOP]):
            continue
        if stage == SENSORS:
            continue
        if stage == FREED:
            chain.beams.n_touched[0] = 0
            spare = most_freed(chain.beams, proposal, 0) + most_cut(chain.beams, proposal, 0)
            if spare >= needed:
                total += touch_freed_beams(graph, chain.edge_index, chain.beams, proposal, 0, needed, spare)[0]
            continue
        total += touch_beams(graph, chain.edge_index, chain.beams, proposal, 0, needed)[1]
    return total


@bench
def apply_map(chain: Chain, prior: float, likelihood: float) -> None:
    """Apply a proposal to the map alone: the reference keeps nothing about beams."""
    graph, proposal = chain.graph, chain.proposal
    apply_edges(graph, chain.edge_index, proposal)
    refresh_vertices(graph, proposal)
    window = graph.window
    x, y = 0.5 * (window[0] + window[2]), 0.5 * (window[1] + window[3])
    if inside_loop(x, y, proposal.loop, proposal.counts[N_LOOP]):
        graph.counts[c.ANCHOR_BLACK] = 1 - graph.counts[c.ANCHOR_BLACK]
    graph.sums[c.LOG_PRIOR] += prior
    graph.sums[c.LOG_LIKELIHOOD] += likelihood


@bench
def log_likelihood_from_scratch(chain: Chain) -> float:
    """Log likelihood of the proposed map: every beam walks the edge index from its origin to its first obstacle."""
    beams, proposal = chain.beams, chain.proposal
    n_old = proposal.counts[N_OLD_EDGES]
    total = 0.0
    for beam in range(beams.ray.shape[0]):
        edge, distance = nearest_new_edge(beams.ray[beam], proposal)
        start = beams.slot_start[beam]
        old, nearer = first_hit(chain.graph, chain.edge_index, beams, beam, start, distance, proposal.old_edges, n_old)
        if old != c.NONE:
            distance = nearer
        elif edge == c.NONE:
            distance = math.inf
        total += beam_log_likelihood(beams.model, beams.weight[beam], beams.ray[beam, c.RANGE], distance)
    return total


@bench
def step_from_scratch(chain: Chain, rng: np.random.Generator) -> None:
    """One step as the sampler's, but the likelihood of each valid proposal recomputed from all beams."""
    graph, proposal = chain.graph, chain.proposal
    graph.counts[c.STEP] += 1
    move = choose_move(chain.move_probabilities, rng)
    chain.outcomes[move, c.PROPOSED] += 1
    legal, log_forward, log_reverse = propose(chain, move, rng)
    if not legal:
        return
    log_u = math.log(1.0 - rng.random())
    if not is_valid(graph, chain.edge_index, proposal):
        return
    chain.outcomes[move, c.VALID] += 1
    ratio = log_proposal_ratio(chain.move_probabilities, move, log_forward, log_reverse)
    if ratio == -math.inf:
        return
    prior = log_prior_change(graph, proposal, chain.density[c.SCALE], chain.lines)
    if any_inside(chain.sensors, proposal.loop, proposal.counts[N_LOOP]):
        return
    likelihood = log_likelihood_from_scratch(chain) - graph.sums[c.LOG_LIKELIHOOD]
    if log_u < prior + likelihood + ratio:
        apply_map(chain, prior, likelihood)
        chain.outcomes[move, c.ACCEPTED] += 1


@bench
def run_from_scratch(chain: Chain, rng: np.random.Generator, until: int) -> bool:
    """As the sampler's own ``run``, from scratch."""
    while chain.graph.counts[c.STEP] < until:
        if chain.graph.counts[c.NEEDS_ROOM] != 0:
            return False
        step_from_scratch(chain, rng)
    return True


@bench
def list_whole_beams(beams: Beams) -> int:
    """Make the index of beams static: list every slot up to the beam's reach; return how many were listed before."""
    before = 0
    for cell in range(beams.cell_count.size):
        before += beams.cell_count[cell]
        beams.cell_count[cell] = 0
    for beam in range(beams.ray.shape[0]):
        for slot in range(beams.slot_start[beam], beams.slot_start[beam + 1]):
            list_slot(beams, beam, slot)
    return before


@bench
def move_touched(chain: Chain) -> None:
    """Move the touched beams to their new impacts; the static index of beams stays as it is."""
    beams = chain.beams
    for i in range(beams.n_touched[0]):
        beam = beams.touched[i]
        edge = beams.touched_edge[i]
        if edge <= NEW_EDGE:
            edge = chain.proposal.new_slot[NEW_EDGE - edge]
        shift_cells(beams, beam, beams.ray[beam, c.BEAM_LOG_LIKELIHOOD] - beams.touched_log_likelihood[i])
        beams.ray[beam, c.DISTANCE] = beams.touched_distance[i]
        beams.ray[beam, c.BEAM_LOG_LIKELIHOOD] = beams.touched_log_likelihood[i]
        link_beam(beams, beam, edge)
        beams.last_slot[beam] = slot_at(beams, beam, beams.touched_distance[i], beams.last_slot[beam])


@bench
def run_static(chain: Chain, rng: np.random.Generator, until: int) -> bool:
    """As the sampler's own ``run``, on a chain whose index lists whole beams."""
    graph = chain.graph
    while graph.counts[c.STEP] < until:
        if graph.counts[c.NEEDS_ROOM] != 0:
            return False
        graph.counts[c.STEP] += 1
        move = choose_move(chain.move_probabilities, rng)
        chain.outcomes[move, c.PROPOSED] += 1
        legal, log_forward, log_reverse = propose(chain, move, rng)
        if not legal:
            continue
        log_u = math.log(1.0 - rng.random())
        if not is_valid(graph, chain.edge_index, chain.proposal):
            continue
        chain.outcomes[move, c.VALID] += 1
        accepted, prior, likelihood = accept(chain, move, log_forward, log_reverse, log_u, rng)
        if accepted:
            release_touched(chain.beams)
            apply_map(chain, prior, likelihood)
            move_touched(chain)
            chain.outcomes[move, c.ACCEPTED] += 1
    return True


@bench
def count_touching(chain: Chain, rng: np.random.Generator, n: int, counts: np.ndarray) -> None:
    """Add to `counts` (2,) how many of `n` steps are accepted, and how many of these change the impact of a beam."""
    for _ in range(n):
        if chain.graph.counts[c.NEEDS_ROOM] != 0:
            return
        if step(chain, rng):
            counts[0] += 1
            if chain.beams.n_touched[0] > 0:
                counts[1] += 1


@bench
def next_touching(chain: Chain, rng: np.random.Generator) -> float:
    """Propose until a proposal is valid and leaves the sensors in white; return its change of log likelihood."""
    proposal = chain.proposal
    while True:
        legal, _, _ = propose(chain, choose_move(chain.move_probabilities, rng), rng)
        if not legal or not is_valid(chain.graph, chain.edge_index, proposal):
            continue
        if any_inside(chain.sensors, proposal.loop, proposal.counts[N_LOOP]):
            continue
        return touch_beams(chain.graph, chain.edge_index, chain.beams, proposal, 0, -math.inf)[1]


@bench
def change_from_scratch(chain: Chain) -> float:
    """Change of log likelihood by the present proposal as the difference of two sums over all beams."""
    after = log_likelihood_from_scratch(chain)
    before = 0.0
    for beam in range(chain.beams.ray.shape[0]):
        before += chain.beams.ray[beam, c.BEAM_LOG_LIKELIHOOD]
    return after - before
