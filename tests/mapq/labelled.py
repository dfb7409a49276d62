"""Small labelled maps for tests of whole verbs: walls in a row, some of them drawn twice and shifted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mapq.labels import FROM_FIELD
from mapq.patches import Patches
from tests.mapq.factories import Rectangle, sample_patches, wall


def draw_walls(seed: int, n_walls: int = 24) -> tuple[list[Rectangle], np.ndarray]:
    """Return walls along streets 12 m apart, and which (m,) belong to a pair of copies 0.4 m apart."""
    rng = np.random.default_rng(seed)
    walls, double = [], []
    for number in range(n_walls):
        x, y = 14.0 * (number % 6), 12.0 * (number // 6)
        walls.append(wall((x, y), (x + 10.0, y + rng.uniform(-0.5, 0.5)), 4.0))
        bad = number % 6 in (4, 5)
        double.append(bad)
        if bad:
            walls.append(wall((x, y + 0.4), (x + 10.0, y + 0.4 + rng.uniform(-0.3, 0.3)), 4.0))
            double.append(True)
    return walls, np.array(double)


def draw_patches(seed: int, n_walls: int = 24, labelled: bool = True) -> Patches:
    """Return the patches of such walls with point field truth, labelled with it unless told otherwise."""
    walls, double = draw_walls(seed, n_walls)
    patches = sample_patches(walls, seed, density=6.0)
    truth = double[patches.patch].astype(np.uint8)
    patches = replace(patches, cloud=patches.cloud.with_fields(intensity=np.arange(len(truth)), truth=truth))
    if not labelled:
        return patches
    label = double.astype(np.uint8)
    return replace(patches, label=label, label_source=np.full(len(label), FROM_FIELD, np.uint8))
