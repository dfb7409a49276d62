"""What is inferred about a map point by point, from a result, from patches or from a cloud."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.configuration import AS_IT_IS, ReadOptions
from mapq.io.maps import StoredResult, read_map
from mapq.io.patches import is_patches
from mapq.labels import NO_PATCH
from mapq.model import Model
from mapq.patches import Patches
from mapq.results.result import AREA, Result, assess
from mapq.segmentation import segment
from prf.shell.cli.files import STREAM
from prf.shell.cli.storage import damaged
from prf.shell.errors import UsageError

COLUMNS = (AREA, "n_points", "p_suspicious", "low", "disagreement_m", "high")
"""Of a patch in the JSON of a result; the last three are null where they are not known."""

Floats = NDArray[np.float64]


class Judged(NamedTuple):
    """Points of the patches of a map, with what is inferred about them."""

    xyz: Floats  # (n, 3) world coordinates, metres
    area: Floats  # (n,) each point's part of its patch's area, m²
    suspicious: NDArray[np.bool_]  # (n,)
    probability: Floats  # (n,)
    disagreement: Floats  # (n,) metres by which scans disagree on each point's patch; nan where that is not known
    error: Floats  # (n,) its standard error
    coverage: float  # share of the points on planes of any kind that are in patches; nan where that is not known
    tolerance: float  # metres at which it is judged
    source: str


def read_judged(
    path: str,
    model: Model | None,
    cell: float = 1.0,
    options: ReadOptions = AS_IT_IS,
    tolerance: float | None = None,
) -> Judged:
    """Return what is inferred about the map in a RESULT, or what `model` infers about PATCHES or a cloud.

    Of a result all points of a patch in one cube of `cell` metres count as one. Raises UsageError if a model is given
    for a result, which has labels already, or a tolerance that is not its own.
    """
    is_segmented = path != STREAM and is_patches(path)  # options may be for the other map
    found = read_map(path, AS_IT_IS if is_segmented else options)
    if not isinstance(found, StoredResult):
        return judge(assess(found if isinstance(found, Patches) else segment(found), model, tolerance=tolerance), path)
    if model is not None:
        raise UsageError(f"{path} has labels of a model already. Leave out --model.")
    if tolerance not in (None, found.tolerance):
        raise UsageError(f"{path} was judged at {found.tolerance:g} m. Leave out --tolerance, or classify it anew.")
    coverage, is_suspicious, columns = _columns(found)
    whole = coverage, found.tolerance, path
    places, patches, counts = [], [], []
    for piece in found.pieces():
        rows, patch = found.inside(piece, len(is_suspicious))
        cubes = np.floor(piece.metric_of(piece.xyz[rows]) / cell)
        keys, n = np.unique(np.column_stack([patch, cubes]), axis=0, return_counts=True)
        places.append((keys[:, 1:] + 0.5) * cell)
        patches.append(keys[:, 0].astype(np.int64))
        counts.append(n)
    of = np.concatenate(patches)
    return _judged(np.concatenate(places), np.concatenate(counts), of, is_suspicious, columns, whole)


def judge(result: Result, source: str) -> Judged:
    """Return a result point by point."""
    patches, cloud = result.patches, result.patches.cloud
    inside = np.flatnonzero((patches.patch != NO_PATCH) & cloud.finite())
    patch = patches.patch[inside]
    n_points = np.bincount(patch, minlength=len(patches))
    columns = np.array([result.area, n_points, result.probability, *result.features.disagreement.T])
    xyz = cloud.metric_of(cloud.xyz[inside])
    whole = result.coverage, result.tolerance, source
    return _judged(xyz, np.ones(len(xyz)), patch, result.is_suspicious, columns, whole)


def _judged(
    xyz: Floats,
    n_points: NDArray[Any],
    patch: NDArray[np.integer],
    is_suspicious: NDArray[np.bool_],
    columns: Floats,
    whole: tuple[float, float, str],
) -> Judged:
    """Return what `COLUMNS` (6, m) of patches are at places (n, 3) that represent this many points (n,).

    `whole`: coverage, tolerance and source of the map.
    """
    area, size, probability, low, metres, high = columns
    error = (high - low) / (2.0 * 1.96)  # the bounds hold it in 95 of 100
    areas = n_points * (area / np.maximum(size, 1.0))[patch]
    return Judged(xyz, areas, is_suspicious[patch], probability[patch], metres[patch], error[patch], *whole)


def _columns(stored: StoredResult) -> tuple[float, NDArray[np.bool_], Floats]:
    """Return from the JSON of a result the coverage of the map, which patches (m,) are suspicious, and `COLUMNS`."""
    head, rows = stored.content()
    labels, found = [], []
    try:
        for row in rows:
            labels.append(row["label"] == "suspicious")
            found.append(
                [*(float(row[name]) for name in COLUMNS[:3]), *(_number(row.get(name)) for name in COLUMNS[3:])]
            )
        coverage = _number(head.get("counts", {}).get("coverage"))
    except (AttributeError, TypeError, KeyError, ValueError):
        raise damaged(stored.json, f"patches without {', '.join(COLUMNS[:3])} or label") from None
    return coverage, np.array(labels, bool), np.array(found, np.float64).reshape(-1, len(COLUMNS)).T


def _number(value: Any) -> float:
    """Return a number of a file; nan for null."""
    return float("nan") if value is None else float(value)
