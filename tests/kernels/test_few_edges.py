"""Moves on the smallest maps that they can be made on, and on few edges of which hardly any map of a chain has such."""

from __future__ import annotations

import math

import numpy as np
import pytest

from prf.kernels import constants as c
from prf.model.coloring import Coloring
from prf.model.layout import read_coloring
from prf.model.window import Window
from tests.kernels.by_hand import drawn, is_legal, lab_at, log_ratio
from tests.reference.hastings import Lab, attempt
from tests.reference.proposals import log_acceptance_ratio
from tests.reference.scripted import FIRST, SECOND, pick, reached, scripted

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
