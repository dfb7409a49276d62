"""What a move must not propose: corners in the wrong order, places that nothing draws, vertices that may not go."""

from __future__ import annotations

import copy
import math

import pytest

from prf.kernels import constants as c
from prf.model.window import Window
from tests.kernels.by_hand import REACH, chain_listed, drawn, is_legal, lab_at
from tests.reference.hastings import Lab, attempt
from tests.reference.plain_map import plain_map
from tests.reference.scripted import FINEST, FIRST, SCRIPTS, SECOND, edge_slot, pick, scripted, signed

pytestmark = pytest.mark.uncompiled

WIDE = Window(0.0, 0.0, 2.0, 1.0)
WALL = [(0.0, 0.25), (2.0, 0.25)]
BEHIND = [(0.0, 0.6), (2.0, 0.6)]
TOOTH = [(0.0, 0.25), (0.5, 0.25), (0.6, 0.4), (0.7, 0.25), (2.0, 0.25)]
LONG_TOOTH = [(0.0, 0.25), (0.5, 0.25), (0.6, 0.7), (0.7, 0.25), (2.0, 0.25)]
NICHE = [(0.0, 0.25), (0.5, 0.25), (0.5, 0.4), (0.7, 0.4), (0.7, 0.25), (2.0, 0.25)]
LAST = 1.0 - FINEST
"""The last number that is drawn, just below 1."""


def aimed_at(*returns: tuple[float, float]) -> Lab:
    return lab_at(WIDE, 0.25, aimed=0.6, side=0.05, returns=returns)


def test_a_tooth_stands_with_both_feet_on_its_edge() -> None:
    """After one that was proposed, and crosses a wall behind, none of its corners may be taken for the next one's."""
    lab, x = aimed_at((0.6, 0.7)), drawn(WIDE, WALL, BEHIND)
    chain, crossing = chain_listed(lab, x), 0
    for numbers in SCRIPTS[c.NOTCH](chain, plain_map(x), plain_map(drawn(WIDE, LONG_TOOTH, BEHIND)), lab.plan):
        trial = copy.deepcopy(chain)
        if attempt(trial, c.NOTCH, scripted(numbers))[:2] == (True, False):
            crossing += 1
            for place in (5, 6):
                beyond = [*numbers[:place], LAST, *numbers[place + 1 :]]
                assert not attempt(copy.deepcopy(trial), c.NOTCH, scripted(beyond))[0]
    assert crossing > 0


def test_the_feet_of_a_niche_do_not_cross() -> None:
    """Feet drawn towards each other by more than their distance; as far from each other they may stand."""
    lab, x = aimed_at((0.5, 0.4)), drawn(WIDE, WALL)
    (numbers, *_) = SCRIPTS[c.NOTCH](lab.chain_at(x), plain_map(x), plain_map(drawn(WIDE, NICHE)), lab.plan)
    ways = [[*signed(shift, REACH), *signed(-shift, REACH)] for shift in (-0.15, 0.15)]
    assert {is_legal(lab, c.NOTCH, x, [*numbers[:9], *way, *numbers[13:]]) for way in ways} == {False, True}


def test_without_returns_no_notch_is_made_and_none_is_filled() -> None:
    """Squares may be there although nothing is aimed at them: what no notch could undo is not filled."""
    lab = aimed_at((0.6, 0.4), (0.5, 0.4))
    for notched in (TOOTH, NICHE):
        x, y = drawn(WIDE, WALL), drawn(WIDE, notched)
        for move, start, end in ((c.NOTCH, x, y), (c.FILL, y, x)):
            chain = chain_listed(lab, start)
            (numbers, *_) = SCRIPTS[move](chain, plain_map(start), plain_map(end), lab.plan)
            assert attempt(copy.deepcopy(chain), move, scripted(numbers))[3] > -math.inf
            chain.tuning[c.AIMED_SHARE] = 0.0
            legal, _, _, ratio = attempt(chain, move, scripted(numbers))
            assert (legal, ratio) == (move == c.FILL, -math.inf)


def test_the_edge_at_the_border_is_no_inner_edge_of_a_niche() -> None:
    lab, x = aimed_at((0.6, 0.4)), drawn(WIDE, TOOTH)
    chain = lab.chain_at(x)
    for ends in (TOOTH[:2], TOOTH[-2:]):
        assert not is_legal(lab, c.FILL, x, [SECOND, pick(chain, c.EDGES, edge_slot(chain, frozenset(ends)))])


def test_a_split_at_the_very_end_of_an_edge_is_none() -> None:
    lab, x = lab_at(WIDE, 0.25), drawn(WIDE, [(0.5, 0.5), (1.0, 0.5), (1.0, 0.75), (0.5, 0.75), (0.5, 0.5)])
    assert [is_legal(lab, c.SPLIT, x, [0.0, foot, 0.2, FIRST]) for foot in (0.0, 0.5)] == [False, True]


@pytest.mark.parametrize("move", [c.TRIANGLE_BIRTH, c.NOTCH])
def test_what_rounding_puts_beside_its_square_is_not_drawn(move: int) -> None:
    """The last number draws the far border of a square, which is the next one's; nothing is aimed at that."""
    lab = lab_at(WIDE, 0.25, aimed=1.0, side=0.0625, returns=[(1.5, 0.4)])
    x = drawn(WIDE, WALL)
    head = [0.5, 0.5, FIRST] if move == c.TRIANGLE_BIRTH else [FIRST]
    tail = [0.9, 0.1, 0.9, 0.3] if move == c.TRIANGLE_BIRTH else [0.5, 0.5, 0.5, 0.1, FIRST, 0.1, FIRST]
    assert [is_legal(lab, move, x, [*head, 0.5, share, 0.5, *tail]) for share in (LAST, 0.5)] == [False, True]
