"""Exact draws of the Arak process as a particle system in time x (dynamic representation; Arak & Surgailis 1989).

Window [0, width] x [0, height], scale p. Pairs of particles are born inside at rate pi p^2 per area, single ones on
the left side (rate 2p per length), the bottom and the top (rate p). A particle moves straight, turns at rate 2p per
length, dies on the border or, together, with the particle that it meets. The traces are the edges. Angles: f is the
direction in (-pi/2, pi/2); a turn adds d with density sin(d)/2 on (0, pi), wrapped mod pi.

Where edges prefer directions (:mod:`prf.model.orientation`) births come so often as if every direction were the one
preferred most, and are kept with the probability of their own; turns come at rate lambda(f), and the new direction is
drawn until it is kept.

The active particles are in order of y. Only neighbours can meet, so that an event looks at its neighbours alone and
the next event is the least of the rows' two times. Degenerate coincidences (probability zero) are not handled.

Arrays that turn out too small are replaced by longer copies in the kernel itself: a caller who restarts a draw would
have to rewind the random numbers.
"""

import math
from typing import NamedTuple

import numpy as np

from prf.kernels._jit import Array, Rng, jit
from prf.kernels.constants import BOTTOM, INTERIOR, LEFT, LOG_MEAN, ORIENTATION, RIGHT, TOP
from prf.kernels.state.lines import alignment, crossing_factor, log_thinning

# Columns of an active particle.
START_X = 0
START_Y = 1
COS = 2
SIN = 3
VERTEX = 4  # index of the vertex where its edge starts
END_X = 5  # where it will turn or reach the border, unless it meets another first
END_Y = 6
END_SIDE = 7  # INTERIOR: a turn
MEET_X = 8  # where it meets the particle above it, inf if never
MEET_Y = 9
N_COLUMNS = 10

# Entries of ``counts``; vertices and edges over all draws so far.
N_ACTIVE = 0
N_VERTICES = 1
N_EDGES = 2
FIRST_VERTEX = 3  # of the present draw


class Size(NamedTuple):
    """Window [0, width] x [0, height], scale p, and the law of directions."""

    width: float
    height: float
    p: float
    lines: Array  # (N_LINES,) f8


class Process(NamedTuple):
    """The particles of the present draw, and what all draws so far have left."""

    active: Array  # (room, N_COLUMNS) f8 in order of y
    vertices: Array  # (room, 3) f8 x, y, side
    edges: Array  # (room, 2) i4
    counts: Array  # (4,) i8


@jit
def grown(array: Array) -> Array:
    """Return a copy with twice the rows."""
    longer = np.empty((2 * array.shape[0], array.shape[1]), array.dtype)
    longer[: array.shape[0]] = array
    return longer


@jit
def wrapped(angle: float) -> float:
    """Return the direction of the same line in (-pi/2, pi/2], for an angle in (-pi/2, 3 pi/2)."""
    return angle - math.pi if angle > 0.5 * math.pi else angle


@jit
def turn_angle(rng: Rng) -> float:
    """Draw an angle in (0, pi) with density sin(d)/2."""
    return math.acos(1.0 - 2.0 * rng.random())


@jit
def is_kept(direction: float, lines: Array, rng: Rng) -> bool:
    """Return whether a line is kept: with probability m(theta) over its largest value; without K no number is drawn."""
    if lines[ORIENTATION] == 0.0:
        return True
    return rng.random() < math.exp(log_thinning(lines, math.cos(direction), math.sin(direction)))


@jit
def turned(direction: float, lines: Array, rng: Rng) -> float:
    """Draw the direction after a turn."""
    while True:
        new = wrapped(direction + turn_angle(rng))
        if is_kept(new, lines, rng):
            return new


@jit
def peak(lines: Array) -> float:
    """Return the largest value of m(theta)."""
    return math.exp(lines[ORIENTATION] - lines[LOG_MEAN])


@jit
def add_vertex(x: float, y: float, side: int, process: Process) -> int:
    """Append a vertex and return its index in the present draw."""
    index = process.counts[N_VERTICES]
    process.vertices[index, 0] = x
    process.vertices[index, 1] = y
    process.vertices[index, 2] = side
    process.counts[N_VERTICES] = index + 1
    return int(index - process.counts[FIRST_VERTEX])


@jit
def add_edge(start: int, end: int, process: Process) -> None:
    """Append an edge."""
    n = process.counts[N_EDGES]
    process.edges[n, 0] = start
    process.edges[n, 1] = end
    process.counts[N_EDGES] = n + 1


