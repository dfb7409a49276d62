"""A numpy Generator that returns chosen numbers, in compiled code too, and the numbers that make a move propose a map.

A kernel draws ``rng.random()`` in a fixed order; each function here solves that order for a given result. A script that
no longer fits its kernel does not reach its map, which the tests notice.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Sequence

import numpy as np

from prf.kernels import constants as c
from prf.kernels.state.chain import Chain
from prf.kernels.state.targets import Targets
from prf.model.window import Window
from tests.reference.plain_map import PlainMap, Point, foot_and_offset, other
from tests.reference.proposals import Plan, new_points, square_corner, unit

FINEST = 2.0**-53
"""Numbers are multiples of this."""


class Way(float):
    """A number that chooses between two equal ways."""


FIRST, SECOND = Way(0.5 - FINEST), Way(0.5)
"""The first and the second of two equal ways, as near to where they part as numbers come: a kernel that parts them
elsewhere goes the wrong way.
"""
WORDS = 624


def scripted(numbers: Sequence[float]) -> np.random.Generator:
    """Return a Generator whose next ``random()`` are `numbers` in [0, 1): its 19937 bits of state hold them.

    MT19937 puts each word of its state through an invertible tempering and makes a double of 27 and 26 bits.
    """
    key = np.zeros(WORDS, np.uint32)
    for k, number in enumerate(numbers):
        bits = int(number * 2.0**53)
        key[2 * k] = _untempered((bits >> 26) << 5)
        key[2 * k + 1] = _untempered((bits & (2**26 - 1)) << 6)
    generator = np.random.MT19937()
    generator.state = {"bit_generator": "MT19937", "state": {"key": key, "pos": 0}}
    return np.random.Generator(generator)


def below(share: float) -> float:
    """The last number for which a kernel does what it does with this probability."""
    return max((math.ceil(share / FINEST) - 1) * FINEST, 0.0)


def beyond(share: float) -> float:
    """The first number for which it does not."""
    return min(math.ceil(share / FINEST) * FINEST, 1.0 - FINEST)


def _untempered(word: int) -> int:
    """Invert the tempering of Matsumoto and Nishimura (1998)."""
    word ^= word >> 18
    word ^= (word << 15) & 0xEFC60000
    low = word
    for _ in range(4):
        low = word ^ ((low << 7) & 0x9D2C5680)
    word = low & 0xFFFFFFFF
    high = word
    for _ in range(2):
        high = word ^ (high >> 11)
    return high


Script = Callable[[Chain, PlainMap, PlainMap, Plan], Iterator[list[float]]]
"""Numbers that make the move at x propose y; several lists where the order of a list in the kernel is not known."""


def vertex_slot(chain: Chain, v: Point) -> int:
    (alive,) = np.nonzero((chain.graph.positions[c.INTERIOR_VERTICES : c.BOUNDARY_VERTICES + 1] != c.NONE).any(axis=0))
    (found,) = np.nonzero((chain.graph.vertex_xy[alive] == v).all(axis=1))
    return int(alive[found[0]])


def edge_slot(chain: Chain, edge: frozenset[Point]) -> int:
    u, w = (vertex_slot(chain, v) for v in edge)
    for slot in chain.graph.vertex_edges[u]:
        if slot != c.NONE and set(chain.graph.edge_vertices[slot].tolist()) == {u, w}:
            return int(slot)
    raise LookupError(f"no edge {sorted(edge)}")


def pick(chain: Chain, kind: int, slot: int) -> float:
    """The number with which a kernel picks `slot` from a set."""
    return (chain.graph.positions[kind, slot] + 0.5) / chain.graph.counts[kind]


def pick_vertex(chain: Chain, kind: int, v: Point) -> float:
    return pick(chain, kind, vertex_slot(chain, v))


def end_points(chain: Chain, edge: frozenset[Point]) -> tuple[Point, Point]:
    """Ends of an edge in the order of its slot."""
    first, last = chain.graph.vertex_xy[chain.graph.edge_vertices[edge_slot(chain, edge)]]
    return (float(first[0]), float(first[1])), (float(last[0]), float(last[1]))


def reached(r: float, m: float) -> float:
    return r / (m + r)


def across(window: Window, v: Point) -> list[float]:
    return [(v[0] - window.x_min) / window.width, (v[1] - window.y_min) / window.height]


def along(window: Window, side: int, v: Point) -> float:
    return across(window, v)[side % 2]


def gone_vertex(x: PlainMap, y: PlainMap) -> Point:
    (v,) = x.side.keys() - y.side.keys()
    return v


def triangle_birth(chain: Chain, x: PlainMap, y: PlainMap, plan: Plan) -> Iterator[list[float]]:
    yield [*aimed(plan), beyond(plan.local), *(share for v in new_points(x, y, False) for share in across(x.window, v))]


def aimed(plan: Plan) -> list[float]:
    """The number that lets a birth be free, which all are where there are no targets."""
    return [beyond(plan.aimed)] if plan.aimed > 0.0 else []


def triangle_death(chain: Chain, x: PlainMap, y: PlainMap, plan: Plan) -> Iterator[list[float]]:
    for v in x.side.keys() - y.side.keys():
        yield [pick_vertex(chain, c.TRIANGLE_VERTICES, v)]


def boundary_birth(chain: Chain, x: PlainMap, y: PlainMap, plan: Plan) -> Iterator[list[float]]:
    u, v = new_points(x, y, True)
    (apex,) = new_points(x, y, False)
    side, window = y.side[u], x.window
    before = sum(window.side_length(s) for s in range(side))
    middle = (before + 0.5 * window.side_length(side)) / window.perimeter
    yield [beyond(plan.local), middle, along(window, side, u), along(window, side, v), *across(window, apex)]


def boundary_death(chain: Chain, x: PlainMap, y: PlainMap, plan: Plan) -> Iterator[list[float]]:
    (apex,) = [v for v in x.interior() if v not in y.side]
    yield [pick_vertex(chain, c.BOUNDARY_APEXES, apex)]


def corner_birth(chain: Chain, x: PlainMap, y: PlainMap, plan: Plan) -> Iterator[list[float]]:
    u, v = new_points(x, y, True)
    if (y.side[u] + 1) % 4 != y.side[v]:
        u, v = v, u
    yield [beyond(plan.local), (y.side[u] + 0.5) / 4.0, along(x.window, y.side[u], u), along(x.window, y.side[v], v)]


def corner_death(chain: Chain, x: PlainMap, y: PlainMap, plan: Plan) -> Iterator[list[float]]:
    (edge,) = x.edges - y.edges
    yield [pick(chain, c.CORNER_CUTS, edge_slot(chain, edge))]


def split(chain: Chain, x: PlainMap, y: PlainMap, plan: Plan) -> Iterator[list[float]]:
    (edge,) = x.edges - y.edges
    (v,) = new_points(x, y, False)
    u, w = end_points(chain, edge)
    foot, offset = foot_and_offset(v, u, w)
    picked = pick(chain, c.EDGES, edge_slot(chain, edge))
    if plan.square_share > 0.0:
        corner = square_corner(u, w, plan.orientation)
        direction = math.atan2(v[1] - corner[1], v[0] - corner[0]) / (2.0 * math.pi) % 1.0
        yield [picked, below(plan.square_share), FIRST, reached(math.dist(v, corner), plan.cut_reach), direction]
    if 0.0 < foot < 1.0:
        beside = [foot, reached(abs(offset), plan.split_reach), SECOND if offset > 0.0 else FIRST]
        yield [picked, *not_squared(plan), *beside]


def not_squared(plan: Plan) -> list[float]:
    """The number that lets a corner be put anywhere, as all are where edges prefer no direction."""
    return [beyond(plan.square_share)] if plan.square_share > 0.0 else []


def merge(chain: Chain, x: PlainMap, y: PlainMap, plan: Plan) -> Iterator[list[float]]:
    yield [pick_vertex(chain, c.INTERIOR_VERTICES, min(x.side.keys() - y.side.keys()))]


def move_interior(chain: Chain, x: PlainMap, y: PlainMap, plan: Plan) -> Iterator[list[float]]:
    v, (moved,) = gone_vertex(x, y), new_points(x, y, False)
    direction = math.atan2(moved[1] - v[1], moved[0] - v[0]) / (2.0 * math.pi) % 1.0
    picked = pick_vertex(chain, c.INTERIOR_VERTICES, v)
    yield [picked, *not_squared(plan), reached(math.dist(v, moved), plan.move_reach), direction]


def move_boundary(chain: Chain, x: PlainMap, y: PlainMap, plan: Plan) -> Iterator[list[float]]:
    v, (moved,) = gone_vertex(x, y), new_points(x, y, True)
    yield [pick_vertex(chain, c.BOUNDARY_VERTICES, v), beyond(plan.local), along(x.window, y.side[moved], moved)]


def past_corner(chain: Chain, x: PlainMap, y: PlainMap, plan: Plan) -> Iterator[list[float]]:
    v, (moved,) = gone_vertex(x, y), new_points(x, y, True)
    turn = FIRST if (x.side[v] + 1) % 4 == y.side[moved] else SECOND
    yield [pick_vertex(chain, c.BOUNDARY_VERTICES, v), turn, beyond(plan.local), along(x.window, y.side[moved], moved)]


def rejoining(chain: Chain, e: frozenset[Point], f: frozenset[Point], y: PlainMap) -> float:
    a, _ = end_points(chain, e)
    p, _ = end_points(chain, f)
    return SECOND if frozenset((a, p)) in y.edges else FIRST


def recolor(chain: Chain, x: PlainMap, y: PlainMap, plan: Plan) -> Iterator[list[float]]:
    e, f = x.edges - y.edges
    n = len(x.edges)
    i, k = (int(chain.graph.positions[c.EDGES, edge_slot(chain, edge)]) for edge in (e, f))
    yield [(i + 0.5) / n, (k - (k > i) + 0.5) / (n - 1), rejoining(chain, e, f, y)]


def local_recolor(chain: Chain, x: PlainMap, y: PlainMap, plan: Plan) -> Iterator[list[float]]:
    e, f = x.edges - y.edges
    n = len(x.edges)
    for place in range(n):
        picked = pick(chain, c.EDGES, edge_slot(chain, e))
        yield [picked, (place + 0.5) / n, rejoining(chain, e, f, y)]


def slide(chain: Chain, x: PlainMap, y: PlainMap, plan: Plan) -> Iterator[list[float]]:
    v, (moved,) = gone_vertex(x, y), new_points(x, y, False)
    slot = vertex_slot(chain, v)
    for k, edge in enumerate(x.edges_at(v)):
        u = other(edge, v)
        stretch = math.dist(u, moved) / math.dist(u, v)
        k = 0 if chain.graph.vertex_edges[slot, 0] == edge_slot(chain, edge) else 1
        if 0.5 <= stretch < 2.0:
            yield [pick(chain, c.INTERIOR_VERTICES, slot), SECOND if k else FIRST, (stretch - 0.5) / 1.5]


def outer(x: PlainMap, jamb: Iterable[Point]) -> list[Point]:
    """The neighbours of a jamb's corners along the walls, in the order of the corners."""
    p, s = jamb
    return [u for v, w in ((p, s), (s, p)) for u in x.neighbors(v) if u != w]


