"""What a move draws has the density that its ratio claims.

A proposal is a smooth function of the uniform numbers that the kernel draws, so that its density is the sum, over all
branches that lead to it, of the branch's probability over the Jacobian determinant. Here the kernel itself, fed with
scripted numbers, is differentiated; the claim is that of the slow reference.
"""

from __future__ import annotations

import copy
import itertools
import math
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
import pytest

from prf.kernels import constants as c
from prf.kernels.state.chain import Chain
from prf.kernels.state.proposal import N_NEW_VERTICES
from prf.kernels.state.targets import Targets
from prf.model.coloring import Coloring
from prf.model.layout import read_coloring
from prf.model.window import INTERIOR, SIDES
from tests.reference.hastings import CASES, NAMES, Lab, attempt, make_lab, states, tries
from tests.reference.plain_map import (
    Edges,
    PlainMap,
    Point,
    corner_between,
    foot_and_offset,
    plain_map,
    round_the_cut,
    round_the_middle,
    round_the_point,
)
from tests.reference.proposals import SIZES, Plan, log_proposal_density, new_points, square_corner
from tests.reference.scripted import (
    FIRST,
    SCRIPTS,
    SECOND,
    Way,
    across,
    along,
    below,
    beyond,
    box_sides,
    edge_slot,
    end_points,
    gone_vertex,
    not_squared,
    number_of,
    pick,
    picked_by,
    reached,
    scripted,
    vertex_slot,
    within,
)

pytestmark = pytest.mark.uncompiled

SEED = 20050726
STEP = 1e-4
NEAR = 1e-5
"""Share by which differences may miss a density."""


class Branch(NamedTuple):
    """Numbers of the kernel that lead to a map, which of them are continuous, and the probability of the others."""

    probability: float
    numbers: list[float]
    continuous: list[int]


def turn(a: Point, b: Point) -> float:
    return math.atan2(b[1] - a[1], b[0] - a[0]) / (2.0 * math.pi) % 1.0


def triangle_birth(chain: Chain, x: PlainMap, y: PlainMap, plan: Plan) -> Iterator[Branch]:
    m = plan.birth_reach
    for u, v, w in itertools.permutations(new_points(x, y, False)):
        first = across(x.window, u)
        others = [*across(x.window, v), *across(x.window, w)]
        free = 1.0 - plan.aimed
        is_free = beyond(plan.aimed)
        yield Branch(free * (1.0 - plan.local), [is_free, beyond(plan.local), *first, *others], [2, 3, 4, 5, 6, 7])
        others = [reached(math.dist(u, v), m), turn(u, v), reached(math.dist(u, w), m), turn(u, w)]
        yield Branch(free * plan.local, [is_free, below(plan.local), *first, *others], [2, 3, 4, 5, 6, 7])
        yield from aimed_birth(chain.targets, u, v, w, plan)


def aimed_birth(targets: Targets, u: Point, v: Point, w: Point, plan: Plan) -> Iterator[Branch]:
    """A post with u in a target, and a panel with u and v in targets."""
    for size, factor in enumerate(SIZES):
        chosen = [below(plan.aimed), (size + 0.5) / len(SIZES)]
        yield from aimed_birth_of_size(targets, u, v, w, plan, plan.aim_reach * factor, chosen)


def aimed_birth_of_size(
    targets: Targets, u: Point, v: Point, w: Point, plan: Plan, m: float, chosen: list[float]
) -> Iterator[Branch]:
    one, other = plan.target(u), plan.target(v)
    if one is None:
        return
    number = number_of(targets, one)
    first = [picked_by(targets, one), *within(plan, one, u)]
    others = [reached(math.dist(u, v), m), turn(u, v), reached(math.dist(u, w), m), turn(u, w)]
    picked = 0.5 * plan.aimed / len(SIZES) * plan.targets[one]
    yield Branch(picked, [*chosen, FIRST, *first, *others], [4, 5, 6, 7, 8, 9])
    foot, offset = foot_and_offset(w, u, v)
    if other is None or other not in plan.near_target(one) or not 0.0 < foot < 1.0:
        return
    near = targets.near[targets.near_start[number] : targets.near_start[number + 1]].tolist()
    second = [(near.index(number_of(targets, other)) + 0.5) / len(near), *within(plan, other, v)]
    apex = [foot, reached(abs(offset), m), SECOND if offset > 0.0 else FIRST]
    yield Branch(0.5 * picked / len(near), [*chosen, SECOND, *first, *second, *apex], [4, 5, 7, 8, 9, 10])


