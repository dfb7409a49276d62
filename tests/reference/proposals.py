"""Slow reference of the moves: every way in which a move could have proposed a given map, and the density of each.

Written from ``docs/moves.md`` and equations 1 to 3 of the paper alone. Each function of `WAYS` runs through all picks
that the move can make at x - ordered triples, sides, edges, vertices, rejoinings - with continuous choices taken from
the vertices that are new in y, and yields the edges that go, the edges that come and the density of that pick. What
leads to y is summed up. Densities are with respect to area for an interior vertex and length for a boundary vertex;
the slide, whose new vertex lies on a ray, with respect to the share ``r dr`` of the area along it.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Mapping
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from prf.kernels import constants as c
from prf.kernels.state.grid import Grid
from prf.model.coloring import Coloring
from prf.model.orientation import PLAIN, Orientation
from prf.model.window import INTERIOR
from tests.reference.plain_map import (
    Edges,
    PlainMap,
    Point,
    anchor_changes,
    chain,
    closed,
    corner_between,
    foot_and_offset,
    nearest_side,
    plain_map,
    round_the_cut,
    round_the_middle,
    round_the_point,
    sharing_cells,
)
from tests.reference.slow_coloring import slab_area, slow_log_density, slow_log_directions

Way = tuple[Edges, Edges, float]
NOTHING: Edges = frozenset()

REVERSE = {
    c.TRIANGLE_BIRTH: c.TRIANGLE_DEATH,
    c.BOUNDARY_BIRTH: c.BOUNDARY_DEATH,
    c.CORNER_BIRTH: c.CORNER_DEATH,
    c.SPLIT: c.MERGE,
    c.CUT_WALL: c.MEND_WALL,
    c.JOIN_WALL: c.PART_WALL,
    c.DOCK: c.UNDOCK,
    c.NOTCH: c.FILL,
    c.BEND: c.UNBEND,
    c.BOX_BIRTH: c.BOX_DEATH,
}
REVERSE |= {back: move for move, back in REVERSE.items()}


class Plan(NamedTuple):
    """What the proposals depend on besides the map."""

    scale: float
    local: float
    birth_reach: float
    split_reach: float
    move_reach: float
    cut_reach: float
    join_reach: float
    move_probabilities: NDArray[np.float64]
    grid: Grid
    aimed: float = 0.0
    aim_reach: float = 0.1
    target_grid: Grid | None = None
    targets: Mapping[tuple[int, int], float] = MappingProxyType({})
    orientation: Orientation = PLAIN
    square_share: float = 0.0
    free_space: float = 0.0

    def target(self, v: Point) -> tuple[int, int] | None:
        """The square, by column and row, that holds a point, if a reading ended there."""
        if self.target_grid is None:
            return None
        grid = self.target_grid
        square = math.floor((v[0] - grid.x0) / grid.cell), math.floor((v[1] - grid.y0) / grid.cell)
        return square if square in self.targets else None

    def near_target(self, square: tuple[int, int]) -> list[tuple[int, int]]:
        return [other for other in self.targets if math.dist(square, other) <= 12.0]


SIZES = (1.0, 0.3, 0.09)
"""Sizes of aimed births, over the median that they are made with."""


def reach(r: float, m: float) -> float:
    """Density of a distance with median m."""
    return m / (m + r) ** 2


def near(a: Point, b: Point, m: float) -> float:
    """Density in the plane of a point b at such a distance from a, in a uniform direction."""
    return reach(math.dist(a, b), m) / (2.0 * math.pi * math.dist(a, b))


def new_points(x: PlainMap, y: PlainMap, on_border: bool) -> list[Point]:
    return [v for v in (y.boundary() if on_border else y.interior()) if v not in x.side]


def triangle_birth(x: PlainMap, y: PlainMap, plan: Plan) -> Iterator[Way]:
    area, m = x.window.area, plan.birth_reach
    for u, v, w in itertools.permutations(new_points(x, y, False), 3):
        uniform = 1.0 / area**3
        local = 1.0 / area * near(u, v, m) * near(u, w, m)
        free = (1.0 - plan.local) * uniform + plan.local * local
        sizes = [plan.aim_reach * factor for factor in SIZES]
        aimed = sum(0.5 * (post(u, v, w, m, plan) + panel(u, v, w, m, plan)) for m in sizes) / len(sizes)
        yield NOTHING, closed(u, v, w), (1.0 - plan.aimed) * free + plan.aimed * aimed


def post(u: Point, v: Point, w: Point, m: float, plan: Plan) -> float:
    """Density of u in a target, v and w round it."""
    return aimed_at(u, plan) * near(u, v, m) * near(u, w, m)


def panel(u: Point, v: Point, w: Point, m: float, plan: Plan) -> float:
    """Density of u in a target, v in a target near that one, and w beside the line of both."""
    one, other = plan.target(u), plan.target(v)
    if one is None or other is None or plan.target_grid is None or other not in plan.near_target(one):
        return 0.0
    ends = aimed_at(u, plan) / (len(plan.near_target(one)) * plan.target_grid.cell**2)
    foot, offset = foot_and_offset(w, u, v)
    return ends * 0.5 * reach(abs(offset), m) / math.dist(u, v) if 0.0 < foot < 1.0 else 0.0


def triangle_death(x: PlainMap, y: PlainMap, plan: Plan) -> Iterator[Way]:
    loops = set()
    for v in x.interior():
        a, b = x.neighbors(v)
        if frozenset((a, b)) in x.edges:
            loops.add(closed(a, b, v))
    for loop in loops:
        yield loop, NOTHING, 1.0 / len(loops)


def boundary_birth(x: PlainMap, y: PlainMap, plan: Plan) -> Iterator[Way]:
    m = plan.birth_reach
    for u, v in itertools.permutations(new_points(x, y, True), 2):
        if not y.same_side(u, v):
            continue
        length = x.window.side_length(y.side[u])
        first = length / x.window.perimeter / length
        for apex in new_points(x, y, False):
            uniform = first / length / x.window.area
            local = first * 0.5 * reach(math.dist(u, v), m) * near(u, apex, m)
            yield NOTHING, chain(u, apex, v), (1.0 - plan.local) * uniform + plan.local * local


def boundary_death(x: PlainMap, y: PlainMap, plan: Plan) -> Iterator[Way]:
    apexes = [v for v in x.interior() if x.same_side(*x.neighbors(v))]
    for v in apexes:
        yield frozenset(x.edges_at(v)), NOTHING, 1.0 / len(apexes)


def corner_birth(x: PlainMap, y: PlainMap, plan: Plan) -> Iterator[Way]:
    m = plan.birth_reach
    for side, (u, v) in itertools.product(range(4), itertools.permutations(new_points(x, y, True), 2)):
        if (y.side[u], y.side[v]) != (side, (side + 1) % 4):
            continue
        corner = corner_between(x.window, y.side[u], y.side[v])
        assert corner is not None
        uniform = 1.0 / (x.window.side_length(y.side[u]) * x.window.side_length(y.side[v]))
        local = reach(math.dist(corner, u), m) * reach(math.dist(corner, v), m)
        yield NOTHING, chain(u, v), 0.25 * ((1.0 - plan.local) * uniform + plan.local * local)


def corner_death(x: PlainMap, y: PlainMap, plan: Plan) -> Iterator[Way]:
    ends = {edge: [x.side[v] for v in edge] for edge in x.edges}
    cuts = [edge for edge, (s, t) in ends.items() if min(s, t) >= 0 and (s - t) % 4 in (1, 3)]
    for edge in cuts:
        yield frozenset([edge]), NOTHING, 1.0 / len(cuts)


def split(x: PlainMap, y: PlainMap, plan: Plan) -> Iterator[Way]:
    for edge, v in itertools.product(x.edges, new_points(x, y, False)):
        u, w = edge
        foot, offset = foot_and_offset(v, u, w)
        if 0.0 < foot < 1.0:
            density = (1.0 - plan.square_share) * reach(abs(offset), plan.split_reach) / (2.0 * math.dist(u, w))
            yield frozenset([edge]), chain(u, v, w), density / len(x.edges)
        yield frozenset([edge]), chain(u, v, w), squared(u, w, v, plan) / len(x.edges)


def squared(u: Point, w: Point, v: Point, plan: Plan) -> float:
    """Density of v near one of the corners from which the building's directions lead to u and w, if it is put there."""
    corners = [square_corner(u, w, plan.orientation), square_corner(w, u, plan.orientation)]
    return plan.square_share * sum(0.5 * near(corner, v, plan.cut_reach) for corner in corners)


