"""Regions of a map: connected suspicious patches, with extent and severity."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from mapq.features.table import PatchFeatures
from mapq.patches import Patches

MIN_OVERLAP = 0.05
"""Overlap from which a pair's distance shows by how much a region is displaced."""


class Region(NamedTuple):
    """Suspicious patches that are neighbours, directly or through others."""

    patches: NDArray[np.int64]  # (k,) ascending
    n_points: int
    # in m²: area of the patches, and the area among it that is expected to be wrong, the sum of area times
    # p_suspicious. Without areas points are used instead.
    area: float
    severity: float
    low: NDArray[np.float64]  # (3,) box of the points, in world coordinates and the cloud's unit
    high: NDArray[np.float64]  # (3,)
    centre: NDArray[np.float64]  # (3,) mean of the points, likewise
    # metres between surfaces of the region that lie over one another: the median over the shared area; nan where none
    # do
    displacement: float
    p_suspicious: float  # mean over the area

    def row(self, number: int, decimals: int) -> dict[str, Any]:
        """Return the region as JSON; its place among regions is its number."""
        shown = {name: round(getattr(self, name), decimals) for name in ("area", "severity", "displacement")}
        places = {name: [round(x, 6) for x in getattr(self, name).tolist()] for name in ("low", "high", "centre")}
        return {
            "region": number,
            "n_patches": len(self.patches),
            "n_points": self.n_points,
            "area_m2": shown["area"],
            "severity_m2": shown["severity"],
            "displacement_m": shown["displacement"],
            "p_suspicious": round(self.p_suspicious, decimals),
            **places,
            "patches": self.patches.tolist(),
        }


def find_regions(
    patches: Patches,
    features: PatchFeatures,
    suspicious: NDArray[np.bool_],
    probability: NDArray[np.floating],
    area: NDArray[np.float64],
) -> list[Region]:
    """Return the regions of a map, the most severe first, of equals the one with the smallest patch number.

    `features`: neighbours are those of the random field. `suspicious` (m,). `probability` and `area` (m,): areas may be
    nan: then points are used instead.
    """
    size = area if np.isfinite(area).all() else patches.counts.astype(np.float64)
    inside = np.flatnonzero(suspicious[features.pairs].all(axis=1))
    pairs = features.pairs[inside]
    links = coo_matrix((np.ones(len(pairs), np.int8), (pairs[:, 0], pairs[:, 1])), shape=(len(patches),) * 2)
    part = connected_components(links, directed=False)[1]
    members = np.flatnonzero(suspicious)
    order = members[np.argsort(part[members], kind="stable")]
    groups = np.split(order, np.flatnonzero(np.diff(part[order])) + 1) if len(order) else []
    # Pairs are dealt to regions once: looking through all of them for each region would be quadratic.
    inside = inside[np.argsort(part[pairs[:, 0]], kind="stable")]
    wanted, dealt = [part[group[0]] for group in groups], part[features.pairs[inside, 0]]
    first, last = (np.searchsorted(dealt, wanted, side) for side in ("left", "right"))
    wide = probability.astype(np.float64)
    found = [
        _region(patches, group, wide, size, _displacement(features, inside[begin:end]))
        for group, begin, end in zip(groups, first.tolist(), last.tolist(), strict=True)
    ]
    return sorted(found, key=lambda region: (-region.severity, int(region.patches[0])))


def _region(
    patches: Patches,
    group: NDArray[np.int64],
    probability: NDArray[np.float64],
    size: NDArray[np.float64],
    displacement: float,
) -> Region:
    n_points, corners = patches.extent(group)
    area, severity = float(size[group].sum()), float((size[group] * probability[group]).sum())
    low, high, centre = patches.cloud.world_of(corners)
    p_suspicious = severity / area if area > 0.0 else float(probability[group].mean())
    return Region(group, n_points, area, severity, low, high, centre, displacement, p_suspicious)


def _displacement(features: PatchFeatures, inside: NDArray[np.int64]) -> float:
    """Return the median offset of the pairs `inside` a region that lie over one another, by the shared area."""
    columns = [features.edge_names.index(name) for name in ("overlap", "offset", "overlap_area")]
    overlap, offset, shared = features.edge[inside[:, None], columns].T
    over = overlap > MIN_OVERLAP
    return weighted_median(offset[over], np.maximum(shared[over], 1e-9))


def weighted_median(values: NDArray[np.float64], weight: NDArray[np.float64]) -> float:
    """Return the median of values (n,) by weights (n,), of those where both are known; nan of none."""
    known = np.isfinite(values) & np.isfinite(weight)
    order = np.flatnonzero(known)[np.argsort(values[known], kind="stable")]
    total = np.cumsum(weight[order])
    if not len(order) or not total[-1]:
        return float("nan")
    return float(values[order[int(np.searchsorted(total, 0.5 * total[-1]))]])
