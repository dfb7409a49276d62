"""`PatchShapes`: each patch measured on its own, in metres; and the node features (equations 6 to 8)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapq.configuration import FeatureSettings
from mapq.kernels.box_trees import BoxTrees, make_boxes
from mapq.kernels.occupied_area import occupied_areas, occupied_cells
from mapq.kernels.order_statistics import quantiles
from mapq.kernels.planes import Planes
from mapq.kernels.sheets import Sheets, count_sheet_cells, fill_sheets
from mapq.patches import Patches
from prf.shell.errors import InputError

SMALLEST_CELL = 0.01
"""Metres: finer than any map's points, and above 0 for patches whose points coincide."""
CELL_IN_GAPS = 3.0
"""Median gaps that the side of a cell may have where areas are measured: of evenly strewn points one in fifty is empty.
"""
N_CELL_SIZES = 8
"""Cell sizes that are tried, each the root of two times the last."""
LEVEL = 0.3
"""Sine of the tilt below which a plane has no clear horizontal direction, and its longest one is taken instead."""
CURVE_BITS = 21
"""Bits an axis along the space-filling curve; three times that fits 64 bits."""

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class PatchShapes:
    """Patches measured one by one."""

    # (k, 3) finite points of all patches, patch after patch, in an order that does not depend on that of the file
    points: Floats
    number: NDArray[np.int64]  # (k,) which point of the cloud each is
    start: NDArray[np.int64]  # (m + 1,) points of patch i are ``points[start[i]:start[i + 1]]``
    # (m, 3) unit normal as segmented; of a curved patch that at its centre, away from its axis
    normal: Floats
    centre: Floats  # (m, 3) mean of the points; of a curved patch the place of its surface that was segmented
    # (m,) mean squared distance from the plane of best fit, in m² (smallest eigenvalue of the biased covariance)
    mse: Floats
    thickness: Floats  # (m,) 95 % minus 5 % quantile of the signed distance from the plane, in metres
    # (m, 3) unit vectors in the plane: horizontal and upwards; in level planes the longest direction and its normal; of
    # a curved patch round its axis and along it
    across: Floats
    along: Floats  # (m, 3)
    width: Floats  # (m,) extent across and along, in metres
    height: Floats  # (m,)
    cell: Floats  # (m,) side of the smallest cells that leave no holes between points, in metres
    bend: Floats  # (m,) 1/m, one over the radius of a curved patch, 0 for planes
    up: Floats  # (3,)

    def __len__(self) -> int:
        """Return the number of patches."""
        return len(self.normal)

    @cached_property
    def counts(self) -> NDArray[np.int64]:
        """Number of finite points (m,) of each patch."""
        return np.diff(self.start)

    @cached_property
    def up_cosine(self) -> Floats:
        """Return |up . n| (m,), 0 for upright planes and 1 for level ones."""
        return np.asarray(np.minimum(np.abs(self.normal @ self.up), 1.0))

    @cached_property
    def area(self) -> Floats:
        """Area (m,) in m² that the points support: of cells that are no larger than the gaps between them explain.

        Of a patch whose points are dense in one part and few in another, `cell` fills what lies between the few.
        """
        side = np.minimum(
            self.cell, CELL_IN_GAPS * np.maximum(quantiles(self.sheets.gap, self.start, 0.5), SMALLEST_CELL)
        )
        found = occupied_areas(self.sheets.u, self.sheets.v, self.start, side)
        return np.asarray(np.minimum(found, np.maximum(self.width, side) * np.maximum(self.height, side)))

    @cached_property
    def spacing(self) -> Floats:
        """Mean distance (m,) of points in each patch, in metres: root of the area a point has."""
        return np.asarray(np.sqrt(self.area / np.maximum(self.counts, 1)))

    @cached_property
    def size_rank(self) -> NDArray[np.int64]:
        """Return the rank (m,) of each patch, largest first, of equals by place: so nothing depends on numbering."""
        x, y, z = self.centre.T
        rank = np.empty(len(self), np.int64)
        rank[np.lexsort((z, y, x, -self.counts))] = np.arange(len(self))
        return rank

    @cached_property
    def trees(self) -> BoxTrees:
        """Boxes over the points."""
        return BoxTrees(self.points, self.start, *make_boxes(self.points, self.start))

    @cached_property
    def planes(self) -> Planes:
        """What kernels need of the planes."""
        return Planes(self.normal, self.centre, self.across, self.along, self.area, self.bend)

    def chart(self, patch: NDArray[np.int64], places: Floats) -> tuple[Floats, Floats, Floats]:
        """Return where places (k, 3) are in patches (k,), u, v and the height over these (k, each)."""
        axes = self.across, self.along, self.normal
        return charted(places - self.centre[patch], patch, axes, self.bend)

    def normals_at(self, patch: NDArray[np.int64], places: Floats) -> Floats:
        """Return the unit normals (k, 3) of patches (k,) below places (k, 3): of planes the same everywhere."""
        normal = self.normal[patch]
        curved = np.flatnonzero(self.bend[patch] > 0.0)
        if len(curved):
            of = patch[curved]
            away = places[curved] - self.centre[of] + normal[curved] / self.bend[of, None]
            away -= np.einsum("ij,ij->i", away, self.along[of])[:, None] * self.along[of]
            normal[curved] = away / np.maximum(np.linalg.norm(away, axis=1), 1e-12)[:, None]
        return normal

    @cached_property
    def sheets(self) -> Sheets:
        """The points of each patch sorted in its plane."""
        return lay_out(self)

    def tolerance(self, settings: FeatureSettings) -> float:
        """Return the distance in metres from which surfaces count as doubled: the setting's, more where noise is."""
        return settings.tolerance_at(self.noise(settings))

    def noise(self, settings: FeatureSettings) -> float:
        """Return the standard deviation of points from their surface, in metres, given or estimated."""
        found = np.median(np.sqrt(self.mse)) if settings.noise is None and len(self) else settings.noise or 0.0
        return max(float(found), settings.eps)


