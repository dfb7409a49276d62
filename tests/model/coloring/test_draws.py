from __future__ import annotations

import numpy as np
import pytest

from prf.model.arak import exact_draws
from prf.model.coloring import Coloring, Draws
from prf.model.window import Window

UNIT = Window(0.0, 0.0, 1.0, 1.0)
FIELDS = ("vertex_offsets", "xy", "side", "edge_offsets", "edges", "anchor_black")


def assert_same(a: Draws, b: Draws) -> None:
    assert a.window == b.window
    for name in FIELDS:
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name))
        assert getattr(a, name).dtype == getattr(b, name).dtype


@pytest.fixture(scope="module")
def draws() -> Draws:
    return exact_draws(0.7, UNIT, 30, np.random.default_rng(1))


def test_colorings_out_and_in_again(draws: Draws) -> None:
    assert len(draws) == 30
    assert_same(Draws.from_colorings(list(draws)), draws)
    assert draws.n_edges.tolist() == [draw.n_edges for draw in draws]
    np.testing.assert_allclose(draws.total_length(), [draw.total_length() for draw in draws])


def test_indices_count_from_both_ends(draws: Draws) -> None:
    np.testing.assert_array_equal(draws[-1].xy, draws[29].xy)
    with pytest.raises(IndexError):
        draws[30]


def test_no_draws_need_a_window() -> None:
    assert len(Draws.from_colorings([], UNIT)) == 0
    assert Draws.from_colorings([], UNIT).total_length().tolist() == []
    with pytest.raises(ValueError, match="one window"):
        Draws.from_colorings([])


def test_owners_and_global_edges(draws: Draws) -> None:
    ends = draws.xy[draws.global_edges()].reshape(-1, 4)
    np.testing.assert_array_equal(ends, np.concatenate([draw.segments() for draw in draws]))
    assert np.bincount(draws.draw_of_edge(), minlength=30).tolist() == draws.n_edges.tolist()


def test_empty_draws_keep_their_place() -> None:
    black = Draws.from_colorings([Coloring.empty(UNIT, True), Coloring.empty(UNIT)])
    assert black.total_length().tolist() == [0.0, 0.0]
    assert [draw.anchor_black for draw in black] == [True, False]
