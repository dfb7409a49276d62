"""Strata and their quotas."""

from __future__ import annotations

import numpy as np
import pytest

from prf.thinning.quotas import EVENNESS, RARE, Strata, draw_evenly, strata_of, weights
from prf.window import Window

WINDOW = Window(0.0, 0.0, 8.0, 8.0)


def made(sizes: list[int], alike: list[int] | None = None) -> Strata:
    size = np.array(sizes)
    return Strata(np.arange(size.sum()), size, size if alike is None else np.array(alike))


def test_beams_of_a_stratum_share_square_direction_and_outcome() -> None:
    rng = np.random.default_rng(1)
    origin, end = rng.uniform(0.1, 7.9, (2, 3000, 2))
    returned = rng.random(3000) < 0.7
    strata = strata_of(WINDOW, origin, end, returned)
    np.testing.assert_array_equal(np.sort(strata.order), np.arange(3000))
    towards = np.floor((np.arctan2(*(end - origin).T[::-1]) + np.pi) / (np.pi / 4.0)).astype(int) % 8
    names = [
        (*square, outcome) for square, outcome in zip(np.floor(end / 0.5).astype(int).tolist(), returned, strict=True)
    ]
    start = 0
    for size, alike in zip(strata.size, strata.alike, strict=True):
        members = strata.order[start : start + size]
        assert len({names[i] + (towards[i],) for i in members}) == 1
        assert (np.diff(members) > 0).all()
        assert alike == names.count(names[members[0]])
        start += size


def test_quotas_fill_the_budget_and_grow_as_the_power_of_the_size() -> None:
    strata = made([100, 400, 1600, 6400])
    share = weights(strata, 200.0)
    assert strata.size @ share == pytest.approx(200.0)
    quota = strata.size * share
    np.testing.assert_allclose(quota[1:] / quota[:-1], 4.0**EVENNESS)


def test_rare_beams_come_first() -> None:
    share = weights(made([1, 2, 100_000]), 50.0)
    assert share[0] == share[1] == 1.0
    np.testing.assert_allclose(weights(made([300, 100], [400, 400]), 1.0), RARE / 400)


def test_no_stratum_gives_more_than_it_has() -> None:
    share = weights(made([5, 5, 1000]), 900.0)
    assert (share <= 1.0).all()
    assert share[0] == 1.0


def test_drawing_is_even_and_keeps_the_certain() -> None:
    strata = made([3, 10, 10, 1000])
    kept = draw_evenly(strata, np.array([1.0, 0.25, 0.25, 0.125]))
    assert kept[:3].all()
    assert kept[3:23].sum() == 5
    assert abs(kept[23:].sum() - 125) <= 1
    assert set(np.diff(np.flatnonzero(kept[23:]))) == {8}
