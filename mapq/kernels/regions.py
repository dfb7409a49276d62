"""What is done to regions once they have grown: their planes, points that change sides, and who touches whom."""

import numpy as np

from mapq.kernels._jit import Floats, Floats32, Ints, Ints32, core, jit
from mapq.kernels.planes import Surface, Tolerance, add_moments, fit_plane

FREE = -1
PLANE_BITS = 40
"""Of the number of a cell in a plane: 20 for its column, 20 for its row; the region's number is above them."""
MIN_TOUCHING = 3
"""A point that no region holds joins one only beside so many of its members: a single one may be a stray itself."""
MOST_STEPS = 4
"""Points of others that a region walks over for each of its own: what lies farther off than that says little about it,
and fragments of clutter would walk over whole streets."""


@jit
def number_along(region: Ints32, n_regions: int) -> None:
    """Number regions anew by their first points: what lies together is then looked at together, in fast memory."""
    number = np.full(n_regions, FREE, np.int32)
    n_numbered = 0
    for i in range(len(region)):
        r = region[i]
        if r != FREE:
            if number[r] == FREE:
                number[r] = n_numbered
                n_numbered += 1
            region[i] = number[r]


@jit
def sum_regions(xyz: Floats, region: Ints32, origin: Floats, sums: Floats) -> None:
    """Write the moments (m, 10) of each region about the first of its points, which is written to `origin` (m, 3)."""
    sums[:] = 0.0
    for i in range(len(xyz)):
        if region[i] != FREE:
            add_point(xyz, i, region[i], origin, sums)


@core
def add_point(xyz: Floats, i: int, r: int, origin: Floats, sums: Floats) -> None:
    """Add point i to the moments of region r."""
    if sums[r, 0] == 0.0:
        for axis in range(3):
            origin[r, axis] = xyz[i, axis]
    add_moments(sums[r], xyz[i, 0] - origin[r, 0], xyz[i, 1] - origin[r, 1], xyz[i, 2] - origin[r, 2])


@jit
def fit_regions(origin: Floats, sums: Floats, planes: Floats, spread: Floats) -> None:
    """Write the planes (m, 6) of regions, normal and centroid, and their variances (m, 3), ascending.

    A region of fewer than three points gets a normal of nan, which nothing fits.
    """
    plane, variance = np.empty(4), np.empty(3)
    for r in range(len(sums)):
        if sums[r, 0] < 3.0:
            for axis in range(3):
                planes[r, axis] = planes[r, 3 + axis] = spread[r, axis] = np.nan
            continue
        fit_plane(sums[r], plane, variance)
        for axis in range(3):
            planes[r, axis] = plane[axis]
            planes[r, 3 + axis] = origin[r, axis] + sums[r, 1 + axis] / sums[r, 0]
            spread[r, axis] = variance[axis]


@core
def off_plane(xyz: Floats, i: int, planes: Floats, r: int) -> float:
    """Return the distance of point i to the plane of region r; nan if there is none."""
    dx, dy, dz = xyz[i, 0] - planes[r, 3], xyz[i, 1] - planes[r, 4], xyz[i, 2] - planes[r, 5]
    return abs(dx * planes[r, 0] + dy * planes[r, 1] + dz * planes[r, 2])


@core
def faces(normal: Floats32, i: int, planes: Floats, r: int, cos_angle: float) -> bool:
    """Return whether point i faces as the plane of region r does; a point without a normal does."""
    cosine = abs(normal[i, 0] * planes[r, 0] + normal[i, 1] * planes[r, 1] + normal[i, 2] * planes[r, 2])
    return not cosine < cos_angle


@core
def belongs(surface: Surface, i: int, planes: Floats, r: int, tolerance: Tolerance) -> bool:
    """Return whether point i lies near enough to the plane of region r and faces as it does."""
    near = off_plane(surface.xyz, i, planes, r) <= tolerance.max_distance
    return near and faces(surface.normal, i, planes, r, tolerance.cos_angle)


@jit
def change_sides(
    surface: Surface, planes: Floats, tolerance: Tolerance, region: Ints32, begin: int, out: Ints32
) -> None:
    """Give points from number `begin` on the nearest plane among the regions round them, their own included.

    Nearest among the planes near enough that it faces; none if there is no such plane. All look at the regions of
    before, so that the order of the points does not matter.
    """
    (xyz, neighbours, normal), (cos_angle, max_distance) = surface, tolerance
    for i in range(begin, begin + len(out)):
        own = region[i]
        best, nearest = FREE, np.inf
        if own != FREE:
            distance = off_plane(xyz, i, planes, own)
            if distance <= max_distance:
                best, nearest = own, distance
        last = own
        for rank in range(neighbours.shape[1]):
            j = neighbours[i, rank]
            if j < 0:
                break
            r = region[j]
            if r == last or r == FREE or r == own:
                continue
            last = r
            distance = off_plane(xyz, i, planes, r)
            if not distance <= max_distance or distance > nearest or (distance == nearest and r > best):
                continue
            if faces(normal, i, planes, r, cos_angle) and touching(neighbours, i, region, r):
                best, nearest = r, distance
        out[i - begin] = best


@core
def touching(neighbours: Ints32, i: int, region: Ints32, r: int) -> bool:
    """Return whether enough of the neighbours of point i belong to region r."""
    count = 0
    for rank in range(neighbours.shape[1]):
        j = neighbours[i, rank]
        if j < 0:
            break
        count += region[j] == r
    return count >= MIN_TOUCHING


