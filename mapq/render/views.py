"""How three coordinates become two: the plan view and the axonometric view."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

AZIMUTH, ELEVATION = -60.0, 35.0
"""Degrees: from where the axonometric view looks, unless asked otherwise."""


class Bounds(NamedTuple):
    """A window in the plane of a picture, in metres."""

    x_min: float
    y_min: float
    x_max: float
    y_max: float

    @property
    def width(self) -> float:
        """Of the window."""
        return self.x_max - self.x_min

    @property
    def height(self) -> float:
        """Of the window."""
        return self.y_max - self.y_min

    @classmethod
    def around(cls, xy: NDArray[np.float64], margin: float = 0.02) -> Bounds:
        """Return the bounds of points (n, 2), widened by a share of their size; a point alone gets a metre."""
        low, high = xy.min(axis=0), xy.max(axis=0)
        pad = max(margin * float((high - low).max()), 0.5)
        return cls(*(low - pad).tolist(), *(high + pad).tolist())


def axonometric(
    xyz: NDArray[np.float64], azimuth: float = AZIMUTH, elevation: float = ELEVATION
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Project points without perspective, so that parallel walls stay parallel.

    Parameters
    ----------
    xyz : (n, 3) float64
        Metres, z up.
    azimuth, elevation : float
        Degrees: where the viewer stands, counter-clockwise from x, and above the horizon.

    Returns
    -------
    xy : (n, 2) float64
        Place in the picture, right and up, in metres.
    nearness : (n,) float64
        Larger is nearer to the viewer.
    """
    turn, rise = np.radians(azimuth), np.radians(elevation)
    right = np.array([-np.sin(turn), np.cos(turn), 0.0])
    towards = np.array([np.cos(turn) * np.cos(rise), np.sin(turn) * np.cos(rise), np.sin(rise)])
    up = np.cross(towards, right)
    return xyz @ np.stack([right, up], axis=1), xyz @ towards
