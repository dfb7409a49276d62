"""Probe points: where the colour of the map is followed, to tell whether chains agree."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from prf.layout import image_grid
from prf.posterior import Settings

PROBES_PER_AXIS = 4


def probe_pixels(settings: Settings) -> NDArray[np.int64]:
    """Return the pixels (n,) in the middle of a 4 x 4 division of the window."""
    assert settings.resolution is not None
    grid = image_grid(settings.window, settings.resolution)
    share = (np.arange(PROBES_PER_AXIS) + 0.5) / PROBES_PER_AXIS
    ix = (share * settings.window.width / grid.cell).astype(np.int64)
    iy = (share * settings.window.height / grid.cell).astype(np.int64)
    return np.unique((ix[None, :] + grid.nx * iy[:, None]).ravel())
