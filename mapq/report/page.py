"""`write_report`: one file of HTML that needs nothing else."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import PurePath
from typing import Any, NamedTuple

from mapq import __version__
from mapq.report.findings import MAX_REGIONS, Findings, Shown
from mapq.report.histogram import histogram, histogram_svg
from mapq.report.markup import (
    VIEWS,
    asset,
    escape,
    fill,
    packed,
    packed_json,
    script_sources,
    script_tags,
)
from mapq.report.scene import Scene, build_scene
from mapq.report.words import facts, map_table, origin_table, percent, region_table, verdict_line
from prf.shell.files import encoded, open_output

MAX_POINTS = 120_000
"""Default of the points that the views show: a laptop turns so many smoothly."""

MEASURES = ("n_points", "area_m2", "width_m", "height_m", "rms_m", "thickness_m", "tilt_deg", "difference")
"""Numbers of a patch that the page has beside label, probability and place."""
DIGITS = 5
"""Significant digits of numbers in a page."""


class Written(NamedTuple):
    """Size of a report."""

    n_bytes: int
    n_shown: int  # points that the views show, and those of the map
    n_points: int
    n_outlines: int  # patches with an outline


def write_report(path: str, findings: Findings, title: str | None = None, max_points: int = MAX_POINTS) -> Written:
    """Write the report on a result, whole or not at all; ``-`` is standard output.

    `findings`: of :func:`mapq.report.read_findings`. `title`: instead of the name of the file. `max_points`: points
    shown, about. Raises OutputError if it cannot be written.
    """
    scripts = [*map(asset, VIEWS), asset("report.js")]
    shown = findings.shown()
    scene = build_scene(findings.cloud.xyz, shown.patch, shown.normal, shown.label, max_points)._replace(
        n_points=findings.n_points
    )
    text = _page(findings, shown, scene, title or PurePath(findings.path).name, scripts)
    with open_output(path) as stream:
        stream.write(text)
    n_outlines = int((scene.corner_start[1:] > scene.corner_start[:-1]).sum())
    return Written(len(encoded(text)), len(scene.points), scene.n_points, n_outlines)


def _page(findings: Findings, shown: Shown, scene: Scene, title: str, scripts: list[str]) -> str:
    head, content = scene.pack()
    sums, unit = histogram(findings.probability, findings.label, findings.area)
    return fill(
        asset("report.html"),
        {
            "title": escape(title),
            "policy": f"default-src 'none'; script-src {script_sources(scripts)}; style-src 'unsafe-inline'; "
            "img-src data: blob:; base-uri 'none'; form-action 'none'",
            "style": asset("common.css") + asset("report.css"),
            "verdict": verdict_line(findings),
            "facts": facts(findings),
            "map": map_table(findings),
            "histogram": histogram_svg(sums, unit, findings.threshold),
            "unit": unit,
            "share": percent(findings.part("counts").get("share_of_area")),
            "shown": f"{len(scene.points):,} of {scene.n_points:,} points shown, evenly spread",
            "regions": region_table(findings),
            "made": origin_table(findings),
            "version": escape(__version__),
            "data": packed_json(page_data(findings, shown, head)),
            "scene": packed(content),
            "scripts": script_tags(scripts),
        },
    )


def page_data(findings: Findings, shown: Shown, scene: Mapping[str, Any]) -> dict[str, Any]:
    """Return the data of the scripts: columns of numbers and words of the patches listed (docs/report.md).

    The two groups of others (:class:`Shown`) are last; they have a label and a probability and nothing else.
    """
    shift = (findings.cloud.shift * findings.cloud.unit).tolist()
    rows: list[Mapping[str, Any]] = [*findings.rows, *[{}] * (len(shown.label) - len(findings.rows))]
    return {
        "scene": scene,
        "threshold": findings.threshold,
        "shift": shift if any(shift) else None,
        "number": findings.number,
        "others": shown.others,
        "label": shown.label,
        "p": [_short(value) for value in shown.probability.tolist()],
        "measures": {name: [_short(row.get(name)) for row in rows] for name in MEASURES},
        "apart": [[_short(row.get(name), 3) for name in ("disagreement_m", "low", "high")] for row in rows],
        "centre": [[_short(x, 9) for x in findings.local(row.get("centroid"))] for row in rows],
        "normal": [[_short(x, 4) for x in row] for row in shown.normal.tolist()],
        "region": [row.get("region") for row in rows],
        "cause": [_cause(row) for row in rows],
        "reasons": [list(_reasons(row)) for row in rows],
        "regions": [
            {"patches": row.get("patches"), "box": _box(findings, row)} for row in findings.regions[:MAX_REGIONS]
        ],
    }


def _short(value: Any, digits: int = DIGITS) -> Any:
    """Return a number with a few significant digits; anything else is null."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    return value if isinstance(value, int) else float(f"{value:.{digits}g}")


def _cause(row: Mapping[str, Any]) -> list[str] | None:
    cause = row.get("cause")
    return [str(cause.get("kind")), str(cause.get("text"))] if isinstance(cause, dict) else None


def _reasons(row: Mapping[str, Any]) -> Iterator[list[Any]]:
    """Yield the reasons of a patch: words, log-odds, the other patch."""
    for reason in row.get("reasons") or ():
        if isinstance(reason, dict):
            yield [str(reason.get("text")), _short(reason.get("log_odds"), 3), reason.get("other")]


def _box(findings: Findings, region: Mapping[str, Any]) -> list[list[Any]]:
    return [[_short(x, 9) for x in findings.local(region.get(name))] for name in ("low", "high")]
