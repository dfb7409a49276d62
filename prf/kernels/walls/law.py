"""The prior of walls: its density to a Poisson process of unit rate over middle, direction, length and thickness.

Walls come with a rate, and laws of length, direction and thickness; every interaction is a factor below 1, so that the
density is at most that of a Poisson process, and the law a proper one. Paid are

- each end that lies in no other wall (a free end): an end inside another wall, or next to it, is a joint, be it L, T or
  the continuation of a wall, and free;
- two walls that cross without a joint;
- near-copies: nearly parallel walls, one along the other, with hardly a gap between them.
"""

import math

from prf.kernels import constants as c
from prf.kernels._jit import Array, core
from prf.kernels.state.geometry import segments_meet
from prf.kernels.state.graph import Graph
from prf.kernels.state.lines import alignment
from prf.kernels.state.prior import log_prior
from prf.kernels.walls.shape import Wall, is_inside, length_of, wall_of

THINNEST = 0.02
THICKEST = 1.0
"""Metres, of a wall."""
EVEN = 1.2
"""Standard deviation of the logarithm of a length."""
ALIKE = 0.008
"""Standard deviation of a thickness about its common value, m."""
UNCOMMON = 0.25
"""Share of walls whose thickness has no common value: its logarithm is uniform."""
JOINT = 0.05
"""Metres outside a wall up to which an end of another one is joined to it."""
GAP = 0.15
"""Metres between near-copies at most."""
PARALLEL = 0.26
"""Sine of the angle between near-copies at most."""
COPY_COST = 8.0
"""Nats that a wall takes that lies along another one all of its length; in proportion if not all of it."""
NEAR = GAP + 0.01
"""Walls whose boxes are farther apart than this, metres, have nothing to do with each other."""
ROOT_TWO_PI = math.sqrt(2.0 * math.pi)


@core
def log_length(density: Array, length: float) -> float:
    """Log density of a length: lognormal, 1/m."""
    z = math.log(length / density[c.WALL_LENGTH]) / EVEN
    return -0.5 * z * z - math.log(EVEN * ROOT_TWO_PI * length)


@core
def log_thickness(lines: Array, thickness: float) -> float:
    """Log density of a thickness given the common values, 1/m."""
    if not THINNEST < thickness < THICKEST:
        return -math.inf
    total = UNCOMMON / (thickness * math.log(THICKEST / THINNEST))
    for k in range(c.N_COMMON):
        z = (thickness - lines[c.N_LINES + k]) / ALIKE
        total += (1.0 - UNCOMMON) / c.N_COMMON * math.exp(-0.5 * z * z) / (ALIKE * ROOT_TWO_PI)
    return math.log(total)


@core
def log_alone(density: Array, lines: Array, wall: Wall) -> float:
    """What a wall adds to the log density for itself."""
    length = length_of(wall)
    found = math.log(density[c.WALL_DENSITY] / math.pi) + log_length(density, length) + log_thickness(lines, wall[4])
    if lines[c.ORIENTATION] > 0.0:
        found += lines[c.ORIENTATION] * alignment(lines, wall[2] - wall[0], wall[3] - wall[1]) - lines[c.LOG_MEAN]
    return found


@core
def are_near(one: Wall, other: Wall) -> bool:
    """Whether two walls may have to do with each other."""
    reach = 0.5 * (one[4] + other[4]) + NEAR
    if max(one[0], one[2]) + reach < min(other[0], other[2]) or max(other[0], other[2]) + reach < min(one[0], one[2]):
        return False
    return not (
        max(one[1], one[3]) + reach < min(other[1], other[3]) or max(other[1], other[3]) + reach < min(one[1], one[3])
    )


@core
def holds(wall: Wall, x: float, y: float) -> bool:
    """Whether an end of another wall at (x, y) is joined to a wall."""
    return is_inside(wall, x, y, JOINT)


@core
def share_along(longer: Wall, shorter: Wall) -> float:
    """Share of the shorter of two walls that is a near-copy of the longer one."""
    length, own = length_of(longer), length_of(shorter)
    ux, uy = (longer[2] - longer[0]) / length, (longer[3] - longer[1]) / length
    dx, dy = shorter[2] - shorter[0], shorter[3] - shorter[1]
    if abs(ux * dy - uy * dx) > PARALLEL * own:
        return 0.0
    first = (shorter[0] - longer[0]) * ux + (shorter[1] - longer[1]) * uy
    change = dx * ux + dy * uy
    low, high = max(0.0, min(first, first + change)), min(length, max(first, first + change))
    if low >= high:
        return 0.0
    middle = (0.5 * (low + high) - first) / change
    across = (shorter[1] + middle * dy - longer[1]) * ux - (shorter[0] + middle * dx - longer[0]) * uy
    if abs(across) - 0.5 * (longer[4] + shorter[4]) > GAP:
        return 0.0
    return (high - low) / abs(change)


@core
def pair_cost(density: Array, one: Wall, other: Wall) -> float:
    """Nats that two near walls take."""
    cost = 0.0
    if length_of(one) >= length_of(other):
        cost += COPY_COST * share_along(one, other)
    else:
        cost += COPY_COST * share_along(other, one)
    if segments_meet(one[0], one[1], one[2], one[3], other[0], other[1], other[2], other[3]):
        is_joint = holds(one, other[0], other[1]) or holds(one, other[2], other[3])
        if not (is_joint or holds(other, one[0], one[1]) or holds(other, one[2], one[3])):
            cost += density[c.CROSSING]
    return cost


@core
def log_map_prior(graph: Graph, density: Array, lines: Array) -> float:
    """Log density of the map: of walls, or of the Arak process."""
    if density[c.WALL_DENSITY] > 0.0:
        return log_wall_prior(graph, density, lines)
    return log_prior(graph, density[c.SCALE], lines)


@core
def log_wall_prior(graph: Graph, density: Array, lines: Array) -> float:
    """Log density of all walls of a graph."""
    total = -lines[c.LOG_NORMALISER]
    n = graph.counts[c.WALLS]
    for i in range(n):
        wall = wall_of(graph, graph.members[c.WALLS, i])
        total += log_alone(density, lines, wall)
        first, second = 1.0, 1.0
        for k in range(n):
            other = wall_of(graph, graph.members[c.WALLS, k])
            if k == i or not are_near(wall, other):
                continue
            if k < i:
                total -= pair_cost(density, wall, other)
            if holds(other, wall[0], wall[1]):
                first = 0.0
            if holds(other, wall[2], wall[3]):
                second = 0.0
        total -= density[c.FREE_END] * (first + second)
    return total
