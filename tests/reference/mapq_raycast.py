"""Ray casting without a grid and without numba: every beam against every item, each by its own plain formula."""

from __future__ import annotations

import numpy as np

from mapq.kernels.raycast import GOLDEN, NOTHING, Scene


def cast(scene: Scene, origins, directions, times, draws, max_range):  # type: ignore[no-untyped-def]
    """Return ranges (n,) and items (n,), as `cast_beams` fills them."""
    hits = [
        *(wall(row, origins, directions) for row in scene.walls),
        *(sheet(row, origins, directions) for row in scene.sheets),
        *(cylinder(row[:2], *row[2:5], origins, directions) for row in scene.posts),
        *(foliage(row, k, origins, directions, draws) for k, row in enumerate(scene.blobs)),
        *(mover(row, origins, directions, times) for row in scene.movers),
        ground(origins, directions),
    ]
    table = np.array(hits)
    items = table.argmin(axis=0)
    ranges = table.min(axis=0)
    far = ranges >= max_range
    return np.where(far, np.inf, ranges), np.where(far, NOTHING, items)


def ground(origins, directions):  # type: ignore[no-untyped-def]
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = -origins[:, 2] / directions[:, 2]
    return np.where(distance > 0, distance, np.inf)


def wall(row, origins, directions):  # type: ignore[no-untyped-def]
    start, along, length, z0, z1 = row[:2], row[2:4], row[4], row[5], row[6]
    normal = np.array([-along[1], along[0]])
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = (start - origins[:, :2]) @ normal / (directions[:, :2] @ normal)
        points = origins + distance[:, None] * directions
    u, z = (points[:, :2] - start) @ along, points[:, 2]
    inside = (u >= 0) & (u <= length) & (z >= z0) & (z <= z1)
    open_ = in_row(u, *row[7:11]) & in_row(z, *row[11:15])
    return np.where((distance > 0) & inside & ~open_, distance, np.inf)


def in_row(value, first, period, width, end):  # type: ignore[no-untyped-def]
    return (value >= first) & (value < end) & ((value - first) % period < width)


def sheet(row, origins, directions):  # type: ignore[no-untyped-def]
    sides = np.linalg.pinv(row[6:12].reshape(2, 3))
    distance = np.full(len(origins), np.inf)
    for b, (o, d) in enumerate(zip(origins, directions, strict=True)):
        # o + t d = corner + u a + v b
        u, v, t = np.linalg.solve(np.column_stack([sides, -d]), o - row[:3])
        if t > 0 and 0 <= u <= 1 and 0 <= v <= 1:
            distance[b] = t
    return distance


def cylinder(centre, radius, z0, z1, origins, directions):  # type: ignore[no-untyped-def]
    distance = np.full(len(origins), np.inf)
    for b, (o, d) in enumerate(zip(origins, directions, strict=True)):
        flat = np.hypot(d[0], d[1])
        if flat == 0:
            continue
        toward = d[:2] / flat
        closest = (centre - o[:2]) @ toward
        aside = np.hypot(*(o[:2] + closest * toward - centre))
        if aside < radius:
            t = (closest - np.sqrt(radius**2 - aside**2)) / flat
            if t > 0 and z0 <= o[2] + t * d[2] <= z1:
                distance[b] = t
    return distance


def foliage(row, k, origins, directions, draws):  # type: ignore[no-untyped-def]
    scale = np.array([row[3], row[3], row[4]])
    o, d = (origins - row[:3]) / scale, directions / scale
    distance = np.full(len(origins), np.inf)
    for b in range(len(origins)):
        roots = np.roots([d[b] @ d[b], 2 * o[b] @ d[b], o[b] @ o[b] - 1])
        if np.iscomplex(roots).any():
            continue
        near, far = sorted(roots.real)
        t = max(near, 0.0) - np.log(1 - (draws[b] + GOLDEN * (k + 1)) % 1.0) / row[5]
        if t < far:
            distance[b] = t
    return distance


def mover(row, origins, directions, times):  # type: ignore[no-untyped-def]
    distance = np.full(len(origins), np.inf)
    for b in np.flatnonzero((times >= row[5]) & (times <= row[6])):
        centre = row[1:3] + row[3:5] * (times[b] - row[5])
        one = slice(b, b + 1)
        if row[0] == 0:
            distance[b] = cylinder(centre, row[7], row[9], row[10], origins[one], directions[one])[0]
        else:
            distance[b] = box(centre, row, origins[b], directions[b])
    return distance


def box(centre, row, o, d):  # type: ignore[no-untyped-def]
    """Nearest of the six faces, each a bounded plane; a box is not seen from inside."""
    turn = np.array([[row[11], row[12], 0], [-row[12], row[11], 0], [0, 0, 1]])
    p, q = turn @ (o - [*centre, 0]), turn @ d
    low, high = np.array([-row[7], -row[8], row[9]]), np.array([row[7], row[8], row[10]])
    if ((p > low) & (p < high)).all():
        return np.inf
    best = np.inf
    for axis in range(3):
        for face in (low[axis], high[axis]):
            if q[axis] == 0:
                continue
            t = (face - p[axis]) / q[axis]
            others = [other for other in range(3) if other != axis]
            at = p + t * q
            if 0 < t < best and ((at >= low) & (at <= high))[others].all():
                best = t
    return best
