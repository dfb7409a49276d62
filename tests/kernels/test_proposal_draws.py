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
from prf.kernels.chain import Chain
from prf.kernels.proposal import N_NEW_VERTICES
from prf.kernels.targets import Targets
from prf.layout import read_coloring
from prf.window import INTERIOR
from tests.reference.hastings import CASES, NAMES, Lab, attempt, make_lab, states, tries
from tests.reference.plain_map import (
    PlainMap,
    Point,
    corner_between,
    foot_and_offset,
    plain_map,
    round_the_cut,
)
from tests.reference.proposals import Plan, log_proposal_density, new_points
from tests.reference.scripted import (
    LAST,
    SCRIPTS,
    across,
    along,
    edge_slot,
    end_points,
    gone_vertex,
    pick,
    reached,
    scripted,
)

SEED = 20050726
STEP = 1e-4


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
        yield Branch(free * (1.0 - plan.local), [LAST, LAST, *first, *others], [2, 3, 4, 5, 6, 7])
        others = [reached(math.dist(u, v), m), turn(u, v), reached(math.dist(u, w), m), turn(u, w)]
        yield Branch(free * plan.local, [LAST, 0.0, *first, *others], [2, 3, 4, 5, 6, 7])
        yield from aimed_birth(chain.targets, u, v, w, plan)


def aimed_birth(targets: Targets, u: Point, v: Point, w: Point, plan: Plan) -> Iterator[Branch]:
    """A post with u in a target, and a panel with u and v in targets."""
    one, other, m = plan.target(u), plan.target(v), plan.aim_reach
    if one is None:
        return
    number = number_of(targets, one)
    first = [(number + 0.5) / len(plan.targets), *within(plan, one, u)]
    others = [reached(math.dist(u, v), m), turn(u, v), reached(math.dist(u, w), m), turn(u, w)]
    picked = 0.5 * plan.aimed / len(plan.targets)
    yield Branch(picked, [0.0, 0.0, *first, *others], [3, 4, 5, 6, 7, 8])
    foot, offset = foot_and_offset(w, u, v)
    if other is None or other not in plan.near_target(one) or not 0.0 < foot < 1.0:
        return
    near = targets.near[targets.near_start[number] : targets.near_start[number + 1]].tolist()
    second = [(near.index(number_of(targets, other)) + 0.5) / len(near), *within(plan, other, v)]
    apex = [foot, reached(abs(offset), m), LAST if offset > 0.0 else 0.0]
    yield Branch(0.5 * picked / len(near), [0.0, LAST, *first, *second, *apex], [3, 4, 6, 7, 8, 9])


def number_of(targets: Targets, square: tuple[int, int]) -> int:
    return int(targets.number[square[0] + targets.grid.nx * square[1]])


def within(plan: Plan, square: tuple[int, int], v: Point) -> list[float]:
    """Coordinates of a point in its square, as shares of the side."""
    grid = plan.target_grid
    assert grid is not None
    return [(v[0] - grid.x0) / grid.cell - square[0], (v[1] - grid.y0) / grid.cell - square[1]]


def boundary_birth(chain: Chain, x: PlainMap, y: PlainMap, plan: Plan) -> Iterator[Branch]:
    m, window = plan.birth_reach, x.window
    (apex,) = new_points(x, y, False)
    for u, v in itertools.permutations(new_points(x, y, True)):
        side = y.side[u]
        of_side = window.side_length(side) / window.perimeter
        middle = sum(window.side_length(s) for s in range(side)) / window.perimeter + 0.5 * of_side
        start = [middle, along(window, side, u)]
        uniform = [LAST, *start, along(window, side, v), *across(window, apex)]
        yield Branch((1.0 - plan.local) * of_side, uniform, [2, 3, 4, 5])
        way = 0.0 if along(window, side, v) > along(window, side, u) else LAST
        local = [reached(math.dist(u, v), m), way, reached(math.dist(u, apex), m), turn(u, apex)]
        yield Branch(0.5 * plan.local * of_side, [0.0, *start, *local], [2, 3, 5, 6])


def corner_birth(chain: Chain, x: PlainMap, y: PlainMap, plan: Plan) -> Iterator[Branch]:
    (uniform,) = SCRIPTS[c.CORNER_BIRTH](chain, x, y, plan)
    yield Branch(0.25 * (1.0 - plan.local), uniform, [2, 3])
    u, v = new_points(x, y, True)
    corner = corner_between(x.window, y.side[u], y.side[v])
    assert corner is not None
    if (y.side[u] + 1) % 4 != y.side[v]:
        u, v = v, u
    distances = [reached(math.dist(corner, w), plan.birth_reach) for w in (u, v)]
    yield Branch(0.25 * plan.local, [0.0, uniform[1], *distances], [2, 3])


def split(chain: Chain, x: PlainMap, y: PlainMap, plan: Plan) -> Iterator[Branch]:
    (numbers,) = SCRIPTS[c.SPLIT](chain, x, y, plan)
    (edge,) = x.edges - y.edges
    assert 0.0 < foot_and_offset(*new_points(x, y, False), *edge)[0] < 1.0
    yield Branch(0.5 / len(x.edges), numbers, [1, 2])