def boundary_birth(chain: Chain, x: PlainMap, y: PlainMap, plan: Plan) -> Iterator[Branch]:
    m, window = plan.birth_reach, x.window
    (apex,) = new_points(x, y, False)
    for u, v in itertools.permutations(new_points(x, y, True)):
        side = y.side[u]
        of_side = window.side_length(side) / window.perimeter
        middle = sum(window.side_length(s) for s in range(side)) / window.perimeter + 0.5 * of_side
        start = [middle, along(window, side, u)]
        uniform = [beyond(plan.local), *start, along(window, side, v), *across(window, apex)]
        yield Branch((1.0 - plan.local) * of_side, uniform, [2, 3, 4, 5])
        way = FIRST if along(window, side, v) > along(window, side, u) else SECOND
        local = [reached(math.dist(u, v), m), way, reached(math.dist(u, apex), m), turn(u, apex)]
        yield Branch(0.5 * plan.local * of_side, [below(plan.local), *start, *local], [2, 3, 5, 6])


def corner_birth(chain: Chain, x: PlainMap, y: PlainMap, plan: Plan) -> Iterator[Branch]:
    (uniform,) = SCRIPTS[c.CORNER_BIRTH](chain, x, y, plan)
    yield Branch(0.25 * (1.0 - plan.local), uniform, [2, 3])
    u, v = new_points(x, y, True)
    corner = corner_between(x.window, y.side[u], y.side[v])
    assert corner is not None
    if (y.side[u] + 1) % 4 != y.side[v]:
        u, v = v, u
    distances = [reached(math.dist(corner, w), plan.birth_reach) for w in (u, v)]
    yield Branch(0.25 * plan.local, [below(plan.local), uniform[1], *distances], [2, 3])


def split(chain: Chain, x: PlainMap, y: PlainMap, plan: Plan) -> Iterator[Branch]:
    *_, numbers = SCRIPTS[c.SPLIT](chain, x, y, plan)
    (edge,), (v,) = x.edges - y.edges, new_points(x, y, False)
    first = 1 + len(not_squared(plan))
    if 0.0 < foot_and_offset(v, *edge)[0] < 1.0:
        yield Branch(0.5 * (1.0 - plan.square_share) / len(x.edges), numbers, [first, first + 1])
    yield from squared(numbers[0], end_points(chain, edge), v, plan, 1.0 / len(x.edges))


def squared(picked: float, ends: tuple[Point, Point], v: Point, plan: Plan, probability: float) -> Iterator[Branch]:
    """A corner from which the building's directions lead to both ends, in their order, and v near it."""
    u, w = ends
    for which, corner in (
        (FIRST, square_corner(u, w, plan.orientation)),
        (SECOND, square_corner(w, u, plan.orientation)),
    ):
        numbers = [
            picked,
            below(plan.square_share),
            which,
            reached(math.dist(v, corner), plan.cut_reach),
            turn(corner, v),
        ]
        if plan.square_share > 0.0:
            yield Branch(0.5 * plan.square_share * probability, numbers, [3, 4])


def move_interior(chain: Chain, x: PlainMap, y: PlainMap, plan: Plan) -> Iterator[Branch]:
    (numbers,) = SCRIPTS[c.MOVE_INTERIOR](chain, x, y, plan)
    first, share = 1 + len(not_squared(plan)), 1.0 / len(x.interior())
    yield Branch((1.0 - plan.square_share) * share, numbers, [first, first + 1])
    v, (moved,) = gone_vertex(x, y), new_points(x, y, False)
    graph, slot = chain.graph, vertex_slot(chain, v)
    far = [next(u for u in graph.edge_vertices[e].tolist() if u != slot) for e in graph.vertex_edges[slot]]
    u, w = ((float(graph.vertex_xy[k, 0]), float(graph.vertex_xy[k, 1])) for k in far)
    yield from squared(numbers[0], (u, w), moved, plan, share)


