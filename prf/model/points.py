"""Point observations: the points laid out for a chain (paper, equation 5)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from prf.kernels.readings import points as k
from prf.model.sensors import PointModel
from prf.model.window import Window
from prf.shell.errors import ConfigError

Floats = NDArray[np.float64]

POINTS_A_ROW = 4  # if so many points share each y in the mean, they are taken row by row
MIN_SIGMA = 1e-3
"""An estimated sigma is never below this share of the distance of the means: values without noise have none."""
ROUNDS = 1000
"""Of the estimation of sigma at most; it ends before once a round changes sigma by less than `ENOUGH` of itself."""
ENOUGH = 1e-9
MAX_VALUES = 100_000  # sigma is estimated from every k-th value so that no more than twice as many are used


def resolved(model: PointModel, values: Floats) -> PointModel:
    """Return the model with the kind, and the sigma of a gaussian one, that fit `values` (n,)."""
    is_binary = bool(np.isin(values, (0.0, 1.0)).all())
    kind = model.kind or ("binary" if is_binary else "gaussian")
    if kind == "binary":
        if not is_binary:
            odd = values[~np.isin(values, (0.0, 1.0))][0]
            raise ConfigError(f'points-kind "binary": a value is {odd:g}, neither 0 nor 1. Use kind = "gaussian".')
        return model.replace(kind=kind)
    sigma = model.sigma if model.sigma is not None else estimated_sigma(values, model.mean_black, model.mean_white)
    return model.replace(kind=kind, sigma=sigma)


def log_density(model: PointModel, values: Floats) -> Floats:
    """Return the log density of each of `values` (n,) where the map is white and where it is black, (n, 2)."""
    model = resolved(model, values)
    if model.kind == "binary":
        kept, flipped = math.log1p(-model.flip_probability), math.log(model.flip_probability)
        black = np.where(values == 1.0, kept, flipped)
        return np.column_stack((kept + flipped - black, black))
    assert model.sigma is not None
    means = np.array([model.mean_white, model.mean_black])
    with np.errstate(over="ignore"):
        log_density = -0.5 * ((values[:, None] - means) / model.sigma) ** 2
    if not np.isfinite(log_density).all():
        raise ConfigError(f"points-sigma {model.sigma:g}: too small for values so far from both means")
    found: Floats = log_density - math.log(model.sigma * math.sqrt(2.0 * math.pi))
    return found


def estimated_sigma(values: Floats, mean_black: float, mean_white: float) -> float:
    """Return the most likely common sigma of values (n,) drawn from two normals of known means.

    By expectation and maximisation, over sigma and the share of black, from the share that the mean value suggests.
    """
    values = values[:: max(1, len(values) // MAX_VALUES)]
    means = np.array([mean_white, mean_black])
    gap = abs(mean_black - mean_white)
    share = float(np.clip((values.mean() - mean_white) / (mean_black - mean_white), 0.01, 0.99))
    square = (values[:, None] - means) ** 2
    sigma = math.sqrt(max(float(square.min(axis=1).mean()), (MIN_SIGMA * gap) ** 2))
    for _ in range(ROUNDS):
        log_odds = math.log(share / (1.0 - share)) + (square[:, 0] - square[:, 1]) / (2.0 * sigma**2)
        black = 0.5 * (1.0 + np.tanh(0.5 * log_odds))
        share = float(np.clip(black.mean(), 1e-9, 1.0 - 1e-9))
        before, sigma = sigma, math.sqrt(float((square[:, 0] + black * (square[:, 1] - square[:, 0])).mean()))
        sigma = max(sigma, MIN_SIGMA * gap)
        if abs(sigma - before) < ENOUGH * sigma:
            break
    return sigma


def make_points(xy: Floats, log_density: Floats) -> k.Points:
    """Lay out points for a chain, with no colour yet (:func:`paint`).

    `xy` (n, 2): inside the window, metres. `log_density` (n, 2): of each value in white and in black.
    """
    n = len(xy)
    band = _bands(xy[:, 1])
    order = np.lexsort((xy[:, 0], band))
    column = np.zeros((k.N_COLUMNS, n))
    column[[k.X, k.Y]] = xy[order].T
    column[[k.LOG_WHITE, k.LOG_BLACK]] = log_density[order].T
    first = np.flatnonzero(np.diff(band[order], prepend=-1))
    bands = np.full((k.N_BAND, len(first) + 1), float(n))
    bands[k.FIRST, :-1] = first
    for row, extreme in ((k.LOWEST, np.minimum), (k.HIGHEST, np.maximum)):
        bands[row, :-1] = extreme.reduceat(column[k.Y], first) if n else 0.0
    return k.Points(column, bands)


def paint(points: k.Points, black: NDArray[np.bool_]) -> None:
    """Set the colour of every point (n,) and what turning it would gain."""
    gain = points.column[k.LOG_BLACK] - points.column[k.LOG_WHITE]
    points.column[k.BLACK] = black
    points.column[k.GAIN] = np.where(black, -gain, gain)


def _bands(y: Floats) -> NDArray[np.int64]:
    """Return the band of each point (n,), ascending with y: rows of equal y, or about sqrt(n) / 2 equally high ones."""
    rows, row = np.unique(y, return_inverse=True)
    if len(rows) * POINTS_A_ROW <= len(y) or len(rows) < 2:
        band = row
    else:
        n_bands = math.ceil(0.5 * math.sqrt(len(y)))
        band = np.floor((y - rows[0]) / (rows[-1] - rows[0]) * n_bands)
    return np.asarray(band, dtype=np.int64)


def window_round(xy: Floats) -> Window:
    """Return the bounding box of points (n, 2) with a margin of half their spacing: the pixels of a bitmap fill it.

    The spacing is the median distance from a place to its nearest neighbour; 2 m for a single place.
    """
    from scipy.spatial import cKDTree  # noqa: PLC0415 - only runs without laser and sonar need it

    places = np.unique(xy, axis=0)
    spacing = float(np.median(cKDTree(places).query(places, k=2)[0][:, 1])) if len(places) > 1 else 2.0
    low, high = places.min(axis=0) - 0.5 * spacing, places.max(axis=0) + 0.5 * spacing
    return Window.checked(*low.tolist(), *high.tolist())
