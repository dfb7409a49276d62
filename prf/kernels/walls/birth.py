"""Birth of a wall and its death (docs/walls.md)."""

import math

from prf.kernels import constants as c
from prf.kernels._jit import Array, Rng, core
from prf.kernels.state.graph import Graph
from prf.kernels.state.grid import cell_at
from prf.kernels.state.lines import alignment
from prf.kernels.state.proposal import ILLEGAL, Densities, Proposal
from prf.kernels.state.targets import Targets, first_density, pick_near, pick_target, point_in, second_density
from prf.kernels.walls.law import ALIKE, EVEN, THICKEST, THINNEST, UNCOMMON, log_length, log_thickness
from prf.kernels.walls.shape import Wall, length_of, placed, turned_round
from prf.kernels.walls.table import Walls, put, start, take

ALIGNED = 0.5
"""Share of directions drawn about those of the building, where it has some."""
SHARP = 0.95
"""Of these: r of a wrapped Cauchy law of four times the angle."""


@core
def draw_direction(lines: Array, rng: Rng) -> float:
    """Direction of a new wall, radians."""
    if lines[c.ORIENTATION] == 0.0 or rng.random() >= ALIGNED:
        return math.pi * rng.random()
    fourfold = 2.0 * math.atan((1.0 - SHARP) / (1.0 + SHARP) * math.tan(math.pi * (rng.random() - 0.5)))
    return lines[c.ANGLE] + 0.25 * fourfold + (0.5 * math.pi if rng.random() < 0.5 else 0.0)


@core
def direction_density(lines: Array, wall: Wall) -> float:
    """Density of the direction of a wall, 1/rad over half a turn."""
    if lines[c.ORIENTATION] == 0.0:
        return 1.0 / math.pi
    aligned = alignment(lines, wall[2] - wall[0], wall[3] - wall[1])
    peaked = (1.0 - SHARP * SHARP) / (math.pi * (1.0 + SHARP * SHARP - 2.0 * SHARP * aligned))
    return (1.0 - ALIGNED) / math.pi + ALIGNED * peaked


@core
def draw_thickness(lines: Array, rng: Rng) -> float:
    """Thickness by its law; it may lie outside its bounds, where no wall is."""
    if rng.random() < UNCOMMON:
        return THINNEST * math.pow(THICKEST / THINNEST, rng.random())
    k = min(int(rng.random() * c.N_COMMON), c.N_COMMON - 1)
    return lines[c.N_LINES + k] + ALIKE * rng.standard_normal()


@core
def draw_length(density: Array, rng: Rng) -> float:
    """Length by its law, m."""
    return density[c.WALL_LENGTH] * math.exp(EVEN * rng.standard_normal())


@core
def face(wall: Wall) -> Wall:
    """The face on the right of a wall, as a wall of no thickness."""
    half = 0.5 * wall[4] / length_of(wall)
    x, y = half * (wall[3] - wall[1]), -half * (wall[2] - wall[0])
    return wall[0] + x, wall[1] + y, wall[2] + x, wall[3] + y, 0.0


@core
def behind(line: Wall, thickness: float) -> Wall:
    """The wall whose face on the right is a line."""
    half = 0.5 * thickness / length_of(line)
    x, y = -half * (line[3] - line[1]), half * (line[2] - line[0])
    return line[0] + x, line[1] + y, line[2] + x, line[3] + y, thickness


@core
def number_at(targets: Targets, x: float, y: float) -> int:
    """Target at a place, or NONE."""
    return targets.number[cell_at(targets.grid, x, y)]