def measure_shapes(patches: Patches, settings: FeatureSettings | None = None) -> PatchShapes:
    """Measure each patch on its own.

    `settings`: only the up direction is read.
    """
    up = up_direction(patches, settings or FeatureSettings())
    number, patch, start = ordered_points(patches)
    points = np.ascontiguousarray(patches.cloud.xyz[number])
    normal = np.ascontiguousarray(patches.normal, dtype=np.float64).reshape(-1, 3)
    axis = np.zeros_like(normal) if patches.bend is None else patches.bend
    bend = np.linalg.norm(axis, axis=1)
    curved = bend > 0.0
    centre = group_means(points, patch, len(normal))
    centre[curved] = patches.centroid[curved]
    relative = points - centre[patch]
    values, vectors = np.linalg.eigh(covariances(relative, patch, len(normal)))
    across = horizontal_directions(normal, vectors[:, :, 2], up)
    across[curved] = np.cross(axis[curved] / bend[curved, None], normal[curved])
    along = np.cross(normal, across)
    u, v, off = charted(relative, patch, (across, along, normal), bend)
    thickness = quantiles(off, start, 0.95) - quantiles(off, start, 0.05)
    cell, extent = occupied_cells(u, v, start, SMALLEST_CELL, N_CELL_SIZES)
    squares = np.bincount(patch, off * off, len(normal)) / np.maximum(np.diff(start), 1)
    mse = np.where(curved, squares, np.maximum(values[:, 0], 0.0))
    width, height = np.ascontiguousarray(extent.T)
    return PatchShapes(
        points, number, start, normal, centre, mse, thickness, across, along, width, height, cell, bend, up
    )


