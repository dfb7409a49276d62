"""Grid index of edges: which edges pass through a cell (paper, section 1.3.3)."""

from typing import NamedTuple

from prf.kernels import constants as c
from prf.kernels._jit import Array, core
from prf.kernels.state.grid import Grid, walk


class EdgeIndex(NamedTuple):
    """Cells and the edges in each."""

    grid: Grid
    cell_count: Array  # (n_cells,) i4
    cell_edges: Array  # (n_cells, room) i4
    path: Array  # (most_cells,) i4 scratch for one walk
    neighbors: Array  # (edge capacity,) i4 scratch for the edges that share a cell with one
    marks: Array  # (edge capacity,) i8 the list that an edge was last entered into
    mark: Array  # (1,) i8 the list in work


@core
def index_edge(index: EdgeIndex, edge: int, xy: Array) -> bool:
    """Enter an edge with ends `xy` (4,) into the cells that it passes; return whether some cell is short of room."""
    n = walk(index.grid, xy[0], xy[1], xy[2], xy[3], index.path)
    fullest = 0
    for k in range(n):
        cell = index.path[k]
        count = index.cell_count[cell]
        if count < index.cell_edges.shape[1]:
            index.cell_edges[cell, count] = edge
        index.cell_count[cell] = count + 1
        fullest = max(fullest, count + 1)
    return fullest + c.MOST_CHANGES > index.cell_edges.shape[1]


@core
def unindex_edge(index: EdgeIndex, edge: int, xy: Array) -> None:
    """Remove an edge with ends `xy` (4,) from the cells that it passes."""
    n = walk(index.grid, xy[0], xy[1], xy[2], xy[3], index.path)
    for k in range(n):
        cell = index.path[k]
        last = index.cell_count[cell] - 1
        for place in range(last + 1):
            if index.cell_edges[cell, place] == edge:
                index.cell_edges[cell, place] = index.cell_edges[cell, last]
                break
        index.cell_count[cell] = last