def signed(distance: float, m: float) -> list[float]:
    return [reached(abs(distance), m), FIRST if distance > 0.0 else SECOND]


def cut_wall(chain: Chain, x: PlainMap, y: PlainMap, plan: Plan) -> Iterator[list[float]]:
    m = plan.cut_reach
    for e, f in itertools.permutations(x.edges - y.edges):
        (a, b), face = end_points(chain, e), end_points(chain, f)
        (p,), (q,) = ([w for w in y.neighbors(v) if w not in x.side] for v in (a, b))
        (s,), (t,) = ([w for w in y.neighbors(v) if w not in x.side] for v in (p, q))
        feet = [foot_and_offset(v, a, b) for v in (p, q)]
        gap = (feet[1][0] - feet[0][0]) * math.dist(a, b)
        first = [feet[0][0], reached(gap, plan.birth_reach), *signed(feet[0][1], m), *signed(feet[1][1], m)]
        far = [foot_and_offset(v, *face) for v in (s, t)]
        shadows = [foot_and_offset(v, *face)[0] for v in (p, q)]
        second = []
        for (foot, _), shadow in zip(far, shadows, strict=True):
            second += signed((foot - shadow) * math.dist(*face), m)
        second += [*signed(far[0][1], m), *signed(far[1][1], m)]
        # The largest number that lets an edge of its length pass.
        kept = below(math.dist(a, b) / math.hypot(x.window.width, x.window.height) * (1.0 - 1e-12))
        for place in range(len(x.edges)):
            yield [pick(chain, c.EDGES, edge_slot(chain, e)), kept, *first, (place + 0.5) / len(x.edges), *second]