def charted(
    relative: Floats, patch: NDArray[np.int64], axes: tuple[Floats, Floats, Floats], bend: Floats
) -> tuple[Floats, Floats, Floats]:
    """Return places u, v of points in their patches and heights over these (k, each), as the kernels' `chart` does.

    `relative` (k, 3): to the centres of the patches. `axes`: across, along, and normal (m, 3 each). `bend` (m,).
    """
    u, v, height = (np.einsum("ij,ij->i", relative, axis[patch]) for axis in axes)
    curved = np.flatnonzero(bend[patch] > 0.0)
    radius = 1.0 / bend[patch[curved]]
    above = height[curved] + radius
    height[curved] = np.hypot(u[curved], above) - radius
    u[curved] = radius * np.arctan2(u[curved], above)
    return u, v, height


def lay_out(shapes: PatchShapes) -> Sheets:
    """Return the points of each patch in its plane, sorted into cells, with the gaps between them."""
    n_points, n_patches = len(shapes.points), len(shapes)
    patch = np.repeat(np.arange(n_patches), shapes.counts)
    u, v, _ = shapes.chart(patch, shapes.points)
    low, size = np.zeros((n_patches, 2)), np.zeros((n_patches, 2), np.int64)
    base = np.zeros(n_patches + 1, np.int64)
    count_sheet_cells(u, v, shapes.start, shapes.cell, low, size, base)
    first = np.zeros(int(base[-1]) + 1, np.int64)
    sorted_u, sorted_v, gap = np.zeros(n_points), np.zeros(n_points), np.zeros(n_points)
    number = np.zeros(n_points, np.int64)
    sheets = Sheets(sorted_u, sorted_v, gap, shapes.cell, low, size, base, first, number)
    fill_sheets(sheets, u, v, shapes.start)
    return sheets


def up_direction(patches: Patches, settings: FeatureSettings) -> Floats:
    """Return the unit vector (3,) that points up: of the settings, else of the segmentation, else z.

    Raises InputError if the segmentation's is not a direction.
    """
    given: Any = settings.up if settings.up is not None else patches.parameters.get("up")
    try:
        up = np.array([0.0, 0.0, 1.0] if given is None else given, dtype=np.float64).reshape(3)
    except (TypeError, ValueError):
        up = np.zeros(3)
    length = float(np.linalg.norm(up))
    if not 0.0 < length < np.inf:
        raise InputError(f"patches: parameter up, {given}: must be three numbers, not all 0.")
    return np.asarray(up / length)


