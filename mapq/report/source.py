"""What a report is made of: a RESULT and the JSON beside it, checked against each other."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.cloud import PointCloud
from mapq.io.clouds import parse_cloud
from mapq.io.content import Content
from mapq.io.patches import holds_patches
from mapq.io.result_folder import ResultFolder, is_result_folder, open_result_folder, thinned_by_patch
from mapq.io.results import LABEL, PATCH, RESULT_FIELDS, json_beside, read_result_json
from mapq.patches import NO_PATCH
from mapq.report.choice import Columns, choose
from prf.shell.errors import InputError, UsageError
from prf.shell.files import STREAM

MOST_TOLD = 50_000
"""Patches that a page tells of one by one: of more no browser makes a table, and nobody looks at them."""
MOST_READ = 4_000_000
"""Points of a result in tiles that outlines and views are made from, about."""
MOST_REGIONS = 50
"""Regions that a page lists; smaller ones are counted."""

Floats = NDArray[np.float64]


class Findings(NamedTuple):
    """What is said of a map.

    Attributes
    ----------
    path : str
    cloud : PointCloud
        All points; of a result in tiles a part of them, evenly spread over each patch.
    n_points : int
        Of the map.
    patch : (n,) int32
        Patch of each point, `NO_PATCH` for none.
    head : mapping
        The JSON of the result but for its patches.
    rows : sequence of k mappings
        The patches that are told of one by one, without their terms: all of them up to `MOST_TOLD`.
    number : (k,) int64
        Their numbers, ascending.
    label : (m,) uint8
        Of all patches, as what follows.
    probability, area : (m,) float64
        m² of areas; nan where a number is not known.
    normal : (m, 3) float64
    """

    path: str
    cloud: PointCloud
    n_points: int
    patch: NDArray[np.int32]
    head: Mapping[str, Any]
    rows: Sequence[Mapping[str, Any]]
    number: NDArray[np.int64]
    label: NDArray[np.uint8]
    probability: Floats
    area: Floats
    normal: Floats


def read_findings(path: str) -> Findings:
    """Read a RESULT and the JSON beside it, or a result in tiles and the JSON among them.

    Raises
    ------
    InputError
        If either is missing or damaged, the file is no result, or the two do not belong together.
    UsageError
        If `path` is standard input, which has nothing beside it.
    """
    if path == STREAM:
        raise UsageError("a report needs RESULT and the JSON beside it, which standard input does not have. Name it.")
    if is_result_folder(path):
        return _findings_of_folder(open_result_folder(path))
    content = Content(path)
    if holds_patches(content):
        raise InputError(f"{path}: these are patches without a verdict. Run mapq classify {path} first.")
    cloud = parse_cloud(content)[1]
    missing = [name for name in RESULT_FIELDS if name not in cloud.fields]
    if missing:
        raise InputError(f"{path}: this is no result (no field {missing[0]}). Run mapq classify {path} first.")
    beside = Path(json_beside(path))
    if not beside.exists():
        raise InputError(f"{path}: the JSON of this result is not beside it ({beside}). Run mapq classify again.")
    return _findings(path, beside, lambda columns: cloud)._replace(n_points=int(cloud.finite().sum()))


def _findings_of_folder(folder: ResultFolder) -> Findings:
    def cloud_of(columns: Columns) -> PointCloud:
        n_points = np.nan_to_num(columns.of("n_points")).astype(np.int64)
        return thinned_by_patch(folder, n_points, MOST_READ)

    return _findings(folder.path, folder.json, cloud_of)._replace(n_points=folder.n_points)


def regions_in(head: Mapping[str, Any]) -> Sequence[Mapping[str, Any]]:
    """Return the regions that the JSON of a result lists, worst first."""
    found = head.get("regions")
    return [row for row in found if isinstance(row, dict)] if isinstance(found, list) else []


def _findings(path: str, beside: Path, cloud_of: Callable[[Columns], PointCloud]) -> Findings:
    """Check points and JSON against each other."""
    head, rows = read_result_json(beside)
    columns = Columns(beside)
    worst = [region.get("patches") for region in regions_in(head)[:MOST_REGIONS]]
    chosen = choose(columns.passing(rows), worst, MOST_TOLD)
    label = np.frombuffer(columns.label, np.uint8)
    cloud = cloud_of(columns)
    number = np.asarray(cloud.fields[PATCH])
    with np.errstate(invalid="ignore"):
        known = (number >= 0) & cloud.finite() if number.ndim == 1 else np.zeros(len(cloud), np.bool_)
    patch = np.where(known, number if number.ndim == 1 else 0, NO_PATCH).astype(np.int64)
    counts = np.bincount(patch[known], minlength=len(label))
    if len(counts) > len(label) or (counts > columns.of("n_points")).any():
        raise InputError(f"{beside}: not the JSON of {path}, which has other patches. Run mapq classify again.")
    if not np.array_equal(np.asarray(cloud.fields[LABEL])[known], label[patch[known]]):
        raise InputError(f"{beside}: not the JSON of {path}, which has other labels. Run mapq classify again.")
    return Findings(
        path,
        cloud,
        len(cloud),
        patch.astype(np.int32),
        head,
        [row for _, row in chosen],
        np.array([place for place, _ in chosen], np.int64),
        label,
        columns.of("p_suspicious"),
        columns.of("area_m2"),
        columns.of("normal").reshape(-1, 3),
    )
