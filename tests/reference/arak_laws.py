"""The density of the Arak process with scale p, and exact laws of its draws in a convex window.

Edges and vertices count the discontinuity graph inside the window. Sources: Arak 1982; Arak & Surgailis 1989; Paskin &
Thrun 2005 section 1.3.2. "Poisson" marks a law that is known as a whole, not by its mean alone.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from prf.model.coloring import Coloring
from prf.model.window import INTERIOR, SIDES, Window


def log_density(coloring: Coloring, scale: float) -> float:
    """Return log h, the unnormalised log density of a coloring (Paskin & Thrun, eqs. 1-3).

    h = prod_E p exp(-2 p |e|) / |e|  prod_V sin(phi_v), with respect to Lebesgue measure for each interior vertex, arc
    length for each boundary vertex, and counting of graphs and of the two anchor colours; h = 1 without edges.
    phi_v is the angle between the two edges, or between the edge and the side. Divide by the partition function
    (:func:`log_partition`) for a probability density. -inf if two edges continue each other in a straight line.
    """
    p = scale
    lengths = coloring.edge_lengths()
    with np.errstate(divide="ignore"):
        angles = float(np.log(vertex_sines(coloring)).sum())
        edges = float((math.log(p) - 2.0 * p * lengths - np.log(lengths)).sum())
    return edges + angles


def vertex_sines(coloring: Coloring) -> NDArray[np.float64]:
    """Return sin(phi_v) of each vertex, (n_vertices,): between its two edges, or between its edge and its side."""
    directions = np.zeros((coloring.n_vertices, 2, 2))
    along = np.where(np.isin(coloring.side, SIDES[::2])[:, None], (1.0, 0.0), (0.0, 1.0))
    ends = coloring.edges.ravel()
    edge = np.arange(coloring.n_edges)
    units = np.diff(coloring.xy[coloring.edges], axis=1)[:, 0] / coloring.edge_lengths()[:, None]
    order = np.argsort(ends, kind="stable")
    vertex, owner = ends[order], np.repeat(edge, 2)[order]
    second = np.concatenate([[False], vertex[1:] == vertex[:-1]])
    directions[vertex, second.astype(np.intp)] = units[owner]
    on_side = coloring.side != INTERIOR
    directions[on_side, 1] = along[on_side]
    first, other = directions[:, 0], directions[:, 1]
    sines: NDArray[np.float64] = np.abs(first[:, 0] * other[:, 1] - first[:, 1] * other[:, 0])
    return sines


def log_partition(scale: float, window: Window) -> float:
    """Return log Z = log 2 + p perimeter + pi p^2 area: the integral of h over all colorings of a convex window."""
    return math.log(2.0) + scale * window.perimeter + math.pi * scale**2 * window.area


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
