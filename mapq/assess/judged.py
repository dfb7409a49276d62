"""What is said of a map point by point, from a result, from patches or from a cloud."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.assess.inputs import read_input
from mapq.assess.result import AREA, Result, assess
from mapq.cloud import PointCloud
from mapq.io.options import AS_IT_IS, ReadOptions
from mapq.io.result_json import read_result_json
from mapq.io.results import RESULT_FIELDS, json_beside
from mapq.model import Model
from mapq.patches import NO_PATCH, SUSPICIOUS, Patches
from mapq.segmentation import segment
from prf.shell.errors import InputError, UsageError
from prf.shell.storage import damaged

Floats = NDArray[np.float64]


class Judged(NamedTuple):
    """Points of the patches of a map, with what is said of them.

    Attributes
    ----------
    xyz : (n, 3) float64
        World coordinates, metres.
    area : (n,) float64
        Each point's part of its patch's area, m².
    suspicious : (n,) bool
    probability : (n,) float64
    source : str
    """

    xyz: Floats
    area: Floats
    suspicious: NDArray[np.bool_]
    probability: Floats
    source: str


def read_judged(path: str, model: Model | None, options: ReadOptions = AS_IT_IS) -> Judged:
    """Return what is said of the map in a RESULT, or what `model` says of PATCHES or of a cloud.

    Raises
    ------
    InputError
        If the file cannot be read, or the JSON beside a RESULT is missing or of another one.
    UsageError
        If a model is given for a result, which has labels already.
    """
    found = read_input(path, options)
    if isinstance(found, PointCloud) and set(RESULT_FIELDS) <= set(found.fields):
        if model is not None:
            raise UsageError(f"{path} has labels of a model already. Leave out --model.")
        return _judged_result(found, path)
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
    return Judged(xyz, area[patch], result.suspicious[patch], probability[patch], source)


def _judged_result(cloud: PointCloud, path: str) -> Judged:
    """Return the points of a RESULT, with the areas of its patches from the JSON beside it."""
    beside = Path(json_beside(path))
    if not beside.exists():
        raise InputError(f"{path}: the JSON of this result is not beside it ({beside}). Run mapq classify again.")
    _, rows = read_result_json(beside)
    number, label, probability = (np.asarray(cloud.fields[name]) for name in RESULT_FIELDS)
    inside = np.flatnonzero((number != NO_PATCH) & cloud.finite())
    patch = number[inside].astype(np.int64)
    try:
        area = np.array([float(row[AREA]) for row in rows])
    except (TypeError, KeyError, ValueError):
        raise damaged(beside, f"patches without {AREA}") from None
    if len(patch) and not 0 <= int(patch.min()) <= int(patch.max()) < len(area):
        raise InputError(f"{beside}: not the JSON of {path}, which has other patches. Run mapq classify again.")
    per_point = area / np.maximum(np.bincount(patch, minlength=len(area)), 1)
    xyz = cloud.metric_of(cloud.xyz[inside])
    p = probability[inside].astype(np.float64)
    return Judged(xyz, per_point[patch], label[inside] == SUSPICIOUS, p, path)
