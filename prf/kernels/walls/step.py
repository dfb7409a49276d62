"""One Metropolis-Hastings step of a map of walls, and runs of many: as :mod:`prf.kernels.step` of the Arak process."""

import math

from prf.kernels import constants as c
from prf.kernels._jit import Array, Rng, core, loop, spine
from prf.kernels.accept import pass_levels
from prf.kernels.readings.laser_change import apply_touched, release_touched, touch_beams
from prf.kernels.readings.sonar_change import apply_cones, sonar_change, touch_cones
from prf.kernels.state.chain import Chain, apply_edges
from prf.kernels.state.graph import set_add
from prf.kernels.state.guards import is_barred
from prf.kernels.state.image import count_edge
from prf.kernels.state.proposal import ILLEGAL, N_NEW_EDGES, N_OLD_EDGES, Densities, find_cells
from prf.kernels.state.sites import any_inside
from prf.kernels.walls.birth import propose_wall_birth, propose_wall_death
from prf.kernels.walls.change import propose_end, propose_extend, propose_shift, propose_thickness, propose_turn
from prf.kernels.walls.cover import cover_image, cover_points
from prf.kernels.walls.gap import propose_gap, propose_merge
from prf.kernels.walls.hollow import propose_fill, propose_hollow
from prf.kernels.walls.shape import write_corners
from prf.kernels.walls.table import N_NEW, N_OLD, Walls, fill, forget, log_picked, remember, wall_prior_change


@core
def choose_wall_move(move_probabilities: Array, rng: Rng) -> int:
    """Move drawn with these probabilities."""
    u = rng.random()
    for move in range(c.N_WALL_MOVES - 1):
        u -= move_probabilities[move]
        if u < 0.0:
            return move
    return c.N_WALL_MOVES - 1


@spine
def propose_change(chain: Chain, walls: Walls, move: int, rng: Rng) -> Densities:
    """The same of a move of walls that are there, without the density of picking the first."""
    graph, proposal, density, lines = chain.graph, chain.proposal, chain.density, chain.lines
    if move == c.SHIFT_WALL:
        return propose_shift(graph, proposal, walls, rng)
    if move == c.TURN_WALL:
        return propose_turn(graph, proposal, walls, rng)
    if move == c.EXTEND_WALL:
        return propose_extend(graph, proposal, walls, rng)
    if move == c.MOVE_END:
        return propose_end(graph, proposal, walls, rng)
    if move == c.THICKNESS:
        return propose_thickness(graph, proposal, walls, density, lines, rng)
    if move == c.GAP:
        return propose_gap(graph, proposal, walls, rng)
    if move == c.MERGE_WALLS:
        return propose_merge(graph, proposal, walls, rng)
    if move == c.HOLLOW:
        return propose_hollow(graph, proposal, walls, lines, rng)
    return propose_fill(graph, proposal, walls, lines, rng)


@spine
def propose_walls(chain: Chain, walls: Walls, move: int, rng: Rng) -> Densities:
    """Fill the proposal; return whether it is legal, log_forward and log_reverse (see ``moves``)."""
    graph, targets, proposal = chain.graph, chain.targets, chain.proposal
    tuning, density, lines = chain.tuning, chain.density, chain.lines
    if move == c.WALL_BIRTH:
        return propose_wall_birth(graph, targets, proposal, walls, tuning, density, lines, rng)
    if move == c.WALL_DEATH:
        return propose_wall_death(graph, targets, proposal, walls, tuning, density, lines, rng)
    legal, log_forward, log_reverse = propose_change(chain, walls, move, rng)
    if not legal:
        return ILLEGAL
    forward, back = log_picked(walls)
    return True, log_forward + forward, log_reverse + back


@core
def log_move_ratio(move_probabilities: Array, move: int, log_forward: float, log_reverse: float) -> float:
    """Log of the density of the way back over that of the proposal."""
    return log_reverse - log_forward + math.log(move_probabilities[c.WALL_REVERSE[move]] / move_probabilities[move])


@core
def is_blocked(chain: Chain, walls: Walls) -> bool:
    """Whether a proposal puts a sensor in black, or an edge near the way; writes the cells of the new edges."""
    find_cells(chain.edge_index.grid, chain.proposal)
    if is_barred(chain.graph, chain.guards, chain.proposal, True):
        return True
    if chain.sensors.xy.shape[0] > 0:
        for k in range(walls.counts[N_NEW]):
            if any_inside(chain.sensors, chain.proposal.loop[4 * k : 4 * k + 4], 4):
                return True
    return False