def square_corner(u: Point, w: Point, orientation: Orientation) -> Point:
    """The foot of w on the line along the building through u."""
    along = unit(orientation)
    foot = (w[0] - u[0]) * along[0] + (w[1] - u[1]) * along[1]
    return u[0] + foot * along[0], u[1] + foot * along[1]


def unit(orientation: Orientation) -> Point:
    angle = orientation.angle or 0.0
    return math.cos(angle), math.sin(angle)


def merge(x: PlainMap, y: PlainMap, plan: Plan) -> Iterator[Way]:
    for v in x.interior():
        a, b = x.neighbors(v)
        is_legal = frozenset((a, b)) not in x.edges and not x.same_side(a, b)
        if is_legal and (plan.square_share > 0.0 or 0.0 < foot_and_offset(v, a, b)[0] < 1.0):
            yield frozenset(x.edges_at(v)), chain(a, b), 1.0 / len(x.interior())


def move_interior(x: PlainMap, y: PlainMap, plan: Plan) -> Iterator[Way]:
    for v, moved in itertools.product(x.interior(), new_points(x, y, False)):
        a, b = x.neighbors(v)
        density = (1.0 - plan.square_share) * near(v, moved, plan.move_reach) + squared(a, b, moved, plan)
        yield frozenset(x.edges_at(v)), chain(a, moved, b), density / len(x.interior())


