"""The window: the axis-aligned rectangle through which a coloring of the plane is seen."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from prf.kernels.constants import BOTTOM, INTERIOR, LEFT, RIGHT, TOP
from prf.model.sensors import window_fault
from prf.shell.errors import ConfigError

__all__ = [
    "BOTTOM",
    "INTERIOR",
    "LEFT",
    "RIGHT",
    "SIDES",
    "SIDE_NAMES",
    "TOP",
    "Window",
]

SIDES = (BOTTOM, RIGHT, TOP, LEFT)
"""Counter-clockwise: y = y_min, x = x_max, y = y_max, x = x_min. Corner i lies between sides i and (i + 1) % 4.

A vertex that lies on no side is ``INTERIOR``.
"""
SIDE_NAMES = ("bottom", "right", "top", "left")


class Window(NamedTuple):
    """Rectangle [x_min, x_max] x [y_min, y_max] in metres."""

    x_min: float
    y_min: float
    x_max: float
    y_max: float

    @classmethod
    def checked(cls, x_min: float, y_min: float, x_max: float, y_max: float) -> Window:
        """Return the window with these bounds; ConfigError unless they are finite, within range and in order."""
        window = cls(float(x_min), float(y_min), float(x_max), float(y_max))
        if fault := window_fault(window):
            raise ConfigError(f"window {' '.join(map(repr, window))}: {fault}.")
        return window

    @classmethod
    def beyond(cls, box: Sequence[float], margin: float) -> Window:
        """Return the window that reaches `margin` metres beyond a box x_min, y_min, x_max, y_max on every side."""
        x_min, y_min, x_max, y_max = box
        return cls(float(x_min - margin), float(y_min - margin), float(x_max + margin), float(y_max + margin))

    def joined(self, other: Window | None) -> Window:
        """Return the least window that holds this one and another, if there is one."""
        if other is None:
            return self
        low, high = np.minimum(self[:2], other[:2]), np.maximum(self[2:], other[2:])
        return Window(*low.tolist(), *high.tolist())

    @property
    def width(self) -> float:
        """Extent in x."""
        return self.x_max - self.x_min

    @property
    def height(self) -> float:
        """Extent in y."""
        return self.y_max - self.y_min

    @property
    def area(self) -> float:
        """Width times height."""
        return self.width * self.height

    @property
    def perimeter(self) -> float:
        """Length of the border."""
        return 2.0 * (self.width + self.height)

    @property
    def centre(self) -> tuple[float, float]:
        """The anchor point p0 of every coloring in this window."""
        return 0.5 * (self.x_min + self.x_max), 0.5 * (self.y_min + self.y_max)

    def contains(self, xy: ArrayLike, strictly: bool = False) -> NDArray[np.bool_]:
        """Return which points (n, 2) lie in the rectangle, nan outside; `strictly` leaves the border out."""
        points = np.asarray(xy, dtype=np.float64).reshape(-1, 2)
        lower, upper = np.array(self[:2]), np.array(self[2:])
        above = points > lower if strictly else points >= lower
        below = points < upper if strictly else points <= upper
        inside: NDArray[np.bool_] = np.all(above & below, axis=1)
        return inside

    def to_array(self) -> NDArray[np.float64]:
        """Return ``[x_min, y_min, x_max, y_max]`` as a (4,) float64 array."""
        return np.array(self, dtype=np.float64)

    def side_coordinate(self, side: int) -> float:
        """Return the coordinate that all points of `side` share: y for bottom and top, x for right and left."""
        return (self.y_min, self.x_max, self.y_max, self.x_min)[side]

    def side_length(self, side: int) -> float:
        """Return the length of `side`."""
        return self.width if side in (BOTTOM, TOP) else self.height
