"""`PointCloud`: the points of a map, with every field that came with them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

SHIFT_ABOVE = 1e4
"""Metres: farther from the origin than this, covariances of float64 squares begin to lose what sensors resolve."""


@dataclass(frozen=True)
class PointCloud:
    """The points of a map.

    Attributes
    ----------
    xyz : (n, 3) float64
        Metres, relative to `shift`; a point that has no return may be nan.
    shift : (3,) float64
        World coordinates are ``xyz + shift``. Subtracted in float64 before anything else, so that coordinates of a
        survey grid lose nothing.
    fields : mapping of str to (n, ...) array
        Every other field, in the order and the type of the file.
    coordinate_type : type
        ``numpy.float32`` or ``numpy.float64``, the type of the coordinates in the file; results are written in
        the same one where it holds them.
    source : str
        Where the points come from, for messages.
    """

    xyz: NDArray[np.float64]
    shift: NDArray[np.float64]
    fields: Mapping[str, NDArray[Any]] = field(default_factory=dict)
    coordinate_type: type[np.float32 | np.float64] = np.float64
    source: str = ""

    @classmethod
    def from_world(
        cls,
        world: NDArray[Any],
        fields: Mapping[str, NDArray[Any]] | None = None,
        source: str = "",
    ) -> PointCloud:
        """Return the cloud of world coordinates (n, 3) of any number type, choosing the shift."""
        wide = np.asarray(world, dtype=np.float64).reshape(-1, 3)
        shift = choose_shift(wide)
        kind = np.float32 if np.asarray(world).dtype == np.float32 else np.float64
        return cls(np.ascontiguousarray(wide - shift), shift, dict(fields or {}), kind, source)

    def __len__(self) -> int:
        """Return the number of points."""
        return len(self.xyz)

    def world(self) -> NDArray[np.float64]:
        """Return the coordinates (n, 3) as the file has them, in float64."""
        return self.xyz + self.shift

    def finite(self) -> NDArray[np.bool_]:
        """Return which points (n,) have three finite coordinates."""
        return np.asarray(np.isfinite(self.xyz).all(axis=1))

    def take(self, index: NDArray[Any]) -> PointCloud:
        """Return the points of an index or mask, in its order, with their fields."""
        fields = {name: values[index] for name, values in self.fields.items()}
        return replace(self, xyz=np.ascontiguousarray(self.xyz[index]), fields=fields)

    def with_fields(self, **values: NDArray[Any]) -> PointCloud:
        """Return the cloud with fields added, or replaced where the name is taken."""
        return replace(self, fields={**self.fields, **values})


def choose_shift(world: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the shift (3,) for world coordinates (n, 3): whole kilometres where all lie far from the origin, else 0.

    Subtracting it is exact, and so is adding it back: a coordinate and the shift are multiples of the coordinate's
    last bit, and their difference is smaller than the coordinate.
    """
    shift = np.zeros(3)
    kept = world[np.isfinite(world).all(axis=1)]
    if len(kept) == 0:
        return shift
    low, high = kept.min(axis=0), kept.max(axis=0)
    for axis in range(3):
        nearest = 0.0 if low[axis] <= 0.0 <= high[axis] else min(abs(low[axis]), abs(high[axis]))
        if nearest > SHIFT_ABOVE:
            shift[axis] = np.copysign(1000.0 * np.floor(nearest / 1000.0), low[axis])
    return shift
