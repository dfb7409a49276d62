"""How probably a beam that reaches a square ends in it (`p_return`): what a robot's sensor will meet there.

Draws say where walls are in a map at the given poses. A later beam meets them off by what poses and readings err by,
and meets what no wall explains: people, chairs, glass. Both are measured on the readings that the map was made from:

- **spread**: standard deviation of the returns that a wall explains about it, metres. Draws are displaced by so much;
- **counts**: of beams that end and that cross round the place itself. They show within centimetres what is met there,
  and share the word with the wall of the draws by weights that were fitted once, on real logs (docs/scores.md);
- **clutter**: unexplained returns a metre of beam, a Poisson process with one rate a cell, that has a Gamma prior.
"""

from __future__ import annotations

import math
from statistics import NormalDist
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from prf.kernels.score.passed_cells import count_passes
from prf.kernels.state.grid import cells_of, make_grid, most_cells
from prf.model.coloring import Draws
from prf.model.ranges import unit_vectors, window_exit
from prf.model.sensors import LaserModel
from prf.model.window import Window
from prf.readings import Readings
from prf.readings.counts import BeamCounts, beam_counts
from prf.results.estimate import occupied_probability
from prf.results.run import RunData
from prf.results.score.heldout import CLIP, SQUARE
from prf.results.score.scene import first_edges

CELL = 0.2
"""Side of the cells of clutter, metres."""
PRIOR_COUNT = 0.3
"""Unexplained returns that the prior of a cell is worth: its rate is that of the whole map, unless it was looked at."""
MOST_TRACED = 24
"""Draws in which readings are explained."""
MOST_DRAWS, N_PLACES = 256, 64
"""Draws that answer, and places to which they are displaced."""
NEAR = 0.2
"""Metres from a wall up to which a return may be of it, as `prf score` counts distances."""
EM_ROUNDS = 8
LEAST_SPREAD = 0.1
"""Of the model's noise: readings of a simulation may have none."""
MOST_BEAMS = 100_000
"""Beams that are looked at; of more, every k-th."""
CHORD = 0.25 * math.pi
"""Mean length of a beam in a cell or a square that it passes, in sides: that of a line in a random direction."""

COUNTED = 0.5
"""Side of the square in which beams are counted, in sides of the square that is asked for: its middle decides."""
PRIOR_BEAMS = 1.0
"""Beams by which both counts are larger in their ratio: a few beams alone say little."""
WEIGHTS = (-1.32, 0.91, 0.91, 1.01, -0.09, 0.32)
"""Of 1 and of :func:`evidence` in the logit of p_return (python -m benchmarks.returns)."""

Floats = NDArray[np.float64]


class Returns(NamedTuple):
    """What the readings of a run met beside the walls of its draws.

    Attributes
    ----------
    spread : float
        Standard deviation of returns about the walls that explain them, metres.
    explained : float
        Probability that the return of a beam that meets a wall is of it.
    rate : (ny, nx) float64
        Returns a metre of beam that no wall explains, row 0 lowest.
    origin : (2,) float64
        Lower left corner of cell (0, 0), metres.
    counts : BeamCounts
        Of all beams of the run.
    """

    spread: float
    explained: float
    rate: Floats
    origin: Floats
    counts: BeamCounts

    def clutter(self, xy: Floats, square: float) -> Floats:
        """Return how probably a beam that reaches the square round each point (n, 2) ends in it without a wall."""
        column, row = np.floor((xy - self.origin) / CELL).astype(np.int64).T
        rate = self.rate[np.clip(row, 0, self.rate.shape[0] - 1), np.clip(column, 0, self.rate.shape[1] - 1)]
        return np.asarray(-np.expm1(-rate * CHORD * square))


def returns_of_run(run: RunData) -> Returns | None:
    """Return what the readings of a run's laser met; None without a laser or a draw."""
    laser = run.placed().laser
    if laser is None or len(run.draws) == 0:
        return None
    # Of sampled poses only the readings that the map was made from are known where they were.
    counts = run.counts if run.trajectory is None else None
    return returns_of(run.draws, laser, run.laser_model(), counts)


