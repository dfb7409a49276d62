"""The JSON of a result: its head, and a row a patch with reasons and terms (docs/results.md)."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mapq.configuration import SURFACES
from mapq.crf.calibration import cut_probability
from mapq.io.results import CLOUD_UNIT
from mapq.posed.check_poses import WRONG

if TYPE_CHECKING:
    from mapq.crf import Terms
    from mapq.posed.check_scans import ScanMotion
    from mapq.results.result import Result

LABELS = ("plausible", "suspicious")
DECIMALS = 9
"""Of numbers: sums of terms stay exact to a billionth."""


def head_of(result: Result, process: Mapping[str, Any], verdict: Mapping[str, Any]) -> dict[str, Any]:
    """Return the JSON of a result without its patches, of what is known of the process and the verdict."""
    return {
        **process,
        "model": result.origin.model,
        "unit": "m",
        CLOUD_UNIT: result.patches.cloud.unit.tolist(),
        "counts": result.counts,
        "regions": [
            {**region.row(number, DECIMALS), **cause_row(result, region.patches)}
            for number, region in enumerate(result.regions)
        ],
        "edge_model": result.model.edge_model,
        "calibration": result.model.calibration.kind,
        "tolerance": result.tolerance,
        "threshold": {"difference": result.model.threshold, "p_suspicious": cut_probability(result.model)},
        "features": dict(result.features.parameters),
        "segmentation": {"parameters": result.patches.parameters, "report": result.patches.report},
        "verdict": verdict,
        **pose_rows(result),
    }


def counts_of(result: Result) -> dict[str, Any]:
    """Return how much of a map is suspicious: patches, points and area, and their shares (nan of nothing)."""
    counts, bad = result.patches.counts, result.is_suspicious
    n_points, area = int(counts.sum()), float(result.area.sum())
    return {
        "n_patches": len(result.patches),
        "n_suspicious": int(bad.sum()),
        "share_of_patches": share_of(float(bad.sum()), len(result.patches)),
        "n_points": len(result.patches.cloud),
        "n_points_in_patches": n_points,
        "n_points_suspicious": int(counts[bad].sum()),
        "coverage": result.coverage,
        "share_of_points": share_of(float(counts[bad].sum()), n_points),
        "area_m2": area,
        "area_suspicious_m2": float(result.area[bad].sum()),
        "share_of_area": share_of(float(result.area[bad].sum()), area),
        "expected_share_of_area": share_of(float(result.area @ result.labelling.probability), area),
        "by_surface": by_surface(result),
    }


def by_surface(result: Result) -> dict[str, dict[str, Any]]:
    """Return how many patches of each kind there are, their points and area, and how much of it is suspicious."""
    found: dict[str, dict[str, Any]] = {}
    for number, name in enumerate(SURFACES):
        mine = result.patches.kinds == number
        if mine.any():
            area, bad = float(result.area[mine].sum()), float(result.area[mine & result.is_suspicious].sum())
            found[name] = {
                "n_patches": int(mine.sum()),
                "n_points": int(result.patches.counts[mine].sum()),
                "area_m2": area,
                "area_suspicious_m2": bad,
                "share_of_area": share_of(bad, area),
            }
    return found


def share_of(part: float, whole: float) -> float:
    """Return a share; nan of nothing."""
    return part / whole if whole else float("nan")


def scans_of(result: Result) -> list[tuple[ScanMotion, float]]:
    """Return the scans of a map, worst first, each with the suspicious area in m² of which it is the cause.

    By their probability; where that calls none wrong, as of a few scans, which it rarely does, by that area.
    """
    blamed: dict[int, float] = {}
    for patch, cause in result.causes.items():
        if "scan" in cause.measures:
            scan = int(cause.measures["scan"])
            blamed[scan] = blamed.get(scan, 0.0) + float(np.nan_to_num(result.area[patch]))
    rows = [(scan, blamed.get(scan.scan, 0.0)) for scan in result.poses.scans]
    if any(scan.p_wrong > WRONG for scan, _ in rows):
        return rows
    return sorted(rows, key=lambda row: -row[1])


def pose_rows(result: Result) -> dict[str, Any]:
    """Return for JSON which scans and edges are wrong, worst first, and the drift of the poses."""
    found = result.poses
    edges = [{"from": edge.ids[0], "to": edge.ids[1], **edge._asdict()} for edge in found.edges]
    hidden = ("ids", "row", "scans")
    return {
        "scans": [_short({**scan._asdict(), "blamed_m2": area}) for scan, area in scans_of(result)],
        "edges": [_short({name: value for name, value in edge.items() if name not in hidden}) for edge in edges],
        "drift": None if found.drift is None else _short(found.drift._asdict()),
    }


def _short(row: Mapping[str, Any]) -> dict[str, Any]:
    """Return a row with rounded numbers."""
    return {name: round(value, DECIMALS) if isinstance(value, float) else value for name, value in row.items()}


def cause_row(result: Result, some: NDArray[np.int64] | None = None) -> dict[str, Any]:
    """Return for JSON which cause has the largest area, and the area of each."""
    area = result.area_by_cause(some)
    named = {name: round(value, DECIMALS) for name, value in area.items()}
    return {"cause": next(iter(area)) if any(area.values()) else None, "area_by_cause_m2": named}


def patch_rows(result: Result) -> Iterator[dict[str, Any]]:
    """Yield each patch with its label, its probability, its geometry in metres, and its terms."""
    starts = result.terms.starts(len(result.patches))
    region_of = {int(patch): number for number, region in enumerate(result.regions) for patch in region.patches}
    centroids = result.patches.cloud.world_of(result.patches.centroid)
    disagreement = result.features.disagreement
    for patch in range(len(result.patches)):
        begin, end = starts[patch : patch + 2].tolist()
        shape = zip(result.features.shape_names, result.features.shape[patch].tolist(), strict=True)
        yield {
            "patch": patch,
            "label": LABELS[int(result.labelling.label[patch])],
            "p_suspicious": float(result.labelling.probability[patch]),
            "difference": round(float(result.labelling.difference[patch]), DECIMALS),
            "n_points": int(result.patches.counts[patch]),
            "centroid": rounded(centroids[patch]),
            "normal": rounded(result.patches.normal[patch]),
            "surface": SURFACES[int(result.patches.kinds[patch])],
            **{name: round(value, DECIMALS) for name, value in shape if name != "n_points"},
            **_disagreement(*disagreement[patch].tolist()),
            "region": region_of.get(patch),
            "cause": result.causes[patch].row(DECIMALS) if patch in result.causes else None,
            "reasons": [reason.row(DECIMALS) for reason in result.reasons(patch)],
            "log_odds": round(float(result.terms.contribution[begin:end].sum()), DECIMALS),
            "terms": _terms(result.terms, begin, end),
        }


def _terms(terms: Terms, begin: int, end: int) -> list[dict[str, Any]]:
    """Return the terms of a patch, which lie from `begin` to `end`, largest first."""
    columns = (column[begin:end].tolist() for column in (terms.name, terms.value, terms.contribution, terms.other))
    return [
        {"name": terms.names[name], "value": round(value, DECIMALS), "contribution": round(added, DECIMALS)}
        | ({"other": other} if other >= 0 else {})
        for name, value, added, other in zip(*columns, strict=True)
    ]


def _disagreement(low: float, metres: float, high: float) -> dict[str, float | None]:
    """Return by how much scans disagree on a patch, with bounds; null where that is unknown."""
    named = {"disagreement_m": metres, "low": low, "high": high}
    return {name: round(x, DECIMALS) if math.isfinite(metres) else None for name, x in named.items()}


def rounded(values: NDArray[np.float64]) -> list[float]:
    """Return places as numbers of JSON."""
    return [round(value, 6) for value in values.tolist()]