def box_birth(chain: Chain, x: PlainMap, y: PlainMap, plan: Plan) -> Iterator[Branch]:
    for u in new_points(x, y, False):
        for v, t in itertools.permutations(y.neighbors(u)):
            for size, factor in enumerate(SIZES):
                sides = box_sides(u, v, t, y, plan, plan.aim_reach * factor)
                chosen = (size + 0.5) / len(SIZES)
                picked, signs = (1.0 - plan.aimed) / len(SIZES), 0.5**6
                places = [2, 3, 4, 6, 8, 10, 12, 14]
                yield Branch(picked * signs, [chosen, beyond(plan.aimed), *across(x.window, u), *sides], places)
                square = plan.target(u)
                if square is not None:
                    first = [picked_by(chain.targets, square), *within(plan, square, u)]
                    picked = plan.aimed / len(SIZES) * plan.targets[square]
                    numbers = [chosen, below(plan.aimed), *first, *sides]
                    yield Branch(picked * signs, numbers, [place + 1 for place in places])


def move_boundary(chain: Chain, x: PlainMap, y: PlainMap, plan: Plan) -> Iterator[Branch]:
    (uniform,) = SCRIPTS[c.MOVE_BOUNDARY](chain, x, y, plan)
    picked = 1.0 / len(x.boundary())
    yield Branch((1.0 - plan.local) * picked, uniform, [2])
    v, (moved,) = gone_vertex(x, y), new_points(x, y, True)
    way = FIRST if sum(moved) > sum(v) else SECOND
    local = [uniform[0], below(plan.local), reached(math.dist(v, moved), plan.move_reach), way]
    yield Branch(0.5 * plan.local * picked, local, [2])


def past_corner(chain: Chain, x: PlainMap, y: PlainMap, plan: Plan) -> Iterator[Branch]:
    (uniform,) = SCRIPTS[c.PAST_CORNER](chain, x, y, plan)
    picked = 0.5 / len(x.boundary())
    yield Branch((1.0 - plan.local) * picked, uniform, [3])
    v, (moved,) = gone_vertex(x, y), new_points(x, y, True)
    corner = corner_between(x.window, x.side[v], y.side[moved])
    assert corner is not None
    local = [*uniform[:2], below(plan.local), reached(math.dist(corner, moved), plan.birth_reach)]
    yield Branch(plan.local * picked, local, [3])


def cut_wall(chain: Chain, x: PlainMap, y: PlainMap, plan: Plan) -> Iterator[Branch]:
    total = sum(math.dist(*edge) for edge in x.edges)
    scripts = list(SCRIPTS[c.CUT_WALL](chain, x, y, plan))
    for first, second in itertools.permutations(x.edges - y.edges):
        a, b = end_points(chain, first)
        (p,), (q,) = ([w for w in y.neighbors(v) if w not in x.side] for v in (a, b))
        opposite = round_the_cut(x.edges, plan.grid, (a, b), (p, q))
        if second not in opposite:
            continue
        picked = pick(chain, c.EDGES, edge_slot(chain, first))
        ways = (n for n in scripts if n[0] == picked and leads_to(chain, c.CUT_WALL, n, x, y))
        chance = 0.5**6 * math.dist(a, b) / (total * len(opposite))
        yield Branch(chance, next(ways), [2, 3, 4, 6, 9, 11, 13, 15])


def leads_to(chain: Chain, move: int, numbers: list[float], x: PlainMap, y: PlainMap) -> bool:
    """Whether a move with these numbers leads to y, but for rounding: they may pick another edge from a list."""
    trial = copy.deepcopy(chain)
    if attempt(trial, move, scripted(numbers))[3] == -math.inf:
        return False
    return rounded(plain_map(read_coloring(trial.graph)).edges) == rounded(y.edges)


def rounded(edges: Edges) -> frozenset[frozenset[tuple[float, float]]]:
    return frozenset(frozenset((round(px, 6), round(py, 6)) for px, py in edge) for edge in edges)


def join_wall(chain: Chain, x: PlainMap, y: PlainMap, plan: Plan) -> Iterator[Branch]:
    scripts = list(SCRIPTS[c.JOIN_WALL](chain, x, y, plan))
    for e, f in itertools.permutations(x.edges - y.edges):
        walls = round_the_middle(x.edges, plan.grid, e)
        if f in walls:
            picked = pick(chain, c.EDGES, edge_slot(chain, e))
            ways = (n for n in scripts if n[0] == picked and leads_to(chain, c.JOIN_WALL, n, x, y))
            for numbers in itertools.islice(ways, 1):  # None where the feet on f do not come in this order.
                yield Branch(0.5**4 / (len(x.edges) * len(walls)), numbers, [2, 4, 6, 8])


def dock(chain: Chain, x: PlainMap, y: PlainMap, plan: Plan) -> Iterator[Branch]:
    (numbers,) = SCRIPTS[c.DOCK](chain, x, y, plan)
    yield Branch(0.5**2 / len(x.edges), numbers, [1, 3])