def mend_wall(chain: Chain, x: PlainMap, y: PlainMap, plan: Plan) -> Iterator[list[float]]:
    jambs = [edge for edge in x.edges if not edge & y.side.keys()]
    for j, k in itertools.permutations(jambs):
        a, _ = outer(x, end_points(chain, j))
        b, _ = outer(x, end_points(chain, k))
        pairing = SECOND if frozenset((a, b)) in y.edges else FIRST
        for place in range(len(x.edges)):
            yield [pick(chain, c.EDGES, edge_slot(chain, j)), (place + 0.5) / len(x.edges), pairing]


def places(x: PlainMap) -> list[float]:
    """Numbers among which are those of every place in a list of edges whose order is the kernel's own."""
    return [(place + 0.5) / len(x.edges) for place in range(len(x.edges))]


def join_wall(chain: Chain, x: PlainMap, y: PlainMap, plan: Plan) -> Iterator[list[float]]:
    m = plan.cut_reach
    for e, f in itertools.permutations(x.edges - y.edges):
        (u, v), (a, b) = end_points(chain, e), end_points(chain, f)
        (p,), (q,) = ([w for w in y.neighbors(end) if w not in x.side] for end in (u, v))
        corners = [foot_and_offset(w, a, b) for w in (p, q)]
        shifts = []
        for (foot, _), end in zip(corners, (u, v), strict=True):
            shifts += signed((foot - foot_and_offset(end, a, b)[0]) * math.dist(a, b), plan.join_reach)
        for place in places(x):
            aside = [*signed(corners[0][1], m), *signed(corners[1][1], m)]
            yield [pick(chain, c.EDGES, edge_slot(chain, e)), place, *shifts, *aside]


