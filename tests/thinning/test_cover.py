"""Which ground is passed, beside lines that are looked up point by point."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from prf.thinning import cover
from prf.thinning.cover import PASSING, Passages
from prf.window import Window

WINDOW = Window(0.0, 0.0, 12.0, 7.0)


def beams(n: int, seed: int = 2) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    rng = np.random.default_rng(seed)
    low, high = np.array(WINDOW[:2]), np.array(WINDOW[2:])
    return rng.uniform(low, high, (n, 2)), rng.uniform(low, high, (n, 2))


def passes_of(passages: Passages, chosen: NDArray[np.bool_]) -> NDArray[np.int64]:
    return passages._count(chosen)


def test_every_point_of_a_beam_lies_in_a_cell_that_it_passes() -> None:
    start, end = beams(40)
    for share in np.linspace(0.0, 1.0, 101):
        at = start + share * (end - start)
        for i in range(0, 40, 7):
            passages = Passages(WINDOW, start[i : i + 1], end[i : i + 1])
            grid = passages._grid
            column, row = ((at[i] - [grid.x0, grid.y0]) / grid.cell).astype(int)
            assert passages._passes[row * grid.nx + column] == 1


def test_seen_ground_is_that_of_the_squares_passed() -> None:
    row = np.array([[0.5, 3.5]]), np.array([[11.5, 3.5]])
    assert 11.0 <= Passages(WINDOW, *row).seen_area() <= 13.0
    once, often = Passages(WINDOW, *beams(3000)), Passages(WINDOW, *beams(6000))
    assert once.seen_area() == pytest.approx(often.seen_area())
    assert once.seen_area() >= WINDOW.area


@pytest.mark.parametrize("kept_share", [0.0, 0.03, 0.3])
def test_completed_beams_pass_every_cell_twice_or_as_often_as_all(kept_share: float) -> None:
    start, end = beams(1500)
    passages = Passages(WINDOW, start, end)
    kept = np.random.default_rng(3).random(1500) < kept_share
    before = kept.copy()
    passages.complete(kept)
    assert kept[before].all()
    wanted = np.minimum(passes_of(passages, np.ones(1500, np.bool_)), PASSING)
    assert (passes_of(passages, kept) >= wanted).all()
    assert kept.sum() < 700


def test_cells_of_a_vast_window_stay_few(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cover, "MOST_CELLS", 500)
    start, end = beams(50)
    passages = Passages(WINDOW, start, end)
    assert passages._grid.nx * passages._grid.ny < 1000
    assert 0.0 < passages.seen_area() < 4.0 * WINDOW.area
