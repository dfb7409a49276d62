"""A thick wall made two that stand on two of its sides, and two walls filled to one (docs/walls.md).

What lies behind faces that were seen from outside is open: thin walls along the sides of a piece of furniture tell the
readings as much as a solid box. From one to the other leads no chain of small changes, as half a box is neither.

The walls stand round the box counter-clockwise, their right faces outwards. The base lies on its right side. In the
frame of that side, x along it and y into the box of length l and thickness t, the other wall stands `quarters` right
angles and a turn r after the base:

- 1, 3: on the side at x = l or 0, its far end at y = t, the near one at n; the base passes that side by q.
- 2: on the side at y = t, longer than the box by q, its middle n beyond that of the box.

Both thicknesses are drawn by their law. What the box does not have are sums of what two walls have: the Jacobian is 1.
"""

import math

from prf.kernels import constants as c
from prf.kernels._jit import Array, Rng, core
from prf.kernels.state.graph import Graph
from prf.kernels.state.proposal import ILLEGAL, Densities, Proposal
from prf.kernels.walls.birth import behind, draw_thickness, face
from prf.kernels.walls.change import pick_wall
from prf.kernels.walls.gap import ASKEW, cubed, log_cubed
from prf.kernels.walls.law import THICKEST, THINNEST, log_thickness
from prf.kernels.walls.shape import Wall, length_of, turned_round
from prf.kernels.walls.table import Walls, box_of, goes, meets, put, start, take, wall_in

PAST = 1.0
"""Metres that a wall ends past, or before, the side of the box at most."""
BESIDE = 0.5
"""Metres that the other wall begins, or its middle lies, off its place at most."""
AROUND = THICKEST + PAST + BESIDE
"""Metres beyond the base's own box within which the box of the other wall comes."""


@core
def facing(base: Wall, other: Wall, quarters: int) -> tuple[Wall, float]:
    """A wall from the end from which it may stand so many right angles after a base, and its turn beside that."""
    ux, uy, dx, dy = base[2] - base[0], base[3] - base[1], other[2] - other[0], other[3] - other[1]
    along, across = ux * dx + uy * dy, ux * dy - uy * dx
    if quarters == 1:
        along, across = across, -along
    elif quarters == 2:
        along, across = -along, -across
    else:
        along, across = -across, along
    if along < 0.0:
        return turned_round(other), math.atan2(-across, -along)
    return other, math.atan2(across, along)


@core
def filled(base: Wall, other: Wall, quarters: int) -> tuple[bool, Wall, float, float, float]:
    """Whether two walls may be filled; the box; q, n and r."""
    other, turn = facing(base, other, quarters)
    if not abs(turn) < ASKEW:
        return False, base, 0.0, 0.0, 0.0
    line, side, own, width = face(base), face(other), length_of(base), length_of(other)
    ux, uy = (line[2] - line[0]) / own, (line[3] - line[1]) / own
    px, py = 0.5 * (side[0] + side[2]) - line[0], 0.5 * (side[1] + side[3]) - line[1]
    x, y = px * ux + py * uy, py * ux - px * uy
    low, high, thickness = 0.0, own, y
    if quarters == 2:
        past, near = width - own, x - 0.5 * own
    else:
        low, high = (0.0, x) if quarters == 1 else (x, own)
        past, near, thickness = own - high + low, y - 0.5 * width, y + 0.5 * width
    fits = abs(past) < PAST and abs(near) < BESIDE and THINNEST < thickness < THICKEST and low < high
    # What rounding leaves of nothing has no density.
    fits = fits and past != 0.0 and near != 0.0 and turn != 0.0
    front = (line[0] + low * ux, line[1] + low * uy, line[0] + high * ux, line[1] + high * uy, 0.0)
    return fits, (behind(front, thickness) if fits else base), past, near, turn


