"""Where chains agree: shares of the ground, places, and how both are reported."""

from __future__ import annotations

import math

import numpy as np

from prf.results.run import Agreement, agreement

ORIGIN = np.array([10.0, 20.0])


def example() -> Agreement:
    """Two places on seen ground, one of them of cells that touch at a corner only, and one place that nobody saw."""
    differs = np.zeros((10, 10), np.float32)
    differs[0:2, 0:3] = 0.5
    differs[1, 1] = 0.9
    differs[5, 5] = differs[6, 6] = 0.3
    differs[9, 5:] = 1.0
    differs[8, 0] = np.nan
    seen = np.ones((10, 10), np.bool_)
    seen[8:] = False
    return agreement(differs, seen, ORIGIN, 0.5)


def test_shares_are_of_the_cells_that_were_seen_and_of_the_rest() -> None:
    found = example()
    assert found.seen == 1.0 - 8 / 80
    assert found.unseen == 1.0 - 5 / 19


def test_places_are_connected_seen_cells_the_largest_first() -> None:
    (x, y, area, difference), *others = example().places
    assert (x, y) in {(10.75, 20.25), (10.75, 20.75)}
    assert area == 6 * 0.25
    assert difference == np.float32(0.9)
    assert [place[:3] for place in others] == [(12.75, 22.75, 0.25), (13.25, 23.25, 0.25)]


def test_a_small_difference_is_none() -> None:
    found = agreement(np.full((3, 3), 0.2, np.float32), np.ones((3, 3), np.bool_), ORIGIN, 1.0)
    assert (found.seen, found.places) == (1.0, [])
    assert found.words() == "chains agree on 100 % of the seen ground"
    assert math.isnan(found.unseen)


def test_one_chain_has_nothing_to_compare() -> None:
    found = agreement(np.full((3, 3), np.nan, np.float32), np.ones((3, 3), np.bool_), ORIGIN, 1.0)
    assert found.words() == ""
    assert found.document() == {"seen": None, "unseen": None, "places": []}
    assert Agreement.of_document(found.document()).words() == ""


def test_words_round_down_and_name_the_places() -> None:
    found = example()._replace(seen=0.9999)
    assert found.words().startswith("chains agree on 99 % of the seen ground; they differ most round (10.8, 20.")
    assert found.words().endswith("(12.8, 22.8), (13.2, 23.2)")
    again = Agreement.of_document(found.document())
    assert again.words() == found.words()
