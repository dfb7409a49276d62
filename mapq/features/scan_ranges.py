"""How far the scans that see a patch lie apart along its normal, and with what bounds, once their motions are known.

A scan sees a patch by ten points of its own on it, wherever its error put them; stray points within a scan do not
matter, a whole scan that lies apart does. What parts scans on patches beyond their motions shows how far to trust both.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.features.shape import PatchShapes
from mapq.kernels.scan_views import ENOUGH, ranges_of_patches

SURE, UNSURE = 15.0, 6.0
"""Points on a patch from which a scan surely counts, and may do so: which points lie on a patch is not that sharp."""
BENT, BENT_VIEWS = 0.008, 20.0
"""Metres by which scans have patches otherwise than their motions say, before any are seen, and as how many views that
counts."""
FLOOR, OF_BENT = 0.0065, 0.65
"""Standard error of the offset of a scan beside that of its motion: metres at least, and in times what scans are bent.

Neither are right poses quite right, nor ranges.
"""
ALIKE = 0.7
"""Offsets of scans are taken for noise within so many times what scans are bent."""
IN_BOUNDS = 1.96
"""Standard errors of the bounds on either side."""
N_ROUND = 7
"""Normals round a curved patch along which scans are compared: 30 degrees apart, or less."""
HALF_OF_SQUARES = 0.455
"""Median of the square of a unit normal."""
PATCH, MOMENT, PLACE, HEIGHT, SCATTER, N_POINTS = 0, 1, slice(2, 5), 5, 6, 7
"""Columns of views."""

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


class Disagreement(NamedTuple):
    """How far scans disagree on each patch."""

    # (m,) the disagreement with bounds that hold it in 95 of 100; nan where not two scans have ten points on the patch
    metres: Floats
    low: Floats  # (m,)
    high: Floats  # (m,)
    n_scans: Floats  # (m,) scans with ten points or more on it; nan where scans are not known
    shared: Floats  # (m,) share of its points in cells that several such scans see; nan likewise

    @classmethod
    def unknown(cls, n_patches: int) -> Disagreement:
        """Return what is known where scans are not."""
        return cls(*(np.full(n_patches, np.nan) for _ in cls._fields))


class Window(NamedTuple):
    """A neighbourhood: its scans (s,), ascending, and their motions (s, 6) about its centre."""

    centre: Floats
    scans: Ints
    motion: Floats


def jacobian_of(normal: Floats, place: Floats, centre: Floats) -> Floats:
    """Return how motions about a centre displace places (r, 3) along normals (r, 3), (r, 6)."""
    return np.hstack([normal, np.cross(place - centre, normal)])


def normals_round(shapes: PatchShapes) -> dict[int, Floats]:
    """Return normals (k, 3) round each curved patch, by its number: of a whole cylinder, round half of it.

    Scans that see opposite sides of a column lie apart along a normal that both share.
    """
    found = {}
    for patch in np.flatnonzero(shapes.bend > 0.0).tolist():
        half = min(0.5 * shapes.width[patch] * shapes.bend[patch], 0.5 * np.pi)
        angle = np.linspace(-half, half, N_ROUND)[:, None]
        found[patch] = np.cos(angle) * shapes.normal[patch] + np.sin(angle) * shapes.across[patch]
    return found


def write_ranges(
    found: Disagreement,
    normal: Floats,
    round_about: Mapping[int, Floats],
    views: Floats,
    window: Window,
    covariance: Floats,
) -> None:
    """Write the disagreement of the patches that a window answers for.

    Parameters
    ----------
    found : Disagreement
        Of all patches.
    normal : (m, 3) float64
        Of all patches.
    round_about : mapping
        Normals of curved patches, as :func:`normals_round` gives them: the largest range along these is theirs.
    views : (r, 8) float64
        Of those patches, as :func:`mapq.kernels.scan_views.find_views` gives them.
    window : Window
        With the motions that were fitted.
    covariance : (6s, 6s) float64
        Of the motions.
    """
    number = views[:, PATCH].astype(np.int64)
    patch, first = np.unique(number, return_index=True)
    first, bent = np.append(first, len(views)).astype(np.int64), bent_by(views)
    ranges = _ranges_along(normal[number], views, first, window, covariance, bent)
    for place in np.flatnonzero(np.isin(patch, list(round_about))).tolist():
        own = views[first[place] : first[place + 1]]
        several = np.concatenate(
            [
                _ranges_along(np.tile(each, (len(own), 1)), own, np.array([0, len(own)]), window, covariance, bent)
                for each in round_about[int(patch[place])]
            ]
        )
        ranges[place] = several[several[:, :, 0].argmax(axis=0), np.arange(several.shape[1])]
    apart, variance, n_scans = np.moveaxis(ranges, 2, 0)
    error = IN_BOUNDS * np.sqrt(variance + 2.0 * (FLOOR**2 + (OF_BENT * bent) ** 2))
    low, high = np.where(n_scans >= 2, apart - error, 0.0), apart + error
    judged = n_scans[:, 1] >= 2
    found.n_scans[patch] = n_scans[:, 1]
    found.metres[patch[judged]] = apart[judged, 1]
    found.low[patch[judged]] = np.maximum(low[judged, :2].min(axis=1), 0.0)
    found.high[patch[judged]] = high[judged, 1:].max(axis=1)


def _ranges_along(
    normal: Floats, views: Floats, first: Ints, window: Window, covariance: Floats, bent: float
) -> Floats:
    """Return ranges of offsets along normals (r, 3) of views, as :func:`ranges_of_patches` does, for three `least`."""
    scan = np.searchsorted(window.scans, views[:, MOMENT]).astype(np.int64)
    jacobian = np.ascontiguousarray(jacobian_of(normal, views[:, PLACE], window.centre))
    n_points, least = np.ascontiguousarray(views[:, N_POINTS]), np.array([SURE, ENOUGH, UNSURE])
    motions = jacobian, window.motion, covariance
    return np.asarray(ranges_of_patches(first, scan, n_points, *motions, least, ALIKE * bent))


def bent_by(views: Floats) -> float:
    """Return the standard deviation in metres by which scans have patches otherwise than their motions say.

    Robust, of views (r, 8) of ten points or more, less what the noise of these makes of a mean; drawn towards `BENT`.
    """
    some = views[views[:, N_POINTS] >= ENOUGH]
    if not len(some):
        return BENT
    by_noise = float(np.median(np.maximum(some[:, SCATTER], 0.0) / some[:, N_POINTS]))
    square = max(float(np.median(some[:, HEIGHT] ** 2)) / HALF_OF_SQUARES - by_noise, 0.0)
    return float(np.sqrt((len(some) * square + BENT_VIEWS * BENT**2) / (len(some) + BENT_VIEWS)))
