"""Moves on the smallest maps that they can be made on, and on few edges of which hardly any map of a chain has such."""

from __future__ import annotations

import copy
import math

import numpy as np
import pytest

from prf.kernels import constants as c
from prf.model.coloring import Coloring
from prf.model.layout import read_coloring
from prf.model.window import BOTTOM, INTERIOR, TOP, Window
from prf.sampler.target import Execution, Target, Tuning
from tests.kernels.by_hand import REACH, chain_listed, drawn, is_legal, lab_at, log_ratio
from tests.reference.hastings import NAMES, Lab, attempt, is_same_map, log_ratio_back, make_lab, proposed_coloring
from tests.reference.plain_map import plain_map
from tests.reference.proposals import REVERSE, log_acceptance_ratio
from tests.reference.scripted import FINEST, FIRST, SCRIPTS, SECOND, edge_slot, pick, reached, scripted, signed

pytestmark = pytest.mark.uncompiled

UNIT = Window(0.0, 0.0, 1.0, 1.0)
WIDE = Window(0.0, 0.0, 2.0, 1.0)
CUT = [(0.75, 0.0), (0.0, 0.75)]
"""A corner cut: a map of one edge."""
TOOTH = [(0.75, 0.0), (0.5, 0.25), (0.25, 0.25), (0.25, 0.5), (0.0, 0.75)]
NICHE = [(0.75, 0.0), (0.5, 0.25), (0.375, 0.125), (0.125, 0.375), (0.25, 0.5), (0.0, 0.75)]
WALL = [(0.0, 0.3125), (2.0, 0.3125)]
BEHIND = [(0.0, 0.65), (2.0, 0.65)]
ONE_EYED = [(0.0, 0.3125), (0.5, 0.3), (0.5, 0.53), (0.7, 0.55), (0.7, 0.32), (2.0, 0.3125)]
"""A niche of whose inner corners one has the wall in the block of cells round it; the other lies a row further off."""

ROOMY = lab_at(UNIT, 4.0)
"""One cell holds the whole window."""
AIMED = lab_at(UNIT, 0.25, aimed=0.6, returns=[(0.25, 0.25), (0.375, 0.125)])
SEEN = lab_at(WIDE, 0.1, aimed=0.6, side=0.05, returns=[(0.5, 0.53), (0.7, 0.55)])

PAIRS = [
    pytest.param(
        ROOMY,
        (c.RECOLOR, c.RECOLOR),
        drawn(UNIT, [(0.25, 0.0), (0.0, 0.25)], [(1.0, 0.75), (0.75, 1.0)]),
        drawn(UNIT, [(0.25, 0.0), (1.0, 0.75)], [(0.0, 0.25), (0.75, 1.0)], black=True),
        id="recolour",
    ),
    pytest.param(
        ROOMY,
        (c.LOCAL_RECOLOR, c.LOCAL_RECOLOR),
        drawn(UNIT, [(0.25, 0.0), (0.0, 0.25)], [(1.0, 0.75), (0.75, 1.0)]),
        drawn(UNIT, [(0.25, 0.0), (1.0, 0.75)], [(0.0, 0.25), (0.75, 1.0)], black=True),
        id="local recolour",
    ),
    pytest.param(AIMED, (c.NOTCH, c.FILL), drawn(UNIT, CUT), drawn(UNIT, TOOTH), id="tooth in the only edge"),
    pytest.param(AIMED, (c.NOTCH, c.FILL), drawn(UNIT, CUT), drawn(UNIT, NICHE), id="niche in the only edge"),
    pytest.param(SEEN, (c.NOTCH, c.FILL), drawn(WIDE, WALL), drawn(WIDE, ONE_EYED), id="niche out of one's sight"),
    pytest.param(
        SEEN, (c.NOTCH, c.FILL), drawn(WIDE, WALL, BEHIND), drawn(WIDE, ONE_EYED, BEHIND), id="niche before a wall"
    ),
]


@pytest.mark.parametrize(("lab", "moves", "x", "y"), PAIRS)
def test_ratio_there_and_back(lab: Lab, moves: tuple[int, int], x: Coloring, y: Coloring) -> None:
    for move, start, end in ((moves[0], x, y), (moves[1], y, x)):
        expected = log_acceptance_ratio(move, start, end, lab.plan)
        assert math.isfinite(expected)
        assert log_ratio(lab, move, start, end) == pytest.approx(expected, abs=1e-9)


