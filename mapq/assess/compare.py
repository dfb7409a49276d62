"""Two maps of one place: which is better, and where each is."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from mapq.assess.judged import Judged
from prf.shell.errors import InputError, UsageError

LEAST_AREA = 1.0
"""m² of patches that both maps need in a cell for it to be common ground."""
CHANGE = 0.25
"""Expected suspicious share by which a cell must differ to be called better or worse."""
CORNER = 1.9
"""Sides: centres of cells that touch, be it at a corner, are sqrt(3) apart at most, and of all others 2 or more."""
SAME = 0.005
"""Expected suspicious shares of whole maps closer than this are called the same."""

Floats = NDArray[np.float64]


class Place(NamedTuple):
    """Neighbouring cells that changed alike.

    Attributes
    ----------
    worse : bool
        Whether the second map is worse there.
    n_cells : int
    area, change : float
        m² of patches (mean of both maps), and by how much more of it is expected to be suspicious in the second map.
    before, after : float
        Expected suspicious share of the area in both maps.
    low, high : (3,) float64
        Corners of the box of the cells, world coordinates.
    """

    worse: bool
    n_cells: int
    area: float
    change: float
    before: float
    after: float
    low: Floats
    high: Floats


class Comparison(NamedTuple):
    """How two maps of one place differ, on their common ground.

    Attributes
    ----------
    cell : float
        Side of the cells in metres.
    n_cells : int
        Cells in which both maps have patches.
    area, suspicious, expected : (2,) float64
        Of each map on common ground: m² of patches, the share of it called suspicious, and the share expected to be.
    covered : (2,) float64
        Share of each map's area that is common ground.
    better : str
        ``first``, ``second``, or ``same``.
    places : list of Place
        Largest change first.
    """

    cell: float
    n_cells: int
    area: Floats
    suspicious: Floats
    expected: Floats
    covered: Floats
    better: str
    places: list[Place]


def compare(first: Judged, second: Judged, cell: float) -> Comparison:
    """Return how the second map differs from the first, cell by cell.

    Parameters
    ----------
    first, second : Judged
        In one frame: nothing is aligned.
    cell : float
        Side in metres of the cubes that are compared; larger than what walls moved by between the maps.

    Raises
    ------
    UsageError
        If the cell is no length.
    InputError
        If no cell has patches of both.
    """
    check_cell(cell)
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
    area, suspicious, expected = sums[:, :, common].transpose(1, 0, 2)
    total = area.sum(axis=1)
    shares = expected.sum(axis=1) / total
    winner = "same" if abs(shares[1] - shares[0]) < SAME else ("second" if shares[1] < shares[0] else "first")
    places = _places(keys[common], area, expected / area, cell)
    covered = total / sums[:, 0].sum(axis=1)
    return Comparison(cell, len(common), total, suspicious.sum(axis=1) / total, shares, covered, winner, places)


def check_cell(cell: float) -> None:
    """Raise UsageError if the side of the cubes is no length."""
    if not 0.0 < cell < 1e6:
        raise UsageError(f"--cell {cell:g} is no length in metres. Give one above 0.")


def _sums(judged: Judged, cell: NDArray[np.int64], n_cells: int) -> Floats:
    """Return by cell (3, n): area, suspicious area, expected suspicious area."""
    weights = judged.area, judged.area * judged.suspicious, judged.area * judged.probability
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


def comparison_content(comparison: Comparison) -> Mapping[str, Any]:
    """Return a comparison as the JSON object of ``mapq compare``, without the schema."""
    maps = zip(comparison.area, comparison.suspicious, comparison.expected, comparison.covered, strict=True)
    names = ("area_m2", "share_of_area", "expected_share_of_area", "share_in_common")
    first, second = (dict(zip(names, map(float, row), strict=True)) for row in maps)
    return {
        "cell_m": comparison.cell,
        "n_cells": comparison.n_cells,
        "first": first,
        "second": second,
        "better": comparison.better,
        "places": [_place_row(place) for place in comparison.places],
    }


def _place_row(place: Place) -> dict[str, Any]:
    return {
        "change": "worse" if place.worse else "better",
        "n_cells": place.n_cells,
        "area_m2": place.area,
        "change_m2": place.change,
        "expected_share_before": place.before,
        "expected_share_after": place.after,
        "low": place.low,
        "high": place.high,
    }
