"""Colours of points and black areas, of one coloring or of many draws."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from prf.coloring.graph import Coloring, Draws
from prf.kernels.colours import draws_black_area, draws_odd
from prf.window import Window


def black_at(coloring: Coloring, xy: ArrayLike) -> NDArray[np.bool_]:
    """Return the colour of points: parity of the edges met on a path from the anchor (Paskin & Thrun 1.3.1).

    Parameters
    ----------
    coloring : Coloring
    xy : (n, 2) array
        Points in the closed window; a point on an edge gets the colour of one of its sides.

    Returns
    -------
    (n,) bool array
        Whether each point is black; without meaning outside the window.
    """
    colours: NDArray[np.bool_] = black_at_draws(Draws.from_colorings([coloring]), xy)[0]
    return colours


def black_at_draws(draws: Draws, xy: ArrayLike) -> NDArray[np.bool_]:
    """Return the colour of points in every draw, as :func:`black_at`.

    Parameters
    ----------
    draws : Draws
    xy : (n, 2) array

    Returns
    -------
    (n_draws, n) bool array
    """
    points = np.asarray(xy, dtype=np.float64).reshape(-1, 2)
    centre = np.array([draws.window.centre])
    odd = _odd(draws, np.concatenate([centre, points]))
    return odd[:, 1:] ^ (odd[:, :1] ^ draws.anchor_black[:, None])


def black_areas(draws: Draws) -> NDArray[np.float64]:
    """Return the area of the black region of each draw, (n_draws,), in square metres."""
    area = np.empty(len(draws))
    corner_black = draws.anchor_black ^ _odd(draws, np.array([draws.window.centre]))[:, 0]
    arrays = (draws.vertex_offsets, draws.xy, draws.side, draws.edge_offsets, draws.edges)
    draws_black_area(draws.window.to_array(), *arrays, corner_black, area)
    return area


def _odd(draws: Draws, points: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return whether each point's colour differs from that of the bottom left corner, (n_draws, n)."""
    order = np.argsort(points[:, 0], kind="stable")
    inside = np.ascontiguousarray(_off_right_side(points[order], draws.window))
    odd = np.zeros((len(draws), len(points)), dtype=np.bool_)
    draws_odd(inside, draws.vertex_offsets, draws.xy, draws.side, draws.edge_offsets, draws.edges, odd)
    unsorted = np.empty_like(odd)
    unsorted[:, order] = odd
    return unsorted


def _off_right_side(points: NDArray[np.float64], window: Window) -> NDArray[np.float64]:
    """Move points of the right side one float to the left: half-open spans end just short of it."""
    moved = points.copy()
    np.minimum(moved[:, 0], np.nextafter(window.x_max, -np.inf), out=moved[:, 0])
    return moved
