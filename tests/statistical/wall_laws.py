"""The prior of walls by rejection from the Poisson process, which shares no line with the sampler, and by its chain."""

from __future__ import annotations

import dataclasses
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from prf.kernels import constants as c
from prf.model.coloring import Coloring
from prf.model.layout import make_targets, read_coloring
from prf.model.orientation import MEAN_STRENGTH, RIGHT_ANGLE, Orientation
from prf.model.sensors import MOST_ORIENTATION
from prf.model.walls import SPREAD, WallPrior, walls_of
from prf.model.window import Window
from prf.sampler.directions import redraw_wall_laws
from prf.sampler.target import Target, make_chain, run_chain
from tests.reference.slow_walls import bars, pair_cost

Floats = NDArray[np.float64]
WINDOW = Window(0.0, -0.5, 1.6, 0.7)
PRIOR = WallPrior(density=1.5, length=0.3, thickness=0.05, free_end=0.4, crossing=0.9)
NAMES = (
    "walls",
    "pairs",
    "length",
    "squared length",
    "thickness",
    "aligned",
    "free ends",
    "pair costs",
    "common value",
)
TURN = 20
"""Steps between two draws of directions and common values."""


def drawn_walls(rng: np.random.Generator, prior: WallPrior, window: Window) -> tuple[Floats, float, float, Floats]:
    """Walls of the Poisson process without interactions, strength, angle and common values of the thickness."""
    strength = MOST_ORIENTATION + 1.0
    while strength > MOST_ORIENTATION:
        strength = rng.exponential(MEAN_STRENGTH)
    angle, common = RIGHT_ANGLE * rng.random(), prior.thickness * np.exp(SPREAD * rng.standard_normal(c.N_COMMON))
    n = rng.poisson(prior.density * window.area)
    theta = (angle + rng.vonmises(0.0, strength, n) / 4.0) + 0.5 * math.pi * rng.integers(0, 2, n)
    length = np.exp(math.log(prior.length) + 1.2 * rng.standard_normal(n))
    even = 0.02 * 50.0 ** rng.random(n)
    thickness = np.where(rng.random(n) < 0.25, even, rng.choice(common, n) + 0.008 * rng.standard_normal(n))
    middle = rng.uniform(window[:2], window[2:], (n, 2))
    half = 0.5 * length[:, None] * np.column_stack([np.cos(theta), np.sin(theta)])
    return np.column_stack([middle - half, middle + half, thickness]), strength, angle, common


def is_legal(walls: Floats, common: Floats, window: Window) -> bool:
    """Whether all walls are walls inside the window, and all common values in their bounds."""
    if not ((common > 0.02) & (common < 1.0)).all():
        return False
    for wall in bars(walls):
        x, y = np.array(wall.polygon().exterior.coords).T
        inside = window.x_min < x.min() and x.max() < window.x_max and window.y_min < y.min() and y.max() < window.y_max
        if not (inside and 0.02 < wall.t < 1.0 and wall.length > wall.t):
            return False
    return True


def statistics(walls: Floats, prior: WallPrior, angle: float, common: Floats) -> list[float]:
    """What the two are compared by."""
    found = bars(walls)
    length = np.array([wall.length for wall in found])
    aligned = sum(math.cos(4.0 * (math.atan2(w.unit.imag, w.unit.real) - angle)) for w in found)
    free = sum(not any(o.has(end) for o in found if o is not w) for w in found for end in (w.a, w.b))
    costs = sum(pair_cost(found[i], found[k], prior.crossing) for i in range(len(found)) for k in range(i))
    n = len(found)
    return [n, n * (n - 1), length.sum(), (length**2).sum(), walls[:, 4].sum(), aligned, free, costs, common.sum()]


class Drawn(NamedTuple):
    """A map of walls with what is sampled beside it."""

    walls: Floats
    strength: float
    angle: float
    common: Floats

    def statistics(self, prior: WallPrior) -> list[float]:
        """See :func:`statistics`."""
        return statistics(self.walls, prior, self.angle, self.common)


