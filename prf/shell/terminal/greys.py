"""Probabilities as greys, or as shades of characters: white free, black occupied."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from prf.shell.terminal.cells import RGB, Layer, Raster
from prf.shell.terminal.screen import Screen

UNKNOWN_RGB: RGB = (246, 231, 216)
"""Where nothing is said, as in the other pictures."""
UNKNOWN_LETTER = "?"
ALMOST = 1e-6
ASCII_SHADES = " .:-=+*#%@"
BLOCK_SHADES = " ░▒▓█"


def shades_of(screen: Screen) -> str:
    """Return the characters from free to occupied that stand for greys on a screen without colours."""
    return BLOCK_SHADES if screen.blocks else ASCII_SHADES


def grey_raster(values: NDArray[np.floating], screen: Screen, layers: tuple[Layer, ...] = ()) -> Raster:
    """Return a picture of probabilities.

    Parameters
    ----------
    values : (2 rows, columns) float
        From the top; nan where nothing is known.
    screen : Screen
    layers : tuple of Layer
    """
    known = np.isfinite(values)
    grey = 255.0 * (1.0 - np.clip(np.where(known, values, 0.0), 0.0, 1.0))
    rgb = np.where(known[:, :, None], grey[:, :, None], np.array(UNKNOWN_RGB, np.float64))
    return Raster(rgb, _letters(values, shades_of(screen)), layers)


def legend_of_greys(screen: Screen, event: str = "occupied") -> str:
    """Return what the shades mean, for a screen without colours."""
    shades = shades_of(screen)
    return f"free '{shades[0]}' {shades[1:-1]} '{shades[-1]}' {event}"


def _letters(values: NDArray[np.floating], shades: str) -> NDArray[np.str_]:
    """Return a character for every two pixels, of what is known of them."""
    above, below = values[::2], values[1::2]
    both = np.where(np.isfinite(above), np.where(np.isfinite(below), 0.5 * (above + below), above), below)
    known = np.isfinite(both)
    # A share of so many draws that lies on the border of two shades is not to be decided by rounding.
    level = np.clip(np.where(known, both, 0.0) * len(shades) + ALMOST, 0, len(shades) - 1).astype(np.int64)
    return np.where(known, np.array(list(shades))[level], UNKNOWN_LETTER)
