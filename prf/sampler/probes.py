"""Probe points: where the colour of the map is followed, to tell whether chains agree."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from prf.layout import image_grid, pixel_centres
from prf.posterior import Settings

BLOCKS_PER_AXIS = 4


def probe_pixels(settings: Settings) -> NDArray[np.int64]:
    """Return pixels: of each block of a 4 x 4 division of the window the seen and the unseen one next to its middle."""
    centres, seen = _centres(settings), seen_pixels(settings)
    inside, window = settings.window.contains(centres), settings.window
    place = BLOCKS_PER_AXIS * (centres - window[:2]) / (window.width, window.height)
    block = np.clip(np.floor(place), 0, BLOCKS_PER_AXIS - 1)
    metres = np.hypot(*((place - block - 0.5) * (window.width, window.height)).T)
    kind = (block @ (1, BLOCKS_PER_AXIS)) * 2 + ~seen
    order = np.lexsort((metres, kind))
    order = order[inside[order]]
    _, first = np.unique(kind[order], return_index=True)
    return np.sort(order[first])


def seen_pixels(settings: Settings) -> NDArray[np.bool_]:
    """Return which pixels (n_pixels,) of the image readings saw, row by row from the lowest."""
    return np.ones(len(_centres(settings)), np.bool_) if settings.seen is None else settings.seen.ravel()


def _centres(settings: Settings) -> NDArray[np.float64]:
    assert settings.resolution is not None
    return pixel_centres(image_grid(settings.window, settings.resolution))