def move_boundary(x: PlainMap, y: PlainMap, plan: Plan) -> Iterator[Way]:
    for v, moved in itertools.product(x.boundary(), new_points(x, y, True)):
        if x.side[v] == y.side[moved]:
            (a,) = x.neighbors(v)
            uniform = 1.0 / x.window.side_length(x.side[v])
            local = 0.5 * reach(math.dist(v, moved), plan.move_reach)
            density = (1.0 - plan.local) * uniform + plan.local * local
            yield frozenset(x.edges_at(v)), chain(a, moved), density / len(x.boundary())


def past_corner(x: PlainMap, y: PlainMap, plan: Plan) -> Iterator[Way]:
    for v, moved in itertools.product(x.boundary(), new_points(x, y, True)):
        (a,) = x.neighbors(v)
        corner = corner_between(x.window, x.side[v], y.side[moved])
        if corner is not None and x.side[a] != y.side[moved]:
            uniform = 1.0 / x.window.side_length(y.side[moved])
            local = reach(math.dist(corner, moved), plan.birth_reach)
            density = (1.0 - plan.local) * uniform + plan.local * local
            yield frozenset(x.edges_at(v)), chain(a, moved), 0.5 * density / len(x.boundary())


def rejoinings(x: PlainMap, e: frozenset[Point], f: frozenset[Point]) -> Iterator[Edges]:
    """The legal ones of the two ways to rejoin the ends of two edges."""
    (a, b), (u, v) = sorted(e), sorted(f)
    for new in (frozenset(map(frozenset, ((a, u), (b, v)))), frozenset(map(frozenset, ((a, v), (b, u))))):
        if not e & f and not new & x.edges and not any(x.same_side(*edge) for edge in new):
            yield new


def recolor(x: PlainMap, y: PlainMap, plan: Plan) -> Iterator[Way]:
    n = len(x.edges)
    for e, f in itertools.permutations(x.edges, 2):
        for new in rejoinings(x, e, f):
            yield frozenset((e, f)), new, 0.5 / (n * (n - 1))