@spine
def accept_walls(chain: Chain, walls: Walls, log_ratio: float, log_u: float, rng: Rng) -> tuple[bool, float, float]:
    """Decide on a legal proposal; return the decision and the changes of log prior and log likelihood.

    `log_ratio`: of the proposal densities. The target is (prior x likelihood ^ power) ^ inverse temperature; no sensor
    is in black, and no edge near the way. The prior is what costs least, and rejects first.
    """
    graph, index, proposal = chain.graph, chain.edge_index, chain.proposal
    prior = wall_prior_change(graph, walls, chain.density, chain.lines)
    beta, power = chain.density[c.INVERSE_TEMPERATURE], chain.density[c.LIKELIHOOD_POWER]
    needed = (log_u - log_ratio) / beta - prior
    n_readings, n_points = chain.beams.ray.shape[0] + chain.cones.pose.shape[0], chain.points.column.shape[1]
    is_prior = (n_readings == 0 and n_points == 0) or power == 0.0
    if not needed < (0.0 if is_prior else math.inf) or is_blocked(chain, walls):
        return False, 0.0, 0.0
    if is_prior:
        return True, prior, 0.0
    needed /= power
    likelihood = cover_points(chain.points, walls, False) if n_points > 0 else 0.0
    if n_readings > 0:
        n_cones = chain.cones.pose.shape[0]
        floor = -math.inf if n_cones > 0 else needed - likelihood
        may_pass, change = touch_beams(graph, index, chain.beams, proposal, 0, floor)
        if not may_pass:
            return False, 0.0, 0.0
        likelihood += change
        if n_cones > 0:
            touch_cones(graph, index, chain.cones, proposal)
            likelihood += sonar_change(graph, index, chain.cones, proposal)
    if not needed < likelihood:
        return False, prior, likelihood
    accepted, change = pass_levels(chain, rng)
    return accepted, prior, likelihood + change


@spine
def apply_walls(chain: Chain, walls: Walls, log_prior_change: float, log_likelihood_change: float) -> None:
    """Make an accepted proposal the state of the chain."""
    graph, proposal, image = chain.graph, chain.proposal, chain.image
    step = graph.counts[c.STEP]
    if image.black.size > 0:
        for k in range(proposal.counts[N_OLD_EDGES]):
            count_edge(image, graph.edge_xy[proposal.old_edges[k]], -1, step)
        for k in range(proposal.counts[N_NEW_EDGES]):
            count_edge(image, proposal.new_xy[k], 1, step)
        for k in range(walls.counts[N_OLD]):
            write_corners(graph, graph.members[c.WALLS, walls.old[k]], proposal.loop[8:12])
            cover_image(image, proposal.loop[8:12], -1, step)
        for k in range(walls.counts[N_NEW]):
            cover_image(image, proposal.loop[4 * k : 4 * k + 4], 1, step)
    if chain.points.column.shape[1] > 0:
        cover_points(chain.points, walls, True)
    release_touched(chain.beams)
    forget(graph, walls)
    remember(graph, walls)
    apply_edges(graph, chain.edge_index, proposal)
    for k in range(walls.counts[N_NEW]):
        set_add(graph, c.WALLS, proposal.new_slot[4 * k])
    apply_touched(chain.beams, proposal)
    apply_cones(chain.cones)
    graph.sums[c.LOG_PRIOR] += log_prior_change
    graph.sums[c.LOG_LIKELIHOOD] += log_likelihood_change


@spine
def step_walls(chain: Chain, walls: Walls, rng: Rng) -> bool:
    """One step: pick a move, propose, accept or reject, apply. An illegal proposal counts as a rejected step."""
    graph, outcomes = chain.graph, chain.outcomes
    graph.counts[c.STEP] += 1
    move = choose_wall_move(chain.move_probabilities, rng)
    outcomes[move, c.PROPOSED] += 1
    legal, log_forward, log_reverse = propose_walls(chain, walls, move, rng)
    if not legal:
        return False
    log_u = math.log(1.0 - rng.random())
    outcomes[move, c.VALID] += 1
    log_ratio = log_move_ratio(chain.move_probabilities, move, log_forward, log_reverse)
    accepted, prior, likelihood = accept_walls(chain, walls, log_ratio, log_u, rng)
    if accepted:
        apply_walls(chain, walls, prior, likelihood)
        outcomes[move, c.ACCEPTED] += 1
    return accepted


@core
def run_wall_steps(chain: Chain, walls: Walls, rng: Rng, until: int) -> bool:
    """The loop of :func:`run_walls`, without reference counts."""
    counts = chain.graph.counts
    fill(chain.graph, chain.targets, walls)
    while counts[c.STEP] < until:
        if counts[c.NEEDS_ROOM] != 0:
            return False
        step_walls(chain, walls, rng)
    return True


@loop
def run_walls(chain: Chain, walls: Walls, rng: Rng, until: int) -> bool:
    """Step until the step counter reaches `until`; False if the chain needs room first (``prf.model.layout``)."""
    return run_wall_steps(chain, walls, rng, until)
