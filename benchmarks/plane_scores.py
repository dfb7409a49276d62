"""Scores of a segmentation against true planes, in the words of EVOPS (Kornilova et al. 2022, arXiv 2204.05799)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.cloud import PointCloud
from prf.shell.errors import InputError

OVERLAP = 0.5
"""Share of a plane's points on another by which the one counts as part of the other."""


class SegmentationScore(NamedTuple):
    """How patches agree with true planes."""

    # true planes, patches, and pairs of them whose IoU is above the threshold; above 1/2 no plane has two
    n_planes: int
    n_patches: int
    n_matched: int
    precision: float  # shares of the patches, and of the planes, that are matched; nan without any
    recall: float
    mean_iou: float  # over true planes, of each with its best patch: 0 where no patch touches it
    mean_dice: float
    over_segmented: int  # planes that most of two or more patches lie on
    under_segmented: int  # patches that most of two or more planes lie on
    missed: int  # planes no patch of which covers a share of :data:`OVERLAP`, nor several together
    noise: int  # patches that lie with less than that share on any one plane, and hold no such share of one
    plane: NDArray[np.int64]  # (n_planes,) the numbers of the planes, ascending
    plane_points: NDArray[np.int64]  # (n_planes,)
    iou: NDArray[np.float64]  # (n_planes,) of each plane with its best patch
    best_patch: NDArray[np.int64]  # (n_planes,) that patch, -1 for none


def truth_of(cloud: PointCloud, name: str) -> NDArray[np.int64]:
    """Return the true plane (n,) of each point from a field of whole numbers, negative for none.

    Raises InputError if the cloud has no such field, or it holds anything but one whole number a point.
    """
    if name not in cloud.fields:
        known = ", ".join(cloud.fields) or "none"
        raise InputError(f"{cloud.source}: no field {name!r}; it has: {known}.")
    values = cloud.fields[name]
    if values.ndim != 1 or values.dtype.kind not in "iufb":
        raise InputError(f"{cloud.source}: field {name!r} is not one number a point.")
    wide = values.astype(np.float64)
    if not (np.isfinite(wide) & (wide == np.floor(wide))).all():
        raise InputError(f"{cloud.source}: field {name!r} must hold whole numbers, the numbers of planes.")
    return wide.astype(np.int64)


def score_segmentation(
    patch: NDArray[np.int32], truth: NDArray[np.integer], min_iou: float = 0.75
) -> SegmentationScore:
    """Return how the patches of points (n,) agree with the planes (n,) they truly lie on.

    `patch` and `truth` (n,): numbers of patches and planes; negative for none. `min_iou`: above this intersection over
    union (points) a patch and a plane are a match; at least 0.5. Raises InputError if the lengths differ, or there is
    no true plane.
    """
    if patch.shape != truth.shape:
        raise InputError(f"{len(patch)} patch numbers and {len(truth)} true planes: one of each a point is needed.")
    planes, plane_of = _numbered(truth)
    patches, patch_of = _numbered(patch)
    if len(planes) == 0:
        raise InputError("no point has a true plane: every number is negative.")
    shared = _shared(plane_of, patch_of, len(patches))
    n_plane = np.bincount(plane_of[plane_of >= 0], minlength=len(planes))
    n_patch = np.bincount(patch_of[patch_of >= 0], minlength=len(patches))
    return _scores(planes, patches, shared, n_plane, n_patch, min_iou)


class _Shared(NamedTuple):
    """Points in both a plane and a patch, for each pair that has any."""

    plane: NDArray[np.int64]
    patch: NDArray[np.int64]
    n: NDArray[np.int64]


def _numbered(values: NDArray[np.integer]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the distinct numbers that are not negative, and the place (n,) of each value among them, -1 for none."""
    known = values >= 0
    distinct, places = np.unique(values[known].astype(np.int64), return_inverse=True)
    out = np.full(len(values), -1, np.int64)
    out[known] = places
    return distinct, out


def _shared(plane_of: NDArray[np.int64], patch_of: NDArray[np.int64], n_patches: int) -> _Shared:
    both = (plane_of >= 0) & (patch_of >= 0)
    pairs, n = np.unique(plane_of[both] * max(n_patches, 1) + patch_of[both], return_counts=True)
    return _Shared(pairs // max(n_patches, 1), pairs % max(n_patches, 1), n.astype(np.int64))


def _scores(
    planes: NDArray[np.int64],
    patches: NDArray[np.int64],
    shared: _Shared,
    n_plane: NDArray[np.int64],
    n_patch: NDArray[np.int64],
    min_iou: float,
) -> SegmentationScore:
    together = n_plane[shared.plane] + n_patch[shared.patch]
    iou = shared.n / (together - shared.n)
    best_iou, best_dice, best = np.zeros(len(planes)), np.zeros(len(planes)), np.full(len(planes), -1, np.int64)
    order = np.lexsort((-shared.patch, iou))
    best_iou[shared.plane[order]] = iou[order]
    best_dice[shared.plane[order]] = 2.0 * shared.n[order] / together[order]
    best[shared.plane[order]] = patches[shared.patch[order]]
    on_plane = shared.n > OVERLAP * n_patch[shared.patch]
    on_patch = shared.n > OVERLAP * n_plane[shared.plane]
    pieces = np.bincount(shared.plane[on_plane], minlength=len(planes))
    joined = np.bincount(shared.patch[on_patch], minlength=len(patches))
    covered = np.bincount(shared.plane[on_plane], weights=shared.n[on_plane], minlength=len(planes)) > OVERLAP * n_plane
    covered[shared.plane[on_patch]] = True
    n_matched = int(np.count_nonzero(best_iou > min_iou))
    return SegmentationScore(
        n_planes=len(planes),
        n_patches=len(patches),
        n_matched=n_matched,
        precision=n_matched / len(patches) if len(patches) else float("nan"),
        recall=n_matched / len(planes),
        mean_iou=float(best_iou.mean()),
        mean_dice=float(best_dice.mean()),
        over_segmented=int(np.count_nonzero(pieces > 1)),
        under_segmented=int(np.count_nonzero(joined > 1)),
        missed=int(np.count_nonzero(~covered)),
        noise=int(len(patches) - len(np.unique(shared.patch[on_plane | on_patch]))),
        plane=planes,
        plane_points=n_plane.astype(np.int64),
        iou=best_iou,
        best_patch=best,
    )