def notch(chain: Chain, x: PlainMap, y: PlainMap, plan: Plan) -> Iterator[Branch]:
    scripts = list(SCRIPTS[c.NOTCH](chain, x, y, plan))
    (edge,) = x.edges - y.edges
    new = new_points(x, y, False)
    inner = [v for v in new if not set(edge) & set(y.neighbors(v))]
    for first in inner:
        square, walls = plan.target(first), round_the_point(x.edges, plan.grid, first)
        if square is None or edge not in walls:
            continue
        share = within(plan, square, first)
        ways = (n for n in scripts if n[2:4] == share and leads_to(chain, c.NOTCH, n, x, y))
        picked = 0.5 * plan.targets[square] / len(walls)
        if len(new) == 3:
            yield Branch(picked * 0.5**2, next(ways), [2, 3, 5, 6, 7, 9])
        else:
            yield Branch(picked * 0.5**6, next(ways), [2, 3, 5, 7, 9, 11, 13, 15])


def bend(chain: Chain, x: PlainMap, y: PlainMap, plan: Plan) -> Iterator[Branch]:
    (v,) = new_points(x, y, False)
    square = plan.target(v)
    if square is None:
        return
    scripts = SCRIPTS[c.BEND](chain, x, y, plan)
    numbers = next(n for n in scripts if leads_to(chain, c.BEND, n, x, y))
    yield Branch(plan.targets[square] / len(round_the_point(x.edges, plan.grid, v)), numbers, [1, 2])


BRANCHES: dict[int, Callable[[Chain, PlainMap, PlainMap, Plan], Iterator[Branch]]] = {
    c.TRIANGLE_BIRTH: triangle_birth,
    c.BOUNDARY_BIRTH: boundary_birth,
    c.CORNER_BIRTH: corner_birth,
    c.SPLIT: split,
    c.MOVE_INTERIOR: move_interior,
    c.MOVE_BOUNDARY: move_boundary,
    c.PAST_CORNER: past_corner,
    c.CUT_WALL: cut_wall,
    c.JOIN_WALL: join_wall,
    c.DOCK: dock,
    c.NOTCH: notch,
    c.BEND: bend,
    c.BOX_BIRTH: box_birth,
}


def placed(start: Chain, move: int, numbers: list[float]) -> np.ndarray:
    """Free coordinates of the new vertices, in the order in which the kernel places them."""
    chain = copy.deepcopy(start)
    assert attempt(chain, move, scripted(numbers))[0]
    graph = chain.graph
    slots = chain.proposal.new_vertices[: chain.proposal.counts[N_NEW_VERTICES]]
    free = [(0, 1) if graph.vertex_side[v] == INTERIOR else (graph.vertex_side[v] % 2,) for v in slots]
    return np.array([graph.vertex_xy[v, k] for v, axes in zip(slots, free, strict=True) for k in axes])


def slope(start: Chain, move: int, numbers: list[float], k: int) -> np.ndarray:
    """Derivative of the places by number k, by central differences within what is legal."""
    step = STEP * min(numbers[k], 1.0 - numbers[k])
    for _ in range(4):
        ends = [[*numbers[:k], numbers[k] + shift, *numbers[k + 1 :]] for shift in (-step, step)]
        if all(attempt(copy.deepcopy(start), move, scripted(each))[0] for each in ends):
            break
        step /= 4.0
    low, high = (placed(start, move, each) for each in ends)
    return (high - low) / (2.0 * step)


def density(start: Chain, move: int, branch: Branch, target: PlainMap) -> float:
    """Probability of the branch over the Jacobian of the places by the numbers, by central differences."""
    reached_places = placed(start, move, branch.numbers)
    assert all(np.isclose(np.array(list(target.side)), value, 1e-9, 1e-9).any() for value in reached_places)
    columns = [slope(start, move, branch.numbers, k) for k in branch.continuous]
    return branch.probability / abs(float(np.linalg.det(np.array(columns))))


def test_sides_come_in_proportion_to_their_lengths() -> None:
    """By the number that picks the side of a birth, at both ends of the stretch of each side."""
    lab = make_lab(CASES[1], np.random.default_rng(SEED))
    window = lab.target.window
    for side in SIDES:
        ends = [sum(window.side_length(s) for s in range(k)) / window.perimeter for k in (side, side + 1)]
        for share in (ends[0] + 1e-12, ends[1] - 1e-12):
            chain = lab.chain_at(Coloring.empty(window))
            legal = attempt(chain, c.BOUNDARY_BIRTH, scripted([beyond(lab.plan.local), share, 0.3, 0.6, 0.4, 0.7]))[0]
            slots = chain.proposal.new_vertices[: chain.proposal.counts[N_NEW_VERTICES]]
            assert legal
            assert sorted(chain.graph.vertex_side[slots].tolist()) == [INTERIOR, side, side]


