"""Exact draws of the Arak process as a particle system in time x (dynamic representation; Arak & Surgailis 1989).

Window [0, width] x [0, height], scale p. Pairs of particles are born inside at rate pi p^2 per area, single ones on
the left side (rate 2p per length), the bottom and the top (rate p). A particle moves straight, turns at rate 2p per
length, dies on the border or, together, with the particle that it meets. The traces are the edges. Angles: f is the
direction in (-pi/2, pi/2); a turn adds d with density sin(d)/2 on (0, pi), wrapped mod pi.

The active particles are in order of y. Only neighbours can meet, so that an event looks at its neighbours alone and
the next event is the least of the rows' two times. Degenerate coincidences (probability zero) are not handled.

Arrays that turn out too small are replaced by longer copies in the kernel itself: a caller who restarts a draw would
have to rewind the random numbers.
"""

import math
from typing import NamedTuple

import numpy as np

from prf.kernels._jit import jit
from prf.kernels.constants import BOTTOM, INTERIOR, LEFT, RIGHT, TOP

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
    """Window [0, width] x [0, height] and scale p."""

    width: float
    height: float
    p: float


@jit
def grown(array: np.ndarray) -> np.ndarray:
    """Return a copy with twice the rows."""
    longer = np.empty((2 * array.shape[0], array.shape[1]), array.dtype)
    longer[: array.shape[0]] = array
    return longer


@jit
def wrapped(angle: float) -> float:
    """Return the direction of the same line in (-pi/2, pi/2], for an angle in (-pi/2, 3 pi/2)."""
    return angle - math.pi if angle > 0.5 * math.pi else angle


@jit
def turn_angle(rng: np.random.Generator) -> float:
    """Draw an angle in (0, pi) with density sin(d)/2."""
    return math.acos(1.0 - 2.0 * rng.random())


@jit
def add_vertex(x: float, y: float, side: int, vertices: np.ndarray, counts: np.ndarray) -> int:
    """Append a vertex ``x, y, side`` and return its index in the present draw."""
    index = counts[N_VERTICES]
    vertices[index, 0] = x
    vertices[index, 1] = y
    vertices[index, 2] = side
    counts[N_VERTICES] = index + 1
    return int(index - counts[FIRST_VERTEX])


@jit
def add_edge(start: int, end: int, edges: np.ndarray, counts: np.ndarray) -> None:
    """Append an edge."""
    edges[counts[N_EDGES], 0] = start
    edges[counts[N_EDGES], 1] = end
    counts[N_EDGES] += 1


@jit
def plan_end(particle: np.ndarray, size: Size, rng: np.random.Generator) -> None:
    """Draw where the particle turns (length Exp(2p)); the border ends it if that is nearer."""
    x, y, c, s = particle[START_X], particle[START_Y], particle[COS], particle[SIN]
    length = rng.standard_exponential() / (2.0 * size.p)
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
def plan_meeting(i: int, active: np.ndarray, n: int) -> None:
    """Find where particle `i` meets the one above it, as if neither ended before."""
    active[i, MEET_X] = math.inf
    if i + 1 >= n:
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
def place(x: float, y: float, active: np.ndarray, n: int) -> int:
    """Return how many active particles pass below (x, y), by bisection."""
    low, high = 0, n
    while low < high:
        middle = (low + high) // 2
        a = active[middle]
        if a[COS] * (y - a[START_Y]) - a[SIN] * (x - a[START_X]) > 0.0:
            low = middle + 1
        else:
            high = middle
    return low


@jit
def launch(
    i: int,
    direction: float,
    vertex: int,
    at: np.ndarray,
    active: np.ndarray,
    size: Size,
    rng: np.random.Generator,
) -> None:
    """Fill row `i` with a particle that leaves the vertex ``at`` = (x, y, side)."""
    active[i, START_X] = at[0]
    active[i, START_Y] = at[1]
    active[i, COS] = math.cos(direction)
    active[i, SIN] = math.sin(direction)
    active[i, VERTEX] = vertex
    plan_end(active[i], size, rng)


@jit
def open_rows(i: int, n_new: int, active: np.ndarray, counts: np.ndarray) -> None:
    """Make room for `n_new` particles before row `i`."""
    n = counts[N_ACTIVE]
    for k in range(n - 1, i - 1, -1):
        active[k + n_new] = active[k]
    counts[N_ACTIVE] = n + n_new


@jit
def close_rows(i: int, n_gone: int, active: np.ndarray, counts: np.ndarray) -> None:
    """Take out `n_gone` particles from row `i` on, and plan the meeting of the two that become neighbours."""
    n = counts[N_ACTIVE] - n_gone
    for k in range(i, n):
        active[k] = active[k + n_gone]
    counts[N_ACTIVE] = n
    if i > 0:
        plan_meeting(i - 1, active, n)


@jit
def give_birth(
    at: np.ndarray,
    low: float,
    high: float,
    active: np.ndarray,
    vertices: np.ndarray,
    counts: np.ndarray,
    size: Size,
    rng: np.random.Generator,
) -> None:
    """Start a particle at the vertex ``at`` in direction `low`, and a second one in direction `high` if inside."""
    n_new = 2 if at[2] == INTERIOR else 1
    vertex = add_vertex(at[0], at[1], int(at[2]), vertices, counts)
    i = place(at[0], at[1], active, counts[N_ACTIVE])
    open_rows(i, n_new, active, counts)
    launch(i, low, vertex, at, active, size, rng)
    if n_new == 2:
        launch(i + 1, high, vertex, at, active, size, rng)
    for k in range(max(i - 1, 0), i + n_new):
        plan_meeting(k, active, counts[N_ACTIVE])


