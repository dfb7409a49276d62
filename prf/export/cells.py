"""Probabilities on square cells, of a run, a grid or one map."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from prf.coloring import Coloring, Draws
from prf.estimate import occupied_probability
from prf.export.formats import Options
from prf.export.source import Source
from prf.layout import image_grid, pixel_centres
from prf.occupancy import OccupancyGrid
from prf.run import names
from prf.shell.errors import UsageError

RESOLUTION = 0.05
"""Metres a cell of one map: what maps for navigation mostly have."""
MOST_CELLS = 25_000_000


class Cells(NamedTuple):
    """Probabilities on square cells.

    Attributes
    ----------
    probability : (ny, nx) float array
        Of being occupied; row 0 has the lowest y; nan where nothing is known.
    origin : (2,) float64 array
        Lower left corner of cell (0, 0) in metres.
    resolution : float
        Side of a cell in metres.
    """

    probability: NDArray[Any]
    origin: NDArray[np.float64]
    resolution: float


def cells_of(source: Source, options: Options) -> Cells:
    """Return the posterior image of a run, the cells of a grid, or one map as cells of probability 0 and 1.

    Parameters
    ----------
    source : Source
    options : Options
        `draw`, `squares` and `resolution` are used.

    Raises
    ------
    InputError
        If the run has no image yet, or no such map.
    UsageError
        If something is asked of cells that they cannot give, or for too many cells.
    """
    run = source.run
    if source.grid is not None and options.draw is None:
        return _cells_of_grid(source.grid, options)
    if run is None or options.draw is not None:
        own = RESOLUTION if run is None or run.image is None else run.image.resolution
        chosen = source.choose_map(options.draw)
        return rasterise(chosen.coloring, options.resolution or own, options.squares)
    if run.image is None:
        raise run.missing(names.POSTERIOR)
    if options.resolution is not None:
        raise UsageError(
            f"--resolution is for one map: the posterior image of {run.name} has cells of {run.image.resolution:g} m."
        )
    probability = run.image.square_occupancy if options.squares else run.image.occupancy
    return Cells(probability, run.image.origin, run.image.resolution)


def _cells_of_grid(grid: OccupancyGrid, options: Options) -> Cells:
    """Return the cells of a grid, nan where no reading came: 0.5 may also be what the readings say."""
    if options.squares or options.resolution is not None:
        raise UsageError(f"a GRID has cells of {grid.resolution:g} m only: leave --squares and --resolution out.")
    probability = np.where(grid.seen, grid.occupancy, np.nan)
    return Cells(probability, grid.origin, grid.resolution)


def rasterise(coloring: Coloring, resolution: float, squares: bool) -> Cells:
    """Return the cells of one map: 1 where the centre (`squares`: any part) is black, nan beyond the window."""
    window = coloring.window
    if window.area / resolution**2 > MOST_CELLS:
        raise UsageError(f"--resolution {resolution:g}: more than {MOST_CELLS} cells. Give a larger one.")
    grid = image_grid(window, resolution)
    draws = Draws.from_colorings([coloring])
    black = occupied_probability(draws, pixel_centres(grid), resolution if squares else 0.0)
    return Cells(black.reshape(grid.ny, grid.nx), np.array([grid.x0, grid.y0]), resolution)