@pytest.mark.parametrize("side", SIDES)
def test_near_a_corner_is_a_reach_from_it_along_each_side(side: int) -> None:
    lab = make_lab(CASES[1], np.random.default_rng(SEED))
    window, m = lab.target.window, lab.plan.birth_reach
    corner = corner_between(window, side, (side + 1) % 4)
    assert corner is not None
    numbers = [below(lab.plan.local), (side + 0.5) / 4.0, reached(0.2, m), reached(0.3, m)]
    along_sides = placed(lab.chain_at(Coloring.empty(window)), c.CORNER_BIRTH, numbers)
    ways = [1.0 if 2.0 * corner[s % 2] < sum(window[s % 2 :: 2]) else -1.0 for s in (side, side + 1)]
    expected = [corner[side % 2] + 0.2 * ways[0], corner[(side + 1) % 2] + 0.3 * ways[1]]
    assert along_sides == pytest.approx(expected, abs=1e-12)


def proposals(lab: Lab, move: int, rng: np.random.Generator) -> Iterator[tuple[Chain, Chain]]:
    for start in states(lab, 3, rng):
        chain = copy.deepcopy(start)
        for _ in range(tries(move)):
            if attempt(chain, move, rng)[3] > -math.inf:
                yield start, chain
                break


def densities(lab: Lab, move: int, start: Chain, end: Chain) -> tuple[float, float]:
    """The density of a way from the map of `start` to that of `end`: by the kernel's draws, and by the reference."""
    x, y = read_coloring(start.graph), read_coloring(end.graph)
    a, b = plain_map(x), plain_map(y)
    drawn = sum(density(start, move, branch, b) for branch in BRANCHES[move](start, a, b, lab.plan))
    return drawn, math.exp(log_proposal_density(move, x, y, lab.plan)) / lab.plan.move_probabilities[move]


LONG = (c.TRIANGLE_BIRTH, c.BOX_BIRTH, c.CUT_WALL, c.JOIN_WALL, c.NOTCH)
"""Moves with many numbers to differentiate by."""


@pytest.mark.parametrize(
    "move",
    [pytest.param(k, id=NAMES[k], marks=pytest.mark.slow if k in LONG else ()) for k in BRANCHES],
)
def test_draws_have_the_density_of_the_reference(move: int) -> None:
    rng = np.random.default_rng(SEED)
    n = 0
    for target in CASES:
        lab = make_lab(target, rng)
        for start, end in proposals(lab, move, rng):
            found, expected = densities(lab, move, start, end)
            assert found == pytest.approx(expected, rel=NEAR)
            n += 1
    assert n >= 10


def idle_choices(lab: Lab, move: int, start: Chain, end: Chain) -> int:
    """Number of the choices between two ways, from `start` to `end`, of which the other leads there too.

    A cut besides refuses an edge for a number above its share of the diagonal, and draws again.
    """
    x, y = plain_map(read_coloring(start.graph)), plain_map(read_coloring(end.graph))
    scripts = SCRIPTS[move](start, x, y, lab.plan)
    numbers = next((n for n in scripts if leads_to(start, move, n, x, y)), [])
    ways = [k for k, n in enumerate(numbers) if isinstance(n, Way)]
    others = [[*numbers[:k], FIRST if numbers[k] == SECOND else SECOND, *numbers[k + 1 :]] for k in ways]
    n_idle = sum(leads_to(start, move, other, x, y) for other in others)
    if move == c.CUT_WALL:
        refused = [numbers[0], beyond(numbers[1] * (1.0 + 1e-11)), *numbers] if numbers else []
        n_idle += not leads_to(start, move, refused, x, y)
    return n_idle


@pytest.mark.parametrize("move", SCRIPTS, ids=[NAMES[move] for move in SCRIPTS])
def test_of_two_ways_each_leads_elsewhere(move: int) -> None:
    rng = np.random.default_rng(SEED)
    for target in CASES[:2]:
        lab = make_lab(target, rng)
        start, end = next(proposals(lab, move, rng))
        assert idle_choices(lab, move, start, end) == 0