def local_recolor(x: PlainMap, y: PlainMap, plan: Plan) -> Iterator[Way]:
    near_by = sharing_cells(x.edges, plan.grid)
    for e in x.edges:
        for f in near_by[e]:
            for new in rejoinings(x, e, f):
                yield frozenset((e, f)), new, 0.5 / (len(x.edges) * len(near_by[e]))


def slide(x: PlainMap, y: PlainMap, plan: Plan) -> Iterator[Way]:
    for v, moved in itertools.product(x.interior(), new_points(x, y, False)):
        for u in x.neighbors(v):
            r, new_r = math.dist(u, v), math.dist(u, moved)
            aside = (v[0] - u[0]) * (moved[1] - u[1]) - (v[1] - u[1]) * (moved[0] - u[0])
            ahead = (v[0] - u[0]) * (moved[0] - u[0]) + (v[1] - u[1]) * (moved[1] - u[1])
            if ahead > 0.0 and abs(aside) < 1e-9 * r * new_r and 0.5 * r <= new_r <= 2.0 * r:
                density = 0.5 / len(x.interior()) / (1.5 * r) / new_r
                (w,) = (w for w in x.neighbors(v) if w != u)
                yield frozenset(x.edges_at(v)), chain(u, moved, w), density


def corners_density(e: tuple[Point, Point], f: tuple[Point, Point], corners: tuple[Point, ...], plan: Plan) -> float:
    """D(e) of the corners p, q, s, t between the faces e = ab and f = ru; 0 where they are not drawn so.

    Along e the order is a, p, q, b, and along f it is r, s, t, u.
    """
    p, q, s, t = corners
    lengths = math.dist(*e), math.dist(*f)
    (on_p, off_p), (on_q, off_q) = foot_and_offset(p, *e), foot_and_offset(q, *e)
    (on_s, off_s), (on_t, off_t) = foot_and_offset(s, *f), foot_and_offset(t, *f)
    if not (0.0 < on_p < on_q < 1.0 and 0.0 < on_s < on_t < 1.0):
        return 0.0
    slips = [(foot - foot_and_offset(v, *f)[0]) * lengths[1] for foot, v in ((on_s, p), (on_t, q))]
    aside = math.prod(0.5 * reach(abs(distance), plan.cut_reach) for distance in (off_p, off_q, off_s, off_t, *slips))
    return reach((on_q - on_p) * lengths[0], plan.birth_reach) * aside


def cut_wall(x: PlainMap, y: PlainMap, plan: Plan) -> Iterator[Way]:
    total = sum(math.dist(*edge) for edge in x.edges)
    corners = new_points(x, y, False)
    for e in x.edges - y.edges:  # Faces that stay lead elsewhere.
        a, b = sorted(e)
        for p, q in itertools.permutations(corners, 2):
            s_and_t = [v for v in corners if v not in (p, q)]
            opposite = round_the_cut(x.edges, plan.grid, (a, b), (p, q))
            for f in opposite:
                for (r, u), (s, t) in itertools.product(itertools.permutations(f), itertools.permutations(s_and_t, 2)):
                    density = corners_density((a, b), (r, u), (p, q, s, t), plan)
                    if density > 0.0:
                        way = chain(a, p, s, r) | chain(b, q, t, u)
                        yield frozenset((e, f)), way, density / (total * len(opposite))


def mend_wall(x: PlainMap, y: PlainMap, plan: Plan) -> Iterator[Way]:
    for j in x.edges - y.edges:  # Jambs that stay lead elsewhere.
        p, s = j
        partners = round_the_middle(x.edges, plan.grid, j)
        for q, t in (ends for k in partners for ends in itertools.permutations(k)):
            corners = {p, q, s, t}
            if any(x.side[v] != INTERIOR for v in corners):
                continue
            (a,), (r,), (b,), (u,) = (set(x.neighbors(v)) - {w} for v, w in ((p, s), (s, p), (q, t), (t, q)))
            faces = frozenset(map(frozenset, ((a, b), (r, u))))
            is_legal = len({a, b, r, u} - corners) == 4 and not faces & x.edges
            if is_legal and not any(x.same_side(*face) for face in faces):
                yield chain(a, p, s, r) | chain(b, q, t, u), faces, 0.5 / (len(x.edges) * len(partners))


