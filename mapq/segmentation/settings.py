"""`SegmentSettings`: parameters of a segmentation; those that are not given are estimated from the cloud."""

from __future__ import annotations

import sys
from dataclasses import dataclass, fields, replace

import numpy as np

from mapq.axes import turn
from prf.shell.errors import UsageError

MOST_NEIGHBOURS = 64
LARGEST = 1e9
"""Of metres, degrees and points."""


@dataclass(frozen=True)
class SegmentSettings:
    """Parameters of :func:`mapq.segmentation.segment`; None is estimated from the cloud.

    Attributes
    ----------
    neighbours : int
        Nearest neighbours that make a point's normal and lead to further points.
    resolution : float or None
        Side in metres of the cells of which one point each is looked at first; the others join afterwards. 0 looks
        at every point. Estimated: as fine as neighbourhoods still show a plane rather than a scan line or noise.
    noise : float or None
        Standard deviation in metres of points about their surface.
    max_angle : float or None
        Degrees between a point's normal and that of the patch it joins.
    max_distance : float or None
        Metres between a point and the plane of the patch it joins.
    max_gap : float or None
        Metres between a point and the point of the patch by which it joins: patches end at wider gaps.
    max_variation : float or None
        Surface variation above which a point's normal counts for nothing (smallest variance of its neighbourhood by
        the sum of all three; 0 is a plane, 1/3 a ball).
    min_points : int
        Smaller patches are dropped.
    min_extent : float or None
        Metres; patches that are narrower (square root of 12 times the smaller in-plane standard deviation) are dropped.
    max_tilt : float
        Degrees; patches whose plane is farther from vertical are dropped. 90 keeps all.
    up : tuple of 3 floats
        The vertical, of any length.
    """

    neighbours: int = 16
    resolution: float | None = None
    noise: float | None = None
    max_angle: float | None = None
    max_distance: float | None = None
    max_gap: float | None = None
    max_variation: float | None = None
    min_points: int = 50
    min_extent: float | None = None
    max_tilt: float = 30.0
    up: tuple[float, float, float] = (0.0, 0.0, 1.0)

    def check(self) -> None:
        """Raise :class:`UsageError` for values outside their domains."""
        for field in fields(self):
            value = getattr(self, field.name)
            numbers = value if isinstance(value, tuple) else () if value is None else (value,)
            largest = sys.float_info.max if field.name == "up" else LARGEST
            if not all(abs(number) <= largest for number in numbers):
                raise UsageError(f"{_flag(field.name)} must be a finite number up to {largest:g}, not {value}.")
            if field.name != "up" and any(number < 0 for number in numbers):
                raise UsageError(f"{_flag(field.name)} must not be negative, not {value}.")
        for name, low, high in (("neighbours", 3, MOST_NEIGHBOURS), ("max_angle", 0, 90), ("max_tilt", 0, 90)):
            value = getattr(self, name)
            if value is not None and not low <= value <= high:
                raise UsageError(f"{_flag(name)} must be from {low} to {high}, not {value}.")
        for name in ("max_gap", "max_distance", "max_variation", "max_angle"):
            if getattr(self, name) == 0:
                raise UsageError(f"{_flag(name)} must be above 0.")
        if not 1e-100 < max(abs(number) for number in self.up) < 1e100:
            raise UsageError("--up must be a direction other than 0 0 0, of a length that can be squared.")

    def turned(self, quarter: int) -> SegmentSettings:
        """Return the settings for axes that were turned by quarters."""
        x, y, z = turn(np.array(self.up, np.float64), quarter).tolist()
        return replace(self, up=(x, y, z))


def _flag(name: str) -> str:
    return "--" + name.replace("_", "-")
