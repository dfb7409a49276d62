"""Exact means of the Arak process with scale p in a convex window, beside those of draws.

Edges count the discontinuity graph inside the window. Sources: Arak 1982; Arak & Surgailis 1989; Paskin & Thrun 2005
section 1.3.2. Further laws: tests/reference/arak_laws.py.
"""

from __future__ import annotations

import math
from typing import NamedTuple

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