def weighed(rng: np.random.Generator, prior: WallPrior, window: Window) -> tuple[Drawn, float]:
    """Draw from the Poisson process; and what its interactions leave of the density, 0 where a wall is not legal."""
    found = Drawn(*drawn_walls(rng, prior, window))
    if not is_legal(found.walls, found.common, window):
        return found, 0.0
    row = found.statistics(prior)
    return found, math.exp(-prior.free_end * row[6] - row[7])


def one_draw(rng: np.random.Generator, prior: WallPrior, window: Window) -> Drawn:
    """Draw from the prior by rejection from the Poisson process."""
    while True:
        found, weight = weighed(rng, prior, window)
        if rng.random() < weight:
            return found


def log_constant(n: int, seed: int, prior: WallPrior = PRIOR) -> tuple[float, float]:
    """Log of the normalising constant, that without walls being near 0, and its standard error, by `n` draws."""
    rng = np.random.default_rng(seed)
    weights = np.array([weighed(rng, prior, WINDOW)[1] for _ in range(n)])
    return prior.density * WINDOW.area + math.log(weights.mean()), float(weights.std() / weights.mean() / math.sqrt(n))


def by_rejection(n: int, seed: int, prior: WallPrior = PRIOR) -> Floats:
    """Statistics (n, 9) of independent draws."""
    rng = np.random.default_rng(seed)
    return np.array([one_draw(rng, prior, WINDOW).statistics(prior) for _ in range(n)])


def by_chain(n: int, seed: int, prior: WallPrior = PRIOR) -> Floats:
    """Statistics (n, 9) of every `TURN`-th map of a chain, some of whose births are aimed at targets."""
    rng = np.random.default_rng(seed)
    rows: list[list[float]] = []
    target = Target(WINDOW, 0.1, orientation=Orientation(None, None), walls=prior)
    chain = make_chain(target, Coloring.empty(WINDOW))
    chain = chain._replace(
        targets=make_targets(WINDOW, 0.05, rng.uniform(WINDOW[:2], (WINDOW.centre[0], WINDOW.y_max), (60, 2)))
    )
    chain.tuning[c.AIMED_SHARE] = 0.5
    for until in range(TURN, TURN * (n + 1), TURN):
        chain = run_chain(chain, rng, until)
        redraw_wall_laws(chain, prior, target.orientation, rng)
        walls = walls_of(read_coloring(chain.graph))
        rows.append(statistics(walls, prior, float(chain.lines[c.ANGLE]), chain.lines[c.N_LINES :].copy()))
    return np.array(rows)


def z_scores(chain: Floats, exact: Floats, n_batches: int = 60) -> dict[str, float]:
    """Return how far the means lie apart, in standard errors; those of the chain by batches."""
    size = len(chain) // n_batches
    batches = chain[: n_batches * size].reshape(n_batches, size, -1).mean(axis=1)
    error = np.sqrt(batches.var(axis=0, ddof=1) / n_batches + exact.var(axis=0, ddof=1) / len(exact))
    return dict(zip(NAMES, ((batches.mean(axis=0) - exact.mean(axis=0)) / error).tolist(), strict=True))


def mean_of(chain: Floats, name: str, n_batches: int = 60) -> tuple[float, float]:
    """Mean of a statistic over a chain, and its standard error by batches."""
    size = len(chain) // n_batches
    batches = chain[: n_batches * size, NAMES.index(name)].reshape(n_batches, size).mean(axis=1)
    return float(batches.mean()), float(batches.std(ddof=1) / math.sqrt(n_batches))


def other_law() -> WallPrior:
    """A law that must be told from `PRIOR`: its free ends cost a quarter less."""
    return dataclasses.replace(PRIOR, free_end=0.3)
