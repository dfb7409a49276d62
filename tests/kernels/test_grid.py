"""The walk of a segment through cells against exact clipping in rational numbers."""

from __future__ import annotations

import itertools
import math
from fractions import Fraction

import numpy as np
import pytest

from prf.kernels import constants as c
from prf.kernels.state.cell_lists import first_segments, list_segments
from prf.kernels.state.grid import Grid, cells_of, make_grid, most_cells
from prf.model.layout import image_grid
from prf.model.window import Window
from tests.kernels.entries import cells_at, exits, hit_table, walk_segments

ROOM = Window(-5.0, -5.0, 5.0, 5.0)
GRIDS = [
    pytest.param(Grid(0.0, 0.0, 1.0, 12, 9), id="whole"),
    pytest.param(Grid(0.0, 0.0, 0.1, 12, 9), id="tenths"),
    pytest.param(make_grid(*ROOM, 0.4), id="of a room"),
    pytest.param(make_grid(1e5, -3e5, 1e5 + 20.0, -3e5 + 12.0, 0.7), id="far from the origin"),
    pytest.param(image_grid(Window(0.1, -0.3, 3.7, 2.25), 0.1), id="of an image", marks=pytest.mark.slow),
]
HAIR = Fraction(1, 10**8)
"""Share of a cell within which a passage may be missed by rounding: nothing meets there but near a corner."""


def walks(grid: Grid, segments: np.ndarray) -> list[list[int]]:
    cells = np.full((len(segments), most_cells(grid)), -1, np.int32)
    numbers = np.zeros(len(segments), np.int64)
    walk_segments(grid, np.ascontiguousarray(segments, np.float64), cells, numbers)
    return [row[:n].tolist() for row, n in zip(cells, numbers, strict=True)]


def clip(grid: Grid, segment: np.ndarray, hair: Fraction) -> set[int]:
    """Cells, each side drawn in by `hair` (or put out, if below 0), with which the segment has a length in common."""
    a = [
        (Fraction(float(segment[k])) - Fraction(origin)) / Fraction(grid.cell)
        for k, origin in ((0, grid.x0), (1, grid.y0))
    ]
    b = [
        (Fraction(float(segment[k])) - Fraction(origin)) / Fraction(grid.cell)
        for k, origin in ((2, grid.x0), (3, grid.y0))
    ]
    lows = [math.floor(min(a[i], b[i])) for i in range(2)]
    highs = [math.floor(max(a[i], b[i])) for i in range(2)]
    found = set()
    for ix, iy in itertools.product(range(lows[0] - 1, highs[0] + 2), range(lows[1] - 1, highs[1] + 2)):
        enter, leave = Fraction(0), Fraction(1)
        for start, end, index in ((a[0], b[0], ix), (a[1], b[1], iy)):
            low, high = index + hair, index + 1 - hair
            if start == end:
                if not low < start < high:
                    leave = Fraction(-1)
            else:
                first, second = sorted(((low - start) / (end - start), (high - start) / (end - start)))
                enter, leave = max(enter, first), min(leave, second)
        if enter < leave and 0 <= ix < grid.nx and 0 <= iy < grid.ny:
            found.add(ix + grid.nx * iy)
    return found


def box(grid: Grid) -> np.ndarray:
    return np.array([grid.x0, grid.y0, grid.x0 + grid.nx * grid.cell, grid.y0 + grid.ny * grid.cell])


def random_segments(grid: Grid, rng: np.random.Generator, n: int) -> np.ndarray:
    """Half across the whole grid, half short ones down to a millionth of a cell."""
    low, high = box(grid)[:2], box(grid)[2:]
    a, b = rng.uniform(low, high, (n, 2)), rng.uniform(low, high, (n, 2))
    shrunk = a + (b - a) * 10.0 ** rng.uniform(-7.0, 0.0, (n, 1))
    return np.hstack([a, np.where(rng.random((n, 1)) < 0.5, b, shrunk)])


def lattice_segments(grid: Grid, rng: np.random.Generator, n: int) -> np.ndarray:
    """Ends on corners, borders and middles of cells: through corners, along borders, along the grid's own border."""
    halves = rng.integers(0, [2 * grid.nx + 1, 2 * grid.ny + 1], (2, n, 2)) / 2.0
    ends = np.array([grid.x0, grid.y0]) + grid.cell * halves
    level = rng.random(n) < 0.25
    ends[1, level, 1] = ends[0, level, 1]
    upright = ~level & (rng.random(n) < 0.33)
    ends[1, upright, 0] = ends[0, upright, 0]
    return np.minimum(np.hstack([ends[0], ends[1]]), np.tile(box(grid)[2:], 2))


