"""Which patch a person is asked about next."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def most_uncertain_first(
    counts: NDArray[np.int64], probability: NDArray[np.floating] | None, has_label: NDArray[np.bool_]
) -> NDArray[np.int64]:
    """Return the patches (m,) in the order in which to label them.

    Parameters
    ----------
    counts : (m,) int64
        Points of each patch: of equally uncertain ones the larger comes first.
    probability : (m,) float, optional
        That each is suspicious. A half is most uncertain; without probabilities the largest patch comes first.
    has_label : (m,) bool
        Patches with a label come after all others.
    """
    doubt = np.zeros(len(counts)) if probability is None else np.abs(np.nan_to_num(probability, nan=0.5) - 0.5)
    return np.lexsort((-counts, doubt, has_label)).astype(np.int64)
