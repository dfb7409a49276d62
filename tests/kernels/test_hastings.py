"""The Hastings ratio of every move: held to a slow reference that enumerates the proposals, and to its way back."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import pytest

from prf.kernels import constants as c
from prf.kernels.state.grid import Grid
from prf.model.coloring import Coloring, violations
from prf.model.window import INTERIOR, Window
from tests.reference.hastings import NAMES, TOLERANCE, Findings, examine
from tests.reference.plain_map import cells_passed
from tests.reference.proposals import Plan, log_proposal_density

pytestmark = pytest.mark.uncompiled

SEED = 20050726
ONE_WAY = {"local recolor", "mend wall", "part wall", "fill", "unbend"}
SELDOM = {"cut wall", "join wall"}
"""Moves to whose result no way may lead back; of some a few in a hundred, so that the states here may show none."""


FEW, MANY = 1, 18
"""States of each of the five cases: as plain Python, and compiled."""
LEAST = {FEW: 4, MANY: 50}
"""Valid attempts at each move among them."""


class Examination(NamedTuple):
    """What attempts at every move showed, and of how many valid ones at each there must be."""

    moves: dict[str, Findings]
    least: int


@pytest.fixture(scope="module", params=[FEW, pytest.param(MANY, marks=pytest.mark.slow)])
def found(request: pytest.FixtureRequest) -> Examination:
    return Examination(examine(request.param, SEED), LEAST[request.param])


@pytest.mark.parametrize("move", NAMES)
def test_ratio_is_that_of_the_reference(move: str, found: Examination) -> None:
    assert found.moves[move].valid >= found.least
    assert found.moves[move].reference_error < TOLERANCE


@pytest.mark.parametrize("move", NAMES)
def test_ratio_of_the_way_back_is_the_inverse(move: str, found: Examination) -> None:
    assert found.moves[move].antisymmetry_error < TOLERANCE


@pytest.mark.parametrize("move", NAMES)
def test_what_is_applied_is_valid_and_what_is_refused_crosses(move: str, found: Examination) -> None:
    assert found.moves[move].problems == []


@pytest.mark.parametrize("found", [pytest.param(MANY, marks=pytest.mark.slow)], indirect=True)
def test_refusals_and_ways_without_return_were_seen(found: Examination) -> None:
    """A few states are too few for some of them; what only takes edges away crosses none."""
    deaths = {"triangle death", "box death", "boundary death", "corner death"}
    assert {move for move in NAMES if found.moves[move].refused == 0} == deaths
    assert ONE_WAY <= {move for move in NAMES if found.moves[move].one_way > 0} <= ONE_WAY | SELDOM


WINDOW = Window(0.0, 0.0, 2.0, 1.0)
GRID = Grid(-0.03, -0.03, 0.1, 21, 11)


def plan(**changes: float) -> Plan:
    tuning = {
        "scale": 1.0,
        "local": 0.0,
        "birth_reach": 0.1,
        "split_reach": 0.1,
        "move_reach": 0.1,
        "cut_reach": 0.1,
        "join_reach": 0.1,
        **changes,
    }
    return Plan(**tuning, move_probabilities=np.ones(c.N_MOVES), grid=GRID)


def loop(*points: tuple[float, float]) -> Coloring:
    n = len(points)
    edges = np.array([(k, (k + 1) % n) for k in range(n)], np.int32)
    return Coloring(WINDOW, np.array(points), np.full(n, INTERIOR, np.int8), edges, False)


def rails(*loops: list[tuple[float, float]]) -> Coloring:
    parts = [loop(*points) for points in loops]
    start = np.cumsum([0, *(part.n_vertices for part in parts)])
    edges = np.concatenate([part.edges + n for part, n in zip(parts, start, strict=False)])
    xy = np.concatenate([part.xy for part in parts])
    return Coloring(WINDOW, xy, np.full(len(xy), INTERIOR, np.int8), edges.astype(np.int32), False)


def cut_wall(p: float, q: float, s: float, t: float) -> Coloring:
    """The wall between y = 0.7 and y = 0.76, cut at these abscissae: q and t lie on the faces, p and s off them."""
    west = [(0.2, 0.76), (0.2, 0.7), (p, 0.71), (s, 0.75)]
    east = [(1.8, 0.7), (1.8, 0.76), (t, 0.76), (q, 0.7)]
    return rails(west, east)


ROUND_WALL = 2.0 * (1.6 + 0.06)


def walls_by_hand() -> Iterator[tuple[str, int, Coloring, Coloring, Plan, float]]:
    wall = loop((0.2, 0.7), (1.8, 0.7), (1.8, 0.76), (0.2, 0.76))
    cut = cut_wall(0.8, 1.0, 0.83, 1.02)

    def reach(r: float) -> float:
        return 0.1 / (0.1 + r) ** 2

    aside = reach(0.01) ** 2 * reach(0.0) ** 2 * reach(0.03) * reach(0.02) / 2.0**6
    density = (reach(0.2) + reach(0.19)) * aside
    yield "cut", c.CUT_WALL, wall, cut, plan(), density / ROUND_WALL
    yield "mend", c.MEND_WALL, cut, wall, plan(), 0.5 / 8.0 * (1.0 / 3.0 + 1.0 / 3.0)
    # From the middle of the west jamb the block ends at 1.17, from that of the east one it begins at 0.77.
    uneven = cut_wall(0.8, 1.15, 0.8, 1.18)
    yield "mend from unequal jambs", c.MEND_WALL, uneven, wall, plan(), 0.5 / 8.0 * (1.0 / 2.0 + 1.0 / 3.0)
    # The block of the west jamb ends at 1.17: it meets the slanted east jamb, whose own begins at 0.87.
    one_sided = cut_wall(0.8, 1.1, 0.8, 1.4)
    yield "mend from one jamb", c.MEND_WALL, one_sided, wall, plan(), 0.5 / 8.0 / 2.0
    yield "too wide a gap to mend", c.MEND_WALL, cut_wall(0.8, 1.4, 0.8, 1.4), wall, plan(), 0.0
    aside = reach(0.01) ** 2 * reach(0.0) ** 4 / 2.0**6
    yield "wide cut", c.CUT_WALL, wall, cut_wall(0.8, 1.4, 0.8, 1.4), plan(), 2.0 * reach(0.6) * aside / ROUND_WALL
    overlap = rails(
        [(0.2, 0.76), (0.2, 0.7), (1.0, 0.7), (0.8, 0.75)], [(1.8, 0.7), (1.8, 0.76), (1.75, 0.76), (0.9, 0.69)]
    )
    assert not violations(overlap)
    yield "cut out of order", c.CUT_WALL, wall, overlap, plan(), 0.0


WALL = [(0.2, 0.5), (1.8, 0.5), (1.8, 0.9), (0.2, 0.9)]
TARGETS = {"target_grid": Grid(0.0, 0.0, 0.1, 20, 10), "targets": {(6, 3): 1.0}}


def joined_by_hand() -> Iterator[tuple[str, int, Coloring, Coloring, Plan, float]]:
    def half(*distances: float) -> float:
        return math.prod(0.5 * 0.1 / (0.1 + r) ** 2 for r in distances)

    apart = rails([(0.5, 0.3), (0.6, 0.2), (0.7, 0.3)], WALL)
    joined = loop(WALL[0], (0.45, 0.5), (0.5, 0.3), (0.6, 0.2), (0.7, 0.3), (0.7, 0.52), *WALL[1:])
    yield "join", c.JOIN_WALL, apart, joined, plan(), half(0.05, 0.0, 0.0, 0.02) / 7.0
    # Round the west link lie the east one, its edge to the corner, an edge of the triangle and the west wall.
    yield "part", c.PART_WALL, joined, apart, plan(), 0.25 / 9.0 * (1.0 / 4.0 + 1.0 / 3.0)
    free = loop((0.3, 0.1), (0.4, 0.3), (0.5, 0.1))
    sides = np.array([INTERIOR, INTERIOR, INTERIOR, 0, 0], np.int8)
    xy = np.array([(0.3, 0.1), (0.4, 0.3), (0.5, 0.1), (0.25, 0.0), (0.5, 0.0)])
    docked = Coloring(WINDOW, xy, sides, np.array([(3, 0), (0, 1), (1, 2), (2, 4)], np.int32), False)
    yield "dock", c.DOCK, free, docked, plan(), half(0.05, 0.0) / 3.0
    yield "dock too far", c.DOCK, free, docked, plan(scale=3.0), 0.0
    yield "undock", c.UNDOCK, docked, free, plan(), 1.0


def notches_by_hand() -> Iterator[tuple[str, int, Coloring, Coloring, Plan, float]]:
    def reach(*distances: float) -> float:
        return math.prod(0.1 / (0.1 + r) ** 2 for r in distances)

    aimed = plan()._replace(**TARGETS)
    wall = loop(*WALL)
    tooth = loop(WALL[0], (0.5, 0.5), (0.65, 0.35), (0.7, 0.51), *WALL[1:])
    density = reach(0.15, 0.05) * 0.25 * reach(0.0, 0.01)
    yield "tooth", c.NOTCH, wall, tooth, aimed, 0.5 / 0.1**2 * density
    yield "tooth off target", c.NOTCH, wall, tooth, plan(), 0.0
    yield "fill tooth", c.FILL, tooth, wall, aimed, 0.5 / 7.0
    niche = loop(WALL[0], (0.64, 0.5), (0.65, 0.35), (0.85, 0.36), (0.85, 0.5), *WALL[1:])
    density = 0.5**6 * reach(0.2, 0.01, 0.01, 0.0, 0.0, 0.0)
    yield "niche", c.NOTCH, wall, niche, aimed, 0.5 / 0.1**2 * density
    yield "fill niche", c.FILL, niche, wall, aimed, 0.5 / 8.0


def by_hand() -> Iterator[tuple[str, int, Coloring, Coloring, Plan, float]]:
    empty = Coloring.empty(WINDOW)
    triangle = loop((0.2, 0.2), (0.5, 0.2), (0.2, 0.6))
    quadrangle = loop((0.2, 0.2), (0.5, 0.2), (0.6, 0.6), (0.2, 0.6))
    near = {r: 0.1 / (0.1 + r) ** 2 / (2.0 * math.pi * r) for r in (0.3, 0.4, 0.5)}
    local = 2.0 / 2.0 * (near[0.3] * near[0.4] + near[0.3] * near[0.5] + near[0.4] * near[0.5])
    yield "uniform birth", c.TRIANGLE_BIRTH, empty, triangle, plan(), 6.0 / 2.0**3
    yield "local birth", c.TRIANGLE_BIRTH, empty, triangle, plan(local=1.0), local
    yield "mixed birth", c.TRIANGLE_BIRTH, empty, triangle, plan(local=0.8), 0.2 * 6.0 / 2.0**3 + 0.8 * local
    yield "death", c.TRIANGLE_DEATH, triangle, empty, plan(), 1.0
    yield "no way", c.TRIANGLE_DEATH, triangle, quadrangle, plan(), 0.0
    yield "anchor", c.TRIANGLE_DEATH, triangle, empty._replace(anchor_black=True), plan(), 0.0
    moved = loop((0.2, 0.2), (0.5, 0.2), (0.2, 0.7))
    yield "slide", c.SLIDE, triangle, moved, plan(), 0.5 / 3.0 / (1.5 * 0.4) / 0.5
    yield "slide back", c.SLIDE, moved, triangle, plan(), 0.5 / 3.0 / (1.5 * 0.5) / 0.4
    yield "too far a slide", c.SLIDE, triangle, loop((0.2, 0.2), (0.5, 0.2), (0.2, 0.39)), plan(), 0.0
    offset = 0.1 / math.hypot(0.3, 0.4)
    split = loop((0.2, 0.2), (0.5, 0.2), (0.35 + 0.8 * offset / 2, 0.4 + 0.6 * offset / 2), (0.2, 0.6))
    density = 0.1 / (0.1 + offset / 2) ** 2 / (2.0 * 0.5)
    yield "split", c.SPLIT, triangle, split, plan(), density / 3.0
    yield "merge", c.MERGE, split, triangle, plan(), 0.25
    yield "merge of a triangle", c.MERGE, triangle, empty, plan(), 0.0
    yield from walls_by_hand()
    yield from joined_by_hand()
    yield from notches_by_hand()


@pytest.mark.parametrize("name", [example[0] for example in by_hand()])
def test_reference_by_hand(name: str) -> None:
    (example,) = [example for example in by_hand() if example[0] == name]
    move, x, y, plan, density = example[1:]
    expected = math.log(density) if density else -math.inf
    assert log_proposal_density(move, x, y, plan) == pytest.approx(expected, abs=1e-12)


def test_cells_by_hand() -> None:
    grid = Grid(0.0, 0.0, 1.0, 4, 3)
    assert cells_passed(grid, (0.5, 0.5), (2.5, 0.6)) == {(0, 0), (1, 0), (2, 0)}
    assert cells_passed(grid, (0.5, 0.75), (1.5, 1.25)) == {(0, 0), (1, 1)}, "through a corner of cells"
    assert cells_passed(grid, (1.75, 0.5), (0.5, 1.6)) == {(1, 0), (1, 1), (0, 1)}
    assert cells_passed(grid, (2.5, 0.1), (2.5, 2.9)) == {(2, 0), (2, 1), (2, 2)}
