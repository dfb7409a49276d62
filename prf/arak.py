"""The Arak process, the prior over polygonal maps: density, partition function, exact draws.

The exact laws of its statistics are in :mod:`prf.laws`.
"""

from __future__ import annotations

import math
import sys

import numpy as np
from numpy.typing import NDArray

from prf.coloring.graph import Coloring, Draws
from prf.kernels.arak_sampler import Size, draw_many
from prf.laws import expected_edges
from prf.shell.errors import ConfigError
from prf.window import INTERIOR, SIDES, Window

MAX_SCALE = 1e6
"""1/m: walls a micrometre apart."""
MAX_EDGES = 1e8
"""Of all draws that are asked for at once: gigabytes."""


def checked_scale(scale: float) -> float:
    """Return `scale` as a float; ConfigError unless it is above 0, and at most `MAX_SCALE`."""
    if not 0.0 < scale <= MAX_SCALE:
        raise ConfigError(f"scale {scale}: must be a finite number above 0, at most {MAX_SCALE:g}, in 1/m.")
    return float(scale)


def refuse_too_many_edges(scale: float, window: Window, n_draws: int) -> None:
    """Raise ConfigError if draws have so many edges that neither time nor memory would do for them."""
    expected = min(n_draws, sys.maxsize) * expected_edges(checked_scale(scale), window)
    if not expected <= MAX_EDGES:
        raise ConfigError(
            f"scale {scale:g}: {n_draws} draws on {window.width:g} x {window.height:g} m would have about "
            f"{expected:.2g} edges. Give a smaller scale or window, or fewer draws."
        )


def log_density(coloring: Coloring, scale: float) -> float:
    """Return log h, the unnormalised log density of a coloring (Paskin & Thrun, eqs. 1-3).

    h = prod_E p exp(-2 p |e|) / |e|  prod_V sin(phi_v), with respect to Lebesgue measure for each interior vertex, arc
    length for each boundary vertex, and counting of graphs and of the two anchor colours; h = 1 without edges.
    phi_v is the angle between the two edges, or between the edge and the side. Divide by the partition function
    (:func:`log_partition`) for a probability density.

    Parameters
    ----------
    coloring : Coloring
        Valid; whether it is, is not looked at.
    scale : float
        p in 1/m.

    Returns
    -------
    float
        -inf if two edges continue each other in a straight line.
    """
    p = checked_scale(scale)
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
    p = checked_scale(scale)
    return math.log(2.0) + p * window.perimeter + math.pi * p * p * window.area


def exact_draws(scale: float, window: Window, n_draws: int, rng: np.random.Generator) -> Draws:
    """Return independent draws of the Arak process by its dynamic representation.

    Parameters
    ----------
    scale : float
        p in 1/m.
    window : Window
    n_draws : int
    rng : numpy.random.Generator
        Advanced by as many numbers as the draws take.

    Returns
    -------
    Draws

    Raises
    ------
    ConfigError
        If `scale` is not above 0 or `n_draws` is negative, or the draws would have more than `MAX_EDGES`.
    """
    if n_draws < 0:
        raise ConfigError(f"{n_draws} draws: the number cannot be negative.")
    refuse_too_many_edges(scale, window, n_draws)
    size = Size(window.width, window.height, checked_scale(scale))
    vertices, edges, offsets, anchor_black = draw_many(n_draws, size, rng)
    side = vertices[:, 2].astype(np.int8)
    columns = np.ascontiguousarray(offsets.T)
    return Draws(
        window, columns[0], _placed(vertices[:, :2], side, window), side, columns[1], edges.copy(), anchor_black
    )


def _placed(xy: NDArray[np.float64], side: NDArray[np.int8], window: Window) -> NDArray[np.float64]:
    """Move vertices of [0, width] x [0, height] into the window: inside stays inside, sides get their coordinate."""
    lower, upper = np.array(window[:2]), np.array(window[2:])
    placed: NDArray[np.float64] = np.clip(xy + lower, np.nextafter(lower, upper), np.nextafter(upper, lower))
    for s in SIDES:
        placed[side == s, 1 - s % 2] = window.side_coordinate(s)
    return placed
