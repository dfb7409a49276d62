"""Moves of one wall: shift, turn, extend, an end to a joint or off it, thickness (docs/walls.md).

All but the last two are symmetric over middle (or an end), direction, length and thickness, between which the measure
is the same: densities are 0. Picking the wall has its own (:func:`prf.kernels.walls.table.log_picked`).
"""

import math

from prf.kernels import constants as c
from prf.kernels._jit import Array, Rng, core
from prf.kernels.state.graph import Graph
from prf.kernels.state.proposal import ILLEGAL, Densities, Proposal
from prf.kernels.walls.birth import behind, draw_length, draw_thickness, face
from prf.kernels.walls.law import THICKEST, THINNEST, log_length, log_thickness
from prf.kernels.walls.shape import Wall, length_of, placed, turned_round
from prf.kernels.walls.table import SEEN, WEIGHT, Walls, is_on_line, put, start, take, wall_in

LEAST_STEP, MOST_STEP = 0.004, 0.5
"""Metres: a shift has a normal law whose scale is drawn, even in its logarithm, between these."""
MOST_EXTENSION = 5.0
"""The same of an extension."""
MOST_THICKENING = 0.2
TO_DEPTH = 0.4
"""Share of thicknesses that are drawn anew behind a face."""
OFF = 0.5
"""Mean distance that an end is taken off a joint, or to one, m."""
TO_JOINT = 0.5
"""Share of ends that are taken to a joint."""
REACH = 1.0
"""Metres at which a joint is half as probable as one next to the end."""


@core
def step(least: float, most: float, rng: Rng) -> float:
    """A symmetric random step, its scale even in the logarithm."""
    return least * math.pow(most / least, rng.random()) * rng.standard_normal()


@core
def pick_wall(graph: Graph, proposal: Proposal, walls: Walls, rng: Rng) -> Wall:
    """Take a wall out by its weight, from either end; there is one."""
    n = graph.counts[c.WALLS]
    i = min(int(rng.random() * n), n - 1)
    while SEEN * rng.random() >= walls.row[i, WEIGHT]:
        i = min(int(rng.random() * n), n - 1)
    wall = take(graph, proposal, walls, i)
    return wall if rng.random() < 0.5 else turned_round(wall)


@core
def propose_shift(graph: Graph, proposal: Proposal, walls: Walls, rng: Rng) -> Densities:
    """Shift a wall across or along itself."""
    start(proposal, walls)
    if graph.counts[c.WALLS] == 0:
        return ILLEGAL
    wall = pick_wall(graph, proposal, walls, rng)
    by = step(LEAST_STEP, MOST_STEP, rng) / length_of(wall)
    dx, dy = by * (wall[2] - wall[0]), by * (wall[3] - wall[1])
    if rng.random() < 0.7:
        dx, dy = -dy, dx
    moved = (wall[0] + dx, wall[1] + dy, wall[2] + dx, wall[3] + dy, wall[4])
    return put(graph, proposal, walls, moved), 0.0, 0.0


@core
def propose_turn(graph: Graph, proposal: Proposal, walls: Walls, rng: Rng) -> Densities:
    """Turn a wall about an end or its middle."""
    start(proposal, walls)
    if graph.counts[c.WALLS] == 0:
        return ILLEGAL
    wall = pick_wall(graph, proposal, walls, rng)
    length, share = length_of(wall), 0.5 * int(2.0 * rng.random())
    angle = step(LEAST_STEP, MOST_STEP, rng) / length
    px, py = wall[0] + share * (wall[2] - wall[0]), wall[1] + share * (wall[3] - wall[1])
    cosine, sine = math.cos(angle), math.sin(angle)
    ux, uy = (wall[2] - wall[0]) / length, (wall[3] - wall[1]) / length
    ux, uy = cosine * ux - sine * uy, sine * ux + cosine * uy
    moved = placed(px - share * length * ux, py - share * length * uy, ux, uy, length, wall[4])
    return put(graph, proposal, walls, moved), 0.0, 0.0


@core
def with_length(wall: Wall, length: float) -> Wall:
    """The wall with its second end at another distance from the first."""
    factor = length / length_of(wall)
    return (
        wall[0],
        wall[1],
        wall[0] + factor * (wall[2] - wall[0]),
        wall[1] + factor * (wall[3] - wall[1]),
        wall[4],
    )


@core
def propose_extend(graph: Graph, proposal: Proposal, walls: Walls, rng: Rng) -> Densities:
    """Extend or shorten a wall at one end."""
    start(proposal, walls)
    if graph.counts[c.WALLS] == 0:
        return ILLEGAL
    wall = pick_wall(graph, proposal, walls, rng)
    length = length_of(wall) + step(LEAST_STEP, MOST_EXTENSION, rng)
    if not length > wall[4]:
        return ILLEGAL
    return put(graph, proposal, walls, with_length(wall, length)), 0.0, 0.0


@core
def span_within(wall: Wall, other: Wall) -> tuple[float, float]:
    """Distances from the first end of a wall, along it, between which its line lies in another one."""
    length, own = length_of(other), length_of(wall)
    ux, uy = (other[2] - other[0]) / length, (other[3] - other[1]) / length
    dx, dy = (wall[2] - wall[0]) / own, (wall[3] - wall[1]) / own
    px, py = wall[0] - other[0], wall[1] - other[1]
    low, high = 0.0, math.inf
    for axis in range(2):
        at, change = (px * ux + py * uy, dx * ux + dy * uy) if axis == 0 else (py * ux - px * uy, dy * ux - dx * uy)
        least, most = (0.0, length) if axis == 0 else (-0.5 * other[4], 0.5 * other[4])
        if change == 0.0:
            if not least <= at <= most:
                return 1.0, 0.0
        else:
            first, second = (least - at) / change, (most - at) / change
            low, high = max(low, min(first, second)), min(high, max(first, second))
    return low, high


