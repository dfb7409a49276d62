"""An occupancy grid in memory."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import NDArray

from prf.kernels.grid import Grid
from prf.run import PosteriorImage
from prf.window import Window


@dataclasses.dataclass(frozen=True, eq=False)
class OccupancyGrid:
    """Probability of being occupied, cell by cell; row 0 has the lowest y.

    Attributes
    ----------
    occupancy : (ny, nx) float32
        Probability that the cell is occupied; 0.5 where no reading came.
    hits, misses : (ny, nx) int32
        Readings that ended in the cell, and that passed it.
    origin : (2,) float64
        Lower left corner of cell (0, 0) in metres.
    resolution : float
        Side of a cell in metres.
    settings : dict
        Configuration as resolved, in SI units.
    process : dict
        Versions, command, digests of the inputs.
    """

    occupancy: NDArray[np.float32]
    hits: NDArray[np.int32]
    misses: NDArray[np.int32]
    origin: NDArray[np.float64]
    resolution: float
    settings: dict[str, Any] = dataclasses.field(default_factory=dict)
    process: dict[str, Any] = dataclasses.field(default_factory=dict)

    @property
    def cells(self) -> Grid:
        """The grid as kernels take it."""
        n_rows, n_columns = self.occupancy.shape
        return Grid(float(self.origin[0]), float(self.origin[1]), self.resolution, n_columns, n_rows)

    @property
    def window(self) -> Window:
        """The rectangle that the cells fill."""
        x, y = self.origin.tolist()
        n_rows, n_columns = self.occupancy.shape
        return Window(x, y, x + n_columns * self.resolution, y + n_rows * self.resolution)

    def image(self) -> PosteriorImage:
        """Return the probabilities as an image; a grid has no other value for squares than for points."""
        return PosteriorImage(self.occupancy, self.occupancy, self.origin, self.resolution, self.seen)

    @property
    def seen(self) -> NDArray[np.bool_]:
        """Which cells (ny, nx) some reading reached."""
        reached: NDArray[np.bool_] = (self.hits + self.misses) > 0
        return reached

    @property
    def share_seen(self) -> float:
        """Share of the cells that some reading reached."""
        return float(np.mean(self.seen))
