"""Cells that readings saw, against shapely."""

from __future__ import annotations

import numpy as np
import shapely

from prf.model.layout import image_grid
from prf.model.window import Window
from prf.readings.ground import seen_by_beams, seen_by_cones
from tests.reference.slow_sonar import Cone, reach_in

WINDOW = Window(-2.0, 1.0, 6.0, 7.0)
GRID = image_grid(WINDOW, 0.25)


def squares() -> np.ndarray:
    x = GRID.x0 + GRID.cell * np.arange(GRID.nx)
    y = GRID.y0 + GRID.cell * np.arange(GRID.ny)
    low_x, low_y = np.meshgrid(x, y)
    return shapely.box(low_x, low_y, low_x + GRID.cell, low_y + GRID.cell)


def test_beams_see_the_cells_that_they_cross_up_to_their_end() -> None:
    rng = np.random.default_rng(1)
    origin = rng.uniform(WINDOW[:2], WINDOW[2:], (60, 2))
    angle, ranges = rng.uniform(-np.pi, np.pi, 60), rng.uniform(0.1, 12.0, 60)
    ranges[::7] = np.inf
    seen = seen_by_beams(GRID, WINDOW, origin, angle, ranges, 9.0)
    length = np.minimum(ranges, 9.0)
    end = origin + length[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    lines = shapely.linestrings(np.stack([origin, end], axis=1))
    crossed = shapely.intersects(squares()[..., None], lines).any(axis=-1)
    assert seen.shape == (GRID.ny, GRID.nx)
    assert (seen == crossed).all()
    assert 0.2 < seen.mean() < 0.95


def test_cones_see_no_less_than_they_cover_and_little_more() -> None:
    rng = np.random.default_rng(2)
    origin = rng.uniform(WINDOW[:2], WINDOW[2:], (12, 2))
    angle, ranges = rng.uniform(-np.pi, np.pi, 12), rng.uniform(0.3, 3.0, 12)
    ranges[0] = np.inf
    seen = seen_by_cones(GRID, WINDOW, origin, angle, np.full(12, 0.35), ranges, 3.5)
    length = np.minimum(
        ranges, [reach_in(WINDOW, Cone(*xy, turn, 0.35), 3.5) for xy, turn in zip(origin, angle, strict=True)]
    )
    turn = angle[:, None] + 0.35 * np.linspace(-0.5, 0.5, 41)
    rim = origin[:, None] + length[:, None, None] * np.stack([np.cos(turn), np.sin(turn)], axis=-1)
    cones = shapely.union_all([shapely.Polygon([start, *ends]) for start, ends in zip(origin, rim, strict=True)])
    covered = shapely.intersects(squares(), cones)
    near = shapely.intersects(squares(), cones.buffer(GRID.cell))
    assert (seen >= covered).all()
    assert (seen <= near).all()
