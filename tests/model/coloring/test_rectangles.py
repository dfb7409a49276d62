"""The outline of rectangles is their union, and is not told where rounding would decide."""

import numpy as np
import pytest
import shapely

from prf.model.coloring import Coloring, check, occupied_polygons, outline_of_rectangles
from prf.model.walls import corners_of, map_of_walls, united
from prf.model.window import Window

WINDOW = Window(0.0, 0.0, 10.0, 8.0)


def walls_at_random(n: int, rng: np.random.Generator) -> np.ndarray:
    """Walls (n, 5) of all directions inside the window."""
    middle, angle = rng.uniform([2.0, 2.0], [8.0, 6.0], (n, 2)), rng.uniform(0.0, np.pi, n)
    half = rng.uniform(0.2, 1.8, n)[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return np.column_stack([middle - half, middle + half, rng.uniform(0.02, 0.35, n)])


def union(walls: np.ndarray) -> shapely.Geometry:
    """The same region by GEOS."""
    return shapely.union_all(shapely.polygons(corners_of(walls)))


def difference(coloring: Coloring, walls: np.ndarray) -> float:
    """Area on which a map and its walls differ."""
    return float(shapely.symmetric_difference(occupied_polygons(coloring), union(walls)).area)


@pytest.mark.parametrize("n", [1, 2, 10, 60])
@pytest.mark.parametrize("seed", range(5))
def test_the_outline_is_that_of_the_union(n: int, seed: int) -> None:
    walls = walls_at_random(n, np.random.default_rng(seed))
    coloring = outline_of_rectangles(corners_of(walls), WINDOW)
    assert coloring is not None
    check(coloring)
    assert difference(coloring, walls) < 1e-9
    assert coloring.n_edges == sum(len(ring.coords) - 1 for ring in shapely.get_rings(shapely.get_parts(union(walls))))


TOUCHING = {
    "in a line": [[2.0, 2.0, 4.0, 2.0, 0.2], [4.0, 2.0, 6.0, 2.0, 0.2]],
    "in a point": [[2.0, 2.0, 3.0, 2.0, 0.25], [3.0, 2.25, 4.0, 2.25, 0.25]],
    "at a face": [[2.0, 2.0, 5.0, 2.0, 0.2], [3.0, 2.1, 3.0, 4.0, 0.1]],
    "as one": [[2.0, 2.0, 5.0, 2.0, 0.2], [2.0, 2.0, 5.0, 2.0, 0.2]],
    "on two sides of one": [[2.0, 2.0, 5.0, 2.0, 1.0], [2.0, 1.6, 5.0, 1.6, 0.2], [4.9, 1.5, 4.9, 2.5, 0.2]],
    "crossing in a corner": [[2.0, 2.0, 5.0, 2.0, 0.2], [2.0, 2.0, 2.0, 5.0, 0.2], [2.1, 2.1, 4.0, 4.0, 0.2]],
}


@pytest.mark.parametrize("name", TOUCHING)
def test_walls_that_touch_are_grown_by_what_no_file_shows(name: str) -> None:
    walls = np.array(TOUCHING[name])
    assert outline_of_rectangles(corners_of(walls), WINDOW) is None
    coloring = united(map_of_walls(walls, WINDOW))
    check(coloring)
    assert 0.0 < difference(coloring, walls) < 1e-4
    assert occupied_polygons(coloring).buffer(1e-7).covers(union(walls))


def test_a_wall_that_leaves_the_window_is_cut_off() -> None:
    walls = np.array([[1.0, 2.0, 12.0, 2.0, 0.2]])
    assert outline_of_rectangles(corners_of(walls), WINDOW) is None
    assert shapely.area(occupied_polygons(united(map_of_walls(walls, WINDOW)))) == pytest.approx(9.0 * 0.2)
