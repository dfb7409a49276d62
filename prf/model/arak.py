"""The Arak process with scale p, the prior over polygonal maps: exact means and exact draws.

How moves weigh it: prf/kernels/state/prior.py. Sources: Arak 1982; Arak & Surgailis 1989; Paskin & Thrun 2005, 1.3.2.
Further exact laws: tests/reference/arak_laws.py.
"""

from __future__ import annotations

import math
import sys

import numpy as np
from numpy.typing import NDArray

from prf.kernels.arak_sampler import Size, draw_many
from prf.model.coloring.graph import Draws
from prf.model.window import SIDES, Window
from prf.shell.errors import ConfigError

MAX_EDGES = 1e8
"""Of all draws of a call: gigabytes."""


def compare(draws: Draws, scale: float) -> dict[str, float]:
    """Return the means of edge count and total length (m) over one or more draws, beside their exact values."""
    return {
        "n_draws": len(draws),
        "mean_edges": float(draws.n_edges.mean()),
        "expected_edges": expected_edges(scale, draws.window),
        "mean_length": float(draws.total_length().mean()),
        "expected_length": expected_length(scale, draws.window),
    }


def expected_edges(scale: float, window: Window) -> float:
    """Return the mean number of edges, p perimeter + 4 pi p^2 area."""
    return scale * window.perimeter + 4.0 * math.pi * scale**2 * window.area


def expected_length(scale: float, window: Window) -> float:
    """Return the mean total edge length, pi p area."""
    return math.pi * scale * window.area


def refuse_too_many_edges(scale: float, window: Window, n_draws: int) -> None:
    """Raise ConfigError if draws have so many edges that neither time nor memory would do for them."""
    expected = min(n_draws, sys.maxsize) * expected_edges(scale, window)
    if not expected <= MAX_EDGES:
        raise ConfigError(
            f"scale {scale:g}: {n_draws} draws on {window.width:g} x {window.height:g} m would have about "
            f"{expected:.2g} edges. Give a smaller scale or window, or fewer draws."
        )


def exact_draws(scale: float, window: Window, n_draws: int, rng: np.random.Generator) -> Draws:
    """Return independent draws of the Arak process by its dynamic representation.

    Parameters
    ----------
    scale : float
        p in 1/m, above 0.
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
        If `n_draws` is negative, or the draws would have more than `MAX_EDGES`.
    """
    if n_draws < 0:
        raise ConfigError(f"{n_draws} draws: the number cannot be negative.")
    refuse_too_many_edges(scale, window, n_draws)
    size = Size(window.width, window.height, scale)
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
