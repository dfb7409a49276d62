"""Which patches a page tells of one by one, chosen while the JSON of a result goes by; the rest as two heaps."""

from __future__ import annotations

import heapq
import math
from array import array
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.patches import PLAUSIBLE, SUSPICIOUS
from prf.shell.storage import damaged

LABELS = {"plausible": PLAUSIBLE, "suspicious": SUSPICIOUS}
NUMBERS = ("n_points", "area_m2", "p_suspicious")
NORMAL = "normal"

Floats = NDArray[np.float64]
Row = Mapping[str, Any]


class Columns:
    """Numbers of all patches, taken from their rows as these go by.

    Parameters
    ----------
    path : Path
        Of the JSON, for messages.

    Attributes
    ----------
    label : bytearray
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.label = bytearray()
        self._values = {name: array("d") for name in (*NUMBERS, NORMAL)}

    def passing(self, rows: Iterable[Row]) -> Iterator[Row]:
        """Yield the rows, and take from each what is asked of all.

        Raises
        ------
        InputError
            If a row lacks a number, or has a label that there is not.
        """
        for row in rows:
            for name in NUMBERS:
                self._values[name].append(self._number(row, name))
            for axis in range(3):
                self._values[NORMAL].append(self._number(row, NORMAL, axis))
            label = row.get("label")
            if not isinstance(label, str) or label not in LABELS:
                raise damaged(self.path, "a label is neither plausible nor suspicious")
            self.label.append(LABELS[label])
            yield row

    def of(self, name: str) -> Floats:
        """Return a number of every patch (m,), null as nan; of normals (3 m,)."""
        return np.array(self._values[name], np.float64)

    def _number(self, row: Row, name: str, axis: int | None = None) -> float:
        try:
            value = row[name] if axis is None else row[name][axis]
            return math.nan if value is None else float(value)
        except (KeyError, IndexError, TypeError, ValueError, OverflowError):
            raise damaged(self.path, f"patches without {name}") from None


def choose(rows: Iterable[Row], worst: Sequence[Any], n_most: int) -> list[tuple[int, Row]]:
    """Return the patches that matter most with their numbers, ascending, at most `n_most`; without their terms.

    First those of the regions listed, then suspicious patches, the surest first, then plausible ones, the largest
    first.

    Parameters
    ----------
    rows : iterable of mapping
        Patches in the order of their numbers; no more than `n_most` of them are held.
    worst : sequence
        Lists of the patches of the regions listed.
    n_most : int
    """
    listed = {patch for patches in worst if isinstance(patches, list) for patch in patches if isinstance(patch, int)}
    kept: list[tuple[bool, bool, float, int, Row]] = []
    for number, row in enumerate(rows):
        is_bad = row.get("label") == "suspicious"
        size = row.get("difference" if is_bad else "area_m2")
        rank = (number in listed, is_bad, size if isinstance(size, int | float) else -math.inf, -number)
        if len(kept) < n_most:
            heapq.heappush(kept, (*rank, _without_terms(row)))
        elif rank > kept[0][:4]:
            heapq.heapreplace(kept, (*rank, _without_terms(row)))
    return sorted(((-minus, row) for _, _, _, minus, row in kept), key=lambda pair: pair[0])


def _without_terms(row: Row) -> Row:
    return {name: value for name, value in row.items() if name != "terms"}


class Shown(NamedTuple):
    """Patches as a page numbers them: those told of, and if there are more, two that stand for all others.

    Attributes
    ----------
    patch : (n,) int32
        Of each point.
    label : (k,) or (k + 2,) uint8
        The last two, if they are there, are the other plausible patches and the other suspicious ones.
    probability : as label, float64
        The mean over all others.
    normal : (k or k + 2, 3) float64
        nan of all others.
    others : (2,) int64
        How many they are.
    """

    patch: NDArray[np.int32]
    label: NDArray[np.uint8]
    probability: Floats
    normal: Floats
    others: NDArray[np.int64]


def shown_patches(
    patch: NDArray[np.int32],
    number: NDArray[np.int64],
    label: NDArray[np.uint8],
    probability: Floats,
    normal: Floats,
) -> Shown:
    """Return patches as a page numbers them, of points (n,) and all m patches; `number` (k,) are those told of."""
    if len(number) == len(label):
        return Shown(patch, label, probability, normal, np.zeros(2, np.int64))
    is_other = np.ones(len(label), np.bool_)
    is_other[number] = False
    groups = [np.flatnonzero(is_other & (label == kind)) for kind in (PLAUSIBLE, SUSPICIOUS)]
    place = np.empty(len(label) + 1, np.int32)
    place[-1] = -1
    place[number] = np.arange(len(number))
    for extra, group in enumerate(groups):
        place[group] = len(number) + extra
    means = [float(np.nanmean(probability[group])) if len(group) else math.nan for group in groups]
    return Shown(
        place[patch],
        np.append(label[number], [PLAUSIBLE, SUSPICIOUS]).astype(np.uint8),
        np.append(probability[number], means),
        np.concatenate([normal[number], np.full((2, 3), np.nan)]),
        np.array([len(group) for group in groups], np.int64),
    )
