"""Axes of a map's own: those of its file, turned by quarters about z until its ground plan lies as all plans do.

Which points make a sample, which of them leads a walk, and where cells begin depend on the axes. So a map is cut and
measured in axes that turn with it; results are in those of the file again. A turn by a quarter swaps and negates
coordinates, which is exact: maps that differ by one are the same in their own axes to the last bit.

Features are measured in places counted from the corner of the box round all patches: cells of space that begin at the
origin lie otherwise in a map once it is shifted.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from mapq.cloud import PointCloud
from mapq.kernels.cells import find_bounds
from mapq.labels import NO_PATCH
from mapq.patches import Patches

TO_SENSOR = ("to_sensor_x", "to_sensor_y", "to_sensor_z")
"""Point fields of the way to the sensor in metres, which turns with the map."""
QUANTUM = 2.0**-20
"""Metres: places are summed in whole numbers of it, as sums of these depend neither on the order nor on parts."""
FARTHEST = 2.0**23
"""Metres up to which they are; what lies farther off counts as if it lay there."""
CHUNK = 1 << 18
"""Points that are summed at once: their sums fit into 63 bits."""
IN_THE_MIDDLE = 4.0 * QUANTUM
"""Metres from the middle of the box within which rounding alone may have put a mean."""

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Number = TypeVar("Number", bound=np.number[Any])


class GroundPlan(NamedTuple):
    """What the axes are chosen by; that of a map is joined from those of its parts."""

    n_points: int = 0  # finite ones
    sums: tuple[int, int] = (0, 0)  # of their x and y, in `QUANTUM`
    low: Floats = np.full(3, np.inf)  # (3,) box of the points in metres; inf and -inf where there are none
    high: Floats = np.full(3, -np.inf)  # (3,)

    @classmethod
    def of(cls, xyz: Floats) -> GroundPlan:
        """Return the plan of those of some points (n, 3) that are finite."""
        plan = cls()
        for begin in range(0, len(xyz), CHUNK):
            some = np.ascontiguousarray(xyz[begin : begin + CHUNK])
            finite = np.isfinite(some)
            some = some if finite.all() else some[finite.all(axis=1)]
            low, high = find_bounds(some)
            sums = _whole_sum(some[:, 0]), _whole_sum(some[:, 1])
            plan = plan.joined(cls(len(some), sums, low, high))
        return plan

    def joined(self, other: GroundPlan) -> GroundPlan:
        """Return the plan of both parts."""
        return GroundPlan(
            self.n_points + other.n_points,
            (self.sums[0] + other.sums[0], self.sums[1] + other.sums[1]),
            np.minimum(self.low, other.low),
            np.maximum(self.high, other.high),
        )

    def quarter(self) -> int:
        """Return how many quarters, counter-clockwise from above, lead from the axes of the file to the map's own.

        There the mean of the points lies from the middle of their box towards (2, 1), by 45 degrees at most: borders
        of the choice are not axes of symmetry that things are built with. A mean in the middle shows nothing; then the
        longer side is along x, and a half turn, which few such maps would show, is left as it is.
        """
        if self.n_points == 0:
            return 0
        middle = 0.5 * self.low[:2] + 0.5 * self.high[:2]
        x, y = np.array([total / self.n_points * QUANTUM for total in self.sums]) - middle
        if max(abs(x), abs(y)) < IN_THE_MIDDLE:
            extent = self.high - self.low
            return int(extent[1] > extent[0])
        along, across = 0.5 * x + 0.25 * y, 0.25 * x - 0.5 * y
        return int(np.argmax([along, across, -along, -across]))

    def box(self, quarter: int) -> Floats:
        """Return the corners (2, 3) of the box in axes that were turned."""
        corners = turn(np.array([self.low, self.high]), quarter)
        return np.sort(corners, axis=0)


def _whole_sum(column: Floats) -> int:
    """Return the sum of coordinates (n,), in `QUANTUM`."""
    places = np.clip(column, -FARTHEST, FARTHEST)
    places *= 1.0 / QUANTUM
    return int(np.rint(places, out=places).astype(np.int64).sum())


def turn(vectors: NDArray[Number], quarter: int) -> NDArray[Number]:
    """Return places or directions (..., 2 or 3) turned about z by quarters, counter-clockwise from above; exact."""
    quarter %= 4
    if quarter == 0:
        return vectors
    out = vectors.copy()
    x, y = vectors[..., 0], vectors[..., 1]
    # From 0, as the negative of 0.0 would be -0.0.
    if quarter == 1:
        np.subtract(0, y, out=out[..., 0])
        out[..., 1] = x
    elif quarter == 2:
        np.subtract(0, vectors[..., :2], out=out[..., :2])
    else:
        out[..., 0] = y
        np.subtract(0, x, out=out[..., 1])
    return out


def turn_cloud(cloud: PointCloud, quarter: int) -> PointCloud:
    """Return a cloud, its frame and the ways to its sensors turned by quarters; other fields stay as they are."""
    if quarter % 4 == 0:
        return cloud
    fields: dict[str, NDArray[Any]] = dict(cloud.fields)
    columns = [fields.get(name, np.empty(0, "U1")) for name in TO_SENSOR]
    if all(column.ndim == 1 and column.dtype.kind in "fiub" for column in columns):
        ways = turn(np.column_stack(columns).astype(np.float64), quarter)
        fields.update(zip(TO_SENSOR, ways.T, strict=True))
    shift, unit = turn(cloud.shift, quarter), np.abs(turn(cloud.unit, quarter))
    return replace(cloud, xyz=turn(cloud.xyz, quarter), shift=shift, fields=fields, unit=unit)


def turn_patches(patches: Patches, quarter: int) -> Patches:
    """Return patches turned by quarters: their points, normals, centroids and axes; parameters stay as they are."""
    if quarter % 4 == 0:
        return patches
    normal, centroid = turn(patches.normal, quarter), turn(patches.centroid, quarter)
    bend = None if patches.bend is None else turn(patches.bend, quarter)
    return replace(patches, cloud=turn_cloud(patches.cloud, quarter), normal=normal, centroid=centroid, bend=bend)


def corner_of(patches: Patches) -> Floats:
    """Return the lowest corner (3,) of the box round the finite points of all patches; 0 without any."""
    in_patches = patches.cloud.xyz[(patches.patch != NO_PATCH) & patches.cloud.finite()]
    return find_bounds(in_patches)[0] if len(in_patches) else np.zeros(3)


def from_corner(patches: Patches, corner: Floats) -> Patches:
    """Return patches with their places counted from a corner (3,)."""
    cloud = patches.cloud
    cloud = replace(cloud, xyz=cloud.xyz - corner, shift=cloud.shift + corner / cloud.unit)
    return replace(patches, cloud=cloud, centroid=patches.centroid - corner)


def keys_of(cells: Ints) -> Ints:
    """Return one number (n,) for each cell (n, 2)."""
    return np.asarray((cells[:, 0] << 32) + cells[:, 1])
