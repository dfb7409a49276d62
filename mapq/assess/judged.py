"""What is inferred about a map point by point, from a result, from patches or from a cloud."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.assess.inputs import read_input
from mapq.assess.result import AREA, Result, assess
from mapq.cloud import PointCloud
from mapq.io.options import AS_IT_IS, ReadOptions
from mapq.io.patches import is_patches
from mapq.io.result_folder import ResultFolder, is_result_folder, open_result_folder
from mapq.io.results import RESULT_FIELDS, json_beside, read_result_json
from mapq.model import Model
from mapq.patches import NO_PATCH, SUSPICIOUS, Patches
from mapq.segmentation import segment
from prf.shell.errors import InputError, UsageError
from prf.shell.files import STREAM
from prf.shell.storage import damaged

DISAGREEMENT = ("low", "disagreement_m", "high")
"""Keys of a patch in the JSON of a result."""

Floats = NDArray[np.float64]


class Judged(NamedTuple):
    """Points of the patches of a map, with what is inferred about them."""

    xyz: Floats  # (n, 3) world coordinates, metres
    area: Floats  # (n,) each point's part of its patch's area, m²
    suspicious: NDArray[np.bool_]  # (n,)
    probability: Floats  # (n,)
    # (n,) metres by which scans disagree on each point's patch, and standard error; nan where that is not known
    disagreement: Floats
    error: Floats  # (n,)
    coverage: float  # share of the points on planes of any tilt that are in patches; nan where that is not known
    source: str


def read_judged(path: str, model: Model | None, options: ReadOptions = AS_IT_IS, cell: float = 1.0) -> Judged:
    """Return what is inferred about the map in a RESULT, or what `model` infers about PATCHES or a cloud.

    Of a result in tiles all points of a patch in one cube of `cell` metres count as one.

    Raises InputError if the file cannot be read, or the JSON beside a RESULT is missing or of another one; UsageError
    if a model is given for a result, which has labels already.
    """
    if options.unit is not None and path != STREAM and is_patches(path):
        options = replace(options, unit=None)  # it is for the other map
    is_folder = is_result_folder(path)
    found = None if is_folder else read_input(path, options)
    if found is None or (isinstance(found, PointCloud) and set(RESULT_FIELDS) <= set(found.fields)):
        if model is not None:
            raise UsageError(f"{path} has labels of a model already. Leave out --model.")
        return _judged_folder(open_result_folder(path, options), cell) if found is None else _judged_result(found, path)
    patches = found if isinstance(found, Patches) else segment(found)
    return judge(assess(patches, model), path)


def judge(result: Result, source: str) -> Judged:
    """Return a result point by point."""
    patches = result.patches
    inside = np.flatnonzero((patches.patch != NO_PATCH) & patches.cloud.finite())
    patch = patches.patch[inside]
    area = result.area / np.maximum(np.bincount(patch, minlength=len(patches)), 1)
    probability = result.labelling.probability.astype(np.float64)
    xyz = patches.cloud.metric_of(patches.cloud.xyz[inside])
    metres, error = _with_error(*result.features.disagreement.T)
    return Judged(
        xyz,
        area[patch],
        result.is_suspicious[patch],
        probability[patch],
        metres[patch],
        error[patch],
        result.coverage,
        source,
    )


def _with_error(low: Floats, metres: Floats, high: Floats) -> tuple[Floats, Floats]:
    """Return metres (m,) and their standard errors, from bounds that hold them in 95 of 100."""
    return metres, (high - low) / (2.0 * 1.96)


def _judged_folder(folder: ResultFolder, cell: float) -> Judged:
    """Return what a result in tiles has of its patches, cube by cube."""
    coverage, (area, n_points, *apart) = _columns(folder.json, (AREA, "n_points"))
    metres, error = _with_error(*apart)
    per_point = area / np.maximum(n_points, 1.0)
    parts = []
    for piece in folder.pieces(RESULT_FIELDS):
        number, label, p = (np.asarray(piece.fields[name]) for name in RESULT_FIELDS)
        inside = np.flatnonzero((number != NO_PATCH) & piece.finite())
        patch = number[inside].astype(np.int64)
        _check_numbers(patch, len(area), folder.json, folder.path)
        places = np.floor(piece.metric_of(piece.xyz[inside]) / cell)
        rows, first, counts = np.unique(np.column_stack([patch, places]), axis=0, return_index=True, return_counts=True)
        chosen = inside[first]
        is_bad, of = label[chosen] == SUSPICIOUS, patch[first]
        middle, areas = (rows[:, 1:] + 0.5) * cell, counts * per_point[of]
        parts.append((middle, areas, is_bad, p[chosen].astype(np.float64), metres[of], error[of]))
    xyz, areas, suspicious, probability, *apart = (np.concatenate(columns) for columns in zip(*parts, strict=True))
    return Judged(xyz, areas, suspicious, probability, apart[0], apart[1], coverage, folder.path)


def _columns(beside: Path, names: tuple[str, ...]) -> tuple[float, Floats]:
    """Return from the JSON of a result the coverage of the map, and numbers (k + 3, m) of all patches.

    Last are the lower bound, value and upper bound of the disagreement, like the coverage nan where they are not
    known; those of earlier releases have none.
    """
    head, rows = read_result_json(beside)
    try:
        found = [
            [*(float(row[name]) for name in names), *(_number(row.get(name)) for name in DISAGREEMENT)] for row in rows
        ]
        coverage = _number(head.get("counts", {}).get("coverage"))
    except (AttributeError, TypeError, KeyError, ValueError):
        raise damaged(beside, f"patches without {' or '.join(names)}") from None
    return coverage, np.array(found, np.float64).reshape(-1, len(names) + len(DISAGREEMENT)).T


def _number(value: Any) -> float:
    """Return a number of a file; nan for null."""
    return float("nan") if value is None else float(value)


def _check_numbers(patch: NDArray[np.int64], n_patches: int, beside: Path, path: str) -> None:
    """Refuse patches of points (k,) that the JSON of a result does not have."""
    if len(patch) and not 0 <= int(patch.min()) <= int(patch.max()) < n_patches:
        raise InputError(f"{beside}: not the JSON of {path}, which has other patches. Run mapq classify again.")


def _judged_result(cloud: PointCloud, path: str) -> Judged:
    """Return the points of a RESULT, with the areas of its patches from the JSON beside it."""
    beside = Path(json_beside(path))
    if not beside.exists():
        raise InputError(f"{path}: the JSON of this result is not beside it ({beside}). Run mapq classify again.")
    coverage, (area, *apart) = _columns(beside, (AREA,))
    metres, error = _with_error(*apart)
    number, label, probability = (np.asarray(cloud.fields[name]) for name in RESULT_FIELDS)
    inside = np.flatnonzero((number != NO_PATCH) & cloud.finite())
    patch = number[inside].astype(np.int64)
    _check_numbers(patch, len(area), beside, path)
    per_point = area / np.maximum(np.bincount(patch, minlength=len(area)), 1)
    xyz = cloud.metric_of(cloud.xyz[inside])
    p = probability[inside].astype(np.float64)
    is_bad = label[inside] == SUSPICIOUS
    return Judged(xyz, per_point[patch], is_bad, p, metres[patch], error[patch], coverage, path)
