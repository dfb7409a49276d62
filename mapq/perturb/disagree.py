"""By how much scans that see the same surface disagree along its normal, where the right poses are known."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.perturb.surfaces import Surfaces

Floats = NDArray[np.float64]


class Disagreement(NamedTuple):
    """What is known of each point.

    Attributes
    ----------
    metres : (n,) float64
        Along the normal, from the scan that disagrees most; 0 where one scan alone saw the surface; nan where it is
        not known.
    n_others : (n,) int64
        Other scans that see the same surface.
    """

    metres: Floats
    n_others: NDArray[np.int64]


def known_disagreement(surfaces: Surfaces, right: Floats, used: Floats, agree: float) -> Disagreement:
    """Return how far apart the poses that are used put what is one place under the right poses.

    At an element each scan b puts the place x of the right map at ``used_b inv(right_b) x``. The differences between
    scans are taken along the mean of the normal as the scans turn it: errors of poses, not of the whole frame.
    Elements without a plane have no normal; there the distance itself is a bound, which says that scans agree where it
    is below `agree`, and nothing else.

    Parameters
    ----------
    surfaces : Surfaces
    right, used : (k, 4, 4) float64
    agree : float
        Metres.
    """
    moved = used @ np.linalg.inv(right)
    n_elements = len(surfaces.place)
    at, by = surfaces.seen_at, surfaces.seen_by
    normal = _mean_normal(surfaces, moved)
    # Rows of `at` that are not in `seen` compare themselves with those that are.
    low, high = np.full((n_elements, 3), np.inf), np.full((n_elements, 3), -np.inf)
    along_low, along_high = np.full(n_elements, np.inf), np.full(n_elements, -np.inf)
    seen_place = _put(moved, by, surfaces.place[at]) - surfaces.place[at]
    seen_along = np.einsum("ij,ij->i", seen_place, normal[at])
    np.minimum.at(low, at, seen_place)
    np.maximum.at(high, at, seen_place)
    np.minimum.at(along_low, at, seen_along)
    np.maximum.at(along_high, at, seen_along)
    at, by = surfaces.at, surfaces.by
    place = _put(moved, by, surfaces.place[at]) - surfaces.place[at]
    along = np.einsum("ij,ij->i", place, normal[at])
    # A scan that is alone in an element, or has too few points to count, still agrees with itself.
    metres = np.maximum(0.0, np.maximum(along - along_low[at], along_high[at] - along))
    bound = np.linalg.norm(np.maximum(0.0, np.maximum(place - low[at], high[at] - place)), axis=1)
    rough = np.where(bound < agree, bound, np.nan)
    n_seen = np.bincount(surfaces.seen_at, minlength=n_elements)[at]
    itself = np.isin(at * len(right) + by, surfaces.seen_at * len(right) + surfaces.seen_by)
    n_others = n_seen - itself
    value = np.where(n_others == 0, 0.0, np.where(surfaces.flat[at], metres, rough))
    return Disagreement(value[surfaces.entry], n_others[surfaces.entry])


def _put(moved: Floats, scan: NDArray[np.int64], place: Floats) -> Floats:
    """Return where scans (e,) put places (e, 3)."""
    return np.asarray(np.einsum("eij,ej->ei", moved[scan, :3, :3], place) + moved[scan, :3, 3])


def _mean_normal(surfaces: Surfaces, moved: Floats) -> Floats:
    """Return the unit normals (m, 3) as the scans at each element turn them, in the mean."""
    turned = np.einsum("eij,ej->ei", moved[surfaces.by, :3, :3], surfaces.normal[surfaces.at])
    total = np.stack([np.bincount(surfaces.at, column, len(surfaces.place)) for column in turned.T], axis=1)
    return np.asarray(total / np.maximum(np.linalg.norm(total, axis=1), np.finfo(float).tiny)[:, None])