def signed(distance: float, m: float) -> float:
    """Density of a reach to either side."""
    return 0.5 * reach(abs(distance), m)


def join_wall(x: PlainMap, y: PlainMap, plan: Plan) -> Iterator[Way]:
    m = plan.join_reach
    for e in x.edges - y.edges:  # Edges that stay lead elsewhere.
        u, v = sorted(e)
        walls = round_the_middle(x.edges, plan.grid, e)
        for (a, b), (p, q) in itertools.product(
            (ends for f in walls for ends in itertools.permutations(f)),
            itertools.permutations(new_points(x, y, False), 2),
        ):
            (on_p, off_p), (on_q, off_q) = foot_and_offset(p, a, b), foot_and_offset(q, a, b)
            if 0.0 < on_p < on_q < 1.0:
                shifts = [(on - foot_and_offset(w, a, b)[0]) * math.dist(a, b) for on, w in ((on_p, u), (on_q, v))]
                density = math.prod(signed(shift, m) for shift in shifts)
                density *= signed(off_p, plan.cut_reach) * signed(off_q, plan.cut_reach)
                way = chain(a, p, u) | chain(b, q, v)
                yield frozenset((e, frozenset((a, b)))), way, density / (len(x.edges) * len(walls))


def part_wall(x: PlainMap, y: PlainMap, plan: Plan) -> Iterator[Way]:
    for j in x.edges - y.edges:  # Links that stay lead elsewhere.
        partners = round_the_middle(x.edges, plan.grid, j)
        links = (ends for k in partners for ends in itertools.permutations(k))
        for (p, u), (q, v) in itertools.product(itertools.permutations(j), links):
            if x.side[p] != INTERIOR or x.side[q] != INTERIOR:
                continue
            (a,), (b,) = set(x.neighbors(p)) - {u}, set(x.neighbors(q)) - {v}
            new = frozenset(map(frozenset, ((a, b), (u, v))))
            is_legal = len({a, b, u, v} - {p, q}) == 4 and not new & x.edges
            if is_legal and not any(x.same_side(*edge) for edge in new):
                yield chain(a, p, u) | chain(b, q, v), new, 0.25 / (len(x.edges) * len(partners))


def dock(x: PlainMap, y: PlainMap, plan: Plan) -> Iterator[Way]:
    for e, (p, q) in itertools.product(x.edges - y.edges, itertools.permutations(new_points(x, y, True), 2)):
        u, v = sorted(e)
        side = nearest_side(x.window, u, v, 0.25 / plan.scale)
        if side == y.side[p] == y.side[q] and side not in (x.side[u], x.side[v]):
            axis = side % 2
            density = signed(p[axis] - u[axis], plan.join_reach) * signed(q[axis] - v[axis], plan.join_reach)
            yield frozenset([e]), chain(u, p) | chain(v, q), density / len(x.edges)


def undock(x: PlainMap, y: PlainMap, plan: Plan) -> Iterator[Way]:
    n = len(x.boundary())
    for p, q in itertools.permutations(x.boundary(), 2):
        (u,), (v,) = x.neighbors(p), x.neighbors(q)
        new = frozenset((u, v))
        is_legal = x.side[p] == x.side[q] and u != v and new not in x.edges and not x.same_side(u, v)
        if is_legal and nearest_side(x.window, u, v, 0.25 / plan.scale) == x.side[p]:
            yield chain(p, u) | chain(q, v), frozenset([new]), 1.0 / (n * (n - 1))


def aimed_at(v: Point, plan: Plan) -> float:
    """Density of a uniform point of a target that is picked with its probability."""
    square = plan.target(v)
    return 0.0 if square is None or plan.target_grid is None else plan.targets[square] / plan.target_grid.cell**2


