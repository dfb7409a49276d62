"""Moves between maps of as few edges as they can do with, and proposals at the borders of what can be proposed."""

from __future__ import annotations

import copy
import math

import numpy as np
import pytest

from prf.kernels import constants as c
from prf.model.coloring import Coloring
from prf.model.window import BOTTOM, INTERIOR, TOP, Window
from prf.sampler.posterior import Settings
from tests.reference.hastings import NAMES, Lab, attempt, is_same_map, log_ratio_back, make_lab, proposed_coloring
from tests.reference.plain_map import plain_map
from tests.reference.proposals import REVERSE, log_acceptance_ratio
from tests.reference.scripted import FIRST, SCRIPTS, edge_slot, pick, reached, scripted

pytestmark = pytest.mark.uncompiled

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


WALL = map_of(FEET, SIDES_OF_FEET, ACROSS)
JOINED = map_of(
    [*FEET, (1.24, 0.47), (1.26, 0.53)], [*SIDES_OF_FEET, INTERIOR, INTERIOR], [(0, 4), (4, 2), (1, 5), (5, 3)]
)
SMALLEST = {
    c.CUT_WALL: (WALL, cut(0.4, 0.6)),
    c.MEND_WALL: (cut(0.4, 0.6), WALL),
    c.JOIN_WALL: (WALL, JOINED),
    c.PART_WALL: (JOINED, WALL),
}


@pytest.fixture(scope="module")
def lab() -> Lab:
    return make_lab(Settings(WINDOW, 1.0, cell=0.1, cut_reach=0.03), np.random.default_rng(1))


@pytest.mark.parametrize("move", SMALLEST, ids=[NAMES[move] for move in SMALLEST])
def test_a_wall_of_two_edges_is_changed_and_changed_back(lab: Lab, move: int) -> None:
    x, y = SMALLEST[move]
    found = log_ratio_back(lab, REVERSE[move], y, x)
    assert found == pytest.approx(log_acceptance_ratio(move, x, y, lab.plan), abs=1e-9)


def test_a_cut_too_wide_to_be_mended_is_not_accepted(lab: Lab) -> None:
    wide = cut(0.1, 0.9)
    chain = lab.chain_at(WALL)
    seen = 0
    for numbers in SCRIPTS[c.CUT_WALL](chain, plain_map(WALL), plain_map(wide), lab.plan):
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
    for move in set(range(len(NAMES))) - {c.TRIANGLE_BIRTH, c.BOUNDARY_BIRTH, c.CORNER_BIRTH}:
        assert not any(attempt(chain, move, rng)[0] for _ in range(5)), NAMES[move]
