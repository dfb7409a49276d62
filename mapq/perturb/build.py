"""`build`: posed scans to a labelled map; its files are the cloud, and a JSON with how it was made."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.cloud import PointCloud
from mapq.configuration import MergeSettings, PerturbSettings
from mapq.io.write import check_name, write_cloud
from mapq.labels import PLAUSIBLE, SUSPICIOUS, UNLABELLED
from mapq.perturb.errors import displaced
from mapq.perturb.known import find_surfaces, known_disagreement
from mapq.perturb.measure import measured_disagreement
from mapq.posed import PosedScans, drive_passes
from mapq.posed.merge import Merged, map_of, merge
from prf.shell.cli.files import STREAM, atomic_write, together
from prf.shell.cli.outputs import claim_output
from prf.shell.cli.storage import dump_object
from prf.shell.errors import UsageError

SCHEMA = "mapq.perturb/1"

Floats = NDArray[np.float64]


class Built(NamedTuple):
    """A labelled map: its points scan by scan, and a report for JSON."""

    cloud: PointCloud
    report: dict[str, Any]


def build(
    scans: PosedScans,
    settings: PerturbSettings | None = None,
    merging: MergeSettings | None = None,
    reference: Floats | None = None,
    seed: int = 0,
    progress: Callable[[float], None] = lambda share: None,
) -> Built:
    """Merge posed scans, displaced or not, and label every point.

    Parameters
    ----------
    scans : PosedScans
    settings : PerturbSettings
        Errors that are added to the poses, and bounds of the labels.
    merging : MergeSettings
    reference : (k, 4, 4) float64, optional
        The right poses. None: with errors the poses before them; without, no poses are known to be right, and what
        disagrees is measured by registration of small pieces.
    seed : int
        Of the directions of errors.
    progress : callable
        Called with the share that is done.

    Raises
    ------
    InputError
        If a scan cannot be read or no point is left.
    """
    settings, merging = settings or PerturbSettings(), merging or MergeSettings()
    merged = merge(scans, merging, lambda done: progress(0.5 * done / len(scans)))
    used = scans.poses if settings.moves_nothing else displaced(scans.poses, settings, seed)
    right = reference if reference is not None or settings.moves_nothing else scans.poses
    sided = not merging.submaps
    if right is not None:
        surfaces = find_surfaces(merged, right, settings.reach, sided)
        progress(0.8)
        metres, n_others = known_disagreement(surfaces, right, used, settings.plausible_below)
        basis: dict[str, Any] = {"labels_from": "reference poses", "reach": surfaces.reach}
    else:
        share = 0.5 / len(scans)
        metres, n_others = measured_disagreement(
            merged, used, settings.search, sided, settings.suspicious_above, lambda n: progress(0.5 + share * n)
        )
        basis = {"labels_from": "registration"}
    label = label_points(metres, settings)
    labels: dict[str, NDArray[Any]] = {"suspicious": label, "disagreement": metres.astype(np.float32)}
    cloud = map_of(merged, used, scans, merging, labels)
    progress(1.0)
    return Built(
        cloud, {**basis, **_counts(merged, metres, n_others, label), "scans": _rows(scans, merged, used, right)}
    )


def _counts(merged: Merged, metres: Floats, n_others: NDArray[np.int64], label: NDArray[np.uint8]) -> dict[str, Any]:
    """Return how many points there are of each kind, and how many scans see what."""
    return {
        "n_read": int(merged.counts.sum()),
        "n_points": len(label),
        "n_suspicious": int(np.count_nonzero(label == SUSPICIOUS)),
        "n_plausible": int(np.count_nonzero(label == PLAUSIBLE)),
        "n_ambiguous": int(np.count_nonzero((label == UNLABELLED) & np.isfinite(metres))),
        "n_not_known": int(np.count_nonzero(np.isnan(metres))),
        "n_seen_once": int(np.count_nonzero((n_others == 0) & np.isfinite(metres))),
        "largest_disagreement": float(np.nanmax(metres)) if np.isfinite(metres).any() else float("nan"),
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


def label_points(metres: NDArray[np.float64], rule: PerturbSettings) -> NDArray[np.uint8]:
    """Return the label (n,) of each point: suspicious, plausible, or `UNLABELLED` where ambiguous or not known."""
    with np.errstate(invalid="ignore"):
        label = np.where(metres > rule.suspicious_above, SUSPICIOUS, UNLABELLED)
        label[metres <= rule.plausible_below] = PLAUSIBLE
    return label.astype(np.uint8)


def target_files(output: str | None, force: bool) -> tuple[str, str]:
    """Return the names of the map and of its JSON, both of them free to be written."""
    if output is None:
        raise UsageError("the map has no name. Give one with -o MAP.ply.")
    name = Path(output)
    if output == STREAM or name.suffix == ".json":
        raise UsageError("a labelled map is a PLY and a JSON of the same name. Name the PLY with -o MAP.ply.")
    check_name(output)
    targets = str(name if name.suffix else name.with_suffix(".ply")), str(name.with_suffix(".json"))
    for target in targets:
        claim_output(target, force)
    return targets


def write_map(targets: tuple[str, str], built: Built, head: Mapping[str, Any]) -> dict[str, Any]:
    """Write both files, which take their places together, and return the content of the JSON: `head` and the report."""
    path, beside = targets
    label = built.cloud.fields["suspicious"]
    kinds = {"suspicious": SUSPICIOUS, "plausible": PLAUSIBLE, "without_label": UNLABELLED}
    counts = {f"n_{name}": int(np.count_nonzero(label == kind)) for name, kind in kinds.items()}
    content = {**head, **built.report, "files": [{"path": path, "n_points": len(built.cloud), **counts}]}
    with together():
        write_cloud(path, built.cloud)
        with atomic_write(beside) as stream:
            stream.write(dump_object(SCHEMA, content) + "\n")
    return content
