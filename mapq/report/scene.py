"""`PageScene`: points and outlines that the views of a page draw, few enough to stay smooth, and packed for it."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.labels import NO_PATCH, SUSPICIOUS
from mapq.picture import box_of

VIEWS = (("mapq.report", "scene.js"), ("mapq.report", "view.js"))
"""Scripts of the views of a scene, which the report and the labelling page share."""
EYE = (-1.05, 0.6)
"""Radians: turn and rise of the 3D view at first, as report.js has it."""
MOST_OUTLINES = 20_000
"""Patches with an outline: suspicious ones first, then the largest; the rest are points alone."""

N_DIRECTIONS = 24
"""Directions in which the outermost point of a patch is a corner:  its hull, without corners blunter than 15°."""
N_ROUNDS = 12
"""Sizes of cells that are tried at most to thin points; each try is a sort."""
CLOSE_ENOUGH = 0.8
"""Share of the points allowed that is not worth another try."""
LOOKED_AT = 4_000_000
"""Points that cells are made of; of more, evenly spaced ones."""
FINEST = 1e-3
"""Metres: coordinates are whole numbers of it, or of more where a map is too large for that."""
STEPS = 2**30

_ODD = np.array([0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9, 0x27D4EB2F165667C5], np.uint64)
"""Multipliers that spread cells over 64 bits."""

Floats = NDArray[np.float64]


LEAST_FILLED = 0.5
"""Of its hull that a patch fills which is drawn with its outline: streets round a block are no polygon of its size."""


class PageScene(NamedTuple):
    """Points and outlines of patches."""

    points: Floats  # (k, 3) metres, in the frame of ``cloud.xyz``; patch after patch, those without a patch last
    start: NDArray[np.int64]  # (m + 2,) where the points of each patch begin, and of those without
    corners: Floats  # (h, 3) of the outlines
    corner_start: NDArray[np.int64]  # (m + 1,) where those of each patch begin; one without outline has none
    low: Floats  # (3,) box of all points in patches, and of the others without those far out
    high: Floats  # (3,)
    n_points: int  # finite points

    @property
    def aspect(self) -> float:
        """Height of the map by its width, as the taller of both views shows it at first."""
        x, y, z = np.maximum(self.high - self.low, 1.0).tolist()
        (turn, rise), level = EYE, abs(np.sin(EYE[0])) * x + abs(np.cos(EYE[0])) * y
        tall = np.sin(rise) * (abs(np.cos(turn)) * x + abs(np.sin(turn)) * y) + np.cos(rise) * z
        return float(max(y / x, tall / level))

    def pack(self) -> tuple[dict[str, Any], bytes]:
        """Return how the numbers are to be read, and the numbers: little-endian int32, column after column."""
        step = max(FINEST, float(np.abs(self.points - self.low).max(initial=0.0)) / STEPS)
        whole = [np.rint((values - self.low) / step).astype("<i4") for values in (self.points, self.corners)]
        starts = [values.astype("<i4") for values in (self.start, self.corner_start)]
        content = b"".join(part.tobytes() for part in (*whole[0].T, starts[0], *whole[1].T, starts[1]))
        head = {"k": len(self.points), "m": len(self.start) - 2, "h": len(self.corners), "step": step}
        return {**head, "low": self.low, "high": self.high, "n_points": self.n_points}, content


def build_scene(
    xyz: Floats,
    patch: NDArray[np.int32],
    normal: Floats,
    label: NDArray[np.uint8],
    n_most: int,
) -> PageScene:
    """Return the scene of a map.

    `xyz` (n, 3): metres; points that are not finite are left out. `patch` (n,): `NO_PATCH` for none. `normal` (m, 3).
    `label` (m,). `n_most`: points shown, about; a fifth of them at most without a patch.
    """
    n_patches = len(normal)
    finite = np.flatnonzero(np.isfinite(xyz).all(axis=1))
    inside, loose = (finite[(patch[finite] != NO_PATCH) == within] for within in (True, False))
    order = inside[np.argsort(patch[inside], kind="stable")]
    counts = np.bincount(patch[order], minlength=n_patches)
    corners, corner_start = _chosen_outlines(xyz[order], counts, normal, label)
    n_loose = min(len(loose), max(n_most // 5, n_most - len(order)))
    shown = order[evenly(xyz[order], patch[order], n_most - n_loose)]
    without = loose[evenly(xyz[loose], patch[loose], n_loose)] if n_loose else loose[:0]
    start = np.concatenate([[0], np.cumsum(np.bincount(patch[shown], minlength=n_patches)), [0]]).astype(np.int64)
    start[-1] = len(shown) + len(without)
    low, high = box_of(xyz[order], xyz[finite])
    return PageScene(
        xyz[np.concatenate([shown, without])],
        start,
        corners,
        corner_start,
        low,
        high,
        len(finite),
    )


def outlines(xyz: Floats, start: NDArray[np.int64], normal: Floats) -> tuple[Floats, NDArray[np.int64]]:
    """Return the corners (h, 3) of the outlines of m patches, and where (m + 1,) each one's begin.

    `xyz` (n, 3): points, patch after patch. `start` (m + 1,): where each patch's points begin. `normal` (m, 3): A patch
    whose normal is not finite, whose points lie on a line, or that fills little of its hull, has no outline.
    """
    n_patches = len(start) - 1
    counts = np.diff(start)
    across, along = _axes(normal)
    owner = np.repeat(np.arange(n_patches), counts)
    u, v = (np.einsum("ij,ij->i", xyz, axis[owner]) for axis in (across, along))
    corner = np.full((n_patches, N_DIRECTIONS), -1, np.int64)
    filled = np.flatnonzero((counts > 2) & np.isfinite(normal).all(axis=1))
    for step in range(N_DIRECTIONS if len(filled) else 0):
        angle = 2.0 * np.pi * step / N_DIRECTIONS
        corner[filled, step] = _outermost(np.cos(angle) * u + np.sin(angle) * v, start, owner)[filled]
    # A corner that is outermost in several directions counts once; these directions are consecutive.
    new = (corner != np.roll(corner, 1, axis=1)) & (corner >= 0)
    new[new.sum(axis=1) < 3] = False
    new[_filling(u, v, start, owner, corner) < LEAST_FILLED] = False
    begin = np.concatenate([[0], np.cumsum(new.sum(axis=1))]).astype(np.int64)
    return xyz[corner[new]], begin


def _filling(
    u: Floats, v: Floats, start: NDArray[np.int64], owner: NDArray[np.int64], corner: NDArray[np.int64]
) -> Floats:
    """Return the share (m,) of their hulls that patches fill, by cells that hold four points in the mean.

    `u`, `v` (n,): places of the points, of the patches `owner`; `corner` (m, k): numbers of the corners of their hulls.
    """
    x, y = u[corner], v[corner]
    hull = 0.5 * np.abs((x * np.roll(y, -1, axis=1) - y * np.roll(x, -1, axis=1)).sum(axis=1))
    side = np.maximum(2.0 * np.sqrt(hull / np.maximum(np.diff(start), 1)), 1e-9)
    cells = np.unique(np.column_stack([owner, *(np.floor(each / side[owner]) for each in (u, v))]), axis=0)
    return np.asarray(
        np.bincount(cells[:, 0].astype(np.int64), minlength=len(hull)) * side**2 / np.maximum(hull, 1e-12)
    )


def _axes(normal: Floats) -> tuple[Floats, Floats]:
    """Return two unit vectors (m, 3) across each normal and each other."""
    least = np.argmin(np.abs(np.nan_to_num(normal)), axis=1)
    across = np.cross(normal, np.eye(3)[least])
    across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-12)
    return across, np.cross(normal, across)


def _outermost(reach: Floats, start: NDArray[np.int64], owner: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the first point (m,) of the largest reach of each patch; of a patch without points something else."""
    largest = np.maximum.reduceat(np.append(reach, -np.inf), start[:-1])
    top = np.flatnonzero(reach == largest[owner])
    first = np.ones(len(top), np.bool_)
    first[1:] = owner[top[1:]] != owner[top[:-1]]
    found = np.zeros(len(start) - 1, np.int64)
    found[owner[top[first]]] = top[first]
    return found


