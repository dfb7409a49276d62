"""The part of a report that holds the trajectory beside the truth: figures and two diagrams."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from prf.configuration import ReadingOptions
from prf.poses.truth import FEWEST, TrueErrors
from prf.readings.poses import true_poses
from prf.results import RunData
from prf.shell.cli.page import escape
from prf.shell.errors import InputError

WIDE, HIGH, LEFT, BELOW = 720, 240, 84, 28  # of a diagram, and its margins, in its own units

Floats = NDArray[np.float64]


def true_errors(run: RunData, path: str) -> TrueErrors:
    """Return the errors of the poses that a run sampled, by a file of true ones; InputError where there are none."""
    found = run.trajectory
    if found is None or not len(found.draws):
        raise InputError(f"{run.name}: no poses were sampled, so there are none to compare with --truth. Leave it out.")
    true = true_poses(path, found.scan, found.time, ReadingOptions().pose_gap)
    if np.isfinite(true[:, 0]).sum() < FEWEST:
        raise InputError(
            f"{path}: fewer than {FEWEST} scans of {run.name} have a true pose. Give one a scan, or times."
        )
    return TrueErrors.of(found, true, path)


def truth_section(found: TrueErrors | None) -> str:
    """Return the part as markup; empty without it."""
    if found is None:
        return ""
    absolute = _diagram(
        "Absolute error of each pose", found.scan, {"error": found.place, "95 %, as stated": found.radius}
    )
    relative = _diagram("Error of each step, from scan to scan", found.scan, {"error": found.step})
    note = (
        "Absolute errors are those left when the posterior mean of the trajectory is moved and turned as a whole to "
        "where it fits the truth best. Dashed: the long half axis of the ellipse that holds each pose at 95\u00a0%."
    )
    return (
        f'<section class="panel wide" id="truth"><h2>Beside the truth</h2><p>{escape(found.words())}. '
        f'Truth: {escape(found.source)}.</p><div class="diagrams">{absolute}{relative}</div>'
        f'<p class="note">{note}</p></section>'
    )


def _diagram(title: str, scan: NDArray[np.int64], lines: dict[str, Floats]) -> str:
    """Return a diagram of lines, metres, over numbers of scans (k,); one of fewer values ends with the last scan."""
    most = max(float(values.max(initial=0.0)) for values in lines.values()) or 1.0
    step = 10.0 ** np.floor(np.log10(most))
    step *= 2.0 if most / step > 5.0 else 1.0 if most / step > 2.0 else 0.5
    first, last = int(scan[0]), int(scan[-1])
    x = LEFT + (WIDE - LEFT) * (scan - first) / max(last - first, 1)
    marks = [
        f'<path class="grid" d="M{LEFT} {_height(y, most)}H{WIDE}"/>'
        f'<text x="{LEFT - 6}" y="{_height(y, most) + 4}" text-anchor="end">{y:.3g} m</text>'
        for y in np.arange(0.0, most * 1.001, step).tolist()
    ]
    ends = [
        f'<text x="{at}" y="{HIGH - 4}" text-anchor="{side}">scan {number}</text>'
        for at, side, number in ((LEFT, "start", first), (WIDE, "end", last))
    ]
    drawn = []
    for k, values in enumerate(lines.values()):
        places = [f"{a:.1f} {_height(b, most)}" for a, b in zip(x[len(x) - len(values) :], values, strict=True)]
        drawn += [f'<path class="line{k}" d="M{"L".join(places)}"/>'] if places else []
    key = "".join(f'<span class="keep"><i class="line{k}"></i>{name}</span> ' for k, name in enumerate(lines))
    picture = (
        f'<svg viewBox="0 0 {WIDE} {HIGH}" role="img" aria-label="{title}">{"".join([*marks, *ends, *drawn])}</svg>'
    )
    return f'<figure class="diagram"><figcaption>{title} <small>{key}</small></figcaption>{picture}</figure>'


def _height(value: float, most: float) -> float:
    return round(HIGH - BELOW - (HIGH - BELOW - 8) * value / most, 1)