@jit
def plan_end(particle: Array, size: Size, rng: Rng) -> None:
    """Draw where the particle turns (length Exp(2p)); the border ends it if that is nearer."""
    x, y, c, s = particle[START_X], particle[START_Y], particle[COS], particle[SIN]
    length = rng.standard_exponential() / (2.0 * size.p * crossing_factor(size.lines, alignment(size.lines, c, s)))
    to_right = (size.width - x) / c if c > 0.0 else math.inf
    to_level = math.inf
    if s > 0.0:
        to_level = (size.height - y) / s
    elif s < 0.0:
        to_level = -y / s
    particle[END_SIDE] = INTERIOR
    if length < to_right and length < to_level:
        particle[END_X] = x + length * c
        particle[END_Y] = y + length * s
    elif to_right < to_level:
        particle[END_SIDE] = RIGHT
        particle[END_X] = size.width
        particle[END_Y] = y + to_right * s
    else:
        particle[END_SIDE] = TOP if s > 0.0 else BOTTOM
        particle[END_X] = x + to_level * c
        particle[END_Y] = size.height if s > 0.0 else 0.0


@jit
def plan_meeting(i: int, process: Process) -> None:
    """Find where particle `i` meets the one above it, as if neither ended before."""
    active = process.active
    active[i, MEET_X] = math.inf
    if i + 1 >= process.counts[N_ACTIVE]:
        return
    a, b = active[i], active[i + 1]
    closing = a[SIN] * b[COS] - a[COS] * b[SIN]
    if closing <= 0.0:
        return
    # Along a's own direction: the crossing stays on a steep trace, where a slope would lose the digits.
    length = (b[COS] * (b[START_Y] - a[START_Y]) - b[SIN] * (b[START_X] - a[START_X])) / closing
    active[i, MEET_X] = a[START_X] + length * a[COS]
    active[i, MEET_Y] = a[START_Y] + length * a[SIN]


@jit
def place(x: float, y: float, process: Process) -> int:
    """Return how many active particles pass below (x, y), by bisection."""
    low, high = 0, process.counts[N_ACTIVE]
    while low < high:
        middle = (low + high) // 2
        a = process.active[middle]
        if a[COS] * (y - a[START_Y]) - a[SIN] * (x - a[START_X]) > 0.0:
            low = middle + 1
        else:
            high = middle
    return low


@jit
def launch(particle: Array, direction: float, vertex: int, at: Array, size: Size, rng: Rng) -> None:
    """Fill a row with a particle that leaves the vertex ``at`` = (x, y, side)."""
    particle[START_X] = at[0]
    particle[START_Y] = at[1]
    particle[COS] = math.cos(direction)
    particle[SIN] = math.sin(direction)
    particle[VERTEX] = vertex
    plan_end(particle, size, rng)


@jit
def open_rows(i: int, n_new: int, process: Process) -> None:
    """Make room for `n_new` particles before row `i`."""
    n = process.counts[N_ACTIVE]
    for k in range(n - 1, i - 1, -1):
        process.active[k + n_new] = process.active[k]
    process.counts[N_ACTIVE] = n + n_new


@jit
def close_rows(i: int, n_removed: int, process: Process) -> None:
    """Remove `n_removed` particles from row `i` on, and plan the meeting of the two that become neighbours."""
    n = process.counts[N_ACTIVE] - n_removed
    for k in range(i, n):
        process.active[k] = process.active[k + n_removed]
    process.counts[N_ACTIVE] = n
    if i > 0:
        plan_meeting(i - 1, process)


@jit
def give_birth(at: Array, low: float, high: float, process: Process, size: Size, rng: Rng) -> None:
    """Start a particle at the vertex ``at`` in direction `low`, and a second one in direction `high` if inside."""
    n_new = 2 if at[2] == INTERIOR else 1
    vertex = add_vertex(at[0], at[1], int(at[2]), process)
    i = place(at[0], at[1], process)
    open_rows(i, n_new, process)
    launch(process.active[i], low, vertex, at, size, rng)
    if n_new == 2:
        launch(process.active[i + 1], high, vertex, at, size, rng)
    for k in range(max(i - 1, 0), i + n_new):
        plan_meeting(k, process)


@jit
def birth_after_start(x: float, process: Process, size: Size, rng: Rng) -> None:
    """Give birth at time `x`: inside, on the bottom or on the top, with probabilities as pi p^2 height : p : p.

    None is given to a line that is not kept.
    """
    inside = math.pi * size.p * size.height * peak(size.lines)
    chosen = rng.random() * (inside + 2.0)
    at = np.empty(3)
    at[0] = x
    low = high = 0.0
    if chosen < inside:
        at[1] = size.height * rng.random()
        at[2] = INTERIOR
        first = math.pi * (rng.random() - 0.5)
        second = wrapped(first + turn_angle(rng))
        if not (is_kept(first, size.lines, rng) and is_kept(second, size.lines, rng)):
            return
        low, high = min(first, second), max(first, second)
    elif chosen < inside + 1.0:
        at[1] = 0.0
        at[2] = BOTTOM
        low = math.acos(1.0 - rng.random())
        if not is_kept(low, size.lines, rng):
            return
    else:
        at[1] = size.height
        at[2] = TOP
        low = -math.acos(1.0 - rng.random())
        if not is_kept(low, size.lines, rng):
            return
    give_birth(at, low, high, process, size, rng)