def corner_segments(grid: Grid, rng: np.random.Generator, n: int) -> np.ndarray:
    """Segments through corners of cells in arbitrary directions, as exactly as floats allow."""
    corner = np.array([grid.x0, grid.y0]) + grid.cell * rng.integers(3, [grid.nx - 2, grid.ny - 2], (n, 2))
    direction = rng.normal(size=(n, 2))
    direction /= np.hypot(*direction.T)[:, None]
    before, after = rng.uniform(0.0, 2.0, (2, n, 1)) * grid.cell
    return np.hstack([corner - before * direction, corner + after * direction])


KINDS = {"random": random_segments, "lattice": lattice_segments, "corner": corner_segments}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("grid", GRIDS)
def test_every_cell_that_a_segment_passes_is_listed_once(grid: Grid, kind: str) -> None:
    segments = KINDS[kind](grid, np.random.default_rng(11), 100)
    for segment, cells in zip(segments, walks(grid, segments), strict=True):
        assert clip(grid, segment, HAIR) <= set(cells), segment
        assert set(cells) <= clip(grid, segment, -Fraction(1, 10**6)), segment
        assert len(set(cells)) == len(cells), segment
        assert len(cells) <= most_cells(grid)


@pytest.mark.parametrize("grid", GRIDS)
def test_a_passage_through_a_corner_lists_all_four_cells(grid: Grid) -> None:
    """Rounding decides on which side of the corner the segment runs; what ends there must be found either way."""
    rng = np.random.default_rng(25)
    place = rng.integers(3, [grid.nx - 2, grid.ny - 2], (400, 2))
    corner = np.array([grid.x0, grid.y0]) + grid.cell * place
    turn = rng.uniform(0.2, 0.5 * np.pi - 0.2, 400) + rng.integers(4, size=400) * np.pi / 2
    direction = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    before, after = rng.uniform(0.5, 2.0, (2, 400, 1)) * grid.cell
    for (ix, iy), cells in zip(
        place, walks(grid, np.hstack([corner - before * direction, corner + after * direction])), strict=True
    ):
        assert {i + grid.nx * k for i in (ix - 1, ix) for k in (iy - 1, iy)} <= set(cells)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("grid", GRIDS)
def test_the_walk_starts_and_ends_where_its_ends_lie(grid: Grid, kind: str) -> None:
    segments = KINDS[kind](grid, np.random.default_rng(12), 400)
    ends = np.zeros((2, len(segments)), np.int64)
    cells_at(grid, np.ascontiguousarray(segments[:, :2]), ends[0])
    ends[1] = cells_of(grid, segments[:, 2:])
    for cells, first, last in zip(walks(grid, segments), *ends.tolist(), strict=True):
        assert (cells[0], cells[-1]) == (first, last)


@pytest.mark.parametrize("grid", GRIDS)
def test_a_walk_and_the_walk_back_pass_the_same_cells(grid: Grid) -> None:
    segments = random_segments(grid, np.random.default_rng(13), 2000)
    for there, back in zip(walks(grid, segments), walks(grid, segments[:, [2, 3, 0, 1]]), strict=True):
        assert set(there) == set(back)


def exactly_crosses(p: np.ndarray, q: np.ndarray) -> bool:
    """Whether the closed segments p and q meet, in rational numbers."""
    a, b, c, d = (tuple(map(Fraction, ends.tolist())) for ends in (p[:2], p[2:], q[:2], q[2:]))

    def turn(u: tuple[Fraction, ...], v: tuple[Fraction, ...], w: tuple[Fraction, ...]) -> int:
        area = (v[0] - u[0]) * (w[1] - u[1]) - (v[1] - u[1]) * (w[0] - u[0])
        return (area > 0) - (area < 0)

    return turn(a, b, c) * turn(a, b, d) < 0 and turn(c, d, a) * turn(c, d, b) < 0


@pytest.mark.parametrize("kinds", list(itertools.combinations_with_replacement(KINDS, 2)))
@pytest.mark.parametrize("grid", GRIDS)
def test_segments_that_cross_share_a_cell(grid: Grid, kinds: tuple[str, str]) -> None:
    """What the index is for: a crossing that no cell shows would go unseen."""
    rng = np.random.default_rng(14)
    one, two = (KINDS[kind](grid, rng, 2000) for kind in kinds)
    if kinds == ("corner", "corner"):  # let both pass the same corner
        middle = rng.uniform(0.3, 1.0, (2000, 1)) * grid.cell
        corner = np.array([grid.x0, grid.y0]) + grid.cell * rng.integers(3, [grid.nx - 2, grid.ny - 2], (2000, 2))
        turn = rng.normal(size=(2, 2000, 2))
        turn /= np.hypot(turn[..., 0], turn[..., 1])[..., None]
        one, two = (np.hstack([corner - middle * t, corner + middle * t]) for t in turn)
    n_crossing = 0
    for p, q, in_one, in_two in zip(one, two, walks(grid, one), walks(grid, two), strict=True):
        if exactly_crosses(p, q):
            n_crossing += 1
            assert set(in_one) & set(in_two), (p, q)
    assert n_crossing > (500 if kinds == ("corner", "corner") else 0)


