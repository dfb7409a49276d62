"""Histogram of the area of a map by the probability that it is suspicious, as a drawing of a page."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mapq.labels import SUSPICIOUS

N_BINS = 20
WIDTH, HEIGHT, LEFT, RIGHT, BOTTOM, TOP = 460.0, 150.0, 56.0, 450.0, 132.0, 8.0
"""Pixels: size of the drawing, and where its axes are."""
Floats = NDArray[np.float64]


def histogram(probability: Floats, label: NDArray[np.uint8], area: Floats) -> tuple[Floats, str]:
    """Return the area (2, `N_BINS`) of plausible and suspicious patches by probability, and its name.

    Patches without a probability are left out. Where areas are not known patches are counted.
    """
    known = np.isfinite(probability)
    measured = bool(np.isfinite(area).all())
    weight = area if measured else np.ones(len(label))
    place = np.clip((np.nan_to_num(probability) * N_BINS).astype(np.int64), 0, N_BINS - 1)
    is_bad = label == SUSPICIOUS
    sums = [np.bincount(place[known & kind], weight[known & kind], N_BINS) for kind in (~is_bad, is_bad)]
    return np.array(sums), "m²" if measured else "patches"


def histogram_svg(sums: Floats, unit: str, threshold: float) -> str:
    """Return the drawing of a histogram (2, `N_BINS`); `threshold`: probability from which patches are suspicious."""
    top, high, step = _round_up(float(sums.sum(axis=0).max(initial=0.0))), BOTTOM - TOP, (RIGHT - LEFT) / N_BINS
    parts = [_line("axis", LEFT, RIGHT, BOTTOM, BOTTOM)]
    for share in (0.0, 0.5, 1.0):
        y = BOTTOM - high * share
        parts.append(_line("grid", LEFT, RIGHT, y, y) + _text(LEFT - 6, y + 4, "end", f"{share * top:,.9g}"))
    for index, counts in enumerate(sums.T.tolist()):
        foot = BOTTOM
        for kind, value in zip(("plausible", "suspicious"), counts, strict=True):
            tall = high * value / top
            foot -= tall
            parts.append(
                f'<rect class="{kind}" x="{LEFT + step * index + 1:.1f}" y="{foot:.1f}" width="{step - 2:.1f}" '
                f'height="{tall:.1f}"><title>p {index / N_BINS:.2f} to {(index + 1) / N_BINS:.2f}: {value:,.4g} {unit} '
                f"{kind}</title></rect>"
            )
    for share in (0.0, 0.25, 0.5, 0.75, 1.0):
        parts.append(_text(LEFT + (RIGHT - LEFT) * share, BOTTOM + 15, "middle", f"{share:g}"))
    if np.isfinite(threshold):
        at = LEFT + (RIGHT - LEFT) * threshold
        parts.append(_line("threshold", at, at, TOP, BOTTOM))
    good, bad = sums.sum(axis=1).tolist()
    spoken = f"Histogram of probabilities: {good:,.0f} {unit} plausible, {bad:,.0f} {unit} suspicious"
    return f'<svg role="img" aria-label="{spoken}" viewBox="0 0 {WIDTH:g} {HEIGHT:g}">{"".join(parts)}</svg>'


def _line(kind: str, x1: float, x2: float, y1: float, y2: float) -> str:
    return f'<line class="{kind}" x1="{x1:.1f}" x2="{x2:.1f}" y1="{y1:.1f}" y2="{y2:.1f}"/>'


def _text(x: float, y: float, anchor: str, text: str) -> str:
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}">{text}</text>'


def _round_up(value: float) -> float:
    """Return the next number of 1, 2, 5 times a power of ten, 1 for nothing."""
    if not value > 0.0:
        return 1.0
    power = float(10.0 ** np.floor(np.log10(value)))
    return next(step * power for step in (1.0, 2.0, 5.0, 10.0) if step * power >= value * (1.0 - 1e-12))