@jit
def end_particle(i: int, process: Process, size: Size, rng: Rng) -> None:
    """End particle `i` where it was planned: it turns there, or stops on the border."""
    a = process.active[i]
    at = np.empty(3)
    at[0], at[1], at[2] = a[END_X], a[END_Y], a[END_SIDE]
    vertex = add_vertex(at[0], at[1], int(at[2]), process)
    add_edge(int(a[VERTEX]), vertex, process)
    if at[2] != INTERIOR:
        close_rows(i, 1, process)
        return
    direction = turned(math.atan2(a[SIN], a[COS]), size.lines, rng)
    launch(a, direction, vertex, at, size, rng)
    for k in range(max(i - 1, 0), i + 1):
        plan_meeting(k, process)


@jit
def meet(i: int, process: Process) -> None:
    """End particle `i` and the one above it where they meet."""
    active = process.active
    vertex = add_vertex(active[i, MEET_X], active[i, MEET_Y], INTERIOR, process)
    add_edge(int(active[i, VERTEX]), vertex, process)
    add_edge(int(active[i + 1, VERTEX]), vertex, process)
    close_rows(i, 2, process)


@jit
def next_event(process: Process) -> tuple[int, bool, float]:
    """Return the particle of the next event, whether it is a meeting, and its time (inf if none is active)."""
    which, is_meeting, time = 0, False, math.inf
    for i in range(process.counts[N_ACTIVE]):
        if process.active[i, END_X] < time:
            which, is_meeting, time = i, False, process.active[i, END_X]
        if process.active[i, MEET_X] < time:
            which, is_meeting, time = i, True, process.active[i, MEET_X]
    return which, is_meeting, time


@jit
def with_room(process: Process) -> Process:
    """Return the process with room for what one event can add, in longer copies of arrays where it is short."""
    active, vertices, edges, counts = process
    if counts[N_ACTIVE] + 2 > active.shape[0]:
        active = grown(active)
    if counts[N_VERTICES] + 1 > vertices.shape[0]:
        vertices = grown(vertices)
    if counts[N_EDGES] + 2 > edges.shape[0]:
        edges = grown(edges)
    return Process(active, vertices, edges, counts)


@jit
def draw_one(process: Process, size: Size, rng: Rng) -> Process:
    """Append one draw; return the process, whose arrays may have been replaced by longer copies."""
    at = np.zeros(3)
    at[2] = LEFT
    often = peak(size.lines)
    for _ in range(rng.poisson(2.0 * size.p * size.height * often)):
        process = with_room(process)
        at[1] = size.height * rng.random()
        direction = math.asin(2.0 * rng.random() - 1.0)
        if is_kept(direction, size.lines, rng):
            give_birth(at, direction, 0.0, process, size, rng)
    birth_rate = (math.pi * size.p * size.p * size.height * often + 2.0 * size.p) * often
    birth_x = rng.standard_exponential() / birth_rate
    while True:
        process = with_room(process)
        i, is_meeting, time = next_event(process)
        if birth_x < min(time, size.width):
            birth_after_start(birth_x, process, size, rng)
            birth_x += rng.standard_exponential() / birth_rate
        elif time == math.inf:
            return process
        elif is_meeting:
            meet(i, process)
        else:
            end_particle(i, process, size, rng)


@jit
def draw_many(n_draws: int, size: Size, lines: Array, rng: Rng) -> tuple[Array, Array, Array, Array]:
    """Return vertices ``x, y, side``, edges, offsets (n_draws + 1, 2) of vertices and edges, and the coins.

    `lines` (n_draws or 1, N_LINES): the law of directions of each draw, or of all.
    """
    counts = np.zeros(4, np.int64)
    process = Process(np.empty((16, N_COLUMNS)), np.empty((256, 3)), np.empty((256, 2), np.int32), counts)
    offsets = np.zeros((n_draws + 1, 2), np.int64)
    anchor_black = np.empty(n_draws, np.bool_)
    for k in range(n_draws):
        anchor_black[k] = rng.random() < 0.5
        counts[FIRST_VERTEX] = counts[N_VERTICES]
        own = Size(size.width, size.height, size.p, lines[min(k, lines.shape[0] - 1)])
        process = draw_one(process, own, rng)
        offsets[k + 1, 0] = counts[N_VERTICES]
        offsets[k + 1, 1] = counts[N_EDGES]
    return process.vertices[: counts[N_VERTICES]], process.edges[: counts[N_EDGES]], offsets, anchor_black
