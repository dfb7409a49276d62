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
    """Map and tiles of a round, and how its chains step.

    Attributes
    ----------
    coloring : Coloring
    pixels : Grid
        Of the image.
    black : (n_pixels,) uint8 array
        Their colours.
    tiles : (k, 4) array
    edge_tile : (n_edges,) int32 array
        Tile inside which an edge lies, or ``NONE``.
    grid, start, entries
        Edges by cells: those of cell i are ``entries[start[i]:start[i + 1]]``.
    seeds : (k,) int64 array
    looks : (n,) int64 array
        Steps of a tile at which what is there is kept; the last is the end.
    probes : (n_probes,) int64 array
        Pixels whose colour is kept with it.
    tuning, odds
        As the chain has them, but for moves on the border.
    aim : (n_targets,) array
        Probabilities of the targets, summed.
    """

    coloring: Coloring
    pixels: Grid
    black: NDArray[np.uint8]
    tiles: Floats
    edge_tile: NDArray[np.int32]
    grid: Grid
    start: NDArray[np.int64]
    entries: NDArray[np.int32]
    seeds: NDArray[np.int64]
    looks: NDArray[np.int64]
    probes: NDArray[np.int64]
    tuning: Floats
    odds: Floats
    aim: Floats

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
    """Begin a round: draw its tiles and find what lies inside each.

    Parameters
    ----------
    data : TileData
    chain : Chain
        On the whole window.
    n_tiles : int
    least : float
        Width of the narrowest tile, metres.
    steps : int
        Of all tiles together; rounded down to as many in each.
    rng : numpy.random.Generator
        Of the chain.
    n_looks : int
        How often what is there is kept, evenly spaced.
    probes : (n_probes,) int64 array
        Pixels.
    """
    coloring = read_coloring(chain.graph)
    tiles = random_tiles(data.settings.window, n_tiles, data.returns, least, chain.image.grid, rng)
    vertex_tile = np.zeros(len(coloring.xy), np.int32)
    tiles_at(tiles, coloring.xy, vertex_tile)
    vertex_tile[coloring.side != INTERIOR] = c.NONE
    first, last = vertex_tile[coloring.edges].T
    odds = chain.odds.copy()
    odds[list(BORDER_MOVES)] = 0.0  # left to the steps between rounds
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
        tuning=chain.tuning.copy(),
        odds=odds / odds.sum(),
        aim=chain.targets.cumulative.copy(),
    )


def _crossed(data: TileData, coloring: Coloring) -> tuple[Grid, NDArray[np.int64], NDArray[np.int32]]:
    """Return the edges by cells."""
    grid = make_grid(*data.settings.window, COARSE * data.settings.cell_size())
    path = np.zeros(most_cells(grid), np.int32)
    return grid, *segments_by_cell(grid, coloring.segments(), path)
