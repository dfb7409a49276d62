"""Two maps of one place: which is better, and where each is."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from mapq.results.judged import Judged
from prf.shell.errors import InputError, UsageError

LEAST_AREA = 1.0
"""m² of patches that both maps need in a cell for it to be common ground."""
CHANGE = 0.25
"""Expected suspicious share by which a cell must differ to be called better or worse."""
CORNER = 1.9
"""Sides: centres of cells that touch, be it at a corner, are sqrt(3) apart at most, and of all others 2 or more."""
SAME = 0.005
"""Expected suspicious shares of whole maps closer than this are called the same."""
LEAST_KNOWN = 0.2
"""Share of either map's area on common ground on which the disagreement of scans must be known to decide."""
BLOCK = 20.0
"""Metres: errors of disagreements so near to one another go together, as one fit of motions has them."""
UNSURE = 0.03
"""Metres: standard error of a difference from which a cell counts for less than half."""
DISAGREEMENT, EXPECTED = "disagreement", "expected share"
"""By what the better map is found."""

Floats = NDArray[np.float64]


class Place(NamedTuple):
    """Neighbouring cells that changed alike."""

    worse: bool  # whether the second map is worse there
    n_cells: int
    # m² of patches (mean of both maps), and by how much more of it is expected to be suspicious in the second map
    area: float
    change: float
    before: float  # expected suspicious share of the area in both maps
    after: float
    low: Floats  # (3,) corners of the box of the cells, world coordinates
    high: Floats  # (3,)


class Comparison(NamedTuple):
    """How two maps of one place differ, on their common ground."""

    cell: float  # side of the cells in metres
    tolerance: float  # metres at which both are judged
    n_cells: int  # cells in which both maps have patches
    # (2,) of each map on common ground: m² of patches, the share of it called suspicious, and the share expected to be
    area: Floats
    suspicious: Floats  # (2,)
    expected: Floats  # (2,)
    covered: Floats  # (2,) share of each map's area that is common ground
    # (2,) mean metres by which scans of each map disagree, where that is known of both; nan where nothing is
    disagreement: Floats
    coverage: Floats  # (2,) share of each map's points on planes that are in patches; nan unknown
    by: str  # by what they are compared: ``disagreement`` where scans are known in both, else ``expected share``
    difference: Floats  # (3,) of that, second less first, between its bounds at 95 %
    better: str  # ``first``, ``second``, or ``same`` where the bounds hold no difference
    places: list[Place]  # largest change first


def compare(first: Judged, second: Judged, cell: float) -> Comparison:
    """Return how the second map differs from the first, cell by cell.

    `first` and `second`: in one frame: nothing is aligned. `cell`: side in metres of the cubes that are compared;
    larger than walls moved between the maps. Raises UsageError unless the cell is a length and both are judged at one
    tolerance; InputError if no cell has patches of both.
    """
    check_cell(cell)
    if first.tolerance != second.tolerance:
        raise UsageError(
            f"{first.source} is judged at {first.tolerance:g} m and {second.source} at {second.tolerance:g} m. "
            f"Judge both at one: --tolerance {max(first.tolerance, second.tolerance):.3g}"
        )
    keys, of_point = np.unique(
        np.floor(np.vstack([first.xyz, second.xyz]) / cell).astype(np.int64), axis=0, return_inverse=True
    )
    parts = np.split(of_point.ravel(), [len(first.xyz)])
    sums = np.array([_sums(each, part, len(keys)) for each, part in zip((first, second), parts, strict=True)])
    common = np.flatnonzero((sums[:, 0] >= LEAST_AREA).all(axis=0))
    if len(common) == 0:
        raise InputError(
            f"{first.source} and {second.source} share no cell of {cell:g} m with patches of both. "
            "Bring them into one frame, or give a larger --cell."
        )
    area, suspicious, expected, *apart = sums[:, :, common].transpose(1, 0, 2)
    total = area.sum(axis=1)
    shares = expected.sum(axis=1) / total
    metres, error, is_known = _disagreement(keys[common], area, np.array(apart), cell)
    measure, off = (metres, 1.96 * error) if is_known else (shares, SAME)
    value = float(measure[1] - measure[0])
    return Comparison(
        cell=cell,
        tolerance=first.tolerance,
        n_cells=len(common),
        area=total,
        suspicious=suspicious.sum(axis=1) / total,
        expected=shares,
        covered=total / sums[:, 0].sum(axis=1),
        disagreement=metres,
        coverage=np.array([first.coverage, second.coverage]),
        by=DISAGREEMENT if is_known else EXPECTED,
        difference=np.array([value - off, value, value + off]),
        better="same" if abs(value) <= off else ("second" if value < 0.0 else "first"),
        places=_places(keys[common], area, expected / area, cell),
    )


