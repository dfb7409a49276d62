"""One Metropolis-Hastings step, and runs of many."""

import math

import numpy as np

from prf.kernels import constants as c
from prf.kernels._jit import core, jit, spine
from prf.kernels.chain import Chain, apply
from prf.kernels.cone_touch import sonar_change, touch_cones
from prf.kernels.crossing import is_valid
from prf.kernels.guards import blocked_change, is_barred
from prf.kernels.moves import (
    bend,
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
)
from prf.kernels.points import gain_inside
from prf.kernels.proposal import N_LOOP, clear, log_prior_change, plain_prior_change
from prf.kernels.region import leaves_region
from prf.kernels.sites import any_inside, occupied_change
from prf.kernels.touch import touch_beams


@core
def choose_move(odds: np.ndarray, rng: np.random.Generator) -> int:
    """Move drawn with probabilities `odds`."""
    u = rng.random()
    for move in range(c.N_MOVES - 1):
        u -= odds[move]
        if u < 0.0:
            return move
    return c.N_MOVES - 1


@spine
def propose(chain: Chain, move: int, rng: np.random.Generator) -> tuple[bool, float]:
    """Fill the proposal; return whether it is legal and the log ratio of proposals (see ``moves``)."""
    graph, proposal, tuning, odds = chain.graph, chain.proposal, chain.tuning, chain.odds
    clear(proposal)
    if move == c.TRIANGLE_BIRTH:
        return interior_triangle.propose_birth(graph, chain.targets, proposal, tuning, odds, rng)
    if move == c.TRIANGLE_DEATH:
        return interior_triangle.propose_death(graph, chain.targets, proposal, tuning, odds, rng)
    if move == c.BOUNDARY_BIRTH:
        return boundary_triangle.propose_birth(graph, proposal, tuning, odds, rng)
    if move == c.BOUNDARY_DEATH:
        return boundary_triangle.propose_death(graph, proposal, tuning, odds, rng)
    if move == c.CORNER_BIRTH:
        return corner_cut.propose_birth(graph, proposal, tuning, odds, rng)
    if move == c.CORNER_DEATH:
        return corner_cut.propose_death(graph, proposal, tuning, odds, rng)
    if move == c.SPLIT:
        return split_edge.propose_split(graph, proposal, tuning, odds, rng)
    if move == c.MERGE:
        return split_edge.propose_merge(graph, proposal, tuning, odds, rng)
    if move == c.CUT_WALL:
        return cut_wall.propose_cut(graph, chain.edge_index, proposal, tuning, odds, rng)
    if move == c.MEND_WALL:
        return cut_wall.propose_mend(graph, chain.edge_index, proposal, tuning, odds, rng)
    if move == c.JOIN_WALL:
        return join_wall.propose_join(graph, chain.edge_index, proposal, tuning, odds, rng)
    if move == c.PART_WALL:
        return join_wall.propose_part(graph, chain.edge_index, proposal, odds, rng)
    if move == c.DOCK:
        return dock.propose_dock(graph, proposal, tuning, odds, rng)
    if move == c.UNDOCK:
        return dock.propose_undock(graph, proposal, tuning, odds, rng)
    if move == c.NOTCH:
        return notch.propose_notch(graph, chain.edge_index, chain.targets, proposal, tuning, odds, rng)
    if move == c.FILL:
        return notch.propose_fill(graph, proposal, odds, rng)
    if move == c.BEND:
        return bend.propose_bend(graph, chain.edge_index, chain.targets, proposal, tuning, odds, rng)
    if move == c.UNBEND:
        return bend.propose_unbend(graph, proposal, odds, rng)
    if move == c.RECOLOR:
        return recolor.propose_global(graph, proposal, rng)
    if move == c.LOCAL_RECOLOR:
        return recolor.propose_local(graph, chain.edge_index, proposal, rng)
    return move_vertex.propose_vertex_move(graph, proposal, tuning, move, rng)


@spine
def log_ratio_of_cells(chain: Chain, move: int) -> float:
    """The part of the log ratio of proposals that needs the cells of the new edges; -inf where no move leads back."""
    graph, index, proposal = chain.graph, chain.edge_index, chain.proposal
    if move == c.LOCAL_RECOLOR:
        return recolor.local_log_ratio(graph, index, proposal)
    if move == c.CUT_WALL:
        return cut_wall.cut_returns(graph, index, proposal, chain.odds)
    if move == c.MEND_WALL:
        return cut_wall.mend_returns(graph, index, proposal, chain.tuning, chain.odds)
    if move == c.JOIN_WALL:
        return join_wall.join_returns(graph, index, proposal, chain.odds)
    if move == c.PART_WALL:
        return join_wall.part_returns(graph, index, proposal, chain.tuning, chain.odds)
    if move == c.FILL:
        return notch.fill_returns(graph, index, chain.targets, proposal, chain.tuning, chain.odds)
    if move == c.UNBEND:
        return bend.unbend_returns(graph, index, chain.targets, proposal, chain.tuning, chain.odds)
    return 0.0


