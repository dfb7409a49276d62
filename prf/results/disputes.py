"""Where logs of one run contradict each other: a map explains readings of the one alone.

A door was shut in between, or a cupboard moved.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from prf.kernels import constants as c
from prf.kernels.score.passed_cells import count_passes
from prf.kernels.state.grid import Grid, cells_of, make_grid, most_cells
from prf.model.ranges import make_rays
from prf.readings import Readings
from prf.results.run import RunData
from prf.results.score.returns import spread_over
from prf.results.score.scene import first_edges

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

MOST_TRACED = 12
"""Draws in half of which at least a return is unexplained."""
EXPLAINED = 4.0
"""Standard deviations within which a wall explains a return."""
CELL = 0.25
"""Metres: side of the cells in which returns are counted; connected ones are one place."""
FEWEST = 8.0
"""Readings of the one log that the map contradicts there at least, and of another one that agree with it."""
MOST = 5
"""Places at most, those of the most readings."""


class Dispute(NamedTuple):
    """A place where the map can follow only one of two logs.

    Attributes
    ----------
    log : str
        The one that the map contradicts.
    x, y : float
        In the middle of it, metres.
    n_readings : int
        Its readings that the map does not explain.
    n_others : int
        Readings of other logs that reach the place and are explained.
    """

    log: str
    x: float
    y: float
    n_readings: int
    n_others: int

    def words(self) -> str:
        """Return it in a sentence."""
        return (
            f"{self.log}: {self.n_readings} readings round ({self.x:.1f}, {self.y:.1f}) contradict the map, and "
            f"{self.n_others} of other logs agree with it: something was moved, opened or shut"
        )


def disputes(run: RunData) -> list[Dispute]:
    """Return where logs of a run's laser contradict each other, the most readings first."""
    laser = run.placed().laser
    if laser is None or len(run.draws) == 0 or laser.log.max(initial=0) == 0:
        return []
    laser = laser.select(np.flatnonzero(run.draws.window.contains(laser.origin, strictly=True)))
    is_odd, end = _against_draws(run, laser)
    grid = make_grid(*run.draws.window, CELL)
    names = run.manifest.get("logs", {}).get("laser", [])
    found = []
    for number in np.unique(laser.log).tolist():
        own = laser.log == number
        cells = cells_of(grid, end[own & is_odd])
        odd = np.bincount(cells, laser.weight[own & is_odd], grid.nx * grid.ny).astype(np.float64)
        agreeing = [_reaching(grid, laser.origin, end, which & ~is_odd) for which in (own, ~own)]
        name = f"log {number + 1}" + (f" ({Path(names[number]).name})" if number < len(names) else "")
        found += _places(grid, name, odd, *agreeing)
    return sorted(found, key=lambda each: -each.n_readings)[:MOST]


def _against_draws(run: RunData, laser: Readings) -> tuple[Bools, Floats]:
    """Return which beams (n,) half of the draws at least do not explain, and where they end or are stopped (n, 2).

    Metres; the nearer of the reading and of the wall that it meets in the middle one of the draws.
    """
    model, window = run.laser_model(), run.draws.window
    rays = make_rays(window, model, laser.origin, laser.angle, laser.range)
    reach = rays[:, c.MAX_DISTANCE]
    chosen = spread_over(len(run.draws), MOST_TRACED).tolist()
    met = np.array([np.minimum(first_edges(rays, run.draws[i].segments(), window), reach) for i in chosen])
    read = np.minimum(laser.range, reach)
    spread = np.maximum(model.noise, model.noise_relative * met)
    is_odd = np.median(np.abs(read - met) > EXPLAINED * spread, axis=0) > 0.5
    length = np.minimum(read, np.median(met, axis=0))
    return is_odd, laser.origin + length[:, None] * rays[:, c.DIRECTION_X : c.DIRECTION_Y + 1]


def _reaching(grid: Grid, start: Floats, end: Floats, chosen: Bools) -> Floats:
    """Return how many of some beams (n,) pass each cell (n_cells,) or end in it."""
    passes = np.zeros(grid.nx * grid.ny, np.int64)
    path = np.empty(most_cells(grid), np.int32)
    count_passes(grid, np.ascontiguousarray(start[chosen]), np.ascontiguousarray(end[chosen]), path, passes)
    return passes.astype(np.float64)


def _places(grid: Grid, log: str, odd: Floats, own: Floats, others: Floats) -> list[Dispute]:
    """Return the places where more readings of a log are odd than agree (n_cells,), and others do."""
    from scipy import ndimage  # noqa: PLC0415 - a fifth of a second

    shape = grid.ny, grid.nx
    label, n = ndimage.label(((odd > own) & (others > 0)).reshape(shape), np.ones((3, 3)))
    numbers = np.arange(1, n + 1)
    count, agreeing = (ndimage.sum_labels(each.reshape(shape), label, numbers) for each in (odd, others))
    found = []
    for number in np.flatnonzero((np.asarray(count) >= FEWEST) & (np.asarray(agreeing) >= FEWEST)).tolist():
        row, column = ndimage.center_of_mass(odd.reshape(shape), label, number + 1)
        x, y = grid.x0 + (column + 0.5) * grid.cell, grid.y0 + (row + 0.5) * grid.cell
        found.append(Dispute(log, float(x), float(y), round(count[number]), round(agreeing[number])))
    return found
