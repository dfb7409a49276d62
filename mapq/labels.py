"""Labels of patches, and what the labels of their points make of them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from prf.shell.errors import InputError

NO_PATCH = -1
"""Patch number of a point that belongs to none."""

PLAUSIBLE, SUSPICIOUS, UNLABELLED = 0, 1, 255
"""Labels of a patch; `UNLABELLED` also marks points without a patch in a result."""

FROM_NOBODY, FROM_FIELD, FROM_HAND = 0, 1, 2
"""Source of a label: those set by hand outrank those of a field."""

LABEL_TOLERANCE = 0.3
"""Metres: what a label of 1 says is farther apart than this, unless PATCHES say otherwise."""

SURE = 0.9
"""Share of a patch's points that must be plausible for a conservative label to call it so."""


def majority_labels(
    patch: NDArray[np.integer], n_patches: int, values: NDArray[Any]
) -> tuple[NDArray[np.uint8], NDArray[np.bool_]]:
    """Return the label (m,) that most points of each patch have, and which patches tie.

    `patch` (n,): patch of each point, `NO_PATCH` for none. `values` (n,): 1 suspicious, 0 plausible, 255 not known;
    other values do not count. A tie of the first two is suspicious: only what is definitely plausible shall be called
    so. A patch of which more points are not known than have the label that it would get, or without a point that
    counts, is `UNLABELLED`.
    """
    return majority_of(votes(patch, n_patches, values))


def votes(patch: NDArray[np.integer], n_patches: int, values: NDArray[Any]) -> NDArray[np.int64]:
    """Return how many points (m, 3) of each patch are plausible, suspicious, and not known; these can be added up."""
    inside = patch != NO_PATCH
    kinds = (PLAUSIBLE, SUSPICIOUS, UNLABELLED)
    return np.column_stack([np.bincount(patch[inside & (values == kind)], minlength=n_patches) for kind in kinds])


def majority_of(counts: NDArray[np.int64]) -> tuple[NDArray[np.uint8], NDArray[np.bool_]]:
    """Return labels (m,) and ties (m,) as :func:`majority_labels`, of votes (m, 3)."""
    plausible, suspicious, not_known = counts.T
    label = np.where(suspicious >= plausible, SUSPICIOUS, PLAUSIBLE)
    most = np.maximum(suspicious, plausible)
    known = (most > 0) & (most >= not_known)
    return np.where(known, label, UNLABELLED).astype(np.uint8), known & (suspicious == plausible)


def are_metres(values: NDArray[Any]) -> bool:
    """Return whether a point field (n,) of labels is metres apart: floats other than 0, 1 and 255."""
    known = values[np.isfinite(values)] if values.dtype.kind == "f" else values[:0]
    return bool(((known >= 0.0) & (known < 255.0) & (known != np.floor(known))).any())


def metres_of(patch: NDArray[np.integer], n_patches: int, values: NDArray[Any]) -> NDArray[np.float64]:
    """Return the median (m,) of a field of metres (n,) over the points of each patch; nan where most are not known."""
    inside = np.flatnonzero((patch != NO_PATCH) & np.isfinite(values))
    order = inside[np.lexsort((values[inside], patch[inside]))]
    n_known = np.bincount(patch[order], minlength=n_patches)
    n_points = np.bincount(patch[patch != NO_PATCH], minlength=n_patches)
    start = np.cumsum(n_known) - n_known
    enough = (n_known > 0) & (2 * n_known >= n_points)
    found = np.full(n_patches, np.nan)
    found[enough] = values[order[start[enough] + n_known[enough] // 2]]
    return found


def truth_values(
    fields: Mapping[str, NDArray[Any]],
    name: str,
    patch: NDArray[np.integer],
    where: str,
    tolerance: float = LABEL_TOLERANCE,
) -> NDArray[Any]:
    """Return the labels (n,) of points in field `name` of file `where`: 0, 1, or 255 without a label, as is nan.

    A field of other floats is metres apart, of which more than `tolerance` is 1.

    Raises InputError if there is no such field, it is not one number a point, or a point of a patch has another value.
    """
    if name not in fields:
        known = ", ".join(fields) or "none"
        raise InputError(f"{where}: no point field {name}; there are {known}.")
    values = np.asarray(fields[name])
    if values.ndim != 1:
        raise InputError(f"{where}: field {name} has {values.shape[1]} numbers a point; expected one.")
    if are_metres(values):
        if (values < 0.0).any():
            raise InputError(f"{where}: field {name} has metres below 0, such as {values[values < 0.0][0]:g}.")
        return np.where(np.isnan(values), UNLABELLED, np.where(values > tolerance, SUSPICIOUS, PLAUSIBLE))
    if values.dtype.kind == "f":
        values = np.where(np.isnan(values), UNLABELLED, values)
    strange = ~np.isin(values, (PLAUSIBLE, SUSPICIOUS, UNLABELLED)) & (patch != NO_PATCH)
    if strange.any():
        example = values[strange][0]
        raise InputError(
            f"{where}: field {name} must be 0, 1 or 255, but is not at {np.count_nonzero(strange)} points of patches "
            f"(e.g. {example}). Give 1 where suspicious, 0 where plausible, 255 where not known; or metres apart, as "
            "floats."
        )
    return values


def conservative_labels(
    patch: NDArray[np.integer], n_patches: int, values: NDArray[Any]
) -> tuple[NDArray[np.uint8], NDArray[np.bool_]]:
    """Return labels as the paper gives them ("only those planes that are definitely plausible"), and no ties.

    A patch is plausible if `SURE` of its points are; every other one is suspicious, also where nothing is known.
    Parameters as :func:`majority_labels`.
    """
    inside = patch != NO_PATCH
    plausible = np.bincount(patch[inside & (values == PLAUSIBLE)], minlength=n_patches)
    counts = np.bincount(patch[inside], minlength=n_patches)
    label = np.where(plausible >= SURE * np.maximum(counts, 1), PLAUSIBLE, SUSPICIOUS)
    return label.astype(np.uint8), np.zeros(n_patches, np.bool_)
