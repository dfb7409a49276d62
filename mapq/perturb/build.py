"""`build`: posed scans to a labelled map."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.cloud import PointCloud
from mapq.labels import PLAUSIBLE, SUSPICIOUS, UNLABELLED
from mapq.perturb.errors import PoseErrors, displaced
from mapq.perturb.known import Disagreement, find_surfaces, known_disagreement
from mapq.perturb.label import Rule, label_points
from mapq.perturb.measure import measured_disagreement
from mapq.posed import PosedScans, drive_passes
from mapq.posed.merge import Merged, MergeSettings, map_of, merge

Floats = NDArray[np.float64]


class Built(NamedTuple):
    """A labelled map: its points scan by scan, and a report for JSON."""

    cloud: PointCloud
    report: dict[str, Any]


def build(
    scans: PosedScans,
    errors: PoseErrors | None = None,
    rule: Rule | None = None,
    settings: MergeSettings | None = None,
    reference: Floats | None = None,
    seed: int = 0,
    progress: Callable[[float], None] = lambda share: None,
) -> Built:
    """Merge posed scans, displaced or not, and label every point.

    Parameters
    ----------
    scans : PosedScans
    errors : PoseErrors
        Added to the poses; None: the poses as they are.
    rule : Rule
    settings : MergeSettings
    reference : (k, 4, 4) float64, optional
        The right poses. None: with errors the poses before them; without, no poses are known to be right, and what
        disagrees is measured by registration of small pieces.
    seed : int
        Of the directions of errors.
    progress : callable
        Called with the share that is done.

    Raises
    ------
    UsageError
        For errors of poses that are negative, not finite, or too large.
    InputError
        If a scan cannot be read or no point is left.
    """
    errors, rule, settings = errors or PoseErrors(), rule or Rule(), settings or MergeSettings()
    merged = merge(scans, settings, lambda done: progress(0.5 * done / len(scans)))
    used = scans.poses if errors.is_none else displaced(scans.poses, errors, seed)
    right = reference if reference is not None or errors.is_none else scans.poses
    sided = not settings.submaps
    if right is not None:
        surfaces = find_surfaces(merged, right, rule.reach, sided)
        progress(0.8)
        found = known_disagreement(surfaces, right, used, rule.plausible_below)
        basis: dict[str, Any] = {"labels_from": "reference poses", "reach": surfaces.reach}
    else:
        share = 0.5 / len(scans)
        found = measured_disagreement(
            merged, used, rule.search, sided, rule.suspicious_above, lambda n: progress(0.5 + share * n)
        )
        basis = {"labels_from": "registration"}
    label = label_points(found.metres, rule)
    labels: dict[str, NDArray[Any]] = {"suspicious": label, "disagreement": found.metres.astype(np.float32)}
    cloud = map_of(merged, used, scans, settings, labels)
    progress(1.0)
    return Built(cloud, {**basis, **_counts(merged, found, label), "scans": _rows(scans, merged, used, right)})


def _counts(merged: Merged, found: Disagreement, label: NDArray[np.uint8]) -> dict[str, Any]:
    """Return how many points there are of each kind, and how many scans see what."""
    return {
        "n_read": int(merged.counts.sum()),
        "n_points": len(label),
        "n_suspicious": int(np.count_nonzero(label == SUSPICIOUS)),
        "n_plausible": int(np.count_nonzero(label == PLAUSIBLE)),
        "n_ambiguous": int(np.count_nonzero((label == UNLABELLED) & np.isfinite(found.metres))),
        "n_not_known": int(np.count_nonzero(np.isnan(found.metres))),
        "n_seen_once": int(np.count_nonzero((found.n_others == 0) & np.isfinite(found.metres))),
        "largest_disagreement": float(np.nanmax(found.metres)) if np.isfinite(found.metres).any() else float("nan"),
    }


def _rows(scans: PosedScans, merged: Merged, used: Floats, right: Floats | None) -> list[dict[str, Any]]:
    """Return the row of each scan in the report."""
    passes = drive_passes(scans.poses)
    n_points = np.bincount(merged.scan, minlength=len(scans))
    rows = []
    for scan, name in enumerate(scans.names):
        row: dict[str, Any] = {"scan": scan, "name": name, "n_read": merged.counts[scan], "n_points": n_points[scan]}
        row |= {"pass_id": passes[scan], "pose": used[scan, :3].ravel()}
        if scans.times is not None:
            row["time"] = scans.times[scan]
        if right is not None:
            row["reference"] = right[scan, :3].ravel()
        rows.append(row)
    return rows
