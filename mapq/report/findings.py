"""`Findings`: a RESULT and the JSON beside it, checked against each other, as a report needs them."""

from __future__ import annotations

import heapq
import math
from array import array
from collections.abc import Callable, Iterable, Mapping, Sequence
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
from mapq.patches import NO_PATCH, PLAUSIBLE, SUSPICIOUS
from prf.shell.errors import InputError, UsageError
from prf.shell.files import STREAM
from prf.shell.storage import damaged

MAX_LISTED = 50_000
"""Patches that a page describes one by one: no browser makes a table of more."""
MAX_READ = 4_000_000
"""Points of a result in tiles that outlines and views are made from, about."""
MAX_REGIONS = 50
"""Regions that a page lists; smaller ones are counted."""
LABELS = {"plausible": PLAUSIBLE, "suspicious": SUSPICIOUS}

Floats = NDArray[np.float64]
Row = Mapping[str, Any]


class Shown(NamedTuple):
    """Patches as a page numbers them: those listed, and behind them, if there are more, two groups of all others."""

    patch: NDArray[np.int32]  # (n,) of each point
    # (k,), (k + 2,) the last two, if they are there, are the other plausible patches and the other suspicious ones
    label: NDArray[np.uint8]
    probability: Floats  # the mean over a group
    normal: Floats  # (k or k + 2, 3) nan of a group
    others: NDArray[np.int64]  # (2,) patches in each group


class Findings(NamedTuple):
    """Contents of a result."""

    path: str
    cloud: PointCloud  # all points; of a result in tiles a part of them, evenly spread over each patch
    n_points: int  # of the map
    patch: NDArray[np.int32]  # (n,) patch of each point, `NO_PATCH` for none
    head: Row  # the JSON of the result without its patches
    rows: Sequence[Row]  # patches listed one by one, without their terms: all of them up to `MAX_LISTED`
    number: NDArray[np.int64]  # (k,) their numbers, ascending
    label: NDArray[np.uint8]  # (m,) of all patches, as what follows
    probability: Floats  # (m,) m² of areas; nan where a number is unknown
    area: Floats  # (m,)
    normal: Floats  # (m, 3)

    def part(self, *names: str) -> Row:
        """Return an object inside the JSON, empty where it is none."""
        found: Any = self.head
        for name in names:
            found = found.get(name) if isinstance(found, dict) else None
        return found if isinstance(found, dict) else {}

    @property
    def regions(self) -> Sequence[Row]:
        """Regions, worst first."""
        return _regions(self.head)

    @property
    def threshold(self) -> float:
        """Probability from which patches are suspicious."""
        value = self.part("threshold").get("p_suspicious")
        return float(value) if isinstance(value, int | float) and 0.0 <= value <= 1.0 else 0.5

    def local(self, place: Any) -> list[float]:
        """Return a place (3) of the JSON in metres without the global shift; nan if it is none."""
        if not isinstance(place, list) or len(place) != 3 or not all(isinstance(x, int | float) for x in place):
            return [math.nan] * 3
        unit, shift = self.cloud.unit.tolist(), self.cloud.shift.tolist()
        return [(x - moved) * factor for x, moved, factor in zip(place, shift, unit, strict=True)]

    def shown(self) -> Shown:
        """Return the patches as a page numbers them."""
        number, label = self.number, self.label
        if len(number) == len(label):
            return Shown(self.patch, label, self.probability, self.normal, np.zeros(2, np.int64))
        is_other = np.ones(len(label), np.bool_)
        is_other[number] = False
        groups = [np.flatnonzero(is_other & (label == kind)) for kind in (PLAUSIBLE, SUSPICIOUS)]
        place = np.full(len(label) + 1, -1, np.int32)
        place[number] = np.arange(len(number))
        for extra, group in enumerate(groups):
            place[group] = len(number) + extra
        means = [float(np.nanmean(self.probability[group])) if len(group) else math.nan for group in groups]
        return Shown(
            place[self.patch],
            np.append(label[number], [PLAUSIBLE, SUSPICIOUS]).astype(np.uint8),
            np.append(self.probability[number], means),
            np.concatenate([self.normal[number], np.full((2, 3), np.nan)]),
            np.array([len(group) for group in groups], np.int64),
        )


class _Columns(NamedTuple):
    """Label (m,) of all patches, their n_points, p_suspicious, area_m2 and normal (m, 6), and the rows listed."""

    label: NDArray[np.uint8]
    numbers: Floats
    listed: list[tuple[int, Row]]


