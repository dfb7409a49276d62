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


def truth_values(fields: Mapping[str, NDArray[Any]], name: str, patch: NDArray[np.integer], where: str) -> NDArray[Any]:
    """Return the 0/1 point field `name` (n,) of file `where`; 255 is a point without a label.

    Raises InputError if there is no such field, it is not one number a point, or a point of a patch has another value
    or nan.
    """
    if name not in fields:
        known = ", ".join(fields) or "none"
        raise InputError(f"{where}: no point field {name}; there are {known}.")
    values = np.asarray(fields[name])
    if values.ndim != 1:
        raise InputError(f"{where}: field {name} has {values.shape[1]} numbers a point; expected one.")
    strange = ~np.isin(values, (PLAUSIBLE, SUSPICIOUS, UNLABELLED)) & (patch != NO_PATCH)
    if strange.any():
        example = values[strange][0]
        raise InputError(
            f"{where}: field {name} must be 0, 1 or 255, but is not at {np.count_nonzero(strange)} points of patches "
            f"(e.g. {example}). Give 1 where suspicious, 0 where plausible, 255 where not known."
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