def part_wall(chain: Chain, x: PlainMap, y: PlainMap, plan: Plan) -> Iterator[list[float]]:
    gone = x.side.keys() - y.side.keys()
    links = [edge for edge in x.edges - y.edges if len(edge & gone) == 1]
    for j, k in itertools.permutations(links, 2):
        ends = [FIRST if end_points(chain, link)[0] in gone else SECOND for link in (j, k)]
        for place in places(x):
            yield [pick(chain, c.EDGES, edge_slot(chain, j)), place, *ends]


def dock(chain: Chain, x: PlainMap, y: PlainMap, plan: Plan) -> Iterator[list[float]]:
    (e,) = x.edges - y.edges
    numbers = [pick(chain, c.EDGES, edge_slot(chain, e))]
    for u in end_points(chain, e):
        (p,) = (w for w in y.neighbors(u) if w not in x.side)
        axis = y.side[p] % 2
        numbers += signed(p[axis] - u[axis], plan.join_reach)
    yield numbers


def undock(chain: Chain, x: PlainMap, y: PlainMap, plan: Plan) -> Iterator[list[float]]:
    n = len(x.boundary())
    p, q = x.side.keys() - y.side.keys()
    i, k = (int(chain.graph.positions[c.BOUNDARY_VERTICES, vertex_slot(chain, v)]) for v in (p, q))
    yield [(i + 0.5) / n, (k - (k > i) + 0.5) / (n - 1)]


def picked_by(targets: Targets, square: tuple[int, int]) -> float:
    """The number that picks a square: the middle of its share."""
    number = number_of(targets, square)
    return float(targets.cumulative[number] + (targets.cumulative[number - 1] if number > 0 else 0.0)) / 2.0


def number_of(targets: Targets, square: tuple[int, int]) -> int:
    return int(targets.number[square[0] + targets.grid.nx * square[1]])


def within(plan: Plan, square: tuple[int, int], v: Point) -> list[float]:
    """Coordinates of a point in its square, as shares of the side."""
    grid = plan.target_grid
    assert grid is not None
    return [(v[0] - grid.x0) / grid.cell - square[0], (v[1] - grid.y0) / grid.cell - square[1]]


