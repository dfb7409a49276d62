"""Exact laws of the Arak process with scale p in a convex window, for checks of samplers and of single draws.

Edges and vertices count the discontinuity graph inside the window. Sources: Arak 1982; Arak & Surgailis 1989; Paskin &
Thrun 2005 section 1.3.2. "Poisson" marks a law that is known as a whole, not by its mean alone.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from prf.coloring.graph import Draws
from prf.window import Window


class Comparison(NamedTuple):
    """Sample means of draws beside the exact laws; lengths in metres."""

    n_draws: int
    mean_edges: float
    expected_edges: float
    mean_length: float
    expected_length: float


def compare(draws: Draws, scale: float) -> Comparison:
    """Return the means of edge count and total length over one or more draws, beside their exact values."""
    return Comparison(
        len(draws),
        float(draws.n_edges.mean()),
        expected_edges(scale, draws.window),
        float(draws.total_length().mean()),
        expected_length(scale, draws.window),
    )


def expected_edges(scale: float, window: Window) -> float:
    """Return the mean number of edges, p perimeter + 4 pi p^2 area."""
    return scale * window.perimeter + 4.0 * math.pi * scale**2 * window.area


def expected_length(scale: float, window: Window) -> float:
    """Return the mean total edge length, pi p area."""
    return math.pi * scale * window.area


def expected_interior_vertices(scale: float, window: Window) -> float:
    """Return the mean number of interior vertices, 4 pi p^2 area."""
    return 4.0 * math.pi * scale**2 * window.area


def expected_extremes(scale: float, window: Window) -> float:
    """Return the mean of the Poisson number of interior vertices that are local minima in one fixed direction."""
    return math.pi * scale**2 * window.area


def expected_crossings(scale: float, length: float) -> float:
    """Return the mean of the Poisson number of edges that cross a segment, 2 p length.

    The same holds for the boundary vertices on a side of that length. Disjoint collinear segments are independent.
    """
    return 2.0 * scale * length


def expected_boundary_vertices(scale: float, window: Window) -> float:
    """Return the mean number of boundary vertices on the whole border, 2 p perimeter; the number is always even."""
    return 2.0 * scale * window.perimeter


def same_colour_probability(scale: float, distance: float) -> float:
    """Return the probability (1 + exp(-4 p distance)) / 2 that two points have the same colour."""
    return 0.5 * (1.0 + math.exp(-4.0 * scale * distance))


def four_point_correlation(scale: float, first_gap: float, last_gap: float) -> float:
    """Return E[s_a s_b s_c s_d], s = +-1 by colour, at collinear points a < b < c < d: exp(-4 p (ab + cd))."""
    return math.exp(-4.0 * scale * (first_gap + last_gap))


def no_edge_probability(scale: float, perimeter: float, area: float) -> float:
    """Return the probability exp(-p perimeter - pi p^2 area) that a convex set meets no edge."""
    return math.exp(-scale * perimeter - math.pi * scale**2 * area)


def edge_length_rate(scale: float) -> float:
    """Return the rate 4 p of the exponential law of edge lengths in the plane: 2 p to turn and 2 p to meet an edge."""
    return 4.0 * scale


def black_fraction_variance(scale: float, window: Window) -> float:
    """Return the variance of the black share of the window, E exp(-4 p |X - Y|) / 4 for X, Y uniform in it.

    The mean is 1/2. The differences of X and Y are integrated in polar coordinates by Gauss-Legendre quadrature; the
    relative error is below 1e-9 unless the window is some hundred times as long as wide (3e-6 at 1000 times).
    """
    width, height, rate = window.width, window.height, 4.0 * scale
    nodes, weights = np.polynomial.legendre.leggauss(64)
    nodes, weights = 0.5 * (nodes + 1.0), 0.5 * weights
    corner = math.atan2(height, width)
    total = 0.0
    for start, stop in ((0.0, corner), (corner, 0.5 * math.pi)):
        angle = (start + (stop - start) * nodes)[:, None]
        x, y = np.cos(angle), np.sin(angle)
        # exp(-45) is below the rounding of the sum: long windows would starve the nodes near r = 0 otherwise.
        reach = np.minimum(np.minimum(width / x, height / y), 45.0 / rate)
        r = reach * nodes
        values = (width - r * x) * (height - r * y) * np.exp(-rate * r) * r * reach
        total += (stop - start) * float(weights @ values @ weights)
    return total / window.area**2