def bend(x: PlainMap, y: PlainMap, plan: Plan) -> Iterator[Way]:
    """A vertex in a target, in an edge that passes near it."""
    (v,) = new_points(x, y, False)
    walls = round_the_point(x.edges, plan.grid, v)
    for e in walls:
        u, w = e
        yield frozenset([e]), chain(u, v, w), aimed_at(v, plan) / len(walls)


def unbend(x: PlainMap, y: PlainMap, plan: Plan) -> Iterator[Way]:
    """A vertex goes, wherever it stands."""
    for v in x.interior():
        u, w = x.neighbors(v)
        new = frozenset((u, w))
        if new not in x.edges and not x.same_side(u, w):
            yield frozenset(x.edges_at(v)), frozenset([new]), 1.0 / len(x.interior())


def notch(x: PlainMap, y: PlainMap, plan: Plan) -> Iterator[Way]:
    """Half of the notches have a tip t, half two inner corners of which s lies in a target."""
    new = new_points(x, y, False)
    for first in new:
        walls = round_the_point(x.edges, plan.grid, first)
        for (a, b), others in itertools.product(
            (ends for e in walls for ends in itertools.permutations(e)), itertools.permutations(set(new) - {first})
        ):
            density = 0.5 * aimed_at(first, plan) / len(walls)
            if len(new) == 3:
                p, q = others
                density *= tooth(a, b, p, first, q, plan)
                yield frozenset([frozenset((a, b))]), chain(a, p, first, q, b), 0.5 * density
            else:
                t, p, q = others
                density *= niche(a, b, p, first, t, q, plan)
                yield frozenset([frozenset((a, b))]), chain(a, p, first, t, q, b), density


def tooth(a: Point, b: Point, p: Point, t: Point, q: Point, plan: Plan) -> float:
    """Density of the corners p and q on ab to either side of the tip t; both orders of a and b name the same way."""
    (on_p, off_p), (on_t, _), (on_q, off_q) = (foot_and_offset(v, a, b) for v in (p, t, q))
    if not 0.0 < on_p < on_t < on_q < 1.0:
        return 0.0
    gaps = [(end - start) * math.dist(a, b) for start, end in ((on_p, on_t), (on_t, on_q))]
    aside = signed(off_p, plan.cut_reach) * signed(off_q, plan.cut_reach)
    return aside * math.prod(reach(gap, plan.join_reach) for gap in gaps)


def niche(a: Point, b: Point, p: Point, s: Point, t: Point, q: Point, plan: Plan) -> float:
    """Density of the inner corner t beside s and of p and q on ab, a being on the side of s."""
    length = math.dist(a, b)
    (on_p, off_p), (on_s, depth_s), (on_t, depth_t), (on_q, off_q) = (foot_and_offset(v, a, b) for v in (p, s, t, q))
    if not 0.0 < on_p < on_q < 1.0 or on_s > on_t:
        return 0.0
    small = (depth_t - depth_s, (on_p - on_s) * length, (on_q - on_t) * length, off_p, off_q)
    return signed((on_t - on_s) * length, plan.join_reach) * math.prod(signed(d, plan.cut_reach) for d in small)


def fill(x: PlainMap, y: PlainMap, plan: Plan) -> Iterator[Way]:
    for t in x.interior():
        yield from filled(x, [t], 0.5 / len(x.interior()))
    for e in x.edges:
        if all(x.side[v] == INTERIOR for v in e):
            yield from filled(x, sorted(e), 0.5 / len(x.edges))


def filled(x: PlainMap, inner: list[Point], density: float) -> Iterator[Way]:
    """The one way to fill a notch of which the inner corners are known, if there is one."""
    first, last = inner[0], inner[-1]
    p, q = [v for w in inner for v in x.neighbors(w) if v not in inner]
    if p == q or x.side[p] != INTERIOR or x.side[q] != INTERIOR:
        return
    (a,), (b,) = set(x.neighbors(p)) - {first}, set(x.neighbors(q)) - {last}
    new = frozenset((a, b))
    if len({a, b, p, q, *inner}) == 4 + len(inner) and new not in x.edges and not x.same_side(a, b):
        yield chain(a, p, *inner, q, b), frozenset([new]), density


