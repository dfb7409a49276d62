"""What a RUN directory holds, as arrays in memory."""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from prf.results.agreement import Agreement, agreement
from prf.results.convergence import Diagnosis

Status = Literal["running", "converged", "not converged", "finished", "interrupted"]


class Progress(NamedTuple):
    """State of a run after a round."""

    step: int  # steps that each chain has made
    seconds: float  # since the start of sampling, in this process
    steps_per_second: float  # over all chains
    share: float  # of the goal that is reached, in [0, 1]; of the time limit when agreement is the goal
    diagnoses: dict[str, Diagnosis] | None  # the latest check of agreement
    status: Status  # "running" until the last round


class PosteriorImage(NamedTuple):
    """Occupancy image on square cells, estimated over every step after burn-in.

    Attributes
    ----------
    occupancy : (ny, nx) float32
        Share of steps in which the cell's centre is black; row 0 has the lowest y; nan where nothing is known.
    square_occupancy : (ny, nx) float32
        Share of steps in which the cell is not completely white.
    origin : (2,) float64
        Lower left corner of cell (0, 0) in metres.
    resolution : float
        Side of a cell in metres.
    seen : (ny, nx) bool
        Whether a reading of the chosen scans and beams, thinned away or not, crossed the cell or ended in it.
    disagreement : (ny, nx) float32 or None
        Largest difference between the shares of black of any two chains; nan where there is none. None of a grid.
    """

    occupancy: NDArray[np.float32]
    square_occupancy: NDArray[np.float32]
    origin: NDArray[np.float64]
    resolution: float
    seen: NDArray[np.bool_]
    disagreement: NDArray[np.float32] | None = None

    @property
    def extent(self) -> tuple[float, float, float, float]:
        """Left, right, bottom and top of the image in metres."""
        n_rows, n_columns = self.occupancy.shape
        x, y = float(self.origin[0]), float(self.origin[1])
        return x, x + n_columns * self.resolution, y, y + n_rows * self.resolution

    def agreement(self) -> Agreement | None:
        """Return where the chains agree; None of a grid."""
        if self.disagreement is None:
            return None
        return agreement(self.disagreement, self.seen, self.origin, self.resolution)

    def seen_at(self, xy: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return whether each of the points (n, 2), metres, lies in a cell that was seen; False outside the image."""
        column, row = np.floor((xy - self.origin) / self.resolution).T
        inside = (column >= 0) & (row >= 0) & (column < self.seen.shape[1]) & (row < self.seen.shape[0])
        found = np.zeros(len(xy), np.bool_)
        found[inside] = self.seen[row[inside].astype(np.int64), column[inside].astype(np.int64)]
        return found

    def sees(self, lines: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return whether each line (n, 2, 2), metres, touches ground that was seen."""
        along = lines[:, :1] + np.linspace(0.0, 1.0, 9)[:, None] * (lines[:, 1:] - lines[:, :1])
        return np.asarray(self.seen_at(along.reshape(-1, 2)).reshape(-1, 9).any(axis=1))
