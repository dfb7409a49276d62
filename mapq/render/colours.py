"""Colours of points: by label, by probability, by patch. Blue and red stay apart for colour-blind readers."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.patches import NO_PATCH, PLAUSIBLE, SUSPICIOUS

PLAUSIBLE_RGB = (0.10, 0.36, 0.72)
SUSPICIOUS_RGB = (0.84, 0.10, 0.11)
UNLABELLED_RGB = (0.55, 0.58, 0.60)
BACKGROUND_RGB = (0.83, 0.84, 0.85)
"""Points without a patch: there for orientation, not to be looked at."""
DOUBTFUL_RGB = (0.93, 0.90, 0.80)
"""Half way between plausible and suspicious."""

GOLDEN_RATIO = 0.6180339887498949
"""Its multiples spread hues so that patches of close numbers differ."""


class Scheme(NamedTuple):
    """Colours of points and what they mean."""

    rgb: NDArray[np.float32]  # (n, 3)
    layer: NDArray[np.uint8]  # (n,) points of a higher layer are drawn over those of a lower one in plan view
    legend: tuple[tuple[str, tuple[float, float, float]], ...]


def label_colours(label: NDArray[np.uint8], patch: NDArray[np.int32]) -> Scheme:
    """Return the colours of points by the label (n,) of their patch (n,): blue, red, grey."""
    rgb = np.empty((len(label), 3), np.float32)
    rgb[:] = UNLABELLED_RGB
    rgb[label == PLAUSIBLE] = PLAUSIBLE_RGB
    rgb[label == SUSPICIOUS] = SUSPICIOUS_RGB
    rgb[patch == NO_PATCH] = BACKGROUND_RGB
    layer = np.where(patch == NO_PATCH, 0, np.where(label == SUSPICIOUS, 2, 1)).astype(np.uint8)
    legend = [("plausible", PLAUSIBLE_RGB), ("suspicious", SUSPICIOUS_RGB), ("no patch", BACKGROUND_RGB)]
    if np.any((patch != NO_PATCH) & (label != PLAUSIBLE) & (label != SUSPICIOUS)):
        legend.insert(2, ("unlabelled", UNLABELLED_RGB))
    return Scheme(rgb, layer, tuple(legend))


def probability_colours(probability: NDArray[np.floating], patch: NDArray[np.int32]) -> Scheme:
    """Return the colours of points by the probability (n,) that their patch is suspicious: blue over pale to red."""
    share = np.clip(np.nan_to_num(probability.astype(np.float32), nan=0.0), 0.0, 1.0)[:, None]
    ends = np.where(share < 0.5, np.array(PLAUSIBLE_RGB, np.float32), np.array(SUSPICIOUS_RGB, np.float32))
    sureness = np.abs(2.0 * share - 1.0)
    rgb = (sureness * ends + (1.0 - sureness) * np.array(DOUBTFUL_RGB, np.float32)).astype(np.float32)
    rgb[patch == NO_PATCH] = BACKGROUND_RGB
    layer = np.where(patch == NO_PATCH, 0, 1 + (share[:, 0] > 0.5)).astype(np.uint8)
    legend = (
        ("surely plausible", PLAUSIBLE_RGB),
        ("doubtful", DOUBTFUL_RGB),
        ("surely suspicious", SUSPICIOUS_RGB),
        ("no patch", BACKGROUND_RGB),
    )
    return Scheme(rgb, layer, legend)


def patch_colours(patch: NDArray[np.int32]) -> Scheme:
    """Return one colour a patch, spread over the hues, so that neighbours differ."""
    hue = np.mod(patch.astype(np.float64) * GOLDEN_RATIO, 1.0)
    value = 0.55 + 0.35 * np.mod(patch.astype(np.float64) * GOLDEN_RATIO**2, 1.0)
    turns = hue[:, None] + np.array([0.0, 2.0 / 3.0, 1.0 / 3.0])
    wave = np.clip(np.abs(6.0 * np.mod(turns, 1.0) - 3.0) - 1.0, 0.0, 1.0)
    rgb = (value[:, None] * (0.15 + 0.85 * wave)).astype(np.float32)
    rgb[patch == NO_PATCH] = BACKGROUND_RGB
    return Scheme(rgb, (patch != NO_PATCH).astype(np.uint8), (("no patch", BACKGROUND_RGB),))
