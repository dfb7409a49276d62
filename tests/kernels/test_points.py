"""What a loop's recolouring gains at points, and the colours after it: against asking every point."""

from __future__ import annotations

import numpy as np
import pytest

from prf.kernels import constants as c
from prf.kernels.readings import points as k
from prf.kernels.readings.points import Points
from prf.model.points import make_points, paint
from tests.kernels.entries import gain_of, inside_table, sum_of
from tests.reference.slow_points import lattice


def scattered(rng: np.random.Generator) -> np.ndarray:
    return rng.uniform(-5.0, 5.0, (300, 2))


def repeated(rng: np.random.Generator) -> np.ndarray:
    """Few places, each observed several times."""
    return rng.uniform(-5.0, 5.0, (20, 2))[rng.integers(0, 20, 150)]


def uneven_rows(rng: np.random.Generator) -> np.ndarray:
    rows = rng.uniform(-5.0, 5.0, 12)
    return np.column_stack([rng.uniform(-5.0, 5.0, 200), rows[rng.integers(0, 12, 200)]])


def crossed(rng: np.random.Generator) -> np.ndarray:
    """A row and a column: bands of one y amid bands of many."""
    along = rng.uniform(-5.0, 5.0, 60)
    return np.concatenate([np.column_stack([along, np.full(60, 0.25)]), np.column_stack([np.full(60, 0.3), along])])


LAYOUTS = {
    "lattice": lambda rng: lattice(17, -5.0, 5.0),
    "scattered": scattered,
    "repeated": repeated,
    "uneven rows": uneven_rows,
    "crossed": crossed,
    "one": lambda rng: np.array([[0.5, -0.5]]),
    "two": lambda rng: np.array([[0.5, -0.5], [-1.0, 2.0]]),
}


def places_of(points: Points) -> np.ndarray:
    return np.ascontiguousarray(points.column[[k.X, k.Y]].T)


def gain(points: Points, loop: np.ndarray, turns: bool) -> float:
    return gain_of(points, loop, np.zeros(2 * c.MOST_CHANGES), turns)


def points_on(xy: np.ndarray, rng: np.random.Generator) -> Points:
    points = make_points(xy, rng.normal(size=(len(xy), 2)))
    paint(points, rng.random(len(xy)) < 0.5)
    return points


@pytest.mark.parametrize("name", LAYOUTS)
def test_points_are_laid_out_band_by_band(name: str) -> None:
    rng = np.random.default_rng(30)
    xy = LAYOUTS[name](rng)
    density = rng.normal(size=(len(xy), 2))
    with np.errstate(divide="raise", invalid="raise"):
        points = make_points(xy, density)
    rows = points.column[[k.X, k.Y, k.LOG_WHITE, k.LOG_BLACK]].T
    given = np.column_stack([xy, density])
    assert np.array_equal(rows[np.lexsort(rows.T)], given[np.lexsort(given.T)])
    first, low, high = points.band
    assert (first[0], first[-1]) == (0, len(xy))
    assert (np.diff(first) > 0).all()
    assert (low[1:-1] > high[:-2]).all()
    for band in range(len(first) - 1):
        x, y = points.column[[k.X, k.Y], int(first[band]) : int(first[band + 1])]
        assert (np.diff(x) >= 0.0).all()
        assert (y.min(), y.max()) == (low[band], high[band])


def test_a_lattice_is_taken_by_rows_and_scattered_points_are_not() -> None:
    rng = np.random.default_rng(31)
    by_row = make_points(lattice(17, -5.0, 5.0), np.zeros((17 * 17, 2)))
    assert by_row.band.shape[1] == 17 + 1
    assert np.array_equal(by_row.band[k.LOWEST], by_row.band[k.HIGHEST])
    loose = make_points(scattered(rng), np.zeros((300, 2)))
    assert 5 <= loose.band.shape[1] <= 20


def test_the_likelihood_takes_each_value_in_the_colour_of_its_place() -> None:
    """Log densities that are all different, so that no other choice of them has the same sum."""
    density = np.array([[1.0, 0.1], [2.0, 0.02], [4.0, 0.004], [8.0, 0.0008]])
    for black in np.ndindex(2, 2, 2, 2):
        points = make_points(np.column_stack([np.arange(4.0), np.zeros(4)]), density)
        paint(points, np.array(black, bool))
        assert sum_of(points) == pytest.approx(sum(density[place, colour] for place, colour in enumerate(black)))


@pytest.mark.parametrize("name", LAYOUTS)
def test_gains_and_colours_are_those_of_asking_every_point(name: str) -> None:
    rng = np.random.default_rng(32)
    points = points_on(LAYOUTS[name](rng), rng)
    places, (white_density, black_density) = places_of(points), points.column[[k.LOG_WHITE, k.LOG_BLACK]]
    black, n_turned = points.column[k.BLACK] != 0.0, 0
    for turns in rng.random(400) < 0.5:
        loop = rng.uniform(-5.0, 5.0, 2) + rng.normal(size=(rng.integers(3, 9), 2)) * 10.0 ** rng.uniform(-0.5, 0.7)
        loop = np.clip(loop, -5.1, 5.1)
        inside = np.zeros(len(places), np.bool_)
        inside_table(places, loop, inside)
        expected = np.where(black, white_density - black_density, black_density - white_density)[inside].sum()
        assert gain(points, loop, bool(turns)) == pytest.approx(expected, abs=1e-9)
        black ^= inside & turns
        n_turned += int((inside & turns).sum())
        assert np.array_equal(points.column[k.BLACK], black)
    assert n_turned > 0
    after = points.column.copy()
    paint(points, black)
    assert np.array_equal(points.column, after), "turning there and back leaves no rounding behind"


def test_no_points_gain_nothing() -> None:
    points = make_points(np.zeros((0, 2)), np.zeros((0, 2)))
    assert gain(points, np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]), True) == 0.0


def test_corners_at_the_height_of_a_row() -> None:
    """A lattice of whole numbers and loops with whole corners: whatever a border point gets, it gets it alike."""
    xy = np.array([(x, y) for y in range(6) for x in range(6)], float)
    points = points_on(xy, np.random.default_rng(34))
    places = places_of(points)
    rng = np.random.default_rng(35)
    for _ in range(200):
        loop = rng.integers(0, 6, (rng.integers(3, 7), 2)).astype(float)
        inside = np.zeros(len(places), np.bool_)
        inside_table(places, loop, inside)
        before = points.column[k.BLACK] != 0.0
        gain(points, loop, True)
        assert np.array_equal(points.column[k.BLACK], before ^ inside)
