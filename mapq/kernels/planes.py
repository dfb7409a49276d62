"""Planes of sets of points by their moments, and planes of patches with the vectors that kernels need."""

from typing import Any, NamedTuple

import numpy as np

from mapq.kernels._jit import Floats, Floats32, Ints32, core

MOMENTS = 10
"""Moments that give the plane of a set: how many, sums of x y z, sums of xx xy xz yy yz zz."""

NO_WIDTH = 1e-28
"""Squared cross product, by the fourth power of the entries, that rounding alone makes of parallel rows."""


class Surface(NamedTuple):
    """Points with what tells which plane they may lie on."""

    xyz: Floats  # (n, 3)
    neighbours: Ints32  # (n, k) nearest first; -1 fills up
    normal: Floats32  # (n, 3) nan where there is none


class Fit(NamedTuple):
    """A plane in work: moments of the set about its own origin, the plane (nx, ny, nz, d), variances ascending."""

    sums: Floats  # (MOMENTS,)
    plane: Floats  # (4,)
    spread: Floats  # (3,)


class Tolerance(NamedTuple):
    """How far points of a plane may turn and lie away from it."""

    cos_angle: float
    max_distance: float  # metres


@core
def add_moments(sums: Floats, x: float, y: float, z: float) -> None:
    """Add one point, given relative to the set's own origin so that the squares stay small."""
    sums[0] += 1.0
    sums[1] += x
    sums[2] += y
    sums[3] += z
    sums[4] += x * x
    sums[5] += x * y
    sums[6] += x * z
    sums[7] += y * y
    sums[8] += y * z
    sums[9] += z * z


@core
def write_moments(
    sums: Floats,
    n: float,
    x: float,
    y: float,
    z: float,
    xx: float,
    xy: float,
    xz: float,
    yy: float,
    yz: float,
    zz: float,
) -> None:
    """Write moments that were added up in registers."""
    sums[0], sums[1], sums[2], sums[3] = n, x, y, z
    sums[4], sums[5], sums[6], sums[7], sums[8], sums[9] = xx, xy, xz, yy, yz, zz


@core
def fit_plane(sums: Floats, plane: Floats, spread: Floats) -> None:
    """Write the plane (nx, ny, nz, d with n . p = d) of a set, and its variances in ascending order (biased).

    Eigenvalues by the trigonometric formula (Smith 1961), the eigenvector as the longest cross product of two rows of
    A - lambda 1. A set without a plane (all on a line, or in a point) gets some plane that holds it.
    """
    n = sums[0]
    cx, cy, cz = sums[1] / n, sums[2] / n, sums[3] / n
    xx, xy, xz = sums[4] / n - cx * cx, sums[5] / n - cx * cy, sums[6] / n - cx * cz
    yy, yz, zz = sums[7] / n - cy * cy, sums[8] / n - cy * cz, sums[9] / n - cz * cz
    mean = (xx + yy + zz) / 3.0
    a, b, c = xx - mean, yy - mean, zz - mean
    off = xy * xy + xz * xz + yz * yz
    p = np.sqrt((a * a + b * b + c * c + 2.0 * off) / 6.0)
    if p > 0.0:
        determinant = a * (b * c - yz * yz) - xy * (xy * c - yz * xz) + xz * (xy * yz - b * xz)
        cosine = np.cos(np.arccos(min(max(0.5 * determinant / (p * p * p), -1.0), 1.0)) / 3.0)
        spread[2] = mean + 2.0 * p * cosine
        # The cosine of a third of a turn more; the sine of an angle up to a sixth of a turn is not negative.
        smallest = mean - p * (cosine + np.sqrt(3.0 * max(1.0 - cosine * cosine, 0.0)))
    else:
        spread[2] = smallest = mean
    spread[1] = max(3.0 * mean - spread[2] - smallest, 0.0)
    normal_of(xx - smallest, xy, xz, yy - smallest, yz, zz - smallest, plane)
    nx, ny, nz = plane[0], plane[1], plane[2]
    quadratic = nx * (xx * nx + 2.0 * (xy * ny + xz * nz)) + ny * (yy * ny + 2.0 * yz * nz) + nz * zz * nz
    spread[0] = max(quadratic, 0.0)
    plane[3] = nx * cx + ny * cy + nz * cz