def _disagreement(keys: NDArray[np.int64], area: Floats, apart: Floats, cell: float) -> tuple[Floats, float, np.bool_]:
    """Return the mean disagreement (2,) of both maps, the standard error of its difference, and whether it decides.

    Each cell (k, 3) in which both know it counts by its area in both, so that copies do not weigh more than what they
    are copies of, and less where it is unsure. `area` (2, k) is all there is; `apart` (3, 2, k) sums of the area in
    which it is known, and of disagreement and error times that.
    """
    both = np.flatnonzero((apart[0] >= LEAST_AREA).all(axis=0))
    known = apart[0][:, both]
    if (known.sum(axis=1) < LEAST_KNOWN * area.sum(axis=1)).any():
        return np.full(2, np.nan), np.nan, np.bool_(False)
    metres, errors = apart[1:, :, both] / known
    error = np.hypot(*errors)
    weight = known.mean(axis=0) / (1.0 + (error / UNSURE) ** 2)
    weight /= weight.sum()
    _, block = np.unique(np.floor(keys[both] * (cell / BLOCK)), axis=0, return_inverse=True)
    of_blocks = np.bincount(block.ravel(), weight * error)
    return metres @ weight, float(np.linalg.norm(of_blocks)), np.bool_(True)


def check_cell(cell: float) -> None:
    """Raise UsageError unless the side of the cubes is a length."""
    if not 0.0 < cell < 1e6:
        raise UsageError(f"--cell {cell:g}: must be a length in metres above 0.")


def _sums(judged: Judged, cell: NDArray[np.int64], n_cells: int) -> Floats:
    """Return by cell (6, n): area, suspicious area, expected suspicious area, and those of the disagreement."""
    known = np.where(np.isfinite(judged.disagreement), judged.area, 0.0)
    weights = (
        judged.area,
        judged.area * judged.suspicious,
        judged.area * judged.probability,
        known,
        known * np.nan_to_num(judged.disagreement),
        known * np.nan_to_num(judged.error),
    )
    return np.array([np.bincount(cell, weight, n_cells) for weight in weights])


def _places(keys: NDArray[np.int64], area: Floats, share: Floats, cell: float) -> list[Place]:
    """Return the groups of touching cells (k, 3) that changed alike; area and share (2, k)."""
    change = share[1] - share[0]
    found = []
    for worse in (True, False):
        some = np.flatnonzero(change > CHANGE if worse else change < -CHANGE)
        if len(some) == 0:
            continue
        near = KDTree(keys[some].astype(np.float64)).query_pairs(CORNER, output_type="ndarray")
        links = coo_matrix((np.ones(len(near), np.int8), (near[:, 0], near[:, 1])), shape=(len(some),) * 2)
        n_parts, part = connected_components(links, directed=False)
        found += [_place(worse, some[part == index], keys, area, share, cell) for index in range(n_parts)]
    return sorted(found, key=lambda place: (-abs(place.change), *place.low.tolist()))


def _place(
    worse: bool, cells: NDArray[np.int64], keys: NDArray[np.int64], area: Floats, share: Floats, cell: float
) -> Place:
    mean = area[:, cells].mean(axis=0)
    before, after = (share[:, cells] * mean).sum(axis=1)
    whole = float(mean.sum())
    low, high = keys[cells].min(axis=0) * cell, (keys[cells].max(axis=0) + 1) * cell
    return Place(
        worse, len(cells), whole, float(after - before), float(before) / whole, float(after) / whole, low, high
    )


def comparison_content(found: Comparison) -> dict[str, Any]:
    """Return a comparison as the JSON object of ``mapq compare``, without the schema."""
    names = ("area_m2", "share_of_area", "expected_share_of_area", "share_in_common", "disagreement_m", "coverage")
    columns = found.area, found.suspicious, found.expected, found.covered, found.disagreement, found.coverage
    first, second = (dict(zip(names, map(float, row), strict=True)) for row in zip(*columns, strict=True))
    return {
        "cell_m": found.cell,
        "tolerance_m": found.tolerance,
        "n_cells": found.n_cells,
        "first": first,
        "second": second,
        "better": found.better,
        "by": found.by,
        "difference": dict(zip(("low", "value", "high"), found.difference.tolist(), strict=True)),
        "places": [
            {
                "change": "worse" if place.worse else "better",
                "n_cells": place.n_cells,
                "area_m2": place.area,
                "change_m2": place.change,
                "expected_share_before": place.before,
                "expected_share_after": place.after,
                "low": place.low,
                "high": place.high,
            }
            for place in found.places
        ],
    }