@core
def hollowed(box: Wall, quarters: int, past: float, near: float, turn: float) -> tuple[Wall, Wall]:
    """The right faces of two walls that fill to a box, as walls of no thickness."""
    line, length, thickness = face(box), length_of(box), box[4]
    ux, uy = (line[2] - line[0]) / length, (line[3] - line[1]) / length
    low, high, x, y, width = 0.0, length, 0.5 * length + near, thickness, length + past
    if quarters != 2:
        x, y, width = (length if quarters == 1 else 0.0), 0.5 * (near + thickness), thickness - near
        low, high = (0.0, length + past) if quarters == 1 else (-past, length)
    angle = 0.5 * math.pi * quarters + turn
    cosine, sine = math.cos(angle), math.sin(angle)
    half_x, half_y = 0.5 * width * (cosine * ux - sine * uy), 0.5 * width * (sine * ux + cosine * uy)
    px, py = line[0] + x * ux - y * uy, line[1] + x * uy + y * ux
    base = (line[0] + low * ux, line[1] + low * uy, line[0] + high * ux, line[1] + high * uy, 0.0)
    return base, (px - half_x, py - half_y, px + half_x, py + half_y, 0.0)


@core
def count_sides(graph: Graph, walls: Walls, base: Wall, quarters: int) -> int:
    """How many walls, those of the proposal left out, may be filled with a base."""
    n = 0
    x0, x1, y0, y1 = box_of(base, AROUND)
    for i in range(graph.counts[c.WALLS]):
        if meets(walls, i, x0, x1, y0, y1) and not goes(walls, i) and filled(base, wall_in(walls.row, i), quarters)[0]:
            n += 1
    return n


@core
def log_hollow(lines: Array, past: float, near: float, turn: float, base: Wall, other: Wall) -> float:
    """Log density of the numbers that are drawn to make two walls of a box."""
    placed = log_cubed(PAST, past) + log_cubed(BESIDE, near) + log_cubed(ASKEW, turn)
    return placed + log_thickness(lines, base[4]) + log_thickness(lines, other[4])


@core
def propose_hollow(graph: Graph, proposal: Proposal, walls: Walls, lines: Array, rng: Rng) -> Densities:
    """Make two walls of a thick one."""
    start(proposal, walls)
    if graph.counts[c.WALLS] == 0:
        return ILLEGAL
    box, quarters = pick_wall(graph, proposal, walls, rng), 1 + min(int(3.0 * rng.random()), 2)
    past, near, turn = cubed(PAST, rng), cubed(BESIDE, rng), cubed(ASKEW, rng)
    first, second = draw_thickness(lines, rng), draw_thickness(lines, rng)
    if not (THINNEST < first < THICKEST and THINNEST < second < THICKEST):
        return ILLEGAL
    if not (length_of(box) + past > 0.0 and (quarters == 2 or box[4] > near)):
        return ILLEGAL
    base, other = hollowed(box, quarters, past, near, turn)
    base, other = behind(base, first), behind(other, second)
    if not put(graph, proposal, walls, base) or not put(graph, proposal, walls, other):
        return ILLEGAL
    if not filled(base, other, quarters)[0]:
        return ILLEGAL
    log_forward = log_hollow(lines, past, near, turn, base, other)
    sides = count_sides(graph, walls, base, quarters) + 1
    return True, log_forward, -math.log(float(sides))


@core
def propose_fill(graph: Graph, proposal: Proposal, walls: Walls, lines: Array, rng: Rng) -> Densities:
    """Fill a wall and a uniform one of those that stand on another side of the same box."""
    start(proposal, walls)
    n = graph.counts[c.WALLS]
    if n < 2:
        return ILLEGAL
    base, quarters = pick_wall(graph, proposal, walls, rng), 1 + min(int(3.0 * rng.random()), 2)
    sides = count_sides(graph, walls, base, quarters)
    if sides == 0:
        return ILLEGAL
    chosen = min(int(rng.random() * sides), sides - 1)
    x0, x1, y0, y1 = box_of(base, AROUND)
    for i in range(n):
        if not meets(walls, i, x0, x1, y0, y1) or goes(walls, i):
            continue
        fits, box, past, near, turn = filled(base, wall_in(walls.row, i), quarters)
        if not fits:
            continue
        if chosen == 0:
            other = take(graph, proposal, walls, i)
            log_reverse = log_hollow(lines, past, near, turn, base, other)
            return put(graph, proposal, walls, box), -math.log(float(sides)), log_reverse
        chosen -= 1
    return ILLEGAL
