"""Probabilities on square cells, of a run, a grid or one map."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from prf.coloring import Coloring, Draws, black_at_draws
from prf.estimate import occupied_probability
from prf.export.formats import Options
from prf.export.known import known_cells
from prf.export.source import Source
from prf.kernels.grid import Grid
from prf.kernels.query import count_black
from prf.layout import image_grid, pixel_centres
from prf.run import PosteriorImage, names
from prf.shell.errors import InputError, UsageError
from prf.window import Window

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
    """Return the posterior of a run, the cells of a grid, or one map as cells of probability 0 and 1.

    Cells farther than `extrapolate` metres from what readings of a run or a grid saw are nan.

    Parameters
    ----------
    source : Source
    options : Options
        `draw`, `squares`, `resolution` and `extrapolate` are used.

    Raises
    ------
    InputError
        If the run has no image yet, or no such map.
    UsageError
        If something is asked of cells that they cannot give, or for too many cells.
    """
    return only_known(_all_cells(source, options), source.image, options.extrapolate or 0.0)


def _all_cells(source: Source, options: Options) -> Cells:
    run, image = source.run, source.image
    if source.grid is not None and options.draw is None:
        if options.squares or options.resolution is not None:
            raise UsageError(
                f"a GRID has cells of {source.grid.resolution:g} m only: leave --squares and --resolution out."
            )
        return Cells(source.grid.occupancy, source.grid.origin, source.grid.resolution)
    if run is None or options.draw is not None:
        own = RESOLUTION if image is None else image.resolution
        return rasterise(source.choose_map(options.draw).coloring, options.resolution or own, options.squares)
    if image is None:
        raise run.missing(names.POSTERIOR)
    if options.resolution is not None:
        if options.squares:
            raise UsageError("--squares and --resolution: a run knows the squares of its own image alone.")
        return share_of_draws(run.draws, options.resolution)
    return Cells(image.square_occupancy if options.squares else image.occupancy, image.origin, image.resolution)


def share_of_draws(draws: Draws, resolution: float) -> Cells:
    """Return the share of draws in which the centre of each cell is black, nan beyond the window.

    Raises
    ------
    InputError
        If there are no draws.
    UsageError
        If there would be too many cells.
    """
    if len(draws) == 0:
        raise InputError("no draws yet: nothing can be exported. Go on with prf sample --resume.")
    grid = _checked_grid(draws.window, resolution)
    first_column = pixel_centres(grid)[:: grid.nx]
    count = np.zeros(grid.nx * grid.ny, np.int32)
    ragged = (draws.vertex_offsets, draws.xy, draws.edge_offsets, draws.edges)
    count_black(grid, black_at_draws(draws, first_column), *ragged, np.zeros(len(count), np.bool_), count)
    share = np.where(draws.window.contains(pixel_centres(grid)), count / len(draws), np.nan)
    return Cells(share.reshape(grid.ny, grid.nx), np.array([grid.x0, grid.y0]), resolution)


def only_known(cells: Cells, image: PosteriorImage | None, extrapolate: float) -> Cells:
    """Return cells with nan where the centre lies farther than `extrapolate` metres from what readings saw."""
    if image is None:
        return cells
    known = image._replace(seen=known_cells(image, extrapolate))
    n_rows, n_columns = cells.probability.shape
    grid = Grid(float(cells.origin[0]), float(cells.origin[1]), cells.resolution, n_columns, n_rows)
    seen = known.seen_at(pixel_centres(grid)).reshape(n_rows, n_columns)
    return cells._replace(probability=np.where(seen, cells.probability, np.nan))


def rasterise(coloring: Coloring, resolution: float, squares: bool) -> Cells:
    """Return the cells of one map: 1 where the centre (`squares`: any part) is black, nan beyond the window."""
    draws = Draws.from_colorings([coloring])
    if not squares:
        return share_of_draws(draws, resolution)
    grid = _checked_grid(coloring.window, resolution)
    black = occupied_probability(draws, pixel_centres(grid), resolution)
    return Cells(black.reshape(grid.ny, grid.nx), np.array([grid.x0, grid.y0]), resolution)


def _checked_grid(window: Window, resolution: float) -> Grid:
    if window.area / resolution**2 > MOST_CELLS:
        raise UsageError(f"--resolution {resolution:g}: more than {MOST_CELLS} cells. Give a larger one.")
    return image_grid(window, resolution)
