"""What a report says in words and tables: the verdict, the regions, and how the result was made."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from pathlib import PurePath
from typing import Any

from mapq.report.markup import escape, table
from mapq.report.source import MOST_REGIONS, Findings, regions_in

DASH = "–"
"""In the place of what is no number."""


def number(value: Any, digits: int = 1, unit: str = "") -> str:
    """Return a number of a file as text, a dash where it is none."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        return DASH
    return f"{value:,.{digits}f}{unit}"


def percent(value: Any) -> str:
    """Return a share as text, a dash where it is none."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        return DASH
    return f"{100.0 * value:.1f} %"


def part(head: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    """Return an object of the JSON of a result, empty where it is none."""
    found = head.get(name)
    return found if isinstance(found, dict) else {}


def threshold_of(findings: Findings) -> float:
    """Return the probability from which patches are called suspicious."""
    value = part(findings.head, "threshold").get("p_suspicious")
    return float(value) if isinstance(value, int | float) and 0.0 <= value <= 1.0 else 0.5


def verdict_words(findings: Findings) -> tuple[str, str]:
    """Return the verdict in one line, and the lines below it, both as markup."""
    counts, verdict = part(findings.head, "counts"), part(findings.head, "verdict")
    if not len(findings.label):
        return "No plane patch was found: nothing is said of this map.", _facts(findings, counts, verdict)
    share = verdict.get("share_of_area", counts.get("share_of_area"))
    limit = verdict.get("fail_over")
    coverage, least = counts.get("coverage"), verdict.get("min_coverage")
    line = f"<strong>{percent(share)}</strong> of the surface that could be judged is suspicious"
    if percent(coverage) != DASH:
        line += f"; that is {percent(coverage)} of what is flat"
    if limit is not None and verdict.get("passed") is not None:
        state = "passes" if verdict["passed"] is True else "fails"
        asked = f"no more than {percent(limit)} was asked for"
        if percent(coverage) != DASH and percent(least) != DASH:
            asked += f", and {percent(least)} to be judged"
        line += f' <span class="verdict-{state}">{state}: {asked}</span>'
    return line, _facts(findings, counts, verdict)


def _facts(findings: Findings, counts: Mapping[str, Any], verdict: Mapping[str, Any]) -> str:
    """Return facts of the whole map as a list."""
    return (
        "<dl>"
        + "".join(f"<div><dt>{name}</dt><dd>{text}</dd></div>" for name, text in _rows(findings, counts, verdict))
        + "</dl>"
    )


def map_facts(findings: Findings) -> str:
    """Return what the map is, as a table: size, points, and how it was cut."""
    cut = part(part(findings.head, "segmentation"), "parameters")
    some = findings.cloud.xyz[findings.patch >= 0] * findings.cloud.unit
    size = (some.max(axis=0) - some.min(axis=0)).tolist() if len(some) else []
    rows = (
        ("patches reach over", " × ".join(number(length) for length in size) + " m" if size else DASH),
        ("points", number(findings.n_points, 0)),
        ("patches", number(len(findings.label), 0)),
        ("spacing", number(cut.get("spacing"), 3, " m")),
        ("noise", number(cut.get("noise"), 3, " m")),
        ("judged up to", number(cut.get("max_tilt"), 0, "° from upright")),
    )
    return table(("", ""), [("", row) for row in rows], "plain")


def _rows(findings: Findings, counts: Mapping[str, Any], verdict: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    n_regions = len(regions_in(findings.head))
    where = f", in {n_regions} region{'' if n_regions == 1 else 's'}" if n_regions else ""
    yield "area", f"{number(counts.get('area_suspicious_m2'))} of {number(counts.get('area_m2'))} m² suspicious"
    yield "patches", f"{number(counts.get('n_suspicious'), 0)} of {number(len(findings.label), 0)} suspicious{where}"
    # By the JSON, as all else here: of a result in tiles not all points are at hand.
    n_points, n_inside = counts.get("n_points"), counts.get("n_points_in_patches")
    are_counts = isinstance(n_inside, int) and isinstance(n_points, int) and 0 <= n_inside <= n_points
    share = n_inside / n_points if are_counts and n_points else None
    yield "judged", f"{percent(counts.get('coverage'))} of the points that lie on planes of any tilt"
    yield "points", f"{number(n_points, 0)}, {percent(share)} of them in patches; nothing is said of the others"
    if len(findings.rows) < len(findings.label):
        yield (
            "told of",
            f"{len(findings.rows):,} of these patches one by one: those of the regions listed, then suspicious ones, "
            "the surest first, then the largest; the JSON of the result has all",
        )
    yield (
        "expected",
        f"{percent(counts.get('expected_share_of_area'))} of the surface is wrong, if the probabilities are right",
    )
    if verdict.get("cause") is not None and findings.cloud.fields.get("cause") is not None:
        areas = part(verdict, "area_by_cause_m2")
        yield "causes", escape(", ".join(f"{name} {number(value)} m²" for name, value in areas.items() if value))
    if isinstance(verdict.get("scans_apart_m"), float):
        yield (
            "scans apart",
            f"{number(verdict['scans_apart_m'], 3)} m in the median over the area that several scans saw, "
            f"{number(verdict.get('disagreement_m'), 3)} m in the mean",
        )
    if findings.cloud.shift.any():
        shift = ", ".join(f"{value:,.0f}" for value in findings.cloud.shift * findings.cloud.unit)
        yield "global shift", f"{shift} m: views and tables leave it out of coordinates; a selected patch shows both"
    for warning in part(part(findings.head, "segmentation"), "report").get("warnings") or ():
        yield "warning", escape(warning)


def region_table(findings: Findings) -> str:
    """Return the table of regions, worst first."""
    regions = regions_in(findings.head)
    if not regions:
        return (
            "<p>No region: no patch is suspicious.</p>" if not findings.label.any() else "<p>The result lists none.</p>"
        )
    names = ("region", "severity", "area", "patches", "extent", "centre", "surfaces apart", "mean p", "cause")
    units = ("", "m²", "m²", "", "m", "m", "m", "", "")
    head = [name + (f" <small>{unit}</small>" if unit else "") for name, unit in zip(names, units, strict=True)]
    rows = [
        (f' tabindex="0" data-region="{place}"', _region_cells(findings, row))
        for place, row in enumerate(regions[:MOST_REGIONS])
    ]
    more = len(regions) - MOST_REGIONS
    rest = f"<p>And {more} less severe ones, which the JSON of the result lists.</p>" if more > 0 else ""
    return table(head, rows, "list") + rest


def _region_cells(findings: Findings, region: Mapping[str, Any]) -> list[str]:
    low, high, centre = (local(findings, region.get(name)) for name in ("low", "high", "centre"))
    extent = " × ".join(number(b - a) for a, b in zip(low, high, strict=True))
    return [
        number(region.get("region"), 0),
        number(region.get("severity_m2")),
        number(region.get("area_m2")),
        number(region.get("n_patches"), 0),
        extent,
        ", ".join(number(value) for value in centre),
        number(region.get("displacement_m"), 2),
        number(region.get("p_suspicious"), 2),
        escape(region.get("cause") or "–"),
    ]


def local(findings: Findings, place: Any) -> list[float]:
    """Return a place (3) of the JSON in metres without the global shift; nan if it is none."""
    if not isinstance(place, list) or len(place) != 3 or not all(isinstance(x, int | float) for x in place):
        return [math.nan] * 3
    unit, shift = findings.cloud.unit.tolist(), findings.cloud.shift.tolist()
    return [(x - moved) * factor for x, moved, factor in zip(place, shift, unit, strict=True)]


def made_table(findings: Findings) -> str:
    """Return how the result was made, from its head."""
    head = findings.head
    versions = ", ".join(f"{name} {value}" for name, value in part(head, "versions").items())
    inputs = head.get("inputs") if isinstance(head.get("inputs"), list) else []
    rows = [
        ("result", PurePath(findings.path).name),
        ("made on", head.get("created", "–")),
        ("command", " ".join(map(str, head.get("command") or ()))),
        *(("input", _input_words(row)) for row in inputs or () if isinstance(row, dict)),
        (
            "model, edges, calibration",
            ", ".join(str(head.get(name, "–")) for name in ("model", "edge_model", "calibration")),
        ),
        ("called suspicious", f"from a probability of {threshold_of(findings):.3f}"),
        ("versions", versions),
    ]
    return table(("", ""), [("", (escape(name), escape(text))) for name, text in rows], "plain")


def _input_words(row: Mapping[str, Any]) -> str:
    return f"{row.get('path')}, sha256 {row.get('sha256')}"
