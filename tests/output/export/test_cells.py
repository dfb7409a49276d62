"""Polygons end where nothing is known."""

from __future__ import annotations

import numpy as np
import shapely

from prf.model.coloring import Coloring, from_polygons, occupied_polygons
from prf.model.window import Window
from prf.output.export.cells import WALL, cut_to_known
from prf.output.export.source import Map
from prf.results import PosteriorImage

WINDOW = Window(0.0, 0.0, 10.0, 10.0)


def image_of(seen: np.ndarray) -> PosteriorImage:
    zeros = np.zeros(seen.shape, np.float32)
    return PosteriorImage(zeros, zeros, np.zeros(2), 0.5, seen)


def test_walls_keep_half_a_metre_and_what_is_in_unseen_ground_is_removed() -> None:
    seen = np.zeros((20, 20), np.bool_)
    seen[:, :8] = True  # x < 4
    wall, island = shapely.box(3.6, 2.0, 9.0, 3.1), shapely.box(7.0, 6.0, 8.0, 7.0)
    near = shapely.box(1.0, 7.0, 2.0, 8.0)
    found = Map(from_polygons(shapely.MultiPolygon([wall, island, near]), WINDOW), {"draw": 1}, "title")
    cut = cut_to_known(found, image_of(seen), 0.0)
    expected = shapely.union(shapely.box(3.6, 2.0, 4.0 + WALL, 3.1), near)
    assert shapely.symmetric_difference(occupied_polygons(cut.coloring), expected).area < 1e-3
    assert (cut.properties, cut.title) == (found.properties, found.title)
    whole = cut_to_known(found, image_of(seen), 20.0)
    assert (
        shapely.symmetric_difference(occupied_polygons(whole.coloring), occupied_polygons(found.coloring)).area < 1e-3
    )


def test_nothing_is_cut_where_all_was_seen_or_of_a_map_alone() -> None:
    found = Map(from_polygons(shapely.MultiPolygon([shapely.box(1.0, 1.0, 2.0, 2.0)]), WINDOW), {}, "title")
    assert cut_to_known(found, image_of(np.ones((20, 20), np.bool_)), 0.0) is found
    assert cut_to_known(found, None, 0.0) is found


def test_a_map_of_which_nothing_is_known_is_empty() -> None:
    seen = np.zeros((20, 20), np.bool_)
    seen[0, 0] = True
    found = Map(from_polygons(shapely.MultiPolygon([shapely.box(5.0, 5.0, 6.0, 6.0)]), WINDOW), {}, "title")
    assert cut_to_known(found, image_of(seen), 0.0).coloring.n_edges == 0


def test_a_window_that_is_all_occupied_stays_so() -> None:
    seen = np.ones((20, 20), np.bool_)
    seen[0, 0] = False
    found = Map(Coloring.empty(WINDOW, black=True), {}, "title")
    assert cut_to_known(found, image_of(seen), 0.0).coloring.anchor_black
