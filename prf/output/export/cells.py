"""Probabilities on square cells of a run, a grid or one map, and what of them is known."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy import ndimage
from shapely.geometry.base import BaseGeometry

from prf.kernels.state.grid import Grid
from prf.model.coloring import Coloring, Draws, count_black, from_polygons, occupied_polygons
from prf.model.layout import image_grid, pixel_centres
from prf.model.window import Window
from prf.output.export.source import Map, Source
from prf.results import PosteriorImage, RunData, names
from prf.results.estimate import occupied_probability
from prf.results.score.heldout import SQUARE
from prf.results.score.returns import return_probability, returns_of_run
from prf.shell.errors import InputError, UsageError

RESOLUTION = 0.05  # metres a cell: what maps for navigation mostly have
MAX_CELLS = 25_000_000
WALL = 0.5  # metres beyond seen cells up to which polygons of occupied ground are kept: walls are seen from one side
SMALL_ROBOT = 0.2  # metres; radius of a disc for which free cells shall be open
SEAM = 1e-6  # metres by which known ground is enlarged: parts of it that touch at a corner grow together


class Raster(NamedTuple):
    """Probabilities on square cells, whatever they are from."""

    probability: NDArray[Any]  # (ny, nx) of being occupied; row 0 has the lowest y; nan where nothing is known
    origin: NDArray[np.float64]  # (2,) lower left corner of cell (0, 0) in metres
    resolution: float  # side of a cell in metres


def cells_of(
    source: Source,
    draw: int | None = None,
    extrapolate: float = 0.0,
    *,
    squares: bool = False,
    radius: float = 0.0,
    resolution: float | None = None,
) -> Raster:
    """Return the posterior of a run, the cells of a grid, or one map as cells of probability 0 and 1.

    Cells farther than `extrapolate` metres from what readings of a run or a grid saw are nan.

    `draw`: number of a draw of the run instead of its posterior. `extrapolate`: metres. `squares`: whether a cell is
    not completely white, instead of the colour of its centre. `radius`: of a disc round the centre, metres; whether it
    is not completely white. `resolution`: side of a cell, metres.
    """
    if radius > 0.0:
        draws, usual = _draws_of(source, draw)
        return only_known(share_of_draws(draws, resolution or usual, radius), source.image, extrapolate)
    return only_known(_all_cells(source, draw, squares, resolution), source.image, extrapolate)


def _draws_of(source: Source, draw: int | None) -> tuple[Draws, float]:
    """Return the draws of a run, one of them, or one map; and the usual side of a cell, metres."""
    if source.grid is not None:
        raise UsageError("--radius: a GRID has no whole maps of which a disc could be free. Give a RUN.")
    if source.run is not None and draw is None:
        return source.run.draws, _usual_resolution(source.run.draws.window, source.image)
    coloring = source.choose_map(draw).coloring
    return Draws.from_colorings([coloring]), _usual_resolution(coloring.window, source.image)


def _all_cells(source: Source, draw: int | None, squares: bool, resolution: float | None) -> Raster:
    run, image = source.run, source.image
    if source.grid is not None and draw is None:
        if squares or resolution is not None:
            raise UsageError(
                f"a GRID has cells of {source.grid.resolution:g} m only: leave --squares and --resolution out."
            )
        return Raster(source.grid.occupancy, source.grid.origin, source.grid.resolution)
    if run is None or draw is not None:
        coloring = source.choose_map(draw).coloring
        return rasterise(coloring, resolution or _usual_resolution(coloring.window, image), squares)
    if image is None:
        raise run.missing(names.POSTERIOR)
    wanted = resolution or (image.resolution if squares else _usual_resolution(run.draws.window, image))
    if wanted == image.resolution:
        return Raster(image.square_occupancy if squares else image.occupancy, image.origin, image.resolution)
    if squares:
        raise UsageError("--squares and --resolution: a run knows the squares of its own image alone.")
    return share_of_draws(run.draws, wanted)


def returned(run: RunData, resolution: float | None = None, extrapolate: float = 0.0) -> Raster | None:
    """Return p_return of a run on square cells: how probably a beam that comes there ends there; None without a laser.

    Of the square of :func:`returned_square` round the middle of each cell. Cells are nan as those of :func:`cells_of`.

    `resolution`: side of a cell, metres; None: the usual one. `extrapolate`: metres.
    """
    if run.image is None:
        raise run.missing(names.POSTERIOR)
    returns = returns_of_run(run)
    if returns is None:
        return None
    grid = _checked_grid(run.draws.window, resolution or _usual_resolution(run.draws.window, run.image))
    middle = pixel_centres(grid)
    known = run.image._replace(seen=known_cells(run.image, extrapolate)).seen_at(middle)
    found = np.full(len(middle), np.nan)
    found[known] = return_probability(run.draws, returns, middle[known], returned_square(grid.cell))
    return Raster(found.reshape(grid.ny, grid.nx), np.array([grid.x0, grid.y0]), grid.cell)


def returned_square(resolution: float) -> float:
    """Return the side of the squares of p_return on cells of this side, metres: 0.2, or the cell's if it is larger."""
    return max(SQUARE, resolution)


def _usual_resolution(window: Window, image: PosteriorImage | None) -> float:
    """Return the side of a cell if none is given: `RESOLUTION`, or the image's if finer or the window is too large."""
    own = RESOLUTION if image is None else image.resolution
    return own if window.area / RESOLUTION**2 > MAX_CELLS else min(own, RESOLUTION)


