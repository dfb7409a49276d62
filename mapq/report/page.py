"""`write_report`: one file of HTML that needs nothing else."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import PurePath
from typing import Any, NamedTuple

from mapq.report.findings import MAX_REGIONS, Findings
from mapq.report.histogram import histogram, histogram_svg
from mapq.report.scene import VIEWS, Scene, build_scene
from mapq.report.words import facts, map_table, origin_table, percent, region_table, verdict_line
from prf.shell.cli.files import encoded, open_output
from prf.shell.cli.page.markup import escape, packed, packed_json, page

MAX_POINTS = 120_000
"""Default of the points that the views show: a laptop turns so many smoothly."""
MEASURES = ("n_points", "area_m2", "width_m", "height_m", "rms_m", "thickness_m", "tilt_deg", "difference")
"""Numbers of a patch that the page has beside label, probability and place."""
DIGITS = 5
"""Significant digits of numbers in a page."""


class Written(NamedTuple):
    """Size of a report: bytes, points that the views show, and those of the map."""

    n_bytes: int
    n_shown: int
    n_points: int


def write_report(path: str, findings: Findings, title: str | None = None, max_points: int = MAX_POINTS) -> Written:
    """Write the report on a result, whole or not at all; ``-`` is standard output.

    `title` instead of the name of the file; `max_points`: points shown, about.
    """
    scene = build_scene(findings.cloud.xyz, findings.patch, findings.normal, findings.label, max_points)
    scene = scene._replace(n_points=findings.n_points)
    text = _page(findings, scene, title or PurePath(findings.path).name)
    with open_output(path) as stream:
        stream.write(text)
    return Written(len(encoded(text)), len(scene.points), scene.n_points)


def _page(findings: Findings, scene: Scene, title: str) -> str:
    head, numbers = scene.pack()
    sums, unit = histogram(findings.probability, findings.label, findings.area)
    content = {
        "title": escape(title),
        "verdict": verdict_line(findings),
        "facts": facts(findings),
        "map": map_table(findings),
        "histogram": histogram_svg(sums, unit, findings.threshold),
        "unit": unit,
        "share": percent(findings.part("counts").get("share_of_area")),
        "shown": f"{len(scene.points):,} of {scene.n_points:,} points shown, evenly spread",
        "regions": region_table(findings),
        "made": origin_table(findings),
        "data": packed_json(page_data(findings, head)),
        "scene": packed(numbers),
    }
    return page("mapq.report", "report", content, (*VIEWS, ("mapq.report", "report.js")))[0]


def page_data(findings: Findings, scene: Mapping[str, Any]) -> dict[str, Any]:
    """Return the data of the scripts: label and p of all patches, and columns of those listed (docs/report.md)."""
    shift = (findings.cloud.shift * findings.cloud.unit).tolist()
    rows = list(findings.rows.values())
    return {
        "scene": scene,
        "threshold": findings.threshold,
        "shift": shift if any(shift) else None,
        "label": findings.label,
        "p": _short(findings.probability.tolist()),
        "listed": list(findings.rows),
        "measures": {name: _short([row.get(name) for row in rows]) for name in MEASURES},
        "apart": [_short([row.get(name) for name in ("disagreement_m", "low", "high")], 3) for row in rows],
        "centre": [_short(findings.local(row.get("centroid")), 9) for row in rows],
        "normal": [_short(row["normal"], 4) for row in rows],
        "region": [row.get("region") for row in rows],
        "cause": [[cause["kind"], cause["text"]] if (cause := row.get("cause")) else None for row in rows],
        "reasons": [
            [[each["text"], *_short([each["log_odds"]], 3), each.get("other")] for each in row.get("reasons", ())]
            for row in rows
        ],
        "regions": [region["patches"] for region in findings.regions[:MAX_REGIONS]],
    }


def _short(values: list[Any], digits: int = DIGITS) -> list[Any]:
    """Return numbers with a few significant digits; what is none stays null."""
    return [float(f"{value:.{digits}g}") if isinstance(value, float) else value for value in values]
