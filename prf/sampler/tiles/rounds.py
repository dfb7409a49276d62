"""The start of a round: the map and its tiles, from which the work in every tile follows."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from prf.coloring import Coloring
from prf.kernels import constants as c
from prf.kernels.chain import Chain
from prf.kernels.grid import Grid, make_grid, most_cells
from prf.kernels.segment_lists import segments_by_cell
from prf.kernels.tile import tiles_at
from prf.layout import read_coloring
from prf.posterior import BORDER_MOVES
from prf.sampler.tiles.data import TileData
from prf.sampler.tiles.partition import random_tiles
from prf.window import INTERIOR

Floats = NDArray[np.float64]

COARSE = 3.0
"""Cells in which a round finds edges on beams, in units of the cells of a chain."""

NO_PROBES = np.zeros(0, np.int64)


class Round(NamedTuple):
    """Map and tiles of a round, and how its chains step."""

    coloring: Coloring
    pixels: Grid  # of the image
    black: NDArray[np.uint8]  # (n_pixels,): their colours
    tiles: Floats  # (k, 4)
    edge_tile: NDArray[np.int32]  # (n_edges,): tile inside which an edge lies, or ``NONE``
    grid: Grid  # edges by cells: those of cell i are ``entries[start[i]:start[i + 1]]``
    start: NDArray[np.int64]  # edges by cells: those of cell i are ``entries[start[i]:start[i + 1]]``
    entries: NDArray[np.int32]  # edges by cells: those of cell i are ``entries[start[i]:start[i + 1]]``
    seeds: NDArray[np.int64]  # (k,)
    looks: NDArray[np.int64]  # (n,): steps of a tile at which what is there is kept; the last is the end
    probes: NDArray[np.int64]  # (n_probes,): pixels whose colour is kept with it
    density: Floats  # of the chain
    tuning: Floats  # of the chain
    move_probabilities: Floats  # of the chain, but for moves on the border
    aim: Floats  # (n_targets,): probabilities of the targets, summed

    @property
    def steps(self) -> int:
        """Steps in each tile."""
        return int(self.looks[-1])


def make_round(
    data: TileData,
    chain: Chain,
    n_tiles: int,
    least: float,
    steps: int,
    rng: np.random.Generator,
    n_looks: int = 1,
    probes: NDArray[np.int64] = NO_PROBES,
) -> Round:
    """Begin a round: draw its tiles and find what lies inside each; `probes` (n_probes,)."""
    coloring = read_coloring(chain.graph)
    tiles = random_tiles(data.settings.window, n_tiles, data.returns, least, chain.image.grid, rng)
    vertex_tile = np.zeros(len(coloring.xy), np.int32)
    tiles_at(tiles, coloring.xy, vertex_tile)
    vertex_tile[coloring.side != INTERIOR] = c.NONE
    first, last = vertex_tile[coloring.edges].T
    move_probabilities = chain.move_probabilities.copy()
    move_probabilities[list(BORDER_MOVES)] = 0.0  # left to the steps between rounds
    return Round(
        coloring,
        chain.image.grid,
        chain.image.black.copy(),
        tiles,
        np.where(first == last, first, c.NONE).astype(np.int32),
        *_crossed(data, coloring),
        seeds=rng.integers(0, 2**63, len(tiles)),
        looks=np.arange(1, n_looks + 1) * (steps // len(tiles)) // n_looks,
        probes=probes,
        density=chain.density.copy(),
        tuning=chain.tuning.copy(),
        move_probabilities=move_probabilities / move_probabilities.sum(),
        aim=chain.targets.cumulative.copy(),
    )


def _crossed(data: TileData, coloring: Coloring) -> tuple[Grid, NDArray[np.int64], NDArray[np.int32]]:
    """Return the edges by cells."""
    grid = make_grid(*data.settings.window, COARSE * data.settings.cell_size())
    path = np.zeros(most_cells(grid), np.int32)
    return grid, *segments_by_cell(grid, coloring.segments(), path)