@core
def aimed_densities(targets: Targets, tuning: Array, wall: Wall) -> tuple[float, float]:
    """Density of the middle of a face at a return, and of both its ends, summed over both faces and halved."""
    middle, ends = 0.0, 0.0
    for turn in range(2):
        line = face(wall if turn == 0 else turned_round(wall))
        middle += first_density(
            targets, tuning, number_at(targets, 0.5 * (line[0] + line[2]), 0.5 * (line[1] + line[3]))
        )
        a, b = number_at(targets, line[0], line[1]), number_at(targets, line[2], line[3])
        ends += first_density(targets, tuning, a) * second_density(targets, a, b)
        ends += first_density(targets, tuning, b) * second_density(targets, b, a)
    return 0.5 * middle, 0.5 * ends


@core
def log_birth(graph: Graph, targets: Targets, tuning: Array, density: Array, lines: Array, wall: Wall) -> float:
    """Log of the density with which a wall is born, over middle, direction, length and thickness."""
    window, aimed = graph.window, tuning[c.AIMED_SHARE]
    straight = direction_density(lines, wall) * math.exp(log_length(density, length_of(wall)))
    found = (1.0 - aimed) * straight / ((window[2] - window[0]) * (window[3] - window[1]))
    if aimed > 0.0:
        middle, ends = aimed_densities(targets, tuning, wall)
        # Two ends are dx dy dx dy = length d(length) d(direction) d(middle).
        found += 0.5 * aimed * (straight * middle + length_of(wall) * ends)
    return math.log(found) + log_thickness(lines, wall[4])


@core
def draw_wall(graph: Graph, targets: Targets, tuning: Array, density: Array, lines: Array, rng: Rng) -> Wall:
    """A new wall: anywhere; the middle of a face at a return; or a face between two returns near each other."""
    thickness = draw_thickness(lines, rng)
    kind = rng.random()
    if kind < 0.5 * tuning[c.AIMED_SHARE]:
        first = pick_target(targets, tuning, rng)
        ax, ay = point_in(targets, first, rng)
        bx, by = point_in(targets, pick_near(targets, first, rng), rng)
        line = (ax, ay, bx, by, 0.0) if rng.random() < 0.5 else (bx, by, ax, ay, 0.0)
        return behind(line, thickness)
    direction = draw_direction(lines, rng)
    ux, uy = math.cos(direction), math.sin(direction)
    length = draw_length(density, rng)
    if kind < tuning[c.AIMED_SHARE]:
        x, y = point_in(targets, pick_target(targets, tuning, rng), rng)
        if rng.random() < 0.5:
            ux, uy = -ux, -uy
        return behind(placed(x - 0.5 * length * ux, y - 0.5 * length * uy, ux, uy, length, 0.0), thickness)
    window = graph.window
    x = window[0] + (window[2] - window[0]) * rng.random()
    y = window[1] + (window[3] - window[1]) * rng.random()
    return placed(x - 0.5 * length * ux, y - 0.5 * length * uy, ux, uy, length, thickness)


@core
def propose_wall_birth(
    graph: Graph,
    targets: Targets,
    proposal: Proposal,
    walls: Walls,
    tuning: Array,
    density: Array,
    lines: Array,
    rng: Rng,
) -> Densities:
    """Add a wall."""
    start(proposal, walls)
    wall = draw_wall(graph, targets, tuning, density, lines, rng)
    if not THINNEST < wall[4] < THICKEST or not put(graph, proposal, walls, wall):
        return ILLEGAL
    log_reverse = -math.log(graph.counts[c.WALLS] + 1.0)
    return True, log_birth(graph, targets, tuning, density, lines, wall), log_reverse


@core
def propose_wall_death(
    graph: Graph,
    targets: Targets,
    proposal: Proposal,
    walls: Walls,
    tuning: Array,
    density: Array,
    lines: Array,
    rng: Rng,
) -> Densities:
    """Remove a uniform wall."""
    start(proposal, walls)
    n = graph.counts[c.WALLS]
    if n == 0:
        return ILLEGAL
    wall = take(graph, proposal, walls, min(int(rng.random() * n), n - 1))
    return True, -math.log(float(n)), log_birth(graph, targets, tuning, density, lines, wall)
