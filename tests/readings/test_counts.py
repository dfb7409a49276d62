"""Counts of beams round places: those of a slow count along every beam."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

from prf.model.window import Window
from prf.readings import Readings
from prf.readings.counts import CELL, BeamCounts, beam_counts

ROOM = Window(-2.0, 1.0, 4.0, 5.0)
REACH = 8.0


@pytest.fixture(scope="module")
def beams() -> Readings:
    rng = np.random.default_rng(4)
    n = 300
    origin = np.column_stack([rng.uniform(-1.9, 3.9, n), rng.uniform(1.1, 4.9, n)])
    ranges = np.where(rng.random(n) < 0.2, np.inf, rng.uniform(0.2, 6.0, n))
    return Readings.from_arrays(origin, rng.uniform(-np.pi, np.pi, n), ranges).within(REACH)


@pytest.fixture(scope="module")
def counts(beams: Readings) -> BeamCounts:
    return beam_counts(ROOM, beams)


def test_every_return_in_the_window_is_counted_once(beams: Readings, counts: BeamCounts) -> None:
    ends = beams.impacts()
    assert counts.returns.sum() == ROOM.contains(ends).sum()
    assert (counts.returns <= counts.passes).all()
    ends_of_all, _ = counts.within(np.array([[1.0, 3.0]]), 6.5)
    assert ends_of_all[0] == pytest.approx(counts.returns.sum())


def test_squares_hold_the_returns_that_lie_in_them(beams: Readings, counts: BeamCounts) -> None:
    """Where the square is one of whole cells."""
    ends = beams.impacts()
    low = counts.origin + CELL * np.array([[20, 20], [40, 30], [77, 51]])
    found, _ = counts.within(low + 10 * CELL, 20 * CELL)
    slow = [int(((ends >= corner) & (ends < corner + 20 * CELL)).all(axis=1).sum()) for corner in low]
    np.testing.assert_allclose(found, slow, atol=1e-6)
    assert sum(slow) > 0


def test_crossings_are_the_length_of_beams_in_a_square(beams: Readings, counts: BeamCounts) -> None:
    """A line in a random direction visits 4 / pi cells on the length of a side."""
    xy, side = np.array([[0.0, 3.0], [1.5, 2.5], [2.0, 4.0]]), 1.0
    direction = np.column_stack([np.cos(beams.angle), np.sin(beams.angle)])
    lines = shapely.linestrings(
        np.stack([beams.origin, beams.origin + np.minimum(beams.range, REACH)[:, None] * direction], axis=1)
    )
    box = shapely.box(*(xy - 0.5 * side).T, *(xy + 0.5 * side).T)
    length = np.array([shapely.length(shapely.intersection(lines, each)).sum() for each in box])
    _, crossing = counts.within(xy, side)
    np.testing.assert_allclose(crossing, 4.0 / np.pi * length / side, rtol=0.07)


def test_places_outside_have_none(counts: BeamCounts) -> None:
    ends, crossing = counts.within(np.array([[-9.0, 3.0], [1.0, 30.0]]), 0.1)
    assert not ends.any()
    assert not crossing.any()


def test_a_large_window_has_larger_cells() -> None:
    far = Readings.from_arrays(np.zeros((1, 2)), np.zeros(1), np.full(1, 5.0)).within(REACH)
    found = beam_counts(Window(-200.0, -200.0, 200.0, 200.0), far)
    assert found.cell == pytest.approx(0.2)
    assert found.returns.sum() == 1