def box_birth(x: PlainMap, y: PlainMap, plan: Plan) -> Iterator[Way]:
    """A box of four new corners: from u a side along the building to v and one across it to t, w opposite."""
    along = unit(plan.orientation)
    new = new_points(x, y, False)
    for u, v, w, t in itertools.permutations(new, 4) if len(new) == 4 else ():
        first = (1.0 - plan.aimed) / x.window.area + plan.aimed * aimed_at(u, plan)
        shifts = [(p[0] - u[0], p[1] - u[1]) for p in (v, t, w)]
        (v1, v2), (t1, t2), (w1, w2) = (
            (dx * along[0] + dy * along[1], dy * along[0] - dx * along[1]) for dx, dy in shifts
        )
        off = math.prod(signed(d, plan.cut_reach) for d in (v2, t1, w1 - v1 - t1, w2 - v2 - t2))
        sizes = [plan.aim_reach * factor for factor in SIZES]
        sides = sum(signed(v1, m) * signed(t2, m) for m in sizes) / len(sizes)
        yield NOTHING, closed(u, v, w, t), first * sides * off


def box_death(x: PlainMap, y: PlainMap, plan: Plan) -> Iterator[Way]:
    """The loop of a vertex, if it has four corners inside the window."""
    for v in x.interior():
        a, b = x.neighbors(v)
        if x.side[a] == x.side[b] == INTERIOR:
            for d in (set(x.neighbors(a)) & set(x.neighbors(b))) - {v}:
                if x.side[d] == INTERIOR and d not in (a, b):
                    yield closed(v, a, d, b), NOTHING, 1.0 / len(x.interior())


WAYS: dict[int, Callable[[PlainMap, PlainMap, Plan], Iterator[Way]]] = {
    getattr(c, each.__name__.upper()): each
    for each in (
        *(triangle_birth, triangle_death, boundary_birth, boundary_death, corner_birth, corner_death),
        *(split, merge, move_interior, move_boundary, past_corner, recolor),
        *(local_recolor, slide, cut_wall, mend_wall, join_wall, part_wall),
        *(dock, bend, unbend, undock, notch, fill, box_birth, box_death),
    )
}


def log_proposal_density(move: int, x: Coloring, y: Coloring, plan: Plan) -> float:
    """Log of p[move] q(x -> y), -inf where the move at x cannot propose y."""
    start, end = plain_map(x), plain_map(y)
    goes, comes = start.edges - end.edges, end.edges - start.edges
    ways = math.fsum(density for old, new, density in WAYS[move](start, end, plan) if (old, new) == (goes, comes))
    flips = start.anchor_black != end.anchor_black
    if ways == 0.0 or flips != anchor_changes(start, end):
        return -math.inf
    return math.log(plan.move_probabilities[move] * ways)


def log_acceptance_ratio(move: int, x: Coloring, y: Coloring, plan: Plan) -> float:
    """Log R(x -> y) for the prior: log h(y) - log h(x) + log q(y -> x) - log q(x -> y)."""
    back = log_proposal_density(REVERSE.get(move, move), y, x, plan)
    there = log_proposal_density(move, x, y, plan)
    prior = slow_log_density(y, plan.scale) - slow_log_density(x, plan.scale)
    return prior + log_tilt(y, plan) - log_tilt(x, plan) + back - there


def log_tilt(coloring: Coloring, plan: Plan) -> float:
    """What preferred directions and the cost of black add to log h, up to a constant."""
    strength, angle = plan.orientation.strength or 0.0, plan.orientation.angle or 0.0
    directions = slow_log_directions(coloring, plan.scale, strength, angle) if strength else 0.0
    return directions - (plan.free_space * slab_area(coloring) if plan.free_space else 0.0)