@core
def normal_of(xx: float, xy: float, xz: float, yy: float, yz: float, zz: float, plane: Floats) -> None:
    """Write the unit vector that a symmetric matrix of rank two (or less) takes to zero; its largest entry positive."""
    best = 0.0
    scale = max(max(abs(xx), abs(yy)), abs(zz))
    plane[0], plane[1], plane[2] = 0.0, 0.0, 1.0
    for pair in range(3):
        if pair == 0:
            nx, ny, nz = xy * yz - xz * yy, xz * xy - xx * yz, xx * yy - xy * xy
        elif pair == 1:
            nx, ny, nz = xy * zz - xz * yz, xz * xz - xx * zz, xx * yz - xy * xz
        else:
            nx, ny, nz = yy * zz - yz * yz, yz * xz - xy * zz, xy * yz - yy * xz
        squared = nx * nx + ny * ny + nz * nz
        if squared > best:
            best = squared
            plane[0], plane[1], plane[2] = nx, ny, nz
    if best > 0.0:
        length = np.sqrt(best)
        plane[0], plane[1], plane[2] = plane[0] / length, plane[1] / length, plane[2] / length
    if best <= NO_WIDTH * scale**4 and scale > 0.0:
        across_line(xx, xy, xz, yy, yz, zz, plane)
    largest = plane[0]
    for axis in range(1, 3):
        if abs(plane[axis]) > abs(largest):
            largest = plane[axis]
    if largest < 0.0:
        plane[0], plane[1], plane[2] = -plane[0], -plane[1], -plane[2]


@core
def across_line(xx: float, xy: float, xz: float, yy: float, yz: float, zz: float, plane: Floats) -> None:
    """Write a unit vector across the line whose points have these second moments."""
    ux, uy, uz = xx, xy, xz
    if yy > xx and yy >= zz:
        ux, uy, uz = xy, yy, yz
    elif zz > xx:
        ux, uy, uz = xz, yz, zz
    # Across the line and, where that leaves a choice, across the axis that the line is farthest from.
    if abs(ux) <= abs(uy) and abs(ux) <= abs(uz):
        plane[0], plane[1], plane[2] = 0.0, uz, -uy
    elif abs(uy) <= abs(uz):
        plane[0], plane[1], plane[2] = -uz, 0.0, ux
    else:
        plane[0], plane[1], plane[2] = uy, -ux, 0.0
    length = np.sqrt(plane[0] ** 2 + plane[1] ** 2 + plane[2] ** 2)
    if length > 0.0:
        plane[0], plane[1], plane[2] = plane[0] / length, plane[1] / length, plane[2] / length


class Planes(NamedTuple):
    """The plane of each patch: unit normal, a point of it, two unit vectors in it (m, 3 each); its area (m,).

    A curved patch is a cylinder about an axis along `along`, that lies one over `bend` (m,) metres below the plane.
    """

    normal: Floats
    centre: Floats
    across: Floats
    along: Floats
    area: Floats
    bend: Floats  # 1/m, 0 for planes


@core
def dot(a: Any, b: Any) -> float:
    """Scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@core
def dot_from(a: Floats, point: Floats, origin: Floats) -> float:
    """Scalar product of a and the ray from `origin` to `point`."""
    return a[0] * (point[0] - origin[0]) + a[1] * (point[1] - origin[1]) + a[2] * (point[2] - origin[2])


@core
def chart(planes: Planes, i: int, point: Floats) -> tuple[float, float, float]:
    """Place of a point in patch i, across and along it, and its height over it; of a curved one across is round it."""
    u, v = dot_from(planes.across[i], point, planes.centre[i]), dot_from(planes.along[i], point, planes.centre[i])
    height = dot_from(planes.normal[i], point, planes.centre[i])
    if planes.bend[i] > 0.0:
        radius = 1.0 / planes.bend[i]
        above = height + radius
        return radius * np.arctan2(u, above), v, np.sqrt(u * u + above * above) - radius
    return u, v, height


@core
def facing(planes: Planes, i: int, point: Floats) -> tuple[float, float, float]:
    """Unit normal of patch i below a point: that of its plane, or what leads away from its axis."""
    normal = planes.normal[i]
    if planes.bend[i] > 0.0:
        across = planes.across[i]
        u = dot_from(across, point, planes.centre[i])
        above = dot_from(normal, point, planes.centre[i]) + 1.0 / planes.bend[i]
        length = np.sqrt(u * u + above * above)
        if length > 0.0:
            u, above = u / length, above / length
            return (
                u * across[0] + above * normal[0],
                u * across[1] + above * normal[1],
                u * across[2] + above * normal[2],
            )
    return normal[0], normal[1], normal[2]


@core
def cross(a: Floats, b: Floats, out: Floats) -> None:
    """Vector product."""
    for axis in range(3):
        one, two = (axis + 1) % 3, (axis + 2) % 3
        out[axis] = a[one] * b[two] - a[two] * b[one]


@core
def normalise(a: Floats) -> None:
    """Make a unit vector of a."""
    length = np.sqrt(dot(a, a))
    for axis in range(3):
        a[axis] /= length
