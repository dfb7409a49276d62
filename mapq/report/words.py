"""Words and tables of a report: the verdict, the regions, and how the result was made."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from pathlib import PurePath
from typing import Any

from mapq.report.findings import MAX_REGIONS, Findings
from mapq.results.inputs import Row
from prf.shell.cli.page.markup import escape, table

DASH = "–"
"""Instead of a missing number."""


def number(value: Any, digits: int = 1, unit: str = "") -> str:
    """Return a number of a file as text, a dash where it is none."""
    return DASH if value is None or not math.isfinite(value) else f"{value:,.{digits}f}{unit}"


def percent(value: Any) -> str:
    """Return a share as text, a dash where it is none."""
    return DASH if value is None else number(100.0 * value, 1, " %")


def verdict_line(findings: Findings) -> str:
    """Return the verdict as markup."""
    if not len(findings.label):
        return "No plane patch was found, so nothing of this map was judged."
    counts, verdict = findings.part("counts"), findings.part("verdict")
    limit, coverage = verdict.get("fail_over"), percent(counts.get("coverage"))
    share = percent(verdict.get("share_of_area", counts.get("share_of_area")))
    line = f"<strong>{share}</strong> of the surface judged is suspicious"
    if coverage != DASH:
        line += f"; {coverage} of all planes could be judged"
    if limit is None or verdict.get("passed") is None:
        return line
    state = "passes" if verdict["passed"] is True else "fails"
    asked = f"no more than {percent(limit)} was asked for"
    least = percent(verdict.get("min_coverage"))
    if DASH not in (coverage, least):
        asked += f", and {least} to be judged"
    return f'{line} <span class="verdict-{state}">{state}: {asked}</span>'


def facts(findings: Findings) -> str:
    """Return facts of the whole map as a list."""
    rows = "".join(f"<div><dt>{name}</dt><dd>{text}</dd></div>" for name, text in _facts(findings))
    return f"<dl>{rows}</dl>"


def _facts(findings: Findings) -> Iterator[tuple[str, str]]:
    counts, verdict, cloud = findings.part("counts"), findings.part("verdict"), findings.cloud
    n_regions = len(findings.regions)
    where = f", in {n_regions} region{'' if n_regions == 1 else 's'}" if n_regions else ""
    yield "area", f"{number(counts.get('area_suspicious_m2'))} of {number(counts.get('area_m2'))} m² suspicious"
    yield "patches", f"{number(counts.get('n_suspicious'), 0)} of {number(len(findings.label), 0)} suspicious{where}"
    # By the JSON, as all else here: of a result in tiles not all points are at hand.
    n_points = counts.get("n_points")
    share = counts["n_points_in_patches"] / n_points if n_points else None
    yield "judged", f"{percent(counts.get('coverage'))} of the points that lie on planes of any tilt"
    yield "points", f"{number(n_points, 0)}, {percent(share)} of them in patches; the others are not judged"
    if len(findings.rows) < len(findings.label):
        yield (
            "listed",
            f"{len(findings.rows):,} of these patches one by one: those of the regions listed, then the most certain "
            "suspicious ones, then the largest; the JSON of the result has all",
        )
    expected = percent(counts.get("expected_share_of_area"))
    yield "expected", f"{expected} of the surface is wrong, if the probabilities are right"
    if verdict.get("cause") is not None and cloud.fields.get("cause") is not None:
        areas = findings.part("verdict", "area_by_cause_m2")
        yield "causes", escape(", ".join(f"{name} {number(value)} m²" for name, value in areas.items() if value))
    if verdict.get("scans_apart_m") is not None:
        median, mean = (number(verdict.get(name), 3) for name in ("scans_apart_m", "disagreement_m"))
        yield "scans disagree", f"{median} m in the median over the area that several scans saw, {mean} m in the mean"
    if cloud.shift.any():
        shift = ", ".join(f"{value:,.0f}" for value in cloud.shift * cloud.unit)
        yield "global shift", f"{shift} m, left out of coordinates in views and tables; a selected patch shows both"
    for warning in findings.part("segmentation", "report").get("warnings") or ():
        yield "warning", escape(warning)


def map_table(findings: Findings) -> str:
    """Return size, points and segmentation of the map as a table."""
    cut = findings.part("segmentation", "parameters")
    some = findings.cloud.xyz[findings.patch >= 0]
    size = (some.max(axis=0) - some.min(axis=0)).tolist() if len(some) else []
    rows = (
        ("extent of patches", " × ".join(number(length) for length in size) + " m" if size else DASH),
        ("points", number(findings.n_points, 0)),
        ("patches", number(len(findings.label), 0)),
        ("spacing", number(cut.get("spacing"), 3, " m")),
        ("noise", number(cut.get("noise"), 3, " m")),
        ("judged up to", number(cut.get("max_tilt"), 0, "° from upright")),
    )
    return _plain(rows)


def region_table(findings: Findings) -> str:
    """Return the table of regions, worst first."""
    regions = findings.regions
    if not regions:
        return "<p>The result lists none.</p>" if findings.label.any() else "<p>No region: no patch is suspicious.</p>"
    names = ("region", "severity", "area", "patches", "extent", "centre", "surfaces apart", "mean p", "cause")
    units = ("", "m²", "m²", "", "m", "m", "m", "", "")
    head = [name + (f" <small>{unit}</small>" if unit else "") for name, unit in zip(names, units, strict=True)]
    rows = [
        (f' tabindex="0" data-region="{place}"', _region_cells(findings, row))
        for place, row in enumerate(regions[:MAX_REGIONS])
    ]
    more = len(regions) - MAX_REGIONS
    rest = f"<p>And {more} less severe ones, which the JSON of the result lists.</p>" if more > 0 else ""
    return table(head, rows, "list") + rest


def _region_cells(findings: Findings, region: Row) -> list[str]:
    low, high, centre = (findings.local(region.get(name)) for name in ("low", "high", "centre"))
    return [
        number(region.get("region"), 0),
        number(region.get("severity_m2")),
        number(region.get("area_m2")),
        number(region.get("n_patches"), 0),
        " × ".join(number(b - a) for a, b in zip(low, high, strict=True)),
        ", ".join(number(value) for value in centre),
        number(region.get("displacement_m"), 2),
        number(region.get("p_suspicious"), 2),
        escape(region.get("cause") or DASH),
    ]


def origin_table(findings: Findings) -> str:
    """Return how the result was made: command, inputs, model, versions."""
    head = findings.head
    model = ", ".join(str(head.get(name, DASH)) for name in ("model", "edge_model", "calibration"))
    rows = [
        ("result", PurePath(findings.path).name),
        ("created", head.get("created", DASH)),
        ("command", " ".join(map(str, head.get("command") or ()))),
        *(("input", _input(row)) for row in head.get("inputs") or ()),
        ("model, edges, calibration", model),
        ("suspicious", f"from a probability of {findings.threshold:.3f}"),
        ("versions", ", ".join(f"{name} {value}" for name, value in findings.part("versions").items())),
    ]
    return _plain((escape(name), escape(text)) for name, text in rows)


def _input(row: Row) -> str:
    digest = row.get("sha256")  # folders and streams have none
    return f"{row.get('path')}, sha256 {digest}" if digest else str(row.get("path"))


def _plain(rows: Iterable[tuple[str, str]]) -> str:
    return table(("", ""), [("", row) for row in rows], "plain")