def returns_of(draws: Draws, laser: Readings, model: LaserModel, counts: BeamCounts | None = None) -> Returns:
    """Return what the readings of a laser met beside the walls of draws.

    `model`: of which the draws were made; without a return a reading is inf, or at or beyond `model.limit`. `counts`:
    those of all beams, if more are known than these.
    """
    window = draws.window
    laser = laser.select(np.flatnonzero(window.contains(laser.origin, strictly=True)))
    counts = counts or beam_counts(window, laser)
    laser = laser.select(np.arange(laser.n_beams)[:: 1 + laser.n_beams // MOST_BEAMS])
    direction = unit_vectors(laser.angle)
    reach = np.minimum(model.limit, window_exit(window, laser.origin, direction))
    rays = np.ascontiguousarray(np.column_stack([laser.origin, direction, reach]))
    chosen = spread_over(len(draws), MOST_TRACED).tolist()
    off = np.array([first_edges(rays, draws[number].segments(), window) for number in chosen])
    has_return = laser.range < reach
    off = np.where(np.isfinite(off) & has_return, np.where(has_return, laser.range, 0.0) - off, np.inf)
    spread, explained = _explained(model, off)
    end = np.ascontiguousarray(laser.origin + np.minimum(laser.range, reach)[:, None] * direction)
    unexplained = np.where(has_return, 1.0 - explained.mean(axis=0), 0.0)
    rate, origin = _rates(window, np.ascontiguousarray(laser.origin), end, unexplained)
    return Returns(spread, model.hit_probability / (1.0 - model.miss_probability), rate, origin, counts)


def _explained(model: LaserModel, off: Floats) -> tuple[float, Floats]:
    """Return the spread of returns about walls, and how probably a wall made each of them (k, n), by EM.

    `off` (k, n): metres by which returns lie beyond the first wall on their beam in each draw, inf without one. The
    others have the model's density of outliers.
    """
    spread, outlier = model.noise, model.outlier_probability / model.limit
    near = np.abs(off) < NEAR
    share = np.zeros(off.shape)
    for _ in range(EM_ROUNDS):
        hit = np.exp(-0.5 * (off[near] / spread) ** 2) / (math.sqrt(2.0 * math.pi) * spread)
        share[near] = model.hit_probability * hit / (model.hit_probability * hit + outlier)
        if share.sum() > 0.0:
            found = math.sqrt(float(share[near] @ off[near] ** 2) / float(share.sum()))
            spread = max(found, LEAST_SPREAD * model.noise)
    return spread, share


def _rates(window: Window, start: Floats, end: Floats, unexplained: Floats) -> tuple[Floats, Floats]:
    """Return the posterior mean of unexplained returns a metre in each cell (ny, nx), and the corner (2,) of the cells.

    Of beams from `start` to `end` (n, 2) in metres, that end there `unexplained` (n,) with so much probability.
    """
    grid = make_grid(*window, CELL)
    passes = np.zeros(grid.nx * grid.ny, np.int64)
    count_passes(grid, start, end, np.empty(most_cells(grid), np.int32), passes)
    found = np.bincount(cells_of(grid, end), unexplained, len(passes))
    metres = CHORD * grid.cell * passes
    usual = max(float(found.sum()), PRIOR_COUNT) / max(float(metres.sum()), 1.0)
    rate = (found + PRIOR_COUNT) / (metres + PRIOR_COUNT / usual)
    return rate.reshape(grid.ny, grid.nx), np.array([grid.x0, grid.y0])


def return_probability(draws: Draws, returns: Returns | None, xy: Floats, square: float) -> Floats:
    """Return how probably a beam that reaches the square round each point ends in it (n,); nan outside the window.

    `xy` (n, 2) and `square`, its side: metres; 0 stands for :data:`SQUARE`, since no beam ends in a point. Without
    `returns`: the share of draws in which the square is not completely white.
    """
    square = square or SQUARE
    if returns is None:
        return occupied_probability(draws, xy, square)
    logit = WEIGHTS[0] + evidence(draws, returns, xy, square) @ np.array(WEIGHTS[1:])
    free = (1.0 - 1.0 / (1.0 + np.exp(-logit))) * (1.0 - returns.clutter(xy, square))
    return np.where(draws.window.contains(xy), 1.0 - free, np.nan)


def evidence(draws: Draws, returns: Returns, xy: Floats, square: float) -> Floats:
    """Return what speaks for a return from the square round each point (n, 5); nan outside the window.

    The logit of the probability that a wall returns a beam from it, the log of the ratio of beams that ended in its
    middle to those that crossed it, the log of their number, one added, and the first two times the third: the more
    beams there are, the less the draws' word counts and the more theirs.
    """
    wall = np.clip(_wall_probability(draws, returns, xy, square), CLIP, 1.0 - CLIP)
    ends, crossing = returns.counts.within(xy, COUNTED * square)
    ratio = np.log((ends + PRIOR_BEAMS) / (crossing + PRIOR_BEAMS))
    claim, number = np.log(wall / (1.0 - wall)), np.log1p(ends + crossing)
    return np.column_stack([claim, ratio, number, claim * number, ratio * number])


def _wall_probability(draws: Draws, returns: Returns, xy: Floats, square: float) -> Floats:
    """Return how probably a wall of the draws, displaced by the spread of returns, returns a beam from the square."""
    chosen = spread_over(len(draws), MOST_DRAWS)
    wall, weight = np.zeros(len(xy)), np.zeros(len(xy))
    for place, offset in enumerate(returns.spread * _normal_places(N_PLACES)):
        some = chosen[place::N_PLACES] if len(chosen) >= N_PLACES else chosen
        share = occupied_probability(Draws.from_colorings([draws[i] for i in some.tolist()]), xy + offset, square)
        known = np.isfinite(share)
        wall[known] += len(some) * share[known]
        weight[known] += len(some)
    return returns.explained * np.where(weight > 0.0, wall / np.maximum(weight, 1.0), np.nan)


def spread_over(n: int, most: int) -> NDArray[np.int64]:
    """Return numbers (k,) of n draws, at most so many, spread evenly over the chains, which follow one another."""
    return np.unique(np.linspace(0, n - 1, min(most, n)).round().astype(np.int64))


def _normal_places(n: int) -> Floats:
    """Return n places (n, 2) that stand for a normal distribution in the plane: a low-discrepancy sequence's."""
    golden = 1.32471795724474602596  # of the plane (Roberts 2018, R2 sequence)
    share = (0.5 + np.arange(n)[:, None] / golden ** np.array([1.0, 2.0])) % 1.0
    return np.array([[NormalDist().inv_cdf(each) for each in row] for row in share.tolist()])
