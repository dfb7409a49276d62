"""Points matched with a place."""

from __future__ import annotations

import numpy as np

from prf.poses.match import CELL, LEVER, place_of, search

WINDOW = np.array([1.5, 1.5, 0.4])
ABOUT = np.array([0.4, -0.6, 0.1])


def wall(x0, y0, x1, y1):
    share = np.linspace(0.0, 1.0, 60)[:, None]
    return (1.0 - share) * [x0, y0] + share * [x1, y1]


def laid(points):
    """Return a place of points, and the same points as seen from elsewhere, at `TRUE`."""
    place = place_of(points, np.zeros_like(points), 8.0)
    c, s = np.cos(TRUE[2]), np.sin(TRUE[2])
    return place, (points - TRUE[:2]) @ np.array([[c, -s], [s, c]])


TRUE = np.array([0.9, -0.2, -0.15])


def test_a_corner_is_found_where_it_is():
    place, points = laid(np.concatenate([wall(-4, 2, 3, 2), wall(3, 2, 3, -3), wall(-4, -3, 0, -3)]))
    best = search(place, points, ABOUT, WINDOW)[0]
    assert (np.abs(best.pose - TRUE) < [1.1 * CELL, 1.1 * CELL, 1.1 * CELL / LEVER]).all()
    assert best.score > 0.8
    assert np.sqrt(np.linalg.eigvalsh(best.covariance)[-1]) < 0.35


def test_a_corridor_leaves_the_way_along_it_open():
    place, points = laid(np.concatenate([wall(-7, 1, 7, 1), wall(-7, -1, 7, -1)]))
    covariance = search(place, points[30:90:2], ABOUT, WINDOW)[0].covariance
    assert covariance[0, 0] > 5.0 * covariance[1, 1]