def test_births_that_are_all_aimed() -> None:
    """Squares of side 1 m too far from one another for a panel between them: one's own is all that is near."""
    window = Window(0.0, 0.0, 32.0, 2.0)
    lab, rng, n = (
        lab_at(window, 1.0, aimed=1.0, side=1.0, returns=[(0.9, 0.9), (30.9, 0.9)]),
        np.random.default_rng(5),
        0,
    )
    x = Coloring.empty(window)
    while n < 12:
        chain = lab.chain_at(x)
        ratio = attempt(chain, c.TRIANGLE_BIRTH, rng)[3]
        if ratio > -math.inf:
            y, n = read_coloring(chain.graph), n + 1
            assert ratio == pytest.approx(log_acceptance_ratio(c.TRIANGLE_BIRTH, x, y, lab.plan), abs=1e-9)


def test_a_boundary_vertex_moves_to_either_side() -> None:
    lab, x = lab_at(UNIT, 0.25), drawn(UNIT, [(0.5, 0.0), (0.0, 0.5)])
    places = set()
    for way in (FIRST, SECOND):
        chain = lab.chain_at(x)
        slot = int(np.flatnonzero(chain.graph.vertex_xy[:2, 1] == 0.0)[0])
        numbers = [pick(chain, c.BOUNDARY_VERTICES, slot), 0.0, reached(0.125, lab.plan.move_reach), way]
        assert attempt(chain, c.MOVE_BOUNDARY, scripted(numbers))[1]
        places |= {round(v[0], 9) for v in read_coloring(chain.graph).xy.tolist() if v[1] == 0.0}
    assert places == {0.375, 0.625}


ALONE = drawn(UNIT, [(0.25, 0.25), (0.75, 0.25), (0.75, 0.75), (0.25, 0.75), (0.25, 0.25)], black=True)
APART = drawn(UNIT, [(0.25, 0.0), (0.0, 0.25)], [(1.0, 0.75), (0.75, 1.0)])


@pytest.mark.parametrize(
    ("move", "x"),
    [
        pytest.param(c.FILL, APART, id="fill without corners"),
        pytest.param(c.LOCAL_RECOLOR, APART, id="recolour without an edge near by"),
        pytest.param(c.RECOLOR, drawn(UNIT, CUT), id="recolour one edge"),
        pytest.param(c.LOCAL_RECOLOR, drawn(UNIT, CUT), id="recolour one edge locally"),
    ],
)
def test_a_move_that_lacks_edges_is_refused(move: int, x: Coloring) -> None:
    lab = lab_at(UNIT, 0.05)
    for first in (0.01, 0.3, 0.6, 0.99):
        assert not is_legal(lab, move, x, [first, first, *([0.3] * 8)])


# Moves between maps of as few edges as they can do with, and proposals at the borders of what can be proposed.


WINDOW = Window(0.0, 0.0, 2.0, 1.0)
FEET = [(1.2, 0.0), (1.2, 1.0), (1.25, 0.0), (1.25, 1.0)]
SIDES_OF_FEET = [BOTTOM, TOP, BOTTOM, TOP]
ACROSS = [(0, 1), (2, 3)]
"""A wall from the bottom to the top."""


def map_of(points: list[tuple[float, float]], sides: list[int], edges: list[tuple[int, int]]) -> Coloring:
    return Coloring(WINDOW, np.array(points), np.array(sides, np.int8), np.array(edges, np.int32), False)


def cut(low: float, high: float) -> Coloring:
    """The wall cut between two heights."""
    corners = [(1.21, low), (1.24, low), (1.2, high), (1.26, high)]
    edges = [(0, 4), (4, 5), (5, 2), (1, 6), (6, 7), (7, 3)]
    return map_of(FEET + corners, SIDES_OF_FEET + [INTERIOR] * 4, edges)


SMALLEST_WALL = map_of(FEET, SIDES_OF_FEET, ACROSS)
JOINED = map_of(
    [*FEET, (1.24, 0.47), (1.26, 0.53)], [*SIDES_OF_FEET, INTERIOR, INTERIOR], [(0, 4), (4, 2), (1, 5), (5, 3)]
)
SMALLEST = {
    c.CUT_WALL: (SMALLEST_WALL, cut(0.4, 0.6)),
    c.MEND_WALL: (cut(0.4, 0.6), SMALLEST_WALL),
    c.JOIN_WALL: (SMALLEST_WALL, JOINED),
    c.PART_WALL: (JOINED, SMALLEST_WALL),
}


