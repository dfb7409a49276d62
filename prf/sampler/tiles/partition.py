"""A random partition of the window into rectangles: of chance and of the readings, never of the map."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from prf.kernels.grid import Grid
from prf.window import Window

Floats = NDArray[np.float64]

QUANTILES = (0.3, 0.7)
"""Between these shares of a rectangle's returns, or of its side where it has none, a cut is drawn."""


def random_tiles(
    window: Window, n: int, returns: Floats, least: float, pixels: Grid, rng: np.random.Generator
) -> Floats:
    """Cut the window into rectangles until there are `n`, or none is large enough to be cut.

    The rectangle with the most returns is cut next, across, at a quantile of its returns drawn by chance: tiles come
    to hold about as many readings each. A cut that runs between pixels lets every pixel belong to one tile.

    `returns` (m, 2).
    """
    parts = [(np.array(window, np.float64), returns[window.contains(returns)])]
    while len(parts) < n:
        sides = [float(np.max(box[2:] - box[:2])) for box, _ in parts]
        wide = [i for i, side in enumerate(sides) if side >= 2.0 * least]
        if not wide:
            break
        chosen = max(wide, key=lambda i: (len(parts[i][1]), sides[i]))
        box, inside = parts.pop(chosen)
        axis = _axis(box, least, rng)
        at = _cut(box, inside, axis, least, pixels, rng)
        low, high = box.copy(), box.copy()
        low[2 + axis] = high[axis] = at
        below = inside[:, axis] < at
        parts[chosen:chosen] = [(low, inside[below]), (high, inside[~below])]
    return np.array([box for box, _ in parts])


def _axis(box: Floats, least: float, rng: np.random.Generator) -> int:
    """Return the axis along which a box is cut: drawn in proportion to the sides that are long enough."""
    sides = box[2:] - box[:2]
    weight = np.where(sides >= 2.0 * least, sides, 0.0)
    return int(rng.random() * weight.sum() >= weight[0])


def _cut(box: Floats, returns: Floats, axis: int, least: float, pixels: Grid, rng: np.random.Generator) -> float:
    """Return where a box is cut along an axis."""
    share = rng.uniform(*QUANTILES)
    low, high = float(box[axis]), float(box[2 + axis])
    at = low + share * (high - low) if len(returns) == 0 else float(np.quantile(returns[:, axis], share))
    at = min(max(at, low + least), high - least)
    if pixels.nx == 0:
        return at
    start = (pixels.x0, pixels.y0)[axis]
    line = start + round((at - start) / pixels.cell) * pixels.cell
    return line if low < line < high else at
