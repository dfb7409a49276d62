"""Geometry of all edges and vertices of many draws at once, for the checks of exact laws."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from prf.model.coloring import Draws
from prf.model.window import INTERIOR, Window

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


class Flat:
    """Draws with what the laws look at: ends of edges, neighbours of vertices, sums by draw.

    Parameters
    ----------
    draws : Draws
    scale : float
    window : Window
        As the sampler was asked for.
    """

    def __init__(self, draws: Draws, scale: float, window: Window) -> None:
        if draws.window != window:
            raise ValueError(f"draws are of {draws.window}, not {window}")
        self.draws, self.scale, self.window = draws, scale, window
        self.edges = draws.global_edges()
        self.edge_draw = draws.draw_of_edge()
        self.vertex_draw = np.repeat(np.arange(len(draws)), np.diff(draws.vertex_offsets))
        self.interior = np.flatnonzero(draws.side == INTERIOR)
        self.boundary = np.flatnonzero(draws.side != INTERIOR)

    def per_draw(self, owner: Ints, values: NDArray[np.generic] | None = None) -> Floats:
        """Return the sum of `values` (or the number of items) by draw, (n_draws,)."""
        return np.bincount(owner, values, len(self.draws)).astype(np.float64)

    @cached_property
    def rightward(self) -> tuple[Floats, Floats, NDArray[np.int8]]:
        """Left ends, right ends (n, 2) and side of the right end (n,) of all edges."""
        xy = self.draws.xy
        swap = xy[self.edges[:, 0], 0] > xy[self.edges[:, 1], 0]
        ordered = np.where(swap[:, None], self.edges[:, ::-1], self.edges)
        return xy[ordered[:, 0]], xy[ordered[:, 1]], self.draws.side[ordered[:, 1]]

    @cached_property
    def _neighbours(self) -> tuple[Ints, Ints]:
        ends = self.edges.ravel()
        others = self.edges[:, ::-1].ravel()[np.argsort(ends, kind="stable")]
        starts = np.concatenate([[0], np.cumsum(np.bincount(ends, minlength=len(self.draws.xy)))])
        return others, starts

    @cached_property
    def interior_directions(self) -> tuple[Floats, Floats]:
        """Unit vectors from each interior vertex to its two neighbours, (n, 2) each."""
        others, starts = self._neighbours
        return self._unit(self.interior, others[starts[self.interior]]), self._unit(
            self.interior, others[starts[self.interior] + 1]
        )

    @cached_property
    def boundary_directions(self) -> Floats:
        """Unit vectors from each boundary vertex to its neighbour, (n, 2)."""
        others, starts = self._neighbours
        return self._unit(self.boundary, others[starts[self.boundary]])

    def _unit(self, start: Ints, end: Ints) -> Floats:
        vectors = self.draws.xy[end] - self.draws.xy[start]
        return vectors / np.hypot(*vectors.T)[:, None]

    def meets_convex(self, corners: Floats) -> NDArray[np.bool_]:
        """Return which draws have an edge in the convex polygon (k, 2) of counter-clockwise `corners` (Cyrus-Beck)."""
        start, end, _ = self.rightward
        enter, leave = np.zeros(len(start)), np.ones(len(start))
        for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
            inward = np.array([a[1] - b[1], b[0] - a[0]])
            depth, slope = (start - a) @ inward, (end - start) @ inward
            with np.errstate(divide="ignore", invalid="ignore"):
                t = -depth / slope
            enter = np.where(slope > 0, np.maximum(enter, t), enter)
            leave = np.where(slope < 0, np.minimum(leave, t), leave)
            leave = np.where((slope == 0) & (depth < 0), -1.0, leave)
        return self.per_draw(self.edge_draw[enter <= leave]) > 0

    def crossings(self, a: Floats, b: Floats) -> Floats:
        """Return how many edges of each draw cross the segment a-b."""
        start, end, _ = self.rightward
        along = b - a
        across = np.array([-along[1], along[0]])
        height_start, height_end = (start - a) @ across, (end - a) @ across
        with np.errstate(divide="ignore", invalid="ignore"):
            t = height_start / (height_start - height_end)
            reach = ((start + t[:, None] * (end - start)) - a) @ along
        hit = ((height_start > 0) != (height_end > 0)) & (reach > 0) & (reach < along @ along)
        return self.per_draw(self.edge_draw[hit])
