"""Random tiles of the window, and the length of a round: by chance, readings and window, never by the map."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from prf.kernels.state.grid import Grid
from prf.model.window import Window
from prf.sampler.posterior import Settings
from prf.sampler.record import FIRST_THIN

LEAST_SIDE = 60.0
"""Metres: windows that are not longer have no tiles unless a number is given."""
LEAST_READINGS = 10_000
"""Likewise with fewer readings: chains side by side use the threads as well, and better."""
TILE_SIDE = 40.0
"""Metres: about the side of a tile, if the readings lay evenly."""
MOST_TILES = 32
NARROWEST = 0.35
"""Least width of a tile, as a share of the side of a square tile."""
STEPS_PER_READING = 4
"""Steps of a round: to begin and to end it costs time in proportion to the readings."""
ROUND_LENGTHS = (64 * FIRST_THIN, 1024 * FIRST_THIN)
"""Steps of the shortest and of the longest round; a longer one would keep Ctrl-C and the clock waiting."""
LOOK_STEPS = 4 * FIRST_THIN
"""Steps between two looks at the tiles of a round, where draws are recorded: each costs some milliseconds."""
PLAIN_SHARE = 1.0 / 64.0
"""Share of a round's steps that the chain makes on the whole window, where nothing stays because of a border.

They cannot be shared out, and each takes longer: memory for all readings does not fit a processor's caches.
"""


def chosen_tiles(window: Window, n_readings: int) -> int:
    """Return the number of tiles that is used unless one is given; 0: none."""
    if max(window.width, window.height) <= LEAST_SIDE or n_readings < LEAST_READINGS:
        return 0
    return min(MOST_TILES, max(4, round(window.area / TILE_SIDE**2)))


def narrowest(window: Window, n_tiles: int) -> float:
    """Return the least width of a tile, metres."""
    return NARROWEST * math.sqrt(window.area / n_tiles)


def looks_of(length: int) -> int:
    """Return the number of looks in a round of `length` steps."""
    return max(1, length // LOOK_STEPS)


def round_length(settings: Settings) -> int:
    """Return the steps of a round: `FIRST_THIN` times a power of two, so that epochs and draws fall on its end."""
    readings = (settings.laser, settings.sonar)
    wanted = STEPS_PER_READING * sum(sensor.readings.n_beams for sensor in readings if sensor is not None)
    length, longest = ROUND_LENGTHS
    while length < min(wanted, longest):
        length *= 2
    return length


def first_round() -> int:
    """Return the step at which the first round begins."""
    return ROUND_LENGTHS[0]


Floats = NDArray[np.float64]

QUANTILES = (0.3, 0.7)
"""Between these shares of a rectangle's returns, or of its side where it has none, a cut is drawn."""


def random_tiles(
    window: Window, n: int, returns: Floats, least: float, pixels: Grid, rng: np.random.Generator
) -> Floats:
    """Cut the window into rectangles until there are `n`, or none is large enough to be cut.

    The rectangle with the most returns is cut next, across, at a quantile of its returns drawn by chance: tiles
    then hold about as many readings each. A cut that runs between pixels lets every pixel belong to one tile.

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