@jit
def birth_after_start(
    x: float,
    active: np.ndarray,
    vertices: np.ndarray,
    counts: np.ndarray,
    size: Size,
    rng: np.random.Generator,
) -> None:
    """Give birth at time `x`: inside, on the bottom or on the top, with probabilities as pi p^2 height : p : p."""
    inside = math.pi * size.p * size.height
    chosen = rng.random() * (inside + 2.0)
    at = np.empty(3)
    at[0] = x
    low = high = 0.0
    if chosen < inside:
        at[1] = size.height * rng.random()
        at[2] = INTERIOR
        first = math.pi * (rng.random() - 0.5)
        second = wrapped(first + turn_angle(rng))
        low, high = min(first, second), max(first, second)
    elif chosen < inside + 1.0:
        at[1] = 0.0
        at[2] = BOTTOM
        low = math.acos(1.0 - rng.random())
    else:
        at[1] = size.height
        at[2] = TOP
        low = -math.acos(1.0 - rng.random())
    give_birth(at, low, high, active, vertices, counts, size, rng)


@jit
def end_particle(
    i: int,
    active: np.ndarray,
    vertices: np.ndarray,
    edges: np.ndarray,
    counts: np.ndarray,
    size: Size,
    rng: np.random.Generator,
) -> None:
    """End particle `i` where it was planned: it turns there, or stops on the border."""
    a = active[i]
    at = np.empty(3)
    at[0], at[1], at[2] = a[END_X], a[END_Y], a[END_SIDE]
    vertex = add_vertex(at[0], at[1], int(at[2]), vertices, counts)
    add_edge(int(a[VERTEX]), vertex, edges, counts)
    if at[2] != INTERIOR:
        close_rows(i, 1, active, counts)
        return
    direction = wrapped(math.atan2(a[SIN], a[COS]) + turn_angle(rng))
    launch(i, direction, vertex, at, active, size, rng)
    for k in range(max(i - 1, 0), i + 1):
        plan_meeting(k, active, counts[N_ACTIVE])


@jit
def meet(i: int, active: np.ndarray, vertices: np.ndarray, edges: np.ndarray, counts: np.ndarray) -> None:
    """End particle `i` and the one above it where they meet."""
    vertex = add_vertex(active[i, MEET_X], active[i, MEET_Y], INTERIOR, vertices, counts)
    add_edge(int(active[i, VERTEX]), vertex, edges, counts)
    add_edge(int(active[i + 1, VERTEX]), vertex, edges, counts)
    close_rows(i, 2, active, counts)


@jit
def next_event(active: np.ndarray, n: int) -> tuple[int, bool, float]:
    """Return the particle of the next event, whether it is a meeting, and its time (inf if none is active)."""
    which, is_meeting, time = 0, False, math.inf
    for i in range(n):
        if active[i, END_X] < time:
            which, is_meeting, time = i, False, active[i, END_X]
        if active[i, MEET_X] < time:
            which, is_meeting, time = i, True, active[i, MEET_X]
    return which, is_meeting, time


@jit
def with_room(
    active: np.ndarray, vertices: np.ndarray, edges: np.ndarray, counts: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the arrays, or longer copies, with room for what one event can add."""
    if counts[N_ACTIVE] + 2 > active.shape[0]:
        active = grown(active)
    if counts[N_VERTICES] + 1 > vertices.shape[0]:
        vertices = grown(vertices)
    if counts[N_EDGES] + 2 > edges.shape[0]:
        edges = grown(edges)
    return active, vertices, edges


@jit
def draw_one(
    active: np.ndarray,
    vertices: np.ndarray,
    edges: np.ndarray,
    counts: np.ndarray,
    size: Size,
    rng: np.random.Generator,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Append one draw; return ``active, vertices, edges``, which may have been replaced by longer copies."""
    at = np.zeros(3)
    at[2] = LEFT
    for _ in range(rng.poisson(2.0 * size.p * size.height)):
        active, vertices, edges = with_room(active, vertices, edges, counts)
        at[1] = size.height * rng.random()
        direction = math.asin(2.0 * rng.random() - 1.0)
        give_birth(at, direction, 0.0, active, vertices, counts, size, rng)
    birth_rate = math.pi * size.p * size.p * size.height + 2.0 * size.p
    birth_x = rng.standard_exponential() / birth_rate
    while True:
        active, vertices, edges = with_room(active, vertices, edges, counts)
        i, is_meeting, time = next_event(active, counts[N_ACTIVE])
        if birth_x < min(time, size.width):
            birth_after_start(birth_x, active, vertices, counts, size, rng)
            birth_x += rng.standard_exponential() / birth_rate
        elif time == math.inf:
            return active, vertices, edges
        elif is_meeting:
            meet(i, active, vertices, edges, counts)
        else:
            end_particle(i, active, vertices, edges, counts, size, rng)


@jit
def draw_many(
    n_draws: int, size: Size, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return vertices ``x, y, side``, edges, offsets (n_draws + 1, 2) of vertices and edges, and the coins."""
    active = np.empty((16, N_COLUMNS))
    vertices = np.empty((256, 3))
    edges = np.empty((256, 2), np.int32)
    counts = np.zeros(4, np.int64)
    offsets = np.zeros((n_draws + 1, 2), np.int64)
    anchor_black = np.empty(n_draws, np.bool_)
    for k in range(n_draws):
        anchor_black[k] = rng.random() < 0.5
        counts[FIRST_VERTEX] = counts[N_VERTICES]
        active, vertices, edges = draw_one(active, vertices, edges, counts, size, rng)
        offsets[k + 1, 0] = counts[N_VERTICES]
        offsets[k + 1, 1] = counts[N_EDGES]
    return vertices[: counts[N_VERTICES]], edges[: counts[N_EDGES]], offsets, anchor_black
