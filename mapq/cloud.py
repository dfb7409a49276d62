"""`PointCloud`: the points of a map, with every field that came with them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapq.picture import picture_of_cloud
from prf.shell.cli.pictures import card

SHIFT_ABOVE = 1e4
"""Metres: farther from the origin than this, covariances of float64 squares begin to lose what sensors resolve."""


@dataclass(frozen=True, repr=False)
class PointCloud:
    """The points of a map.

    Attributes
    ----------
    xyz : (n, 3) float64
        Metres, relative to `shift`; a point that has no return may be nan.
    shift : (3,) float64
        World coordinates, those of the file, are ``xyz / unit + shift``. Subtracted in float64 before anything else, so
        that coordinates of a survey grid lose nothing.
    fields : mapping of str to (n, ...) array
        Every other field, in the order and the type of the file.
    coordinate_type : type
        ``numpy.float32`` or ``numpy.float64``, the type of the coordinates in the file; results are written in
        the same one where it holds them.
    source : str
        Source of the points, for messages.
    unit : (3,) float64
        Metres in a unit of the file, axis by axis: feet, or heights in feet over a grid in metres.
    las_header : bytes
        Header and records of the LAS file of the points, under which a result in LAS is written: scale,
        offset, reference system. Empty for points of other formats.
    """

    xyz: NDArray[np.float64]
    shift: NDArray[np.float64]
    fields: Mapping[str, NDArray[Any]] = field(default_factory=dict)
    coordinate_type: type[np.float32 | np.float64] = np.float64
    source: str = ""
    unit: NDArray[np.float64] = field(default_factory=lambda: np.ones(3))
    las_header: bytes = b""

    @classmethod
    @np.errstate(over="ignore", invalid="ignore")  # of infinite coordinates, which are not points
    def from_world(
        cls,
        world: NDArray[Any],
        fields: Mapping[str, NDArray[Any]] | None = None,
        source: str = "",
        unit: NDArray[np.float64] | float = 1.0,
    ) -> PointCloud:
        """Return the cloud of world coordinates (n, 3) of any number type, choosing the shift.

        `unit` is how many metres one of them is, for all axes or (3,) for each.
        """
        wide = np.asarray(world, dtype=np.float64).reshape(-1, 3)
        shift = choose_shift(wide)
        kind = np.float32 if np.asarray(world).dtype == np.float32 else np.float64
        factor = np.array(np.broadcast_to(unit, 3), np.float64)
        xyz = np.ascontiguousarray(wide - shift)
        xyz *= factor
        return cls(xyz, shift, dict(fields or {}), kind, source, factor)

    def __len__(self) -> int:
        """Return the number of points."""
        return len(self.xyz)

    def __repr__(self) -> str:
        """Return the cloud in a line."""
        fields = f" with {', '.join(self.fields)}" if self.fields else ""
        return f"<mapq.PointCloud: {len(self):,} points{fields}>"

    def _repr_html_(self) -> str:
        """Return the card that a notebook shows."""
        facts = {"points": f"{len(self):,}", "fields": ", ".join(self.fields) or "none", "source": self.source}
        picture = picture_of_cloud(self.source or "arrays", self.metric_of(self.xyz))
        return card(picture.title, facts, picture.png())

    def world(self) -> NDArray[np.float64]:
        """Return the coordinates (n, 3) as the file has them, in float64, to the last bit.

        Of files in another unit than metres to that of float32, or of the integers of LAS.
        """
        return self.world_of(self.xyz)

    def world_of(self, xyz: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return places (..., 3) in the frame of `xyz` as world coordinates, in the unit of the file."""
        return _moved(xyz / self.unit, self.shift)

    def metric_of(self, xyz: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return places (..., 3) in the frame of `xyz` as world coordinates in metres, whatever unit the file has."""
        return _moved(xyz.copy(), self.shift * self.unit)

    @property
    def unit_words(self) -> str:
        """In what unit the coordinates of the file were taken, in words."""
        x, y, z = self.unit.tolist()
        if x == y == z:
            return "coordinates taken as metres" if x == 1.0 else f"coordinates in units of {x:g} m"
        return f"coordinates in units of {x:g}, {y:g} and {z:g} m"

    def place_words(self, place: NDArray[np.float64], digits: int = 1) -> str:
        """Return a place (3) in world coordinates as text that says so where these are no metres."""
        words = " ".join(f"{value:.{digits}f}" for value in place.tolist())
        return words if (self.unit == 1.0).all() else f"{words} (file units)"

    def in_unit(self, unit: NDArray[np.float64]) -> PointCloud:
        """Return the same world coordinates, with another unit: its metres along each axis (3,)."""
        if np.array_equal(unit, self.unit):
            return self
        return replace(self, xyz=self.xyz * (unit / self.unit), unit=np.array(unit, np.float64))

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


def _moved(xyz: NDArray[np.float64], shift: NDArray[np.float64]) -> NDArray[np.float64]:
    """Add a shift (3,) to places (..., 3) in their place; adding 0 would turn -0 into 0."""
    moved = shift != 0.0
    xyz[..., moved] += shift[moved]
    return xyz


def choose_shift(world: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the shift (3,) for world coordinates (n, 3): whole kilometres on each axis far from the origin, else 0.

    Subtracting it and adding it again gives every finite coordinate back to the last bit. Where all points of an axis
    lie on one side of the origin, that holds by itself (below 2^56 m): shift and coordinate are multiples of the
    coordinate's last bit, and their difference is smaller than the coordinate. Where some do not, such as the points
    (0, 0, 0) that many sensors write for "no return" into a survey grid, the median's kilometre is tried, and kept if
    it is exact for the points at hand.
    """
    return np.array([_axis_shift(column[np.isfinite(column)]) for column in world.T])


def _axis_shift(values: NDArray[np.float64]) -> float:
    """Return the shift of one axis, from its finite coordinates (n,)."""
    if len(values) == 0:
        return 0.0
    low, high = float(values.min()), float(values.max())
    if max(abs(low), abs(high)) <= SHIFT_ABOVE:
        return 0.0
    nearest = low if low > 0.0 else min(high, 0.0)
    for candidate in (nearest, float(np.median(values))):
        if abs(candidate) > SHIFT_ABOVE:
            shift = math.copysign(1000.0 * math.floor(abs(candidate) / 1000.0), candidate)
            back = (values - shift) + shift
            if np.array_equal(back.view(np.int64), np.ascontiguousarray(values).view(np.int64)):
                return shift
    return 0.0
