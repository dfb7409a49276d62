"""Where things of a window lie on a screen: a cell is one pixel wide and two high, and holds 2 x 4 dots of braille."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

FEWEST_COLUMNS = 8
SLIVER = 0.25
"""Share of a pixel that a window may stand out of the last one: no pixel is painted for so little."""


class Extent(Protocol):
    """The lower left corner of a window, and its size, in metres."""

    @property
    def x_min(self) -> float:
        """Left bound."""

    @property
    def y_min(self) -> float:
        """Lower bound."""

    @property
    def width(self) -> float:
        """Of the window in x."""

    @property
    def height(self) -> float:
        """Of the window in y."""


@dataclass(frozen=True)
class Canvas:
    """Cells of a screen laid over a window, square pixels, the aspect kept.

    Attributes
    ----------
    x_min, y_max : float
        Upper left corner, metres.
    pixel : float
        Side of a pixel, metres.
    columns, rows : int
        Cells; there are twice as many rows of pixels.
    """

    x_min: float
    y_max: float
    pixel: float
    columns: int
    rows: int

    @classmethod
    def fit(cls, extent: Extent, columns: int, rows: int | None = None) -> Canvas:
        """Return the largest canvas of so many cells at most.

        Parameters
        ----------
        extent : Extent
        columns : int
        rows : int, optional
            As many as the aspect asks for if absent.
        """
        columns = max(columns, FEWEST_COLUMNS)
        pixel = extent.width / columns
        if rows is not None:
            pixel = max(pixel, extent.height / (2 * max(rows, 1)))
        return cls(
            extent.x_min,
            extent.y_min + extent.height,
            pixel,
            max(1, math.ceil(extent.width / pixel - SLIVER)),
            max(1, math.ceil(extent.height / (2 * pixel) - SLIVER)),
        )

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of pixels."""
        return 2 * self.rows, self.columns

    def centres(self) -> Floats:
        """Return the middles (2 rows * columns, 2) of the pixels, row by row from the top, metres."""
        n_rows, n_columns = self.shape
        y, x = np.mgrid[0:n_rows, 0:n_columns] + 0.5
        return np.column_stack((self.x_min + self.pixel * x.ravel(), self.y_max - self.pixel * y.ravel()))

    def places(self, xy: Floats, fine: tuple[int, int] = (1, 1)) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return the row and the column of the pixel of each point (n, 2); pixels may be cut `fine` in y and x.

        What lies outside gets row -1 and column -1.
        """
        size = (self.shape[0] * fine[0], self.shape[1] * fine[1])
        with np.errstate(invalid="ignore"):
            row = np.floor((self.y_max - xy[:, 1]) / self.pixel * fine[0])
            column = np.floor((xy[:, 0] - self.x_min) / self.pixel * fine[1])
            inside = (row >= 0) & (row < size[0]) & (column >= 0) & (column < size[1])
        return np.where(inside, row, -1).astype(np.int64), np.where(inside, column, -1).astype(np.int64)

    def means(self, values: NDArray[np.floating], origin: Floats, resolution: float) -> Floats:
        """Return the mean of an image in every pixel, of what is known there; nan where nothing is.

        Parameters
        ----------
        values : (ny, nx) float
            The lowest row first; nan unknown.
        origin : (2,) float64
            Lower left corner of the image, metres.
        resolution : float
            Side of its cells, metres.

        Returns
        -------
        (2 rows, columns) float64
        """
        # From the top, as the pixels are.
        top = float(origin[1]) + resolution * values.shape[0]
        rows = _cuts((self.y_max - top) / resolution, -self.pixel / resolution, self.shape[0], values.shape[0], -1.0)
        columns = _cuts(
            (self.x_min - float(origin[0])) / resolution, self.pixel / resolution, self.shape[1], values.shape[1]
        )
        known = np.isfinite(values[::-1])
        total = _sums(np.where(known, values[::-1], 0.0).astype(np.float64), rows, columns)
        count = _sums(known.astype(np.float64), rows, columns)
        means: Floats = np.divide(total, count, out=np.full(self.shape, np.nan), where=count > 0)
        return means

    def dots(self, lines: Floats) -> NDArray[np.bool_]:
        """Return the dots (8 / 2 rows, 2 columns) that straight lines (n, 2, 2) in metres go through."""
        marked = np.zeros((4 * self.rows, 2 * self.columns), np.bool_)
        length = np.hypot(*(lines[:, 1] - lines[:, 0]).T)
        n_steps = np.maximum(1, np.ceil(length / (0.25 * self.pixel))).astype(np.int64)
        line = np.repeat(np.arange(len(lines)), n_steps + 1)
        step = np.arange(len(line)) - np.repeat(np.cumsum(n_steps + 1) - (n_steps + 1), n_steps + 1)
        share = (step / n_steps[line])[:, None]
        self.mark(marked, lines[line, 0] + share * (lines[line, 1] - lines[line, 0]))
        return marked

    def mark(self, dots: NDArray[np.bool_], xy: Floats) -> None:
        """Mark in `dots` those of points (n, 2)."""
        row, column = self.places(xy, (2, 2))
        inside = row >= 0
        dots[row[inside], column[inside]] = True


def _cuts(start: float, step: float, n_pixels: int, n_cells: int, sign: float = 1.0) -> NDArray[np.int64]:
    """Return for each pixel its first cell and the one after its last, (2, n_pixels), at least one cell where it lies.

    `start` and `step` are in cells; `sign` -1 for an axis that runs the other way.
    """
    edges = sign * (start + step * np.arange(n_pixels + 1))
    middle = np.floor(0.5 * (edges[:-1] + edges[1:]))
    first, last = np.round(edges[:-1]), np.round(edges[1:])
    first = np.clip(np.where(last > first, first, middle), 0, n_cells - 1)
    last = np.clip(last, first + 1, n_cells)
    cuts: NDArray[np.int64] = np.stack((first, last)).astype(np.int64)
    return cuts


def _sums(values: Floats, rows: NDArray[np.int64], columns: NDArray[np.int64]) -> Floats:
    """Return the sums of `values` over the rectangles that rows and columns (2, n) cut."""
    table = np.zeros((values.shape[0] + 1, values.shape[1] + 1))
    table[1:, 1:] = values.cumsum(axis=0).cumsum(axis=1)
    low, high = table[rows[0]], table[rows[1]]
    sums: Floats = high[:, columns[1]] - high[:, columns[0]] - low[:, columns[1]] + low[:, columns[0]]
    return sums