@pytest.fixture(scope="module")
def lab() -> Lab:
    return make_lab(
        Target(WINDOW, 1.0, tuning=Tuning(cut_reach=0.03), execution=Execution(cell=0.1)), np.random.default_rng(1)
    )


@pytest.mark.parametrize("move", SMALLEST, ids=[NAMES[move] for move in SMALLEST])
def test_a_wall_of_two_edges_is_changed_and_changed_back(lab: Lab, move: int) -> None:
    x, y = SMALLEST[move]
    found = log_ratio_back(lab, REVERSE[move], y, x)
    assert found == pytest.approx(log_acceptance_ratio(move, x, y, lab.plan), abs=1e-9)


def test_a_cut_too_wide_to_be_mended_is_not_accepted(lab: Lab) -> None:
    wide = cut(0.1, 0.9)
    chain = lab.chain_at(SMALLEST_WALL)
    seen = 0
    for numbers in SCRIPTS[c.CUT_WALL](chain, plain_map(SMALLEST_WALL), plain_map(wide), lab.plan):
        trial = copy.deepcopy(chain)
        _, valid, _, ratio = attempt(trial, c.CUT_WALL, scripted(numbers))
        if valid and is_same_map(proposed_coloring(trial), wide):
            seen += 1
            assert ratio == -math.inf
    assert seen


def test_two_corners_at_one_foot_are_no_join(lab: Lab) -> None:
    """The edge from (0.5, 0.2) to (0.5, 0.4) stands upright on the wall to which its ends are led."""
    points = [(0.5, 0.2), (0.5, 0.4), (0.3, 0.3), (0.2, 0.5), (1.8, 0.5), (1.8, 0.9), (0.2, 0.9)]
    edges = [(0, 1), (1, 2), (2, 0), (3, 4), (4, 5), (5, 6), (6, 3)]
    x = map_of(points, [INTERIOR] * 7, edges)
    chain = lab.chain_at(x)
    upright = pick(chain, c.EDGES, edge_slot(chain, frozenset(points[:2])))
    near = reached(0.02, lab.plan.join_reach)
    aside, further = (reached(r, lab.plan.cut_reach) for r in (0.01, 0.02))
    numbers = [upright, 0.25, near, FIRST, near, FIRST, aside, FIRST, further, FIRST]
    assert not attempt(chain, c.JOIN_WALL, scripted(numbers))[0]
    places = chain.graph.vertex_xy[chain.proposal.new_vertices[:2]]
    assert places == pytest.approx(np.array([(0.52, 0.51), (0.52, 0.52)]))


def test_nothing_is_there_to_change_in_a_map_that_was_emptied(lab: Lab) -> None:
    rng = np.random.default_rng(2)
    chain = lab.chain_at(Coloring.empty(WINDOW))
    while attempt(chain, c.TRIANGLE_BIRTH, rng)[3] == -math.inf:
        pass
    while attempt(chain, c.TRIANGLE_DEATH, rng)[3] == -math.inf:
        pass
    for move in set(range(len(NAMES))) - {c.TRIANGLE_BIRTH, c.BOUNDARY_BIRTH, c.CORNER_BIRTH, c.BOX_BIRTH}:
        assert not any(attempt(chain, move, rng)[0] for _ in range(5)), NAMES[move]


# What a move must not propose: corners in the wrong order, places that nothing draws, vertices that may not go.


REFUSED_WALL = [(0.0, 0.25), (2.0, 0.25)]
REFUSED_BEHIND = [(0.0, 0.6), (2.0, 0.6)]
REFUSED_TOOTH = [(0.0, 0.25), (0.5, 0.25), (0.6, 0.4), (0.7, 0.25), (2.0, 0.25)]
LONG_TOOTH = [(0.0, 0.25), (0.5, 0.25), (0.6, 0.7), (0.7, 0.25), (2.0, 0.25)]
REFUSED_NICHE = [(0.0, 0.25), (0.5, 0.25), (0.5, 0.4), (0.7, 0.4), (0.7, 0.25), (2.0, 0.25)]
LAST = 1.0 - FINEST
"""The last number that is drawn, just below 1."""


def aimed_at(*returns: tuple[float, float]) -> Lab:
    return lab_at(WIDE, 0.25, aimed=0.6, side=0.05, returns=returns)