def move_interior(chain: Chain, x: PlainMap, y: PlainMap, plan: Plan) -> Iterator[Branch]:
    (numbers,) = SCRIPTS[c.MOVE_INTERIOR](chain, x, y, plan)
    yield Branch(1.0 / len(x.interior()), numbers, [1, 2])


def move_boundary(chain: Chain, x: PlainMap, y: PlainMap, plan: Plan) -> Iterator[Branch]:
    (uniform,) = SCRIPTS[c.MOVE_BOUNDARY](chain, x, y, plan)
    picked = 1.0 / len(x.boundary())
    yield Branch((1.0 - plan.local) * picked, uniform, [2])
    v, (moved,) = gone_vertex(x, y), new_points(x, y, True)
    way = 0.0 if sum(moved) > sum(v) else LAST
    local = [uniform[0], 0.0, reached(math.dist(v, moved), plan.move_reach), way]
    yield Branch(0.5 * plan.local * picked, local, [2])


def past_corner(chain: Chain, x: PlainMap, y: PlainMap, plan: Plan) -> Iterator[Branch]:
    (uniform,) = SCRIPTS[c.PAST_CORNER](chain, x, y, plan)
    picked = 0.5 / len(x.boundary())
    yield Branch((1.0 - plan.local) * picked, uniform, [3])
    v, (moved,) = gone_vertex(x, y), new_points(x, y, True)
    corner = corner_between(x.window, x.side[v], y.side[moved])
    assert corner is not None
    local = [*uniform[:2], 0.0, reached(math.dist(corner, moved), plan.birth_reach)]
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
        ways = (numbers for numbers in scripts if numbers[0] == picked and leads_to(chain, numbers, x, y))
        chance = 0.5**6 * math.dist(a, b) / (total * len(opposite))
        yield Branch(chance, next(ways), [2, 3, 4, 6, 9, 11, 13, 15])


def leads_to(chain: Chain, numbers: list[float], x: PlainMap, y: PlainMap) -> bool:
    """Whether a cut with these numbers takes the faces that y lacks: they may pick another second face."""
    trial = copy.deepcopy(chain)
    attempt(trial, c.CUT_WALL, scripted(numbers))
    return not (x.edges - y.edges) & plain_map(read_coloring(trial.graph)).edges


BRANCHES: dict[int, Callable[[Chain, PlainMap, PlainMap, Plan], Iterator[Branch]]] = {
    c.TRIANGLE_BIRTH: triangle_birth,
    c.BOUNDARY_BIRTH: boundary_birth,
    c.CORNER_BIRTH: corner_birth,
    c.SPLIT: split,
    c.MOVE_INTERIOR: move_interior,
    c.MOVE_BOUNDARY: move_boundary,
    c.PAST_CORNER: past_corner,
    c.CUT_WALL: cut_wall,
}


def placed(start: Chain, move: int, numbers: list[float]) -> np.ndarray:
    """Free coordinates of the new vertices, in the order in which the kernel places them."""
    chain = copy.deepcopy(start)
    assert attempt(chain, move, scripted(numbers))[0]
    graph = chain.graph
    slots = chain.proposal.new_vertices[: chain.proposal.counts[N_NEW_VERTICES]]
    free = [(0, 1) if graph.vertex_side[v] == INTERIOR else (graph.vertex_side[v] % 2,) for v in slots]
    return np.array([graph.vertex_xy[v, k] for v, axes in zip(slots, free, strict=True) for k in axes])


def density(start: Chain, move: int, branch: Branch, target: PlainMap) -> float:
    """Probability of the branch over the Jacobian determinant of the places by the numbers, by central differences."""
    reached_places = placed(start, move, branch.numbers)
    assert all(np.isclose(np.array(list(target.side)), value, 1e-9, 1e-9).any() for value in reached_places)
    columns = []
    for k in branch.continuous:
        step = STEP * min(branch.numbers[k], 1.0 - branch.numbers[k])
        ends = []
        for sign in (-1.0, 1.0):
            numbers = list(branch.numbers)
            numbers[k] += sign * step
            ends.append(placed(start, move, numbers))
        columns.append((ends[1] - ends[0]) / (2.0 * step))
    return branch.probability / abs(float(np.linalg.det(np.array(columns))))


def proposals(lab: Lab, move: int, rng: np.random.Generator) -> Iterator[tuple[Chain, Chain]]:
    for start in states(lab, 3, rng):
        chain = copy.deepcopy(start)
        for _ in range(tries(move)):
            if attempt(chain, move, rng)[1]:
                yield start, chain
                break


@pytest.mark.parametrize("move", BRANCHES, ids=[NAMES[move] for move in BRANCHES])
def test_draws_have_the_density_of_the_reference(move: int) -> None:
    rng = np.random.default_rng(SEED)
    n = 0
    for settings in CASES:
        lab = make_lab(settings, rng)
        for start, end in proposals(lab, move, rng):
            x, y = read_coloring(start.graph), read_coloring(end.graph)
            a, b = plain_map(x), plain_map(y)
            found = sum(density(start, move, branch, b) for branch in BRANCHES[move](start, a, b, lab.plan))
            expected = math.exp(log_proposal_density(move, x, y, lab.plan)) / lab.plan.odds[move]
            assert found == pytest.approx(expected, rel=1e-5)
            n += 1
    assert n >= 10
