"""The acceptance of a proposal: the one place where the ratios of prior, likelihood and proposal meet.

A proposal is accepted with probability min(1, R), log R being the sum of

- the change of the log prior (:mod:`prf.kernels.state.prior`),
- the change of the log likelihood (laser, sonar, points),
- log p[reverse move] + log_reverse - (log p[move] + log_forward): the probabilities of picking the moves, and the
  densities with which each makes its proposal (:mod:`prf.kernels.moves`).
"""

import math

from prf.kernels import constants as c
from prf.kernels._jit import Array, Rng, core, spine
from prf.kernels.readings.laser_change import touch_beams
from prf.kernels.readings.points import gain_inside
from prf.kernels.readings.sonar_change import sonar_change, touch_cones
from prf.kernels.state.chain import Chain
from prf.kernels.state.free_space import black_change
from prf.kernels.state.guards import blocked_change, is_barred
from prf.kernels.state.prior import log_line_prior_change, log_prior_change
from prf.kernels.state.proposal import N_LOOP, N_NEW_EDGES, N_OLD_EDGES
from prf.kernels.state.sites import any_inside, occupied_change


@core
def log_proposal_ratio(move_probabilities: Array, move: int, log_forward: float, log_reverse: float) -> float:
    """Log of the density of the way back over that of the proposal; -inf where no move leads back."""
    reverse = c.REVERSE[move]
    ratio = log_reverse - log_forward
    if reverse != move and log_reverse != -math.inf:
        ratio += math.log(move_probabilities[reverse] / move_probabilities[move])
    return ratio


@spine
def needed_gain(chain: Chain, margin: float, tilt: float) -> float:
    """The change of log likelihood that a proposal must exceed to be accepted; inf where none will do.

    `margin` is what is missing to the threshold after prior and proposal ratio, `tilt` what free space adds to the log
    prior. The target is h exp(E) with
    E = power (log likelihood - cost * (occupied sensors + blocked pieces of the way)), times
    exp((t - 1) (log prior over lines + E - cost of edges)) at an inverse temperature t:
    power and cost are those of a level of parallel
    tempering, t that of annealing.
    """
    proposal, density = chain.proposal, chain.density
    cost, occupied = density[c.OCCUPIED_COST], 0
    if cost != math.inf:
        occupied = occupied_change(chain.sensors, proposal.loop, proposal.counts[N_LOOP], False)
        occupied += blocked_change(chain.graph, chain.edge_index, chain.guards, proposal)
    elif chain.sensors.xy.shape[0] > 0 and any_inside(chain.sensors, proposal.loop, proposal.counts[N_LOOP]):
        return math.inf
    beta, power = density[c.INVERSE_TEMPERATURE], density[c.LIKELIHOOD_POWER]
    if beta != 1.0:
        added = proposal.counts[N_NEW_EDGES] - proposal.counts[N_OLD_EDGES]
        line_prior = log_line_prior_change(chain.graph, proposal, density[c.SCALE], chain.lines) + tilt
        line_prior -= density[c.EDGE_COST] * added
        margin = (margin - (beta - 1.0) * line_prior) / beta
    if power == 0.0:
        return -math.inf if margin < 0.0 else math.inf
    if power != 1.0:
        margin /= power
    return margin if occupied == 0 else margin + cost * occupied


@spine
def accept(
    chain: Chain, move: int, log_forward: float, log_reverse: float, log_u: float, rng: Rng
) -> tuple[bool, float, float]:
    """Decide on a valid proposal; return the decision and the changes of log prior and log likelihood.

    The threshold `log_u` is drawn before, so that a likelihood that cannot reach it is not computed; it decides on all
    but the beams of further levels, which draw their own from `rng`. A comparison with nan is false: such a proposal is
    rejected.
    """
    graph, proposal = chain.graph, chain.proposal
    if is_barred(graph, chain.guards, proposal, chain.density[c.OCCUPIED_COST] == math.inf):
        return False, 0.0, 0.0
    proposal_ratio = log_proposal_ratio(chain.move_probabilities, move, log_forward, log_reverse)
    if proposal_ratio == -math.inf:
        return False, 0.0, 0.0
    prior, tilt = log_prior_change(graph, proposal, chain.density[c.SCALE], chain.lines), 0.0
    if chain.density[c.FREE_SPACE] > 0.0:
        tilt = -chain.density[c.FREE_SPACE] * black_change(graph, chain.edge_index, proposal)
        prior += tilt
    # A tile may hold readings of sensors in another one, and sensors whose readings belong to another one.
    n_readings, n_points = chain.beams.ray.shape[0] + chain.cones.pose.shape[0], chain.points.column.shape[1]
    is_bare = n_readings == 0 and n_points == 0 and chain.sensors.xy.shape[0] == 0
    if is_bare and chain.guards.lists.shape[0] == 1:
        return log_u < prior + proposal_ratio, prior, 0.0
    needed = needed_gain(chain, log_u - prior - proposal_ratio, tilt)
    if needed == math.inf:
        return False, 0.0, 0.0
    likelihood = 0.0
    if n_points > 0:
        likelihood = gain_inside(chain.points, proposal.loop, proposal.counts[N_LOOP], chain.image.crossings, False)
    if n_readings > 0:
        n_cones = chain.cones.pose.shape[0]
        # No bound is known on what cones gain: with cones all beams are computed.
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
def pass_levels(chain: Chain, rng: Rng) -> tuple[bool, float]:
    """Decide by each further level of beams in turn, with a threshold of its own; return the change over them.

    The probability of acceptance is the product of min(1, r) over the factors r of the ratio: each factor is the
    inverse of that of the move back, so that the posterior stays the same (factorised Metropolis; delayed acceptance
    of Christen & Fox 2005). What few beams reject is never computed for the many.
    """
    likelihood = 0.0
    power = chain.density[c.INVERSE_TEMPERATURE] * chain.density[c.LIKELIHOOD_POWER]
    for level in range(1, chain.beams.first_beam.shape[1]):
        needed = math.log(1.0 - rng.random()) / power if power > 0.0 else -math.inf
        may_pass, change = touch_beams(chain.graph, chain.edge_index, chain.beams, chain.proposal, level, needed)
        if not (may_pass and needed < change):
            return False, likelihood
        likelihood += change
    return True, likelihood
