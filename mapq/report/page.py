"""`write_report`: one file of HTML that needs nothing else."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from pathlib import PurePath
from typing import Any

from mapq.io.maps import Row
from mapq.patches import WIDE_REGION, apart_words, caveat, in_doubt, large_share
from mapq.posed.check_poses import WRONG
from mapq.report.findings import MAX_REGIONS, Findings
from mapq.report.histogram import histogram, histogram_svg
from mapq.report.scene import VIEWS, PageScene, build_scene
from prf.shell.cli.files import encoded, open_output
from prf.shell.cli.page import escape, packed, packed_json, page, table

MOST_NAMED = 5
"""Scans and edges that the head of a page names."""
DASH = "–"
"""Instead of a missing number."""


def number(value: Any, digits: int = 1, unit: str = "") -> str:
    """Return a number of a file as text, a dash for null."""
    # No negative zero.
    return DASH if value is None or not math.isfinite(value) else f"{round(value, digits) + 0.0:,.{digits}f}{unit}"


def area(value: Any) -> str:
    """Return an area in square metres as text, of small ones another digit, a dash for null."""
    return number(value, 2 if value is not None and value < 0.1 else 1)


def percent(value: Any) -> str:
    """Return a share as text, a dash for null."""
    return DASH if value is None else number(100.0 * value, 1, " %")


def verdict_line(findings: Findings) -> str:
    """Return the verdict as markup."""
    if not len(findings.label):
        return "No plane patch was found, so nothing of this map was judged."
    counts, verdict = findings.part("counts"), findings.part("verdict")
    large, coverage = percent(large_share(counts)), percent(counts.get("coverage"))
    share = percent(verdict.get("share_of_area", counts.get("share_of_area")))
    line = f"<strong>{share}</strong> of the surface judged is suspicious"
    if verdict.get("tolerance_m") is not None:
        line += f": farther apart than {number(verdict['tolerance_m'], 2)} m"
    if coverage != DASH:
        line += f"; {large} of all points lie in patches large enough to judge, {coverage} of these were judged"
    line += caveat(verdict)
    if verdict.get("passed") is None:
        return line
    state = "passes" if verdict["passed"] is True else "fails"
    limits = list(_limits(verdict, counts.get("coverage")))
    words = [text for holds, text in limits if state == "passes" or not holds]
    return f'{line}. <span class="verdict-{state}">{state}: {" and ".join(words)}</span>'


def _limits(verdict: Mapping[str, Any], coverage: float | None) -> Iterator[tuple[bool, str]]:
    """Yield of each limit that a map must keep whether it does, and words."""
    asked, apart, least = (verdict.get(name) for name in ("fail_over", "fail_apart", "min_coverage"))
    share, off = verdict.get("share_of_area"), verdict.get("scans_apart_m")
    if asked is not None:
        holds = share is not None and share <= asked
        yield holds, f"{'at most' if holds else 'more than'} the {percent(asked)} asked for"
    if apart is not None and off is None:
        yield False, "how far scans are apart is not known"
    elif apart is not None and off is not None:
        limit = f"{'within' if off <= apart else 'more than'} {number(apart, 3)} m"
        kind = verdict.get("scans_apart_surface")
        surfaces = f" of {escape(kind)} surfaces" if kind else ""
        yield off <= apart, f"scans are {number(off, 3)} m apart in the median{surfaces}, {limit}"
    if least is not None and coverage is not None:
        holds = coverage >= least
        yield holds, f"{'at least' if holds else 'less than'} {percent(least)} judged"


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
    judged = f"{percent(counts.get('coverage'))} of the points in patches that are large enough"
    yield "judged", f"{judged}, in which {percent(large_share(counts))} of all points lie"
    for name, each in (counts.get("by_surface") or {}).items():
        yield name, f"{number(each.get('area_m2'))} m², {percent(each.get('share_of_area'))} of it suspicious"
    yield "points", f"{number(n_points, 0)}, {percent(share)} of them in judged patches"
    also = "" if (cloud.unit == 1.0).all() else "; lengths and places on this page are in metres"
    yield "unit", f"{cloud.unit_words}{also}"
    if len(findings.rows) < len(findings.label):
        yield (
            "listed",
            f"{len(findings.rows):,} of these patches one by one: those of the regions listed, then the most severe "
            "suspicious ones, then the largest; the JSON of the result has all",
        )
    if verdict.get("resolution_m") is not None:
        resolved = f"{number(verdict['resolution_m'], 3)} m in the median"
        left = percent(verdict.get("unresolved_share_of_area"))
        yield "scans resolve", f"{resolved}; {left} of the area one scan alone saw, or several too little to compare"
    elif doubt := in_doubt(findings.label, findings.probability, findings.area):
        yield "in doubt", f"{doubt}; mapq classify calls more of it with a smaller tolerance"
    expected = percent(counts.get("expected_share_of_area"))
    yield "expected", f"{expected} of the surface judged is wrong by the mean of p, if p holds for maps like this one"
    if verdict.get("cause") is not None and cloud.fields.get("cause") is not None:
        areas = findings.part("verdict", "area_by_cause_m2")
        yield "causes", escape(", ".join(f"{name} {number(value)} m²" for name, value in areas.items() if value))
    if verdict.get("scans_apart_surface") is not None:
        least, known = verdict.get("resolution_m") or 0.0, (verdict["scans_apart_m"], verdict.get("disagreement_m"))
        median, mean = (DASH if metres is None else apart_words(metres, least) for metres in known)
        kind = f"{escape(verdict['scans_apart_surface'])} surfaces, the worst kind"
        yield "scans disagree", f"{median} in the median of {kind}; {mean} in the mean of all, where several saw them"
    if cloud.shift.any():
        shift = ", ".join(f"{value:,.0f}" for value in cloud.shift * cloud.unit)
        yield "global shift", f"{shift} m, left out of coordinates in views and tables; a selected patch shows both"
    for warning in findings.part("segmentation", "report").get("warnings") or ():
        yield "warning", escape(warning)


def poses_line(findings: Findings) -> str:
    """Return which scans, and which edges of their graph, are probably wrong, by name; empty without scans."""
    parts = []
    for kind, name in (("scans", _scan_name), ("edges", lambda row: f"from {_edge_name(row)}")):
        rows = findings.head.get(kind) or ()
        wrong = [escape(name(row)) for row in rows if row["p_wrong"] > WRONG]
        more = f" and {len(wrong) - MOST_NAMED} more, listed below" if len(wrong) > MOST_NAMED else ""
        worst = rows[0] if rows else {}
        if kind == "scans" and len(rows) == 2 and not wrong and _area_of_wrong_scans(findings):
            shift = ", ".join(number(worst[axis], 2) for axis in ("dx", "dy", "dz"))
            first, other = (escape(name(row)) for row in rows)
            moved = f"<strong>{first}</strong> would lie on {other} if moved by {shift} m"
            parts.append(f"The two scans disagree, and which is wrong they do not show: {moved}.")
        elif worst.get("blamed_m2") and not wrong:
            most = number(max(row["p_wrong"] for row in rows), 2)
            blame = f"{number(worst['blamed_m2'])} m² are put down to <strong>{escape(name(worst))}</strong>"
            parts.append(f"None of {len(rows)} {kind} is surely displaced (p {most} at most); {blame}.")
        elif rows:
            named = f"<strong>{', '.join(wrong[:MOST_NAMED])}</strong>{more}," if wrong else "none"
            parts.append(f"Probably wrong {kind}: {named} of {len(rows)}.")
    return " ".join(parts)


def _area_of_wrong_scans(findings: Findings) -> float:
    return float(findings.part("verdict", "area_by_cause_m2").get("wrong scan") or 0.0)


def _scan_name(row: Row) -> str:
    return PurePath(str(row["file"])).name


def _edge_name(row: Row) -> str:
    return f"{number(row['from'], 0)} to {number(row['to'], 0)}"


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
        ("surfaces judged", escape(", ".join(cut.get("surfaces") or ())) or DASH),
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
    sides = [b - a for a, b in zip(low, high, strict=True)]
    place = _place(centre)
    worst = findings.rows.get(region.get("worst_patch", -1))
    if worst is not None and max(sides) > WIDE_REGION:
        apart = region.get("worst_displacement_m")
        known = "" if apart is None else f": {number(apart, 2)} m apart"
        place += f"<br><small>worst at {_place(findings.local(worst.get('centroid')))}{known}</small>"
    return [
        number(region.get("region"), 0),
        area(region.get("severity_m2")),
        area(region.get("area_m2")),
        number(region.get("n_patches"), 0),
        " × ".join(map(number, sides)),
        place,
        number(region.get("displacement_m"), 2),
        number(region.get("p_suspicious"), 2),
        escape(region.get("cause") or DASH),
    ]


def _place(xyz: list[float]) -> str:
    return ", ".join(map(number, xyz))


def pose_tables(findings: Findings) -> str:
    """Return the section of scans, and of edges of their graph, worst first; nothing where they are not known."""
    scans, edges = (findings.head.get(name) or () for name in ("scans", "edges"))
    if not scans:
        return ""
    names, units = ("shift", "yaw", "bounds", "p", "blamed for"), ("m", "°", "m", "", "m²")
    head = [f"{name} <small>{unit}</small>" for name, unit in zip(names, units, strict=True)]
    rows = [
        (
            escape(_scan_name(row)),
            ", ".join(number(row[name], 2) for name in ("dx", "dy", "dz")) if row["low"] else DASH,
            number(math.degrees(row["yaw"]), 2) if row["low"] else DASH,
            f"{number(row['low'], 2)} to {number(row['high'], 2)}",
            number(row["p_wrong"], 3),
            number(row.get("blamed_m2")),
        )
        for row in scans[:MAX_REGIONS]
    ]
    text = table(["scan", *head], _marked(rows, scans), "scans")
    if edges:
        off = [
            (
                _edge_name(row),
                number(row["error_m"], 2),
                number(None if row["error_rad"] is None else math.degrees(row["error_rad"]), 2),
                number(row["p_wrong"], 3),
            )
            for row in edges[:MAX_REGIONS]
        ]
        of_edges = ["edge", "off <small>m</small>", "turned <small>°</small>", "p"]
        text += table(of_edges, _marked(off, edges), "scans")
    also = ", and how far edges are off what the clouds say" if edges else ""
    note = (
        f"The shift and turn that the other scans ask of each, {DASH} where it may be right{also}, and the suspicious "
    )
    note += "area of which it is the cause; ▲ probably wrong."
    what = "Scans and edges" if edges else "Scans"
    head_line = f"<summary><h2>{what}, worst first</h2></summary>"
    return f'<details class="panel" open>{head_line}<p class="note">{note}</p>{text}</details>'


def _marked(cells: Iterable[tuple[str, ...]], rows: Iterable[Row]) -> Iterator[tuple[str, tuple[str, ...]]]:
    """Yield the cells of scans or edges, those that are probably wrong with a mark."""
    for (name, *rest), row in zip(cells, rows, strict=False):
        is_wrong = row["p_wrong"] > WRONG
        yield ' class="wrong"' if is_wrong else "", (f"▲ {name}" if is_wrong else name, *rest)


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
    digest = row.get("sha256")  # streams, and folders of folders, have none
    return f"{row.get('path')}, sha256 {digest}" if digest else str(row.get("path"))


def _plain(rows: Iterable[tuple[str, str]]) -> str:
    return table(("", ""), [("", row) for row in rows], "plain")


MAX_POINTS = 120_000
"""Default of the points that the views show: a laptop turns this many smoothly."""
MEASURES = ("n_points", "area_m2", "width_m", "height_m", "rms_m", "thickness_m", "tilt_deg")
"""Numbers of a patch that the page has beside label, probability and place."""
DIGITS = 5
"""Significant digits of numbers in a page."""


def write_report(
    path: str, findings: Findings, title: str | None = None, max_points: int = MAX_POINTS
) -> tuple[int, int]:
    """Write the report on a result, whole or not at all; ``-`` is standard output.

    `title` instead of the name of the file; `max_points`: points shown, about. Returns the bytes of the page, and how
    many points its views show.
    """
    scene = build_scene(findings.cloud.xyz, findings.patch, findings.normal, findings.label, max_points)
    scene = scene._replace(n_points=findings.n_points)
    text = _page(findings, scene, title or PurePath(findings.path).name)
    with open_output(path) as stream:
        stream.write(text)
    return len(encoded(text)), len(scene.points)


def _page(findings: Findings, scene: PageScene, title: str) -> str:
    head, numbers = scene.pack()
    sums, unit = histogram(findings.probability, findings.label, findings.area)
    content = {
        "title": escape(title),
        "verdict": verdict_line(findings),
        "poses_line": poses_line(findings),
        "facts": facts(findings),
        "map": map_table(findings),
        "histogram": histogram_svg(sums, unit, findings.threshold),
        "unit": unit,
        "share": percent(findings.part("counts").get("share_of_area")),
        "aspect": f"{scene.aspect:.3f}",
        "evidence": "how far the scans that see it disagree, by " if findings.head.get("scans") else "",
        "shown": f"{len(scene.points):,} of {scene.n_points:,} points shown, evenly spread",
        "regions": region_table(findings),
        "poses": pose_tables(findings),
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
    """Return numbers with a few significant digits; nan becomes null."""
    return [float(f"{value:.{digits}g}") if isinstance(value, float) else value for value in values]