@core
def joint_density(graph: Graph, walls: Walls, wall: Wall, length: float, u: float) -> tuple[float, float]:
    """Density of taking the second end of a wall to `length` by a joint, 1/m; and a length drawn so with `u` in [0, 1).

    The length is that of the wall where its line meets no other.
    """
    own, total, found, drawn = length_of(wall), 0.0, 0.0, length_of(wall)
    ux, uy = (wall[2] - wall[0]) / own, (wall[3] - wall[1]) / own
    for turn in range(2):
        left = u * total
        for i in range(graph.counts[c.WALLS]):
            if not is_on_line(walls, i, wall[0], wall[1], ux, uy) or i == walls.old[0]:
                continue
            low, high = span_within(wall, wall_in(walls.row, i))
            if not low < high:
                continue
            away = (0.5 * (low + high) - own) / REACH
            weight = 1.0 / (1.0 + away * away)
            if turn == 0:
                total += weight
                if low <= length <= high:
                    found += weight / (high - low)
            elif left < weight:
                return found / total, low + left / weight * (high - low)
            else:
                left -= weight
        if total == 0.0:
            break
    return (found / total if total > 0.0 else 0.0), drawn


@core
def propose_end(graph: Graph, proposal: Proposal, walls: Walls, rng: Rng) -> Densities:
    """Take an end of a wall along its line into another wall, or off one, by a law that does both."""
    start(proposal, walls)
    if graph.counts[c.WALLS] == 0:
        return ILLEGAL
    wall = pick_wall(graph, proposal, walls, rng)
    own = length_of(wall)
    if rng.random() < TO_JOINT:
        length = joint_density(graph, walls, wall, own, rng.random())[1]
    else:
        length = own + OFF * rng.standard_exponential() * (1.0 if rng.random() < 0.5 else -1.0)
    if not length > wall[4] or length == own:
        return ILLEGAL
    moved = with_length(wall, length)
    off = (1.0 - TO_JOINT) * 0.5 / OFF * math.exp(-abs(length - own) / OFF)
    forward = TO_JOINT * joint_density(graph, walls, wall, length, 0.0)[0] + off
    back = TO_JOINT * joint_density(graph, walls, moved, own, 0.0)[0] + off
    if not (forward > 0.0 and back > 0.0):
        return ILLEGAL
    return put(graph, proposal, walls, moved), math.log(forward), math.log(back)


@core
def end_face(wall: Wall) -> Wall:
    """The face at the second end of a wall, which lies on its left."""
    half = 0.5 * wall[4] / length_of(wall)
    x, y = half * (wall[3] - wall[1]), -half * (wall[2] - wall[0])
    return wall[2] + x, wall[3] + y, wall[2] - x, wall[3] - y, 0.0


@core
def box_behind(line: Wall, depth: float) -> Wall:
    """The wall on the left of a face, which is one of its ends if the wall is deeper than the face is long."""
    width = length_of(line)
    if depth < width:
        return behind(line, depth)
    ux, uy = (line[1] - line[3]) / width, (line[2] - line[0]) / width
    return placed(0.5 * (line[0] + line[2]), 0.5 * (line[1] + line[3]), ux, uy, depth, width)


@core
def depth_density(density: Array, lines: Array, depth: float) -> float:
    """Density of a depth behind a face: that of a thickness or of a length, 1/m."""
    return 0.5 * math.exp(log_thickness(lines, depth)) + 0.5 * math.exp(log_length(density, depth))


@core
def propose_depth(
    graph: Graph, proposal: Proposal, walls: Walls, wall: Wall, density: Array, lines: Array, rng: Rng
) -> Densities:
    """Give a wall that was taken out another depth behind one of its faces, be that its thickness or its length."""
    is_thickness, is_end = rng.random() < 0.5, rng.random() < 0.5
    depth = draw_thickness(lines, rng) if is_thickness else draw_length(density, rng)
    if is_thickness and not THINNEST < depth < THICKEST:
        return ILLEGAL
    line, before = (end_face(wall), length_of(wall)) if is_end else (face(wall), wall[4])
    if not THINNEST < min(depth, length_of(line)) < THICKEST:
        return ILLEGAL
    forward, back = depth_density(density, lines, depth), depth_density(density, lines, before)
    return put(graph, proposal, walls, box_behind(line, depth)), math.log(forward), math.log(back)


@core
def propose_thickness(
    graph: Graph, proposal: Proposal, walls: Walls, density: Array, lines: Array, rng: Rng
) -> Densities:
    """Give a wall another thickness: by a step about its middle or from a face that stays, or by a depth drawn anew."""
    start(proposal, walls)
    if graph.counts[c.WALLS] == 0:
        return ILLEGAL
    wall = pick_wall(graph, proposal, walls, rng)
    if rng.random() < TO_DEPTH:
        return propose_depth(graph, proposal, walls, wall, density, lines, rng)
    thickness = wall[4] + step(LEAST_STEP, MOST_THICKENING, rng)
    if not THINNEST < thickness < THICKEST:
        return ILLEGAL
    by = 0.0 if rng.random() < 0.3 else 0.5 * (thickness - wall[4]) / length_of(wall)
    dx, dy = -by * (wall[3] - wall[1]), by * (wall[2] - wall[0])
    moved = (wall[0] + dx, wall[1] + dy, wall[2] + dx, wall[3] + dy, thickness)
    return put(graph, proposal, walls, moved), 0.0, 0.0