def ordered_points(patches: Patches) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Return the finite points (k,) of all patches, the patch (k,) of each, and where (m + 1,) each patch begins.

    Points are given by their number in the cloud. Patch after patch, along a space-filling curve, ties by coordinates:
    the order follows from the points alone.
    """
    kept = np.flatnonzero((patches.patch >= 0) & patches.cloud.finite())
    points, patch = patches.cloud.xyz[kept], patches.patch[kept].astype(np.int64)
    place = curve_places(points)
    order = np.lexsort((place, patch))
    tied = np.zeros(len(order), np.bool_)
    same = (place[order[1:]] == place[order[:-1]]) & (patch[order[1:]] == patch[order[:-1]])
    tied[1:] |= same
    tied[:-1] |= same
    some = order[tied]
    x, y, z = points[some].T
    order[tied] = some[np.lexsort((z, y, x, place[some], patch[some]))]
    start = np.zeros(len(patches) + 1, np.int64)
    np.cumsum(np.bincount(patch, minlength=len(patches)), out=start[1:])
    return kept[order], patch[order], start


def curve_places(points: Floats) -> NDArray[np.uint64]:
    """Return the place (k,) of each point along the Z-order curve (Morton 1966) through their box."""
    if len(points) == 0:
        return np.zeros(0, np.uint64)
    low, high = points.min(axis=0), points.max(axis=0)
    side = max(float((high - low).max()), SMALLEST_CELL)
    steps = ((points - low) * ((2**CURVE_BITS - 1) / side)).astype(np.uint64)
    place = np.zeros(len(points), np.uint64)
    for axis in range(3):
        place |= _spread(steps[:, axis]) << np.uint64(axis)
    return place


def _spread(bits: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """Put two zero bits before each of the 21 lowest bits."""
    for shift, mask in (
        (32, 0x1F00000000FFFF),
        (16, 0x1F0000FF0000FF),
        (8, 0x100F00F00F00F00F),
        (4, 0x10C30C30C30C30C3),
        (2, 0x1249249249249249),
    ):
        bits = (bits | bits << np.uint64(shift)) & np.uint64(mask)
    return bits


def group_means(values: Floats, group: NDArray[np.int64], n_groups: int) -> Floats:
    """Return the mean (n_groups, 3) of the rows of each group, 0 for an empty one, summed in the order of the rows."""
    sums = np.stack([np.bincount(group, values[:, axis], n_groups) for axis in range(3)], axis=1)
    return np.asarray(sums / np.maximum(np.bincount(group, minlength=n_groups), 1)[:, None])


def covariances(relative: Floats, group: NDArray[np.int64], n_groups: int) -> Floats:
    """Return the biased covariance (n_groups, 3, 3) of each group, of coordinates relative to its mean."""
    out = np.zeros((n_groups, 3, 3))
    count = np.maximum(np.bincount(group, minlength=n_groups), 1)
    for a in range(3):
        for b in range(a, 3):
            out[:, a, b] = np.bincount(group, relative[:, a] * relative[:, b], n_groups) / count
            out[:, b, a] = out[:, a, b]
    return out


def horizontal_directions(normal: Floats, longest: Floats, up: Floats) -> Floats:
    """Return a unit vector (m, 3) in each plane: horizontal, or in level planes along the longest direction (m, 3)."""
    wanted = np.cross(up, normal)
    level = np.linalg.norm(wanted, axis=1) < LEVEL
    wanted[level] = longest[level]
    flat = wanted - np.einsum("ij,ij->i", wanted, normal)[:, None] * normal
    length = np.linalg.norm(flat, axis=1)
    lost = length < LEVEL
    flat[lost] = np.cross(normal[lost], np.eye(3)[np.argmin(np.abs(normal[lost]), axis=1)])
    length[lost] = np.linalg.norm(flat[lost], axis=1)
    return np.asarray(flat / length[:, None])


NODE_NAMES = ("fit", "tilt", "thickness")
SHAPE_NAMES = ("n_points", "rms_m", "thickness_m", "area_m2", "width_m", "height_m", "tilt_deg")
"""Measures of a patch for people: a count, metres, m², and degrees."""


def node_features(shapes: PatchShapes, settings: FeatureSettings) -> NDArray[np.float64]:
    """Return the features (m, 3) named by `NODE_NAMES`.

    fit (equation 6): -log((MSE + eps²) / (sigma² + eps²)), sigma the noise of the map; high is flat.
    tilt (equation 7): 1 - |up . n|; 1 is upright.
    thickness (equation 8): -log((eps + P95 - P5 of the signed distance from the plane) / (eps + sigma)); high is thin.

    In times the noise, as in metres a model would learn the sensors of its training maps.
    """
    noise = shapes.noise(settings)
    fit = -np.log((shapes.mse + settings.eps**2) / (noise**2 + settings.eps**2))
    tilt = 1.0 - shapes.up_cosine
    thickness = -np.log((settings.eps + shapes.thickness) / (settings.eps + noise))
    return np.column_stack([fit, tilt, thickness])


def shape_table(shapes: PatchShapes) -> NDArray[np.float64]:
    """Return the measures (m, 7) named by `SHAPE_NAMES`; tilt in degrees from the vertical, 0 for upright planes."""
    tilt = np.degrees(np.arcsin(shapes.up_cosine))
    rms = np.sqrt(shapes.mse)
    columns = [shapes.counts, rms, shapes.thickness, shapes.area, shapes.width, shapes.height, tilt]
    return np.column_stack([np.asarray(column, np.float64) for column in columns])
