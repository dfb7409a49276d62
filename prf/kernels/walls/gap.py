"""A wall split at a gap, such as a door, and two walls merged into one (docs/walls.md).

Split: a wall of length l, from one of its ends, becomes a first part of length s on its own line, and, w beyond that, a
second one up to where the wall ended, which is displaced across by d, turned by r, and thicker by t. Merge: the first
wall is extended over the gap and by the length of the second. The map (l, s, w) -> (s, s + w, l - s - w) has the
Jacobian 1, and d, r and t are what the second wall has beside the first.
"""

import math

from prf.kernels import constants as c
from prf.kernels._jit import Rng, core
from prf.kernels.state.graph import Graph
from prf.kernels.state.proposal import ILLEGAL, Densities, Proposal
from prf.kernels.walls.change import pick_wall, with_length
from prf.kernels.walls.shape import Wall, length_of, placed, turned_round
from prf.kernels.walls.table import Walls, goes, put, start, take, wall_in

WIDEST, OVERLAP = 3.0, 0.25
"""Metres: of a gap at most, and of an overlap."""
ASIDE = 0.1
"""Metres that the second part lies aside at most."""
ASKEW = 0.1
"""Radians that it is turned at most."""
THICKER = 0.1
"""Metres that its thickness differs at most."""


@core
def cubed(most: float, rng: Rng) -> float:
    """A number up to `most` in size, most of them near 0."""
    v = 2.0 * rng.random() - 1.0
    return most * v * v * v


@core
def log_cubed(most: float, value: float) -> float:
    """Log density of :func:`cubed`."""
    return -math.log(6.0 * most) - 2.0 / 3.0 * math.log(abs(value) / most)


@core
def draw_gap(rng: Rng) -> float:
    """Width of a gap, below 0 for an overlap, metres."""
    least, most = -math.sqrt(OVERLAP), math.sqrt(WIDEST)
    v = least + (most - least) * rng.random()
    return v * abs(v)


@core
def log_gap(width: float) -> float:
    """Log density of a gap."""
    return -math.log((math.sqrt(OVERLAP) + math.sqrt(WIDEST)) * 2.0 * math.sqrt(abs(width)))


@core
def beside(first: Wall, second: Wall) -> tuple[bool, float, float, float, float, float]:
    """Whether a wall may be the second part behind a first one; gap, displacement, turn, thickening; length of both.

    `second` begins at the gap.
    """
    length, own = length_of(first), length_of(second)
    ux, uy = (first[2] - first[0]) / length, (first[3] - first[1]) / length
    px, py = second[0] - first[2], second[1] - first[3]
    dx, dy = (second[2] - second[0]) / own, (second[3] - second[1]) / own
    gap, aside = px * ux + py * uy, py * ux - px * uy
    turn, thicker = math.atan2(ux * dy - uy * dx, ux * dx + uy * dy), second[4] - first[4]
    fits = -OVERLAP < gap < WIDEST and abs(aside) < ASIDE and abs(turn) < ASKEW and abs(thicker) < THICKER
    # What rounding leaves of nothing has no density.
    fits = fits and gap != 0.0 and aside != 0.0 and turn != 0.0 and thicker != 0.0
    return fits and gap + own > 0.0, gap, aside, turn, thicker, length + gap + own


@core
def is_at_gap(first: Wall, second: Wall) -> bool:
    """Whether a wall begins so near to the end of a first one as :func:`beside` asks for, and a little farther."""
    return abs(second[0] - first[2]) < WIDEST + ASIDE and abs(second[1] - first[3]) < WIDEST + ASIDE


@core
def count_parts(graph: Graph, walls: Walls, first: Wall) -> int:
    """How many walls, those of the proposal left out, may be the second part behind a first one."""
    n = 0
    for i in range(graph.counts[c.WALLS]):
        if goes(walls, i):
            continue
        wall = wall_in(walls.row, i)
        if is_at_gap(first, wall) and beside(first, wall)[0]:
            n += 1
        wall = turned_round(wall)
        if is_at_gap(first, wall) and beside(first, wall)[0]:
            n += 1
    return n


@core
def log_split(length: float, gap: float, aside: float, turn: float, thicker: float) -> float:
    """Log density of the numbers that a split of a wall of some length draws."""
    place = -math.log(length) + log_gap(gap)
    return place + log_cubed(ASIDE, aside) + log_cubed(ASKEW, turn) + log_cubed(THICKER, thicker)


@core
def propose_gap(graph: Graph, proposal: Proposal, walls: Walls, rng: Rng) -> Densities:
    """Split a wall at a gap."""
    start(proposal, walls)
    if graph.counts[c.WALLS] == 0:
        return ILLEGAL
    wall = pick_wall(graph, proposal, walls, rng)
    length = length_of(wall)
    until, gap = length * rng.random(), draw_gap(rng)
    aside, turn, thicker = cubed(ASIDE, rng), cubed(ASKEW, rng), cubed(THICKER, rng)
    rest = length - until - gap
    if not (until > wall[4] and rest > wall[4] + thicker):
        return ILLEGAL
    first = with_length(wall, until)
    ux, uy = (wall[2] - wall[0]) / length, (wall[3] - wall[1]) / length
    x, y = first[2] + gap * ux - aside * uy, first[3] + gap * uy + aside * ux
    cosine, sine = math.cos(turn), math.sin(turn)
    second = placed(x, y, cosine * ux - sine * uy, sine * ux + cosine * uy, rest, wall[4] + thicker)
    if not put(graph, proposal, walls, first) or not put(graph, proposal, walls, second):
        return ILLEGAL
    if not beside(first, second)[0]:
        return ILLEGAL
    log_forward = log_split(length, gap, aside, turn, thicker)
    parts = count_parts(graph, walls, first) + 1
    if beside(first, turned_round(second))[0]:
        parts += 1
    return True, log_forward, -math.log(float(parts))


@core
def propose_merge(graph: Graph, proposal: Proposal, walls: Walls, rng: Rng) -> Densities:
    """Merge a wall, beyond one of its ends, with a uniform one of those that may be its second part."""
    start(proposal, walls)
    n = graph.counts[c.WALLS]
    if n < 2:
        return ILLEGAL
    first = pick_wall(graph, proposal, walls, rng)
    parts = count_parts(graph, walls, first)
    if parts == 0:
        return ILLEGAL
    chosen = min(int(rng.random() * parts), parts - 1)
    for i in range(n):
        if goes(walls, i):
            continue
        for end in range(2):
            second = wall_in(walls.row, i) if end == 0 else turned_round(wall_in(walls.row, i))
            if not is_at_gap(first, second):
                continue
            fits, gap, aside, turn, thicker, length = beside(first, second)
            if not fits:
                continue
            if chosen == 0:
                take(graph, proposal, walls, i)
                legal = put(graph, proposal, walls, with_length(first, length))
                log_reverse = log_split(length, gap, aside, turn, thicker)
                return legal, -math.log(float(parts)), log_reverse
            chosen -= 1
    return ILLEGAL
