"""`Findings`: a RESULT and the JSON beside it, checked against each other, as a report needs them."""

from __future__ import annotations

import heapq
import math
from array import array
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.cloud import PointCloud
from mapq.io.maps import Row, StoredResult, read_map
from mapq.io.results import LABEL, RESULT_FIELDS
from mapq.io.tiles import thinned_by_patch
from mapq.labels import NO_PATCH, PLAUSIBLE, SUSPICIOUS
from mapq.patches import Patches
from prf.shell.cli.files import STREAM
from prf.shell.cli.storage import damaged
from prf.shell.errors import InputError, UsageError

MAX_LISTED = 50_000
"""Patches that a page describes one by one: no browser makes a table of more."""
MAX_READ = 4_000_000
"""Points of a result in tiles that outlines and views are made from, about."""
MAX_REGIONS = 50
"""Regions that a page lists; smaller ones are counted."""
LABELS = {"plausible": PLAUSIBLE, "suspicious": SUSPICIOUS}

Floats = NDArray[np.float64]


class Findings(NamedTuple):
    """Contents of a result of m patches."""

    path: str
    cloud: PointCloud  # all points; of a result in tiles a part of them, evenly spread over each patch
    n_points: int  # of the map
    patch: NDArray[np.int32]  # (n,) of each point, `NO_PATCH` for none
    head: dict[str, Any]  # the JSON of the result without its patches
    rows: dict[int, Row]  # patches listed one by one, without their terms: all of them up to `MAX_LISTED`
    label: NDArray[np.uint8]  # (m,)
    probability: Floats  # (m,)
    area: Floats  # (m,) m², nan where it is unknown
    normal: Floats  # (m, 3)

    def part(self, *names: str) -> Row:
        """Return an object inside the JSON, empty where it is missing."""
        found: Any = self.head
        for name in names:
            found = found.get(name) or {}
        return dict(found)

    @property
    def regions(self) -> Sequence[Row]:
        """Regions, worst first."""
        return self.head.get("regions") or ()

    @property
    def threshold(self) -> float:
        """Probability from which patches are suspicious."""
        return float(self.part("threshold").get("p_suspicious", 0.5))

    def local(self, place: Sequence[float] | None) -> list[float]:
        """Return a place (3) of the JSON in metres without the global shift; nan if there is none."""
        if place is None:
            return [math.nan] * 3
        moved: Floats = (np.array(place, np.float64) - self.cloud.shift) * self.cloud.unit
        return list(map(float, moved))


def read_findings(path: str) -> Findings:
    """Read a RESULT and the JSON beside it, or a result in tiles and the JSON among them.

    Raises InputError if either is missing or damaged, the file is not a result, or the two do not belong together.
    """
    if path == STREAM:
        raise UsageError("a report needs RESULT and the JSON beside it, which standard input does not have. Name it.")
    stored = read_map(path)
    if isinstance(stored, Patches):
        raise InputError(f"{path}: these are patches without labels of a model. Run mapq classify {path} first.")
    if isinstance(stored, PointCloud):
        missing = next(name for name in RESULT_FIELDS if name not in stored.fields)
        raise InputError(f"{path}: expected a result, with the field {missing}. Run mapq classify {path} first.")
    return findings_of(stored, *stored.content())


def findings_of(stored: StoredResult, head: dict[str, Any], rows: Iterable[Row]) -> Findings:
    """Return the findings of a result, whose JSON is a head and a row a patch.

    Raises InputError if these do not belong to its points.
    """
    first = {patch for region in (head.get("regions") or ())[:MAX_REGIONS] for patch in region["patches"]}
    label, numbers, listed = _columns(stored, rows, first)
    cloud, n_points = _points(stored, numbers[:, 0])
    return Findings(
        stored.path,
        cloud,
        n_points,
        _patch_of_points(stored, cloud, label, numbers[:, 0]),
        head,
        listed,
        label,
        numbers[:, 1],
        numbers[:, 2],
        numbers[:, 3:],
    )


def _points(stored: StoredResult, counts: Floats) -> tuple[PointCloud, int]:
    """Return the points that a report looks at, and how many the map has."""
    if isinstance(stored.points, PointCloud):
        return stored.points, int(stored.points.finite().sum())
    return thinned_by_patch(stored.points, np.nan_to_num(counts).astype(np.int64), MAX_READ), stored.points.n_points


def _patch_of_points(
    stored: StoredResult, cloud: PointCloud, label: NDArray[np.uint8], n_points: Floats
) -> NDArray[np.int32]:
    """Return the patch (n,) of each point, and refuse points and JSON that do not belong together."""
    rows, patch = stored.inside(cloud, len(label))
    if (np.bincount(patch, minlength=len(label)) > n_points).any():
        raise stored.mismatch("patches")
    if not np.array_equal(np.asarray(cloud.fields[LABEL])[rows], label[patch]):
        raise stored.mismatch("labels")
    found = np.full(len(cloud), NO_PATCH, np.int32)
    found[rows] = patch
    return found


def _columns(
    stored: StoredResult, rows: Iterable[Row], first: set[int]
) -> tuple[NDArray[np.uint8], Floats, dict[int, Row]]:
    """Return labels (m,), and n_points, p_suspicious, area_m2 and normal (m, 6); and `MAX_LISTED` of the patches.

    These are the `first` ones, then suspicious ones, the most severe first, then plausible ones, the largest first.
    """
    label, numbers = bytearray(), array("d")
    kept: list[tuple[bool, bool, float, int, Row]] = []
    for number, row in enumerate(rows):
        try:
            label.append(LABELS[row["label"]])
            x, y, z = row["normal"]
            values = (row["n_points"], row["p_suspicious"], row["area_m2"], x, y, z)
            numbers.extend(math.nan if value is None else float(value) for value in values)
        except (KeyError, TypeError, ValueError, OverflowError):
            raise damaged(
                stored.json, f"patch {number} lacks label, n_points, p_suspicious, area_m2 or normal"
            ) from None
        is_bad = label[-1] == SUSPICIOUS
        p, size = values[1:3]
        size = size * p if is_bad and size is not None and p is not None else size
        shown = {name: value for name, value in row.items() if name != "terms"}
        entry = (number in first, is_bad, -math.inf if size is None else size, -number, shown)
        if len(kept) < MAX_LISTED:
            heapq.heappush(kept, entry)
        else:
            heapq.heappushpop(kept, entry)
    listed = {-minus: row for _, _, _, minus, row in kept}
    return np.frombuffer(label, np.uint8), np.array(numbers, np.float64).reshape(-1, 6), dict(sorted(listed.items()))
