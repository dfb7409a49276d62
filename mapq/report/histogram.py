"""How much of a map has which probability, as a drawing in SVG that takes its colours from the page."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mapq.patches import SUSPICIOUS

N_BINS = 20
WIDTH, HEIGHT, LEFT, BOTTOM, TOP = 460.0, 150.0, 46.0, 18.0, 8.0
"""Pixels: of the drawing, and what axes and their words take of it."""

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
    top = _round_up(float(sums.sum(axis=0).max(initial=0.0)))
    inner, high = WIDTH - LEFT - 10.0, HEIGHT - BOTTOM - TOP
    parts = [f'<line class="axis" x1="{LEFT}" x2="{WIDTH - 10}" y1="{TOP + high}" y2="{TOP + high}"/>']
    for share in (0.0, 0.5, 1.0):
        y = TOP + high * (1.0 - share)
        parts.append(f'<line class="grid" x1="{LEFT}" x2="{WIDTH - 10}" y1="{y:.1f}" y2="{y:.1f}"/>')
        parts.append(f'<text x="{LEFT - 6}" y="{y + 4:.1f}" text-anchor="end">{share * top:,.4g}</text>')
    for index, (good, bad) in enumerate(sums.T.tolist()):
        x, wide = LEFT + inner * index / N_BINS, inner / N_BINS - 2.0
        foot = TOP + high
        for kind, value in (("plausible", good), ("suspicious", bad)):
            tall = high * value / top
            foot -= tall
            parts.append(
                f'<rect class="{kind}" x="{x + 1:.1f}" y="{foot:.1f}" width="{wide:.1f}" height="{tall:.1f}">'
                f"<title>p {index / N_BINS:.2f} to {(index + 1) / N_BINS:.2f}: {value:,.4g} {unit} {kind}</title>"
                "</rect>"
            )
    for share in (0.0, 0.25, 0.5, 0.75, 1.0):
        parts.append(
            f'<text x="{LEFT + inner * share:.1f}" y="{TOP + high + 15}" text-anchor="middle">{share:g}</text>'
        )
    if np.isfinite(threshold):
        at = LEFT + inner * min(max(threshold, 0.0), 1.0)
        parts.append(f'<line class="threshold" x1="{at:.1f}" x2="{at:.1f}" y1="{TOP}" y2="{TOP + high}"/>')
    good, bad = sums.sum(axis=1).tolist()
    spoken = f"Histogram of probabilities: {good:,.0f} {unit} plausible, {bad:,.0f} {unit} suspicious"
    return f'<svg role="img" aria-label="{spoken}" viewBox="0 0 {WIDTH:g} {HEIGHT:g}">{"".join(parts)}</svg>'


def _round_up(value: float) -> float:
    """Return the next number of 1, 2, 5 times a power of ten, 1 for nothing."""
    if not value > 0.0:
        return 1.0
    power = float(10.0 ** np.floor(np.log10(value)))
    return next(step * power for step in (1.0, 2.0, 5.0, 10.0) if step * power >= value * (1.0 - 1e-12))
