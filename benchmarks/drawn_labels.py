"""Labels of fewer patches, as if a person had labelled some places of a map only."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from mapq.labels import UNLABELLED
from mapq.patches import Patches
from mapq.training import SMALLEST_REGION, regions_of

PIECES = 10
"""A limited number of patches is drawn as so many regions or a few more: each a place with its neighbours."""


def draw_labels(maps: Sequence[Patches], n_most: int, seed: int) -> list[NDArray[np.uint8]]:
    """Return the labels of each map with all but `n_most` hidden: those of regions drawn at random."""
    labels = [patches.label.copy() for patches in maps]
    regions = regions_of(maps, labels, max(SMALLEST_REGION, n_most // PIECES))
    pieces = []
    for number, (label, region) in enumerate(zip(labels, regions, strict=True)):
        known = np.flatnonzero(label != UNLABELLED)
        pieces += [(number, known[region[known] == index]) for index in np.unique(region[known])]
    left = n_most
    for place in np.random.default_rng(seed).permutation(len(pieces)).tolist():
        number, members = pieces[place]
        labels[number][members[left:]] = UNLABELLED
        left = max(0, left - len(members))
    return labels
