"""`Scene`: what the views of a page draw, small enough to stay smooth, and packed for it."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.patches import NO_PATCH, SUSPICIOUS
from mapq.report.outlines import outlines
from mapq.report.thin import evenly

MOST_OUTLINES = 20_000
"""Patches with an outline: suspicious ones first, then the largest; points stand for the rest."""

OUTLYING = 0.02
"""Share of the points on each side that may lie outside the box: through windows sensors see far away."""
MOST_BOXED = 200_000
"""Points that say where that is."""

FINEST = 1e-3
"""Metres: coordinates are whole numbers of it, or of more where a map is too large for that."""
STEPS = 2**30

Floats = NDArray[np.float64]


class Scene(NamedTuple):
    """Points and outlines of patches.

    Attributes
    ----------
    points : (k, 3) float64
        Metres, in the frame of ``cloud.xyz``; patch after patch, those without a patch last.
    start : (m + 2,) int64
        Where the points of each patch begin, and of those without.
    corners : (h, 3) float64
        Of the outlines.
    corner_start : (m + 1,) int64
        Where those of each patch begin; one without outline has none.
    low, high : (3,) float64
        Box of what is worth seeing: all points in patches, and the others but for a few far out.
    n_points : int
        So many points are finite.
    """

    points: Floats
    start: NDArray[np.int64]
    corners: Floats
    corner_start: NDArray[np.int64]
    low: Floats
    high: Floats
    n_points: int

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
) -> Scene:
    """Return the scene of a map.

    Parameters
    ----------
    xyz : (n, 3) float64
        Metres; points that are not finite are left out.
    patch : (n,) int32
        `NO_PATCH` for none.
    normal : (m, 3) float64
    label : (m,) uint8
    n_most : int
        Points shown, about; a fifth of them at most without a patch.
    """
    n_patches = len(normal)
    finite = np.flatnonzero(np.isfinite(xyz).all(axis=1))
    inside, loose = (finite[(patch[finite] != NO_PATCH) == within] for within in (True, False))
    order = inside[np.argsort(patch[inside], kind="stable")]
    counts = np.bincount(patch[order], minlength=n_patches)
    corners, corner_start = _chosen_outlines(xyz[order], counts, normal, label)
    n_loose = min(len(loose), max(n_most // 5, n_most - len(order)))
    shown = order[evenly(xyz[order], patch[order], max(n_most - n_loose, n_patches))]
    without = loose[evenly(xyz[loose], patch[loose], n_loose)] if n_loose else loose[:0]
    start = np.concatenate([[0], np.cumsum(np.bincount(patch[shown], minlength=n_patches)), [0]]).astype(np.int64)
    start[-1] = len(shown) + len(without)
    low, high = _box(xyz[order], xyz[finite])
    return Scene(
        xyz[np.concatenate([shown, without])],
        start,
        corners,
        corner_start,
        low,
        high,
        len(finite),
    )


def _box(inside: Floats, all_points: Floats) -> tuple[Floats, Floats]:
    """Return the corners of a box around the points in patches, and all points but for `OUTLYING` on each side."""
    if len(all_points) == 0:
        return np.zeros(3), np.zeros(3)
    some = all_points[:: max(1, len(all_points) // MOST_BOXED)]
    low, high = np.quantile(some, (OUTLYING, 1.0 - OUTLYING), axis=0)
    if len(inside) == 0:
        return low, high
    return np.minimum(low, inside.min(axis=0)), np.maximum(high, inside.max(axis=0))


def _chosen_outlines(
    xyz: Floats, counts: NDArray[np.int64], normal: Floats, label: NDArray[np.uint8]
) -> tuple[Floats, NDArray[np.int64]]:
    """Return the outlines of patches whose points (n, 3) stand one patch after the other, as :func:`outlines`."""
    order = np.lexsort((-counts, label != SUSPICIOUS))[:MOST_OUTLINES]
    chosen = np.zeros(len(counts), np.bool_)
    chosen[order] = True
    start = np.concatenate([[0], np.cumsum(np.where(chosen, counts, 0))]).astype(np.int64)
    return outlines(xyz[np.repeat(chosen, counts)], start, normal)