@pytest.mark.parametrize("cell", [0.1, 0.25, 1.0, 7.0, 50.0])
def test_a_grid_covers_its_window_and_lies_off_round_coordinates(cell: float) -> None:
    grid = make_grid(*ROOM, cell)
    low, high = box(grid)[:2], box(grid)[2:]
    assert (low < -5.0).all()
    assert (high > 5.0).all()
    shift = (np.arange(-50, 51) / 10.0 - grid.x0) / cell
    assert np.abs(shift - np.round(shift)).min() > 1e-3


def test_rays_leave_a_cell_where_its_borders_stand() -> None:
    grid = make_grid(*ROOM, 0.7)
    rng = np.random.default_rng(15)
    cell = 5 + grid.nx * 7
    low = np.array([grid.x0 + 5 * 0.7, grid.y0 + 7 * 0.7])
    angle = np.concatenate([rng.uniform(-4, 4, 200), np.arange(4) * np.pi / 2])
    rays = np.hstack([low + 0.7 * rng.random((204, 2)), np.cos(angle)[:, None], np.sin(angle)[:, None]])
    found = np.empty(204)
    exits(grid, cell, rays, found)
    end = rays[:, :2] + found[:, None] * rays[:, 2:]
    off = np.minimum(np.abs(end - low), np.abs(end - low - 0.7)).min(axis=1)
    assert off.max() < 1e-9
    assert ((end > low - 1e-9) & (end < low + 0.7 + 1e-9)).all()
    exits(
        grid, cell, np.array([[low[0] + 0.2, low[1] + 0.3, 1.0, 0.0], [low[0] + 0.2, low[1] + 0.3, 0.0, -1.0]]), found
    )
    assert found[:2] == pytest.approx([0.5, 0.3])


# Segments by cell, and the first of them on rays, against asking every segment.


GRID = make_grid(0.0, 0.0, 10.0, 8.0, 0.7)


def some_segments(rng: np.random.Generator, n: int) -> np.ndarray:
    start = rng.uniform((0.5, 0.5), (9.5, 7.5), (n, 2))
    return np.hstack([start, np.clip(start + rng.normal(0.0, 1.0, (n, 2)), 0.1, 7.9)])


def cells_passed(grid: Grid, segments: np.ndarray) -> list[set[int]]:
    cells, n_cells = np.zeros((len(segments), most_cells(grid)), np.int32), np.zeros(len(segments), np.int64)
    walk_segments(grid, segments, cells, n_cells)
    return [set(row[:n].tolist()) for row, n in zip(cells, n_cells, strict=True)]


@pytest.mark.parametrize("n", [0, 1, 200])
def test_each_cell_lists_the_segments_that_pass_it(n: int) -> None:
    segments = some_segments(np.random.default_rng(n), n)
    lists, passed = list_segments(GRID, segments), cells_passed(GRID, segments)
    for cell in range(GRID.nx * GRID.ny):
        listed = lists.listed[lists.start[cell] : lists.start[cell + 1]].tolist()
        assert listed == [k for k in range(n) if cell in passed[k]]


def test_the_first_segment_on_a_ray_is_the_nearest_outside_its_tile() -> None:
    rng = np.random.default_rng(5)
    segments, n = some_segments(rng, 80), 300
    angle = rng.uniform(0.0, 2.0 * np.pi, n)
    ray = np.column_stack([rng.uniform((1, 1), (9, 7), (n, 2)), np.cos(angle), np.sin(angle)])
    tile, owner = rng.integers(-1, 3, 80).astype(np.int32), rng.integers(-1, 3, n).astype(np.int32)
    limit, path = rng.uniform(0.1, 6.0, n), np.empty(most_cells(GRID), np.int32)
    found, distance = np.empty(n, np.int32), np.empty(n)
    first_segments(list_segments(GRID, segments), tile, ray, owner, limit, path, found, distance)
    table = np.empty((n, 80))
    hit_table(ray, segments, table)
    table[(owner[:, None] == tile) & (owner[:, None] != c.NONE)] = np.inf
    nearest = table.min(axis=1)
    is_hit = nearest < limit
    assert is_hit.sum() > 50
    np.testing.assert_array_equal(found, np.where(is_hit, table.argmin(axis=1), c.NONE))
    np.testing.assert_array_equal(distance, np.where(is_hit, nearest, limit))
