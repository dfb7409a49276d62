"""One coloring as a NamedTuple of arrays, and the ragged store of many."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from prf.kernels.score.query import draws_count_black
from prf.kernels.state.colours import Graphs, draws_black_area, draws_odd
from prf.kernels.state.grid import Grid
from prf.model.window import Window


class Coloring(NamedTuple):
    """Polygonal coloring of a window: discontinuity graph and the colour of the anchor point (Paskin & Thrun 1.3.1).

    Attributes
    ----------
    window : Window
        Its centre is the anchor point p0.
    xy : (n_vertices, 2) float64 array
        Vertices; each is used by an edge.
    side : (n_vertices,) int8 array
        Side of the window on which the vertex lies exactly, or ``INTERIOR``.
    edges : (n_edges, 2) int32 array
        Vertex indices.
    anchor_black : bool
        Colour of p0.
    """

    window: Window
    xy: NDArray[np.float64]
    side: NDArray[np.int8]
    edges: NDArray[np.int32]
    anchor_black: bool

    @classmethod
    def empty(cls, window: Window, black: bool = False) -> Coloring:
        """Return the coloring without edges: all white, or all black."""
        return cls(window, np.empty((0, 2)), np.empty(0, np.int8), np.empty((0, 2), np.int32), black)

    @property
    def n_vertices(self) -> int:
        """Number of vertices."""
        return len(self.xy)

    @property
    def n_edges(self) -> int:
        """Number of edges."""
        return len(self.edges)

    def segments(self) -> NDArray[np.float64]:
        """Return the edges as (n_edges, 4) rows ``x0, y0, x1, y1``."""
        return self.xy[self.edges].reshape(-1, 4)

    def edge_lengths(self) -> NDArray[np.float64]:
        """Return the (n_edges,) lengths."""
        ends = self.xy[self.edges]
        lengths: NDArray[np.float64] = np.hypot(*(ends[:, 1] - ends[:, 0]).T)
        return lengths

    def total_length(self) -> float:
        """Return the summed length of all edges."""
        return float(self.edge_lengths().sum())


@dataclass(frozen=True, eq=False)
class Draws:
    """Many colorings of one window in flat arrays; draw i owns the rows between offsets i and i + 1.

    ``len(draws)``, ``draws[i]`` and iteration are over colorings; those of a NamedTuple are over its fields.

    Attributes
    ----------
    vertex_offsets : (n + 1,) int64 array
    xy : (sum of n_vertices, 2) float64 array
    side : (sum of n_vertices,) int8 array
    edge_offsets : (n + 1,) int64 array
    edges : (sum of n_edges, 2) int32 array
        Vertex indices local to the draw.
    anchor_black : (n,) bool array
    """

    window: Window
    vertex_offsets: NDArray[np.int64]
    xy: NDArray[np.float64]
    side: NDArray[np.int8]
    edge_offsets: NDArray[np.int64]
    edges: NDArray[np.int32]
    anchor_black: NDArray[np.bool_]

    @classmethod
    def from_colorings(cls, colorings: Sequence[Coloring], window: Window | None = None) -> Draws:
        """Return the colorings one after the other. `window`: needed for an empty sequence only."""
        windows = {*(coloring.window for coloring in colorings), *([] if window is None else [window])}
        if len(windows) != 1:
            raise ValueError(f"draws must share one window, got {len(windows)}")
        return cls(
            windows.pop(),
            _offsets([len(coloring.xy) for coloring in colorings]),
            np.concatenate([np.empty((0, 2)), *(coloring.xy for coloring in colorings)]),
            np.concatenate([np.empty(0, np.int8), *(coloring.side for coloring in colorings)]),
            _offsets([len(coloring.edges) for coloring in colorings]),
            np.concatenate([np.empty((0, 2), np.int32), *(coloring.edges for coloring in colorings)]),
            np.array([coloring.anchor_black for coloring in colorings], dtype=np.bool_),
        )

    @property
    def graphs(self) -> Graphs:
        """The discontinuity graphs as the kernels take them."""
        return Graphs(self.vertex_offsets, self.xy, self.side, self.edge_offsets, self.edges)

    def __len__(self) -> int:
        """Return the number of draws."""
        return len(self.anchor_black)

    def __getitem__(self, i: int) -> Coloring:
        """Return draw `i` as views of the arrays (IndexError outside -n ... n - 1)."""
        i = range(len(self))[i]
        vertices = slice(self.vertex_offsets[i], self.vertex_offsets[i + 1])
        edges = self.edges[self.edge_offsets[i] : self.edge_offsets[i + 1]]
        return Coloring(self.window, self.xy[vertices], self.side[vertices], edges, bool(self.anchor_black[i]))

    def __iter__(self) -> Iterator[Coloring]:
        """Yield the draws one by one."""
        return (self[i] for i in range(len(self)))

    @property
    def n_edges(self) -> NDArray[np.int64]:
        """Number of edges of each draw, (n,)."""
        return np.diff(self.edge_offsets)

    def total_length(self) -> NDArray[np.float64]:
        """Return the summed edge length of each draw, (n,)."""
        ends = self.xy[self.global_edges()]
        lengths = np.hypot(*(ends[:, 1] - ends[:, 0]).T)
        return np.bincount(self.draw_of_edge(), lengths, len(self)).astype(np.float64)

    def draw_of_edge(self) -> NDArray[np.int64]:
        """Return the number of the draw that owns each edge, (sum of n_edges,)."""
        return np.repeat(np.arange(len(self)), np.diff(self.edge_offsets))

    def global_edges(self) -> NDArray[np.int64]:
        """Return the edges as rows of indices into ``xy``, (sum of n_edges, 2)."""
        shifts = np.repeat(self.vertex_offsets[:-1], np.diff(self.edge_offsets))
        moved: NDArray[np.int64] = self.edges + shifts[:, None]
        return moved


def _offsets(counts: ArrayLike) -> NDArray[np.int64]:
    """Return the (n + 1,) running sums of `counts`, from 0."""
    return np.concatenate([[0], np.cumsum(np.asarray(counts, dtype=np.int64))]).astype(np.int64)


def black_at(coloring: Coloring, xy: ArrayLike) -> NDArray[np.bool_]:
    """Return the colour of points: parity of the edges met on a path from the anchor (Paskin & Thrun 1.3.1).

    `xy` (n, 2): points in the closed window; a point on an edge gets the colour of one of its sides. Returns (n,):
    whether each point is black; without meaning outside the window.
    """
    colours: NDArray[np.bool_] = black_at_draws(Draws.from_colorings([coloring]), xy)[0]
    return colours


def black_at_draws(draws: Draws, xy: ArrayLike) -> NDArray[np.bool_]:
    """Return the colour of points in every draw, as :func:`black_at`. `xy` (n, 2). Returns (n_draws, n)."""
    points = np.asarray(xy, dtype=np.float64).reshape(-1, 2)
    centre = np.array([draws.window.centre])
    odd = _odd(draws, np.concatenate([centre, points]))
    return odd[:, 1:] ^ (odd[:, :1] ^ draws.anchor_black[:, None])


def black_areas(draws: Draws) -> NDArray[np.float64]:
    """Return the area of the black region of each draw, (n_draws,), in square metres."""
    corner_black = draws.anchor_black ^ _odd(draws, np.array([draws.window.centre]))[:, 0]
    return np.asarray(draws_black_area(draws.window.to_array(), draws.graphs, corner_black))


def count_black(draws: Draws, grid: Grid, radius: float = 0.0) -> NDArray[np.int32]:
    """Return in how many draws the centre of each cell (n_cells,) of a grid over the window is black.

    `radius` above 0, metres: in how many the disc round it is not white, as :func:`prf.results.estimate.path_free`.
    """
    y = grid.y0 + (np.arange(grid.ny) + 0.5) * grid.cell
    first_column = np.stack([np.full(grid.ny, grid.x0 + 0.5 * grid.cell), y], axis=1)
    return np.asarray(draws_count_black(grid, black_at_draws(draws, first_column), draws.graphs, radius))


def _odd(draws: Draws, points: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return whether each point's colour differs from that of the bottom left corner, (n_draws, n)."""
    order = np.argsort(points[:, 0], kind="stable")
    inside = np.ascontiguousarray(_off_right_side(points[order], draws.window))
    odd = draws_odd(inside, draws.graphs)
    unsorted = np.empty_like(odd)
    unsorted[:, order] = odd
    return unsorted


def _off_right_side(points: NDArray[np.float64], window: Window) -> NDArray[np.float64]:
    """Move points of the right side one float to the left: half-open spans end just short of it."""
    moved = points.copy()
    np.minimum(moved[:, 0], np.nextafter(window.x_max, -np.inf), out=moved[:, 0])
    return moved