def read_findings(path: str) -> Findings:
    """Read a RESULT and the JSON beside it, or a result in tiles and the JSON among them.

    Raises InputError if either is missing or damaged, the file is no result, or the two do not belong together;
    UsageError if `path` is standard input, which has nothing beside it.
    """
    if path == STREAM:
        raise UsageError("a report needs RESULT and the JSON beside it, which standard input does not have. Name it.")
    if is_result_folder(path):
        folder = open_result_folder(path)
        return _findings(path, folder.json, lambda columns: _points_of(folder, columns))._replace(
            n_points=folder.n_points
        )
    content = Content(path)
    if holds_patches(content):
        raise InputError(f"{path}: these are patches without labels of a model. Run mapq classify {path} first.")
    cloud = parse_cloud(content)[1]
    missing = [name for name in RESULT_FIELDS if name not in cloud.fields]
    if missing:
        raise InputError(f"{path}: this is no result (no field {missing[0]}). Run mapq classify {path} first.")
    beside = Path(json_beside(path))
    if not beside.exists():
        raise InputError(f"{path}: the JSON of this result is not beside it ({beside}). Run mapq classify again.")
    return _findings(path, beside, lambda columns: cloud)._replace(n_points=int(cloud.finite().sum()))


def _points_of(folder: ResultFolder, columns: _Columns) -> PointCloud:
    return thinned_by_patch(folder, np.nan_to_num(columns.numbers[:, 0]).astype(np.int64), MAX_READ)


def _findings(path: str, beside: Path, cloud_of: Callable[[_Columns], PointCloud]) -> Findings:
    """Check points and JSON against each other."""
    head, rows = read_result_json(beside)
    columns = _columns(beside, rows, _regions(head)[:MAX_REGIONS])
    label, cloud = columns.label, cloud_of(columns)
    number = np.asarray(cloud.fields[PATCH])
    with np.errstate(invalid="ignore"):
        known = (number >= 0) & cloud.finite() if number.ndim == 1 else np.zeros(len(cloud), np.bool_)
    patch = np.where(known, number if number.ndim == 1 else 0, NO_PATCH).astype(np.int64)
    counts = np.bincount(patch[known], minlength=len(label))
    if len(counts) > len(label) or (counts > columns.numbers[:, 0]).any():
        raise InputError(f"{beside}: not the JSON of {path}, which has other patches. Run mapq classify again.")
    if not np.array_equal(np.asarray(cloud.fields[LABEL])[known], label[patch[known]]):
        raise InputError(f"{beside}: not the JSON of {path}, which has other labels. Run mapq classify again.")
    return Findings(
        path,
        cloud,
        len(cloud),
        patch.astype(np.int32),
        head,
        [row for _, row in columns.listed],
        np.array([place for place, _ in columns.listed], np.int64),
        label,
        columns.numbers[:, 1],
        columns.numbers[:, 2],
        columns.numbers[:, 3:],
    )


def _columns(path: Path, rows: Iterable[Row], regions: Sequence[Row]) -> _Columns:
    """Read the patches one after the other and keep `MAX_LISTED` of them.

    First those of the regions, then suspicious patches, the most certain first, then plausible ones, the largest first.
    """
    lists = (region.get("patches") for region in regions)
    first = {patch for each in lists if isinstance(each, list) for patch in each if isinstance(patch, int)}
    label, numbers = bytearray(), array("d")
    kept: list[tuple[bool, bool, float, int, Row]] = []
    for number, row in enumerate(rows):
        try:
            label.append(LABELS[row["label"]])
            x, y, z = row["normal"]
            values = (row["n_points"], row["p_suspicious"], row["area_m2"], x, y, z)
            numbers.extend(math.nan if value is None else float(value) for value in values)
        except (KeyError, TypeError, ValueError, OverflowError):
            raise damaged(path, f"patch {number} lacks label, n_points, p_suspicious, area_m2 or normal") from None
        is_bad = row["label"] == "suspicious"
        size = row.get("difference" if is_bad else "area_m2")
        rank = (number in first, is_bad, size if isinstance(size, int | float) else -math.inf, -number)
        if len(kept) < MAX_LISTED:
            heapq.heappush(kept, (*rank, _without_terms(row)))
        elif rank > kept[0][:4]:
            heapq.heapreplace(kept, (*rank, _without_terms(row)))
    listed = sorted(((-minus, row) for _, _, _, minus, row in kept), key=lambda pair: pair[0])
    return _Columns(np.frombuffer(label, np.uint8), np.array(numbers, np.float64).reshape(-1, 6), listed)


def _without_terms(row: Row) -> Row:
    return {name: value for name, value in row.items() if name != "terms"}


def _regions(head: Row) -> Sequence[Row]:
    found = head.get("regions")
    return [row for row in found if isinstance(row, dict)] if isinstance(found, list) else []