@jit
def count_support(neighbours: Ints32, region: Ints32, own: Ints, free: Ints) -> None:
    """Count the neighbours of each region's points that are in the region too, and those in none.

    Points all through a volume leave most of the neighbours of any slice of it in no region.
    """
    own[:] = 0
    free[:] = 0
    for i in range(len(region)):
        r = region[i]
        if r != FREE:
            n_own, n_free = 0, 0
            for rank in range(neighbours.shape[1]):
                j = neighbours[i, rank]
                if j < 0:
                    break
                n_own += region[j] == r
                n_free += region[j] == FREE
            own[r] += n_own
            free[r] += n_free


@jit
def list_members(region: Ints32, start: Ints, members: Ints32) -> None:
    """List the points of each region in order: those of region r are from ``start[r]`` to ``start[r + 1]``."""
    start[:] = 0
    for r in region:
        if r != FREE:
            start[r + 1] += 1
    for r in range(len(start) - 1):
        start[r + 1] += start[r]
    place = start[:-1].copy()
    for i in range(len(region)):
        r = region[i]
        if r != FREE:
            members[place[r]] = i
            place[r] += 1


@jit
def walk_regions(
    surface: Surface,
    planes: Floats,
    tolerance: Tolerance,
    region: Ints32,
    members: Ints32,
    start: Ints,
    piece: Ints32,
    wants_pairs: bool,
) -> Ints32:
    """Walk over each region, and on over points of others that lie on its plane and face as it does.

    Two copies of a wall that cross share the points along the crossing; whoever does not own them is cut in two there,
    but walks across. Writes the `piece` that each point belongs to (connected under such walks, pieces numbered region
    by region), and returns the pairs (p, 2) of a region and another that it walked on. A walk ends after `MOST_STEPS`;
    without pairs, once it has found the whole region.
    """
    n_regions, neighbours = len(start) - 1, surface.neighbours
    queue, pairs = np.empty(len(region), np.int32), np.empty((n_regions if wants_pairs else 0, 2), np.int32)
    seen, met = np.empty(len(region), np.int32), np.empty(n_regions, np.int32)
    seen[:] = FREE
    met[:] = FREE
    n_pieces, n_pairs = 0, 0
    for r in range(n_regions):
        missing = start[r + 1] - start[r]
        steps = MOST_STEPS * missing
        for first in members[start[r] : start[r + 1]]:
            if seen[first] == r:
                continue
            seen[first] = r
            piece[first] = n_pieces
            missing -= 1
            # Points of the region from the front of the queue, and those of others, which wait, from its back.
            queue[0] = first
            head, tail, over, last = 0, 1, len(queue) - 1, len(queue) - 1
            while head < tail or (over > last and steps > 0 and (wants_pairs or missing > 0)):
                if head < tail:
                    i = queue[head]
                    head += 1
                else:
                    i = queue[over]
                    over -= 1
                    steps -= 1
                for rank in range(neighbours.shape[1]):
                    j = neighbours[i, rank]
                    if j < 0:
                        break
                    if seen[j] == r:
                        continue
                    seen[j] = r
                    other = region[j]
                    if other == r:
                        piece[j] = n_pieces
                        missing -= 1
                        queue[tail] = j
                        tail += 1
                    elif other != FREE and belongs(surface, j, planes, r, tolerance):
                        queue[last] = j
                        last -= 1
                        if wants_pairs and met[other] != r:
                            met[other] = r
                            if n_pairs == len(pairs):
                                pairs = np.concatenate((pairs, np.empty_like(pairs)))
                            pairs[n_pairs, 0], pairs[n_pairs, 1] = r, other
                            n_pairs += 1
            n_pieces += 1
    return pairs[:n_pairs]


@jit
def join_rest(
    xyz: Floats, cell: Ints32, neighbours: Ints32, planes: Floats, max_distance: float, region: Ints32, out: Ints32
) -> None:
    """Give each point (u,) the nearest plane among the regions of its cell's representative and its neighbours.

    ``cell[i]`` is the representative of point i, by which `neighbours` and `region` count.
    """
    for i in range(len(xyz)):
        best, nearest = FREE, max_distance
        own = region[cell[i]]
        if own != FREE and off_plane(xyz, i, planes, own) <= nearest:
            best, nearest = own, off_plane(xyz, i, planes, own)
        for rank in range(neighbours.shape[1]):
            j = neighbours[cell[i], rank]
            if j < 0:
                break
            r = region[j]
            if r != FREE and r != own:
                distance = off_plane(xyz, i, planes, r)
                if distance < nearest or (distance == nearest and r < best):
                    best, nearest = r, distance
        out[i] = best


@jit
def number_plane_cells(xyz: Floats, region: Ints32, planes: Floats, cell: float, key: Ints) -> None:
    """Write for each point the number of its cell in its region's plane, -1 where there is no plane.

    The cells' axes are the plane's horizontal and what is across that; for a plane across z, x and y.
    """
    half = 1 << (PLANE_BITS // 2 - 1)
    for i in range(len(xyz)):
        r = region[i]
        key[i] = -1
        if r == FREE or np.isnan(planes[r, 0]):
            continue
        nx, ny, nz = planes[r, 0], planes[r, 1], planes[r, 2]
        flat = np.hypot(nx, ny)
        ux, uy = (-ny / flat, nx / flat) if flat > 0.1 else (1.0, 0.0)
        dx, dy, dz = xyz[i, 0] - planes[r, 3], xyz[i, 1] - planes[r, 4], xyz[i, 2] - planes[r, 5]
        u = dx * ux + dy * uy
        v = -dx * nz * uy + dy * nz * ux + dz * (nx * uy - ny * ux)
        column = min(max(int(np.floor(u / cell)) + half, 0), 2 * half - 1)
        line = min(max(int(np.floor(v / cell)) + half, 0), 2 * half - 1)
        key[i] = (np.int64(r) << PLANE_BITS) | (column << (PLANE_BITS // 2)) | line
