"""Lines of the plan: where a facade stands, and what is left and right of a way."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Line:
    """A facade's place: from `start` to `end`, the building on the side of the unit vector `inward`."""

    start: Floats
    end: Floats
    inward: Floats

    @classmethod
    def facing(cls, start: Floats, end: Floats, inward: Floats) -> Line:
        """Return the line with the unit normal that points to the side of `inward`."""
        along = (end - start) / np.hypot(*(end - start))
        normal = np.array([-along[1], along[0]])
        return cls(start, end, normal if normal @ inward > 0.0 else -normal)

    @property
    def length(self) -> float:
        """Length in metres."""
        return float(np.hypot(*(self.end - self.start)))

    @property
    def along(self) -> Floats:
        """Unit vector from start to end."""
        return np.asarray((self.end - self.start) / self.length)

    def shifted(self, depth: float) -> Line:
        """Return the line moved into the building."""
        return Line(self.start + depth * self.inward, self.end + depth * self.inward, self.inward)

    def piece(self, first: float, last: float) -> Line:
        """Return the part between two distances from the start."""
        return Line(self.start + first * self.along, self.start + last * self.along, self.inward)


def unit(vector: Floats) -> Floats:
    """Return the vector (2,) at length 1."""
    return np.asarray(vector / np.hypot(*vector))


def left_of(vector: Floats) -> Floats:
    """Return the vector (2,) turned to the left by a right angle."""
    return np.array([-vector[1], vector[0]])


def rotated(vector: Floats, angle: float) -> Floats:
    """Return the vector (2,) turned to the left by an angle in radians."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([c * vector[0] - s * vector[1], s * vector[0] + c * vector[1]])


def crossing(a: Floats, da: Floats, b: Floats, db: Floats) -> Floats:
    """Return where the line through `a` along `da` meets the line through `b` along `db`, all (2,)."""
    factor = ((b[0] - a[0]) * db[1] - (b[1] - a[1]) * db[0]) / (da[0] * db[1] - da[1] * db[0])
    return np.asarray(a + factor * da)
