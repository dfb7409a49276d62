"""The occupancy image: recoloured pixels, counted edges, times added up, each against asking every pixel."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

from prf.kernels.state.image import Image, settle_all
from prf.model.arak import exact_draws
from prf.model.coloring import Coloring, black_at
from prf.model.layout import image_grid, make_graph, make_image, pixel_centres
from prf.model.window import Window
from tests.kernels.entries import change_edge, inside_table, recolor

ODD = Window(-1.3, 0.2, 2.45, 3.0)
RESOLUTION = 0.17


def empty_image(window: Window = ODD, resolution: float = RESOLUTION) -> Image:
    coloring = Coloring.empty(window)
    return make_image(coloring, make_graph(coloring, 16), resolution)


def squares(image: Image) -> np.ndarray:
    centres, half = pixel_centres(image.grid), 0.5 * image.grid.cell
    return shapely.box(*(centres - half).T, *(centres + half).T)


def test_the_grid_of_pixels_covers_the_window() -> None:
    grid = image_grid(ODD, RESOLUTION)
    assert (grid.x0, grid.y0) == ODD[:2]
    assert 0.0 <= grid.x0 + grid.nx * RESOLUTION - ODD.x_max < RESOLUTION
    assert 0.0 <= grid.y0 + grid.ny * RESOLUTION - ODD.y_max < RESOLUTION
    assert image_grid(Window(0.0, 0.0, 0.3, 0.1), 0.1)[3:] == (3, 1)
    assert image_grid(Window(0.0, 0.0, 0.3, 0.1), 5.0)[3:] == (1, 1)


def test_centres_are_row_by_row_from_the_lowest() -> None:
    centres = pixel_centres(image_grid(Window(0.0, 0.0, 3.0, 2.0), 1.0))
    assert centres.tolist() == [[0.5, 0.5], [1.5, 0.5], [2.5, 0.5], [0.5, 1.5], [1.5, 1.5], [2.5, 1.5]]


def test_recolouring_turns_the_centres_inside() -> None:
    image = empty_image()
    rng = np.random.default_rng(22)
    centres = pixel_centres(image.grid)
    black = np.zeros(len(centres), np.bool_)
    for step in range(200):
        loop = rng.uniform(ODD[:2], ODD[2:], (rng.integers(3, 7), 2))
        if step % 4 == 0:  # a sliver along the border
            loop[:, 0] = np.clip(loop[:, 0], ODD.x_max - 0.1, None)
        inside = np.zeros(len(centres), np.bool_)
        inside_table(centres, loop, inside)
        black ^= inside
        recolor(image, loop, step)
        assert np.array_equal(image.black.astype(bool), black)


@pytest.mark.parametrize("resolution", [0.17, 0.5, 3.0])
def test_edges_are_counted_in_the_squares_that_they_pass(resolution: float) -> None:
    for coloring in exact_draws(0.8, ODD, 5, np.random.default_rng(23)):
        image = make_image(coloring, make_graph(coloring, 2 * coloring.n_vertices + 8), resolution)
        lines = shapely.linestrings(coloring.xy[coloring.edges])
        boxes = [shapely.buffer(squares(image), hair) for hair in (-1e-7, 1e-7)]
        passed = [shapely.intersects(box[:, None], lines[None, :]).sum(axis=1) for box in boxes]
        assert (passed[0] <= image.n_edges).all()
        assert (image.n_edges <= passed[1]).all()
        inside = ODD.contains(pixel_centres(image.grid))
        assert np.array_equal(image.black[inside].astype(bool), black_at(coloring, pixel_centres(image.grid))[inside])


def test_times_add_up_whatever_the_order_of_settling() -> None:
    """Against a state by step: black and mixed counted in every step in which they stood."""
    image = empty_image(Window(0.0, 0.0, 4.0, 3.0), 1.0)
    rng = np.random.default_rng(24)
    black_time, mixed_time = np.zeros((2, 12), np.int64)
    edges: list[np.ndarray] = []
    for step in range(1, 400):
        black_time += image.black
        mixed_time += (image.black != 0) | (image.n_edges > 0)
        choice = rng.random()
        if choice < 0.3:
            recolor(image, rng.uniform([0, 0], [4, 3], (3, 2)), step)
        elif choice < 0.5:
            edges.append(rng.uniform([0, 0, 0, 0], [4, 3, 4, 3]) * [1, 1, 0.3, 0.3])
            change_edge(image, edges[-1], 1, step)
        elif choice < 0.7 and edges:
            change_edge(image, edges.pop(int(rng.integers(len(edges)))), -1, step)
        elif choice < 0.75:
            settle_all(image, step)
            assert np.array_equal(image.black_time, black_time)
            assert np.array_equal(image.mixed_time, mixed_time)
    settle_all(image, 399)
    assert np.array_equal(image.black_time, black_time)
    assert np.array_equal(image.mixed_time, mixed_time)
    assert 0 < mixed_time.min() <= mixed_time.max() < 399
