"""The benchmark of the noisy bitmap: its truth, and what its baselines do where that is known."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks import bitmap


def test_the_truth_lies_inside_with_white_all_round() -> None:
    truth = bitmap.bitmap(bitmap.shapes())
    assert truth.shape == (bitmap.SIZE, bitmap.SIZE)
    assert 0.15 < truth.mean() < 0.35
    assert not truth[[0, -1]].any()
    assert not truth[:, [0, -1]].any()
    assert truth[10, 12], "a leg of the letter"
    assert not truth[28, 26], "its counter"


@pytest.mark.parametrize("diagonal", [False, True], ids=["4 neighbours", "8 neighbours"])
def test_the_graph_cut_trades_pixels_for_borders(diagonal: bool) -> None:
    """One black pixel: kept while its border costs less than the odds of a flip."""
    noisy = np.zeros((9, 9), np.bool_)
    noisy[4, 4] = True
    border = 4.0 + (4.0 / np.sqrt(2.0) if diagonal else 0.0)
    odds = np.log((1.0 - bitmap.FLIPS) / bitmap.FLIPS)
    assert np.array_equal(bitmap.by_ising(noisy, 0.99 * odds / border, diagonal), noisy)
    assert not bitmap.by_ising(noisy, 1.01 * odds / border, diagonal).any()


def test_the_median_is_the_majority() -> None:
    noisy = np.zeros((9, 9), np.bool_)
    noisy[:, :4] = True
    noisy[4, 1] = False
    expected = noisy.copy()
    expected[4, 1] = True
    assert np.array_equal(bitmap.by_median(noisy, 3), expected)


def test_the_best_in_hindsight_is_taken() -> None:
    truth = np.eye(4, dtype=np.bool_)
    found = bitmap.best_of([("none", ~truth), ("all", truth), ("half", truth & False)], truth)
    assert found[:2] == (0.0, "all")


def test_the_maps_find_a_half_plane() -> None:
    """Few steps, and pixels so clear that the posterior mean is the truth but along the border."""
    truth = np.zeros((bitmap.SIZE, bitmap.SIZE), np.bool_)
    truth[:, :48] = True
    noisy = truth ^ (np.random.default_rng(1).random(truth.shape) < bitmap.FLIPS)
    image, best, _ = bitmap.by_maps(noisy, 1, 0.03, 30_000, 1)
    assert image.occupancy.shape == truth.shape
    assert bitmap.wrong(image.occupancy > 0.5, truth) < 0.02
    assert best.n_edges < 60
