"""Regions of points that grow over neighbours in one plane, and the union of regions that are pieces of one plane."""

import numpy as np

from mapq.kernels._jit import Floats, Ints, Ints32, core, jit
from mapq.kernels.planes import MOMENTS, Fit, Surface, Tolerance, add_moments, fit_plane

FREE = -1
REFIT_GROWTH = 1.1
"""A region's plane is fitted anew whenever it has grown by a tenth: at most 2.5 times a doubling is not enough to let a
young plane lean, and each point still costs less for refits than for its neighbours."""


@core
def grow_one(
    surface: Surface, seed: int, number: int, tolerance: Tolerance, region: Ints32, queue: Ints32, fit: Fit
) -> int:
    """Grow one region from `seed`; return its size, the length of `queue` that lists it."""
    (xyz, neighbours, normal), (sums, plane, spread) = surface, fit
    plane[0], plane[1], plane[2], plane[3] = normal[seed, 0], normal[seed, 1], normal[seed, 2], 0.0
    sums[:] = 0.0
    x0, y0, z0 = xyz[seed, 0], xyz[seed, 1], xyz[seed, 2]
    queue[0] = seed
    region[seed] = number
    n_members, head, refit_at = 1, 0, 8.0
    add_moments(sums, 0.0, 0.0, 0.0)
    while head < n_members:
        i = queue[head]
        head += 1
        for rank in range(neighbours.shape[1]):
            j = neighbours[i, rank]
            if j < 0:
                break
            if region[j] != FREE:
                continue
            # Normals first: most of those that are turned away are known by them, from half as much memory.
            cosine = abs(plane[0] * normal[j, 0] + plane[1] * normal[j, 1] + plane[2] * normal[j, 2])
            if not cosine >= tolerance.cos_angle:
                continue
            x, y, z = xyz[j, 0] - x0, xyz[j, 1] - y0, xyz[j, 2] - z0
            if abs(plane[0] * x + plane[1] * y + plane[2] * z - plane[3]) > tolerance.max_distance:
                continue
            region[j] = number
            queue[n_members] = j
            n_members += 1
            add_moments(sums, x, y, z)
        if n_members >= refit_at:
            fit_plane(sums, plane, spread)
            refit_at = REFIT_GROWTH * n_members
    return n_members


@jit
def grow_regions(surface: Surface, seeds: Ints, tolerance: Tolerance, min_size: int, region: Ints32) -> int:
    """Number the points of each region, seed after seed; return how many regions there are.

    A point joins if it is a neighbour of a member, and lies near enough to the region's plane and faces as it does.
    Points with a normal of nan neither join nor lead on, and are no seeds. What stays below `min_size` is free again.
    """
    queue, fit = np.empty(len(surface.xyz), np.int32), Fit(np.empty(MOMENTS), np.empty(4), np.empty(3))
    n_regions = 0
    for seed in seeds:
        if region[seed] != FREE:
            continue
        n_members = grow_one(surface, seed, n_regions, tolerance, region, queue, fit)
        if n_members >= min_size:
            n_regions += 1
        else:
            for c in range(n_members):
                region[queue[c]] = FREE
    return n_regions


@core
def translate(sums: Floats, origin: Floats, to: Floats, out: Floats) -> None:
    """Write the moments of a set about another origin."""
    n, x, y, z = sums[0], origin[0] - to[0], origin[1] - to[1], origin[2] - to[2]
    out[0] = n
    out[1], out[2], out[3] = sums[1] + n * x, sums[2] + n * y, sums[3] + n * z
    out[4] = sums[4] + 2.0 * x * sums[1] + n * x * x
    out[5] = sums[5] + x * sums[2] + y * sums[1] + n * x * y
    out[6] = sums[6] + x * sums[3] + z * sums[1] + n * x * z
    out[7] = sums[7] + 2.0 * y * sums[2] + n * y * y
    out[8] = sums[8] + y * sums[3] + z * sums[2] + n * y * z
    out[9] = sums[9] + 2.0 * z * sums[3] + n * z * z


@core
def mean_square(sums: Floats, plane: Floats) -> float:
    """Return the mean squared distance of a set to a plane."""
    nx, ny, nz, d = plane[0], plane[1], plane[2], plane[3]
    quadratic = nx * nx * sums[4] + ny * ny * sums[7] + nz * nz * sums[9]
    quadratic += 2.0 * (nx * ny * sums[5] + nx * nz * sums[6] + ny * nz * sums[8])
    linear = nx * sums[1] + ny * sums[2] + nz * sums[3]
    return max((quadratic - 2.0 * d * linear) / sums[0] + d * d, 0.0)


@core
def joint_rms(a: int, b: int, origin: Floats, sums: Floats, moved: Floats, fit: Fit) -> float:
    """Return how well one plane would do for two regions: the worse one's distance to it, root mean square.

    `fit` becomes that of both about the origin of a, `moved` the moments of b about it.
    """
    translate(sums[b], origin[b], origin[a], moved)
    for c in range(MOMENTS):
        fit.sums[c] = sums[a, c] + moved[c]
    fit_plane(fit.sums, fit.plane, fit.spread)
    return np.sqrt(max(mean_square(sums[a], fit.plane), mean_square(moved, fit.plane)))


@core
def root_of(parent: Ints32, r: int) -> int:
    """Return the region into which r was merged."""
    while parent[r] != r:
        parent[r] = parent[parent[r]]
        r = parent[r]
    return r


@jit
def pair_rms(pairs: Ints32, parent: Ints32, origin: Floats, sums: Floats) -> Floats:
    """Return :func:`joint_rms` of each pair of regions as they are now; inf for pairs that are one already."""
    out = np.empty(len(pairs))
    out[:] = np.inf
    moved, fit = np.empty(MOMENTS), Fit(np.empty(MOMENTS), np.empty(4), np.empty(3))
    for p in range(len(pairs)):
        a, b = root_of(parent, pairs[p, 0]), root_of(parent, pairs[p, 1])
        if a != b and sums[a, 0] >= 3.0 and sums[b, 0] >= 3.0:
            out[p] = joint_rms(min(a, b), max(a, b), origin, sums, moved, fit)
    return out


@jit
def unite(pairs: Ints32, parent: Ints32, origin: Floats, sums: Floats, max_rms: float) -> int:
    """Unite pairs in the order given as long as one plane still does for both; return how many were united.

    The region of the smaller number takes the other in: `parent` and `sums` are updated.
    """
    n_united = 0
    moved, fit = np.empty(MOMENTS), Fit(np.empty(MOMENTS), np.empty(4), np.empty(3))
    for p in range(len(pairs)):
        a, b = root_of(parent, pairs[p, 0]), root_of(parent, pairs[p, 1])
        if a == b:
            continue
        a, b = min(a, b), max(a, b)
        if joint_rms(a, b, origin, sums, moved, fit) <= max_rms:
            parent[b] = a
            for c in range(MOMENTS):
                sums[a, c] = fit.sums[c]
            n_united += 1
    return n_united


@jit
def resolve(parent: Ints32) -> None:
    """Point every region straight to the one into which it was merged."""
    for r in range(len(parent)):
        parent[r] = root_of(parent, r)