def notch(chain: Chain, x: PlainMap, y: PlainMap, plan: Plan) -> Iterator[list[float]]:
    new = new_points(x, y, False)
    (edge,) = x.edges - y.edges
    a, b = end_points(chain, edge)
    (p,), (q,) = ([w for w in y.neighbors(end) if w in new] for end in (a, b))
    inner = [v for v in new if v not in (p, q)]
    for first, last, near, far in ((inner[0], inner[-1], p, q), (inner[-1], inner[0], q, p)):
        square = plan.target(first)
        if square is None:
            continue
        if near not in y.neighbors(first):
            near, far = far, near
        number = picked_by(chain.targets, square)
        corners = tooth(a, b, p, first, q, plan) if len(new) == 3 else niche(a, b, near, first, last, far, plan)
        for place in places(x):
            yield [FIRST if len(new) == 3 else SECOND, number, *within(plan, square, first), place, *corners]


def tooth(a: Point, b: Point, p: Point, t: Point, q: Point, plan: Plan) -> list[float]:
    """Numbers of the corners of a tooth with its tip at t."""
    (on_p, off_p), (on_t, _), (on_q, off_q) = (foot_and_offset(v, a, b) for v in (p, t, q))
    gaps = [reached((end - start) * math.dist(a, b), plan.join_reach) for start, end in ((on_p, on_t), (on_t, on_q))]
    return [*gaps, *signed(off_p, plan.cut_reach), *signed(off_q, plan.cut_reach)]


def niche(a: Point, b: Point, p: Point, s: Point, t: Point, q: Point, plan: Plan) -> list[float]:
    """Numbers of the corners of a niche with an inner corner at s."""
    length = math.dist(a, b)
    (on_p, off_p), (on_s, depth_s), (on_t, depth_t), (on_q, off_q) = (foot_and_offset(v, a, b) for v in (p, s, t, q))
    small = (depth_t - depth_s, (on_p - on_s) * length, (on_q - on_t) * length, off_p, off_q)
    numbers = signed((on_t - on_s) * length, plan.join_reach)
    for distance in small:
        numbers += signed(distance, plan.cut_reach)
    return numbers


def fill(chain: Chain, x: PlainMap, y: PlainMap, plan: Plan) -> Iterator[list[float]]:
    (new,) = y.edges - x.edges
    gone = x.side.keys() - y.side.keys()
    inner = [v for v in gone if not any(w in new for w in x.neighbors(v))]
    if len(gone) == 3:
        yield [FIRST, pick_vertex(chain, c.INTERIOR_VERTICES, inner[0])]
    else:
        yield [SECOND, pick(chain, c.EDGES, edge_slot(chain, frozenset(inner)))]


def bend(chain: Chain, x: PlainMap, y: PlainMap, plan: Plan) -> Iterator[list[float]]:
    (v,) = new_points(x, y, False)
    square = plan.target(v)
    if square is not None:
        for place in places(x):
            yield [picked_by(chain.targets, square), *within(plan, square, v), place]


def box_birth(chain: Chain, x: PlainMap, y: PlainMap, plan: Plan) -> Iterator[list[float]]:
    u, *_ = new_points(x, y, False)
    v, t = y.neighbors(u)
    yield [0.5 / 3.0, *aimed(plan), *across(x.window, u), *box_sides(u, v, t, y, plan, plan.aim_reach)]


def box_sides(u: Point, v: Point, t: Point, y: PlainMap, plan: Plan, size: float) -> list[float]:
    """Numbers of the corners v along the building from u, t across it, and that opposite."""
    (w,) = set(y.neighbors(v)) - {u}
    along, m = unit(plan.orientation), plan.cut_reach
    shifts = [(p[0] - u[0], p[1] - u[1]) for p in (v, t, w)]
    (v1, v2), (t1, t2), (w1, w2) = ((dx * along[0] + dy * along[1], dy * along[0] - dx * along[1]) for dx, dy in shifts)
    numbers = [*signed(v1, size), *signed(v2, m), *signed(t2, size), *signed(t1, m)]
    return [*numbers, *signed(w1 - v1 - t1, m), *signed(w2 - v2 - t2, m)]


SCRIPTS: dict[int, Script] = {
    getattr(c, each.__name__.upper()): each
    for each in (
        *(triangle_birth, triangle_death, boundary_birth, boundary_death, corner_birth, corner_death),
        *(split, merge, move_interior, move_boundary, past_corner, recolor),
        *(local_recolor, slide, cut_wall, mend_wall, join_wall, part_wall),
        *(dock, undock, notch, fill, bend, box_birth),
    )
}
SCRIPTS[c.UNBEND] = SCRIPTS[c.BOX_DEATH] = merge