@spine
def needed_gain(chain: Chain, margin: float) -> float:
    """The change of log likelihood that a proposal must exceed to be accepted; inf where none will do.

    `margin` is what the threshold asks beyond prior and proposal ratio. The target is h exp(E) with
    E = power (log likelihood - cost * (occupied sensors + blocked pieces of the way)), times
    exp((t - 1) (plain log prior + E)) at an inverse temperature t: power and cost are those of a rung of parallel
    tempering, t that of annealing.
    """
    proposal, tuning = chain.proposal, chain.tuning
    cost, turned = tuning[c.OCCUPIED_COST], 0
    if cost != math.inf:
        turned = occupied_change(chain.sensors, proposal.loop, proposal.counts[N_LOOP], False)
        turned += blocked_change(chain.graph, chain.edge_index, chain.guards, proposal)
    elif chain.sensors.xy.shape[0] > 0 and any_inside(chain.sensors, proposal.loop, proposal.counts[N_LOOP]):
        return math.inf
    beta, power = tuning[c.INVERSE_TEMPERATURE], tuning[c.LIKELIHOOD_POWER]
    if beta != 1.0:
        margin = (margin - (beta - 1.0) * plain_prior_change(chain.graph, proposal, tuning[c.SCALE])) / beta
    if power == 0.0:
        return -math.inf if margin < 0.0 else math.inf
    if power != 1.0:
        margin /= power
    return margin if turned == 0 else margin + cost * turned


@spine
def evaluate(
    chain: Chain, move: int, log_proposal_ratio: float, log_u: float, rng: np.random.Generator
) -> tuple[bool, float, float]:
    """Decide on a legal proposal; return the decision and the changes of log prior and log likelihood.

    The threshold `log_u` is drawn before, so that what cannot be reached is not computed; it decides on all but the
    beams of further levels, which draw their own from `rng`. A comparison with nan is false: such a proposal is
    rejected.
    """
    graph, proposal = chain.graph, chain.proposal
    if not is_valid(graph, chain.edge_index, proposal):
        return False, 0.0, 0.0
    if chain.tuning[c.REGION_TARGET] != c.NONE and leaves_region(graph, proposal, chain.tuning):
        return False, 0.0, 0.0
    chain.outcomes[move, c.VALID] += 1
    if is_barred(graph, chain.guards, proposal, chain.tuning[c.OCCUPIED_COST] == math.inf):
        return False, 0.0, 0.0
    log_proposal_ratio += log_ratio_of_cells(chain, move)
    if log_proposal_ratio == -math.inf:
        return False, 0.0, 0.0
    prior = log_prior_change(graph, proposal, chain.tuning[c.SCALE])
    # A tile may hold readings of sensors that stand in another, and sensors whose readings another answers for.
    n_readings, n_points = chain.beams.ray.shape[0] + chain.cones.pose.shape[0], chain.points.column.shape[1]
    is_bare = n_readings == 0 and n_points == 0 and chain.sensors.xy.shape[0] == 0
    if is_bare and chain.guards.lists.shape[0] == 1:
        return log_u < prior + log_proposal_ratio, prior, 0.0
    needed = needed_gain(chain, log_u - prior - log_proposal_ratio)
    if needed == math.inf:
        return False, 0.0, 0.0
    likelihood = 0.0
    if n_points > 0:
        likelihood = gain_inside(chain.points, proposal.loop, proposal.counts[N_LOOP], chain.image.crossings, False)
    if n_readings > 0:
        n_cones = chain.cones.pose.shape[0]
        # What cones may gain is not known before they are asked: with them all beams are.
        floor = -math.inf if n_cones > 0 else needed - likelihood
        may_pass, change = touch_beams(graph, chain.edge_index, chain.beams, proposal, 0, floor)
        if not may_pass:
            return False, 0.0, 0.0
        likelihood += change
        if n_cones > 0:
            touch_cones(graph, chain.edge_index, chain.cones, proposal)
            likelihood += sonar_change(graph, chain.edge_index, chain.cones, proposal)
    if not needed < likelihood:
        return False, prior, likelihood
    accepted, change = pass_levels(chain, rng)
    return accepted, prior, likelihood + change


@spine
def pass_levels(chain: Chain, rng: np.random.Generator) -> tuple[bool, float]:
    """Let the further levels of beams decide in turn, each by a threshold of its own; return the change over them.

    The probability of acceptance is the product of min(1, r) over the factors r of the ratio: each factor is the
    inverse of that of the move back, so that the posterior stays what it is (factorised Metropolis; delayed
    acceptance of Christen & Fox 2005). What few beams refuse, the many are never asked about.
    """
    likelihood = 0.0
    power = chain.tuning[c.INVERSE_TEMPERATURE] * chain.tuning[c.LIKELIHOOD_POWER]
    for level in range(1, chain.beams.first_beam.shape[1]):
        needed = math.log(1.0 - rng.random()) / power if power > 0.0 else -math.inf
        may_pass, change = touch_beams(chain.graph, chain.edge_index, chain.beams, chain.proposal, level, needed)
        if not (may_pass and needed < change):
            return False, likelihood
        likelihood += change
    return True, likelihood


@spine
def step(chain: Chain, rng: np.random.Generator) -> bool:
    """One step: choose a move, propose, decide, apply. An illegal proposal is a rejection and counts as a step."""
    chain.graph.counts[c.STEP] += 1
    move = choose_move(chain.odds, rng)
    chain.outcomes[move, c.PROPOSED] += 1
    legal, log_proposal_ratio = propose(chain, move, rng)
    if not legal:
        return False
    log_u = math.log(1.0 - rng.random())
    accepted, prior, likelihood = evaluate(chain, move, log_proposal_ratio, log_u, rng)
    if accepted:
        apply(chain, prior, likelihood)
        chain.outcomes[move, c.ACCEPTED] += 1
    return accepted


@core
def run_steps(chain: Chain, rng: np.random.Generator, until: int) -> bool:
    """The loop of :func:`run`, without reference counts."""
    counts = chain.graph.counts
    while counts[c.STEP] < until:
        if counts[c.NEEDS_ROOM] != 0:
            return False
        step(chain, rng)
    return True


@jit
def run(chain: Chain, rng: np.random.Generator, until: int) -> bool:
    """Step until the step counter reaches `until`; False if the chain needs room first (:func:`prf.layout.grow`)."""
    return run_steps(chain, rng, until)