def share_of_draws(draws: Draws, resolution: float, radius: float = 0.0) -> Raster:
    """Return the share of draws in which the centre of each cell is black, nan beyond the window.

    `radius` above 0: in which the disc round it is not white, metres.
    """
    if len(draws) == 0:
        raise InputError("no draws yet: nothing can be exported. Resume with prf sample --resume.")
    grid = _checked_grid(draws.window, resolution)
    count = count_black(draws, grid, radius)
    share = np.where(draws.window.contains(pixel_centres(grid)), count / len(draws), np.nan)
    return Raster(share.reshape(grid.ny, grid.nx), np.array([grid.x0, grid.y0]), resolution)


def closed_though_free(
    cells: Raster, run: RunData, free: float, occupied: float
) -> tuple[float, tuple[float, float] | None]:
    """Return the square metres of free cells round which a small robot meets something all the same, and where.

    There the disc of `SMALL_ROBOT` is not white in more than `occupied` of the draws, but a wall that lies elsewhere in
    each of them leaves every cell of it at `occupied` or less. `free`, `occupied`: probabilities below and above which
    cells (ny, nx) are so. Where: x and y of a cell amid the largest piece of them; None if there are none.
    """
    side, marked = cells.resolution, cells.probability > occupied
    away = ndimage.distance_transform_edt(~marked, sampling=side) if marked.any() else np.full(marked.shape, np.inf)
    blocked = share_of_draws(run.draws, side, SMALL_ROBOT).probability > occupied
    closed = blocked & (away > SMALL_ROBOT + side) & (cells.probability < free)
    piece = ndimage.label(closed, np.ones((3, 3)))[0]
    if not piece.any():
        return 0.0, None
    inside = np.argwhere(piece == 1 + np.bincount(piece[closed])[1:].argmax())
    row, column = inside[((inside - inside.mean(axis=0)) ** 2).sum(axis=1).argmin()]
    x, y = cells.origin + side * (np.array([column, row]) + 0.5)
    return float(np.count_nonzero(closed) * side**2), (round(float(x), 2), round(float(y), 2))


def only_known(cells: Raster, image: PosteriorImage | None, extrapolate: float) -> Raster:
    """Return cells with nan where the centre lies farther than `extrapolate` metres from what readings saw."""
    if image is None:
        return cells
    known = image._replace(seen=known_cells(image, extrapolate))
    n_rows, n_columns = cells.probability.shape
    grid = Grid(float(cells.origin[0]), float(cells.origin[1]), cells.resolution, n_columns, n_rows)
    seen = known.seen_at(pixel_centres(grid)).reshape(n_rows, n_columns)
    return cells._replace(probability=np.where(seen, cells.probability, np.nan))


def rasterise(coloring: Coloring, resolution: float, squares: bool) -> Raster:
    """Return the cells of one map: 1 where the centre (`squares`: any part) is black, nan beyond the window."""
    draws = Draws.from_colorings([coloring])
    if not squares:
        return share_of_draws(draws, resolution)
    grid = _checked_grid(coloring.window, resolution)
    black = occupied_probability(draws, pixel_centres(grid), resolution)
    return Raster(black.reshape(grid.ny, grid.nx), np.array([grid.x0, grid.y0]), resolution)


def _checked_grid(window: Window, resolution: float) -> Grid:
    if window.area / resolution**2 > MAX_CELLS:
        raise UsageError(f"--resolution {resolution:g}: more than {MAX_CELLS} cells. Give a larger one.")
    return image_grid(window, resolution)


def known_cells(image: PosteriorImage, extrapolate: float) -> NDArray[np.bool_]:
    """Return which cells (ny, nx) lie within `extrapolate` metres, centre to centre, of one that a reading saw."""
    if extrapolate == 0.0 or image.seen.all() or not image.seen.any():
        return image.seen
    distance = ndimage.distance_transform_edt(~image.seen, sampling=image.resolution)
    return np.asarray(distance <= extrapolate)


def cut_to_known(found: Map, image: PosteriorImage | None, extrapolate: float) -> Map:
    """Return a map without the occupied ground that no reading came near (:data:`WALL`).

    `image`: of the run that the map is of; None: nothing is cut off. `extrapolate`: metres beyond seen cells that count
    as known.
    """
    if image is None or image.seen.all():
        return found
    area = occupied_polygons(found.coloring)
    ground = shapely.simplify(known_ground(image, max(extrapolate, WALL)), image.resolution)  # no stairs of cells
    parts = [part for part in area.geoms if shapely.intersects(part, ground)]
    near = shapely.MultiPolygon(parts)
    for region in (shapely.intersection(near, ground), near):
        polygons = [part for part in shapely.get_parts(region) if shapely.get_dimensions(part) == 2]
        try:
            coloring = from_polygons(shapely.MultiPolygon(polygons), found.coloring.window)
        except InputError:  # the cut made parts touch at a point
            continue
        if coloring.n_edges > 0 or coloring.anchor_black:
            return found._replace(coloring=coloring)
    return found._replace(coloring=type(found.coloring).empty(found.coloring.window))


def known_ground(image: PosteriorImage, extrapolate: float) -> BaseGeometry:
    """Return the ground of the cells that :func:`known_cells` names, joined from boxes of whole runs in a row."""
    row, ends = (np.diff(np.pad(known_cells(image, extrapolate), ((0, 0), (1, 1))).astype(np.int8)) != 0).nonzero()
    low = image.origin + image.resolution * np.column_stack([ends[::2], row[::2]])
    high = image.origin + image.resolution * np.column_stack([ends[1::2], row[1::2] + 1])
    boxes = shapely.box(*(low - SEAM).T, *(high + SEAM).T)
    ground: BaseGeometry = shapely.union_all(boxes)
    return ground