def evenly(xyz: Floats, group: NDArray[np.int32], n_most: int) -> NDArray[np.intp]:
    """Return the numbers of at most `n_most` points, ascending: the first of each group in each cell of a grid.

    `xyz` (n, 3): finite. `group` (n,): patch of each point. Of small patches points remain as long as there are fewer
    patches than `n_most`.
    """
    if len(xyz) <= n_most:
        return np.arange(len(xyz))
    some = np.arange(0, len(xyz), -(-len(xyz) // LOOKED_AT))
    places = xyz[some] - xyz[some].min(axis=0)
    size = float(places.max()) / 500.0 or 1.0
    best = np.zeros(0, np.intp)
    for _ in range(N_ROUNDS):
        found = _firsts(places, group[some], size)
        if len(found) <= n_most and len(found) > len(best):
            best = found
        if CLOSE_ENOUGH * n_most <= len(found) <= n_most or len(found) == len(some):
            break
        # Points lie on surfaces, so there are as many cells as 1 / size².
        size *= float(np.sqrt(len(found) / (0.93 * n_most)))
    if len(best) == 0:
        best = np.arange(0, len(some), -(-len(some) // n_most))
    return np.sort(some[best])


def _firsts(places: Floats, group: NDArray[np.int32], size: float) -> NDArray[np.intp]:
    """Return the first point of every group in every cell of a grid; two cells may by rare chance pass for one."""
    cell = np.floor(places / size).astype(np.int64).astype(np.uint64)
    with np.errstate(over="ignore"):
        key = cell @ _ODD[:3] + group.astype(np.int64).astype(np.uint64) * _ODD[3]
        key ^= key >> np.uint64(29)
    return np.unique(key, return_index=True)[1]


def _chosen_outlines(
    xyz: Floats, counts: NDArray[np.int64], normal: Floats, label: NDArray[np.uint8]
) -> tuple[Floats, NDArray[np.int64]]:
    """Return the outlines of patches whose points (n, 3) are sorted by patch, as :func:`outlines`."""
    order = np.lexsort((-counts, label != SUSPICIOUS))[:MOST_OUTLINES]
    chosen = np.zeros(len(counts), np.bool_)
    chosen[order] = True
    start = np.concatenate([[0], np.cumsum(np.where(chosen, counts, 0))]).astype(np.int64)
    return outlines(xyz[np.repeat(chosen, counts)], start, normal)