def test_a_tooth_stands_with_both_feet_on_its_edge() -> None:
    """After one that was proposed, and crosses a wall behind, none of its corners may be taken for the next one's."""
    lab, x = aimed_at((0.6, 0.7)), drawn(WIDE, REFUSED_WALL, REFUSED_BEHIND)
    chain, crossing = chain_listed(lab, x), 0
    for numbers in SCRIPTS[c.NOTCH](chain, plain_map(x), plain_map(drawn(WIDE, LONG_TOOTH, REFUSED_BEHIND)), lab.plan):
        trial = copy.deepcopy(chain)
        if attempt(trial, c.NOTCH, scripted(numbers))[:2] == (True, False):
            crossing += 1
            for place in (5, 6):
                beyond = [*numbers[:place], LAST, *numbers[place + 1 :]]
                assert not attempt(copy.deepcopy(trial), c.NOTCH, scripted(beyond))[0]
    assert crossing > 0


def test_the_feet_of_a_niche_do_not_cross() -> None:
    """Feet drawn towards each other by more than their distance; as far from each other they may stand."""
    lab, x = aimed_at((0.5, 0.4)), drawn(WIDE, REFUSED_WALL)
    (numbers, *_) = SCRIPTS[c.NOTCH](lab.chain_at(x), plain_map(x), plain_map(drawn(WIDE, REFUSED_NICHE)), lab.plan)
    ways = [[*signed(shift, REACH), *signed(-shift, REACH)] for shift in (-0.15, 0.15)]
    assert {is_legal(lab, c.NOTCH, x, [*numbers[:9], *way, *numbers[13:]]) for way in ways} == {False, True}


def test_without_returns_no_notch_is_made_and_none_is_filled() -> None:
    """Squares may be there although nothing is aimed at them: what no notch could undo is not filled."""
    lab = aimed_at((0.6, 0.4), (0.5, 0.4))
    for notched in (REFUSED_TOOTH, REFUSED_NICHE):
        x, y = drawn(WIDE, REFUSED_WALL), drawn(WIDE, notched)
        for move, start, end in ((c.NOTCH, x, y), (c.FILL, y, x)):
            chain = chain_listed(lab, start)
            (numbers, *_) = SCRIPTS[move](chain, plain_map(start), plain_map(end), lab.plan)
            assert attempt(copy.deepcopy(chain), move, scripted(numbers))[3] > -math.inf
            chain.tuning[c.AIMED_SHARE] = 0.0
            legal, _, _, ratio = attempt(chain, move, scripted(numbers))
            assert (legal, ratio) == (move == c.FILL, -math.inf)


def test_the_edge_at_the_border_is_no_inner_edge_of_a_niche() -> None:
    lab, x = aimed_at((0.6, 0.4)), drawn(WIDE, REFUSED_TOOTH)
    chain = lab.chain_at(x)
    for ends in (REFUSED_TOOTH[:2], REFUSED_TOOTH[-2:]):
        assert not is_legal(lab, c.FILL, x, [SECOND, pick(chain, c.EDGES, edge_slot(chain, frozenset(ends)))])


def test_a_split_at_the_very_end_of_an_edge_is_none() -> None:
    lab, x = lab_at(WIDE, 0.25), drawn(WIDE, [(0.5, 0.5), (1.0, 0.5), (1.0, 0.75), (0.5, 0.75), (0.5, 0.5)])
    assert [is_legal(lab, c.SPLIT, x, [0.0, foot, 0.2, FIRST]) for foot in (0.0, 0.5)] == [False, True]


@pytest.mark.parametrize("move", [c.TRIANGLE_BIRTH, c.NOTCH])
def test_what_rounding_puts_beside_its_square_is_not_drawn(move: int) -> None:
    """The last number draws the far border of a square, which is the next one's; nothing is aimed at that."""
    lab = lab_at(WIDE, 0.25, aimed=1.0, side=0.0625, returns=[(1.5, 0.4)])
    x = drawn(WIDE, REFUSED_WALL)
    head = [0.5, 0.5, FIRST] if move == c.TRIANGLE_BIRTH else [FIRST]
    tail = [0.9, 0.1, 0.9, 0.3] if move == c.TRIANGLE_BIRTH else [0.5, 0.5, 0.5, 0.1, FIRST, 0.1, FIRST]
    assert [is_legal(lab, move, x, [*head, 0.5, share, 0.5, *tail]) for share in (LAST, 0.5)] == [False, True]
