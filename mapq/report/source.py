"""What a report is made of: a RESULT and the JSON beside it, checked against each other."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.cloud import PointCloud
from mapq.io.clouds import parse_cloud
from mapq.io.content import Content
from mapq.io.patches import holds_patches
from mapq.io.results import LABEL, PATCH, RESULT_FIELDS, SCHEMA, json_beside
from mapq.patches import NO_PATCH, PLAUSIBLE, SUSPICIOUS
from prf.shell.errors import InputError, UsageError
from prf.shell.files import STREAM
from prf.shell.storage import damaged, load_object

MOST_PATCHES = 300_000
"""More of them no browser lists and draws; nobody would look at them one by one either."""

LABELS = {"plausible": PLAUSIBLE, "suspicious": SUSPICIOUS}

Floats = NDArray[np.float64]


class Told(NamedTuple):
    """What is said of a map.

    Attributes
    ----------
    path : str
    cloud : PointCloud
        All points.
    patch : (n,) int32
        Patch of each point, `NO_PATCH` for none.
    head : mapping
        The JSON of the result but for its patches.
    rows : sequence of mapping
        Its patches.
    label : (m,) uint8
    probability, area : (m,) float64
        m² of areas; nan where a number is not known.
    normal : (m, 3) float64
    """

    path: str
    cloud: PointCloud
    patch: NDArray[np.int32]
    head: Mapping[str, Any]
    rows: Sequence[Mapping[str, Any]]
    label: NDArray[np.uint8]
    probability: Floats
    area: Floats
    normal: Floats


def read_told(path: str) -> Told:
    """Read a RESULT and the JSON beside it.

    Raises
    ------
    InputError
        If either is missing or damaged, the file is no result, the two do not belong together, or the result has more
        than `MOST_PATCHES` patches.
    UsageError
        If `path` is standard input, which has nothing beside it.
    """
    if path == STREAM:
        raise UsageError("a report needs RESULT and the JSON beside it, which standard input does not have. Name it.")
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
    head = load_object(beside, SCHEMA)
    rows = head.pop("patches", None)
    if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
        raise damaged(beside, "no list of patches")
    if len(rows) > MOST_PATCHES:
        raise InputError(
            f"{beside}: {len(rows):,} patches are more than a page can show ({MOST_PATCHES:,}). Cut the map into parts."
        )
    return _told(path, cloud, beside, head, rows)


def _told(path: str, cloud: PointCloud, beside: Path, head: dict[str, Any], rows: list[dict[str, Any]]) -> Told:
    """Check points and JSON against each other."""
    number = np.asarray(cloud.fields[PATCH])
    with np.errstate(invalid="ignore"):
        known = (number >= 0) & cloud.finite() if number.ndim == 1 else np.zeros(len(cloud), np.bool_)
    patch = np.where(known, number if number.ndim == 1 else 0, NO_PATCH).astype(np.int64)
    counts = np.bincount(patch[known], minlength=len(rows))
    if len(counts) > len(rows) or (counts > _column(beside, rows, "n_points")).any():
        raise InputError(f"{beside}: not the JSON of {path}, which has other patches. Run mapq classify again.")
    if any(row.get("label") not in LABELS for row in rows):
        raise damaged(beside, "a label is neither plausible nor suspicious")
    label = np.array([LABELS[row["label"]] for row in rows], np.uint8)
    if not np.array_equal(np.asarray(cloud.fields[LABEL])[known], label[patch[known]]):
        raise InputError(f"{beside}: not the JSON of {path}, which has other labels. Run mapq classify again.")
    normal = np.column_stack([_column(beside, rows, "normal", axis) for axis in range(3)])
    areas = _column(beside, rows, "area_m2"), _column(beside, rows, "p_suspicious")
    return Told(path, cloud, patch.astype(np.int32), head, rows, label, areas[1], areas[0], normal)


def _column(beside: Path, rows: Sequence[Mapping[str, Any]], name: str, axis: int | None = None) -> Floats:
    """Return one number of every patch (m,), null as nan."""
    try:
        values = [row[name] if axis is None else row[name][axis] for row in rows]
        return np.array([np.nan if value is None else float(value) for value in values], np.float64)
    except (KeyError, IndexError, TypeError, ValueError):
        raise damaged(beside, f"patches without {name}") from None
