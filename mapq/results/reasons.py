"""Why a patch has its label, in words and metres, made of the terms of its log-odds."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from mapq.crf import Terms
from mapq.crf.explain import BASE, NEIGHBOUR_LABEL, NO_OTHER
from mapq.crf.trees import ACROSS, LOW_RATIO, OFFSET_RATIO, OVER, SURELY, TOLERANCE
from mapq.features.context import DISAGREEMENT
from mapq.features.copies import COLUMNS
from mapq.features.table import PatchFeatures
from mapq.patches import Patches

MEASURES = {
    "fit": ("rms_m", "its points lie %.3g m off their plane (rms)"),
    "tilt": ("tilt_deg", "%.3g degrees from vertical"),
    "thickness": ("thickness_m", "%.3g m thick"),
    "inverse_mse": ("rms_m", "its points lie %.3g m off their plane (rms)"),
    "inverse_up_cosine": ("tilt_deg", "%.3g degrees from vertical"),
}
"""Node feature to the shape measure of the same meaning for people, and its words."""

OF_PAIRS = ("over_", OVER, ACROSS)
"""How columns of the trees begin that are of the surface that lies over a patch, or crosses it, most."""
WORDS = {
    OVER: "weighted overlap with the surface over it",
    ACROSS: "weighted crossing with the surface across it",
    "over_partly_covered": "how far the surface over it covers a part of it alone:",
    "over_unlike_height": "how unlike in height the surface over it is:",
    "over_facing_away": "how far the surface over it was seen from the other side:",
    OFFSET_RATIO: "distance of the surface over it, in tolerances:",
}

GROUPS = {
    **dict.fromkeys((*DISAGREEMENT, "n_scans", "seen_by_several"), "disagreement"),
    **dict.fromkeys((SURELY, "disagreement_ratio", LOW_RATIO, "high_ratio"), "disagreement"),
    **dict.fromkeys((*COLUMNS, "along_ratio"), "shift_support"),
}
"""Node features that are one reason, to the one it is named by."""
AGREE = 0.05
"""Metres up to which scans are reported to agree."""

PARALLEL_DEG = 5.0
"""Planes at a smaller angle are called parallel: two passes over one wall may be turned by as much."""
TOUCHING = 0.05
"""Overlap or crossing below which two patches neither lie over one another nor cross: chance makes as much."""

PAIR_MEASURES = (("offset", "offset_m"), ("separation", "separation_m"), ("angle_deg", "angle_deg"))
PAIR_SHARES = ("overlap", "crossing")


class Reason(NamedTuple):
    """A reason for a patch's label."""

    text: str  # for people: "parallel to patch 41 at 0.32 m, overlap 78%"
    log_odds: float  # how much it adds to the log-odds of being suspicious, in nats
    other: int | None  # the other patch, if the reason is a pair
    measures: dict[str, float]  # what the text is made of: metres, degrees and shares by name

    def row(self, decimals: int) -> dict[str, Any]:
        """Return the reason as JSON."""
        measures = {name: round(value, decimals) for name, value in self.measures.items()}
        other = {} if self.other is None else {"other": self.other}
        return {"text": self.text, "log_odds": round(self.log_odds, decimals), **other, **measures}


class Reasons:
    """The reasons of all patches of one map.

    Parameters
    ----------
    features : PatchFeatures
    terms : Terms
    """

    def __init__(self, features: PatchFeatures, terms: Terms) -> None:
        self._features, self._terms = features, terms
        self._starts = terms.starts(len(features.node))
        # Where scans are not known that is so of all patches: no reason for one of them.
        names = features.node_names
        self._knows_scans = "n_scans" in names and bool(np.isfinite(features.node[:, names.index("n_scans")]).any())
        self._keys = features.pairs[:, 0].astype(np.int64) * len(features.node) + features.pairs[:, 1]

    def of(self, patch: int, sign: float, n_most: int) -> list[Reason]:
        """Return at most `n_most` reasons of a patch, largest first.

        `sign`: reasons for suspicious, or for plausible. All features of one pair are one reason; the bias is not one.
        """
        found = [reason for reason in self._all(patch) if sign * reason.log_odds > 0.0]
        found.sort(key=lambda reason: -abs(reason.log_odds))
        return found[:n_most]

    def _all(self, patch: int) -> Iterator[Reason]:
        terms, pairs, groups = self._terms, dict[int, float](), dict[str, float]()
        for place in range(int(self._starts[patch]), int(self._starts[patch + 1])):
            name, gain = terms.names[int(terms.name[place])], float(terms.contribution[place])
            other, value = int(terms.other[place]), float(terms.value[place])
            if name == NEIGHBOUR_LABEL:
                state = "suspicious" if value else "plausible"
                yield Reason(f"neighbour {other} is {state}", gain, other, {})
            elif other != NO_OTHER:
                pairs[other] = pairs.get(other, 0.0) + gain
            elif name in GROUPS:
                groups[GROUPS[name]] = groups.get(GROUPS[name], 0.0) + gain
            elif name not in (BASE, TOLERANCE):
                yield self._of_node(patch, name, value, gain)
        for name, gain in groups.items():
            if name != "disagreement" or self._knows_scans:
                yield self._of_group(patch, name, gain)
        for other, gain in pairs.items():
            yield self._of_pair(patch, other, gain)

    def _of_node(self, patch: int, name: str, value: float, gain: float) -> Reason:
        measure, words = MEASURES.get(name, ("", ""))
        if measure not in self._features.shape_names:
            return Reason(plain_words(name, value), gain, None, {name: value})
        known = float(self._features.shape[patch, self._features.shape_names.index(measure)])
        return Reason(words % known, gain, None, {measure: known})

    def _of_group(self, patch: int, group: str, gain: float) -> Reason:
        values = dict(zip(self._features.node_names, self._features.node[patch].tolist(), strict=True))
        measures = {name: value for name, value in values.items() if GROUPS.get(name) == group and np.isfinite(value)}
        return Reason(group_words(group, values), gain, None, measures)

    def _of_pair(self, patch: int, other: int, gain: float) -> Reason:
        key = min(patch, other) * len(self._features.node) + max(patch, other)
        row = self._features.edge[int(np.searchsorted(self._keys, key))]
        values = dict(zip(self._features.edge_names, row.tolist(), strict=True))
        measures = {shown: values[name] for name, shown in PAIR_MEASURES}
        return Reason(pair_words(values, other), gain, other, measures | {name: values[name] for name in PAIR_SHARES})


def plain_words(name: str, value: float) -> str:
    """Return the reason that a column of the trees gives by itself."""
    if name.startswith(OF_PAIRS) and (not np.isfinite(value) or value == 0.0):
        return "no other surface crosses it" if name == ACROSS else "no other surface lies over it"
    return f"{WORDS.get(name, name.replace('_', ' '))} {value:.2g}"


def group_words(group: str, values: dict[str, float]) -> str:
    """Return the reason that several node features of a patch give together, given all of its node features by name."""
    if group == "disagreement":
        if not np.isfinite(values["disagreement"]):
            return "one scan alone saw it" if values["n_scans"] == 1.0 else "no scan has ten points on it"
        if values["disagreement"] <= AGREE:
            return f"{values['n_scans']:.0f} scans that see it agree within {AGREE} m"
        low, metres, high = (values[name] for name in ("disagreement_low", "disagreement", "disagreement_high"))
        return f"scans that see it disagree by {metres:.2f} m ({low:.2f} to {high:.2f})"
    if not values["shift_support"] > 0.0:
        return "nearby surfaces would lie on others by no shift"
    share, along = values["shift_support"], values["shift_along"]
    far = max(values["shift_length"], along)  # the former is one of the grid of shifts that are tried
    return f"{share:.0%} of nearby surfaces would lie on others if moved by {far:.2f} m, {along:.2f} m along its normal"


def pair_words(values: dict[str, float], other: int) -> str:
    """Return how a patch lies to patch `other`, given the edge features of the pair by name."""
    angle, overlap, crossing = values["angle_deg"], values["overlap"], values["crossing"]
    if crossing > max(overlap, TOUCHING):
        # R is the nearer edge's distance by the farther one's, less where there are openings beside the line.
        inwards = 2.0 * crossing / (1.0 + crossing)
        where = f"at least {inwards:.0%} of the way from the edges to the middle"
        return f"crosses patch {other} at {angle:.3g} degrees, {where}"
    if overlap <= TOUCHING:
        apart = values["separation"]
        away = f"{apart:.2f} m from patch {other}," if apart >= 0.01 else f"touches patch {other}"
        return f"{away} at {angle:.0f} degrees, neither overlapping nor crossing it"
    how = f"parallel to patch {other} at" if angle < PARALLEL_DEG else f"at {angle:.0f} degrees over patch {other} at"
    return f"{how} {values['offset']:.2f} m, overlap {overlap:.0%}{context_words(values)}"


def context_words(values: dict[str, float]) -> str:
    """Return the reason that context gives for a pair that lies over one another, by its edge features; or nothing."""
    if values.get("facing_away", 0.0) > 0.5 * values["weight"] * values["overlap"]:
        return ", seen from opposite sides: two faces of one wall"
    return ""


LEAST_OF_KIND = 0.1
"""Share of the area, of surfaces of a kind, from which on their median counts by itself."""
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
    # metres by which its surfaces lie apart, by what its patches themselves say; nan where they do not
    displacement: float
    p_suspicious: float  # mean over the area
    worst: int  # its patch of the most area times p_suspicious
    worst_displacement: float  # metres by which that says that surfaces lie apart; nan where it does not

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
            "worst_patch": self.worst,
            "worst_displacement_m": round(self.worst_displacement, decimals),
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
    wide, said = probability.astype(np.float64), _said(features)
    found = [
        _region(
            patches, group, wide, size, said, _displacement(features, said[:, group], size[group], inside[begin:end])
        )
        for group, begin, end in zip(groups, first.tolist(), last.tolist(), strict=True)
    ]
    return sorted(found, key=lambda region: (-region.severity, int(region.patches[0])))


def _region(
    patches: Patches,
    group: NDArray[np.int64],
    probability: NDArray[np.float64],
    size: NDArray[np.float64],
    said: NDArray[np.float64],
    displacement: float,
) -> Region:
    n_points, corners = patches.extent(group)
    area, severity = float(size[group].sum()), float((size[group] * probability[group]).sum())
    low, high, centre = patches.cloud.world_of(corners)
    p_suspicious = severity / area if area > 0.0 else float(probability[group].mean())
    worst = int(group[np.argmax(size[group] * probability[group])])
    apart = float(next((metres for metres in said[:, worst] if np.isfinite(metres)), np.nan))
    return Region(group, n_points, area, severity, low, high, centre, displacement, p_suspicious, worst, apart)


def _said(features: PatchFeatures) -> NDArray[np.float64]:
    """Return by how much patches say that surfaces lie apart (2, m): by scans, and by their copies; nan unknown."""
    names, node = features.node_names, features.node
    along = np.full(len(node), np.nan)
    if "shift_along" in names:
        is_copied = node[:, names.index("shift_support")] > 0.0
        along[is_copied] = node[is_copied, names.index("shift_along")]
    return np.array([features.disagreement[:, 1], along])


def _displacement(
    features: PatchFeatures, said: NDArray[np.float64], size: NDArray[np.float64], inside: NDArray[np.int64]
) -> float:
    """Return by how much the patches of a region say (2, k) that surfaces lie apart, the median over their size (k,).

    By scans where they are known; where neither they nor copies are, as of models that look at none, the median offset
    of the pairs `inside` that lie over one another, by the shared area.
    """
    for metres in said:
        if np.isfinite(metres).any():
            return weighted_median(metres, np.maximum(size, 1e-9))
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


def largest_median(metres: NDArray[np.float64], area: NDArray[np.float64], kinds: NDArray[np.uint8]) -> float:
    """Return the largest of the medians of `metres` (n,) by area (n,) over surfaces of one kind (n,); nan of none.

    A shift along the ground leaves floors where they are, one in height walls: most of the area would hide either.
    """
    return max(medians_by_kind(metres, area, kinds).values(), default=float("nan"))


def medians_by_kind(
    metres: NDArray[np.float64], area: NDArray[np.float64], kinds: NDArray[np.uint8]
) -> dict[int, float]:
    """Return the median of `metres` (n,) by area (n,) over surfaces of each kind (n,) that has enough of it."""
    known = np.isfinite(metres) & np.isfinite(area)
    found = usual_kinds(np.where(known, area, 0.0), kinds)
    return {int(kinds[mine][0]): weighted_median(metres[mine], area[mine]) for mine in found}


def usual_kinds(area: NDArray[np.float64], kinds: NDArray[np.uint8]) -> list[NDArray[np.bool_]]:
    """Return, of each kind that has :data:`LEAST_OF_KIND` of all area in m² (n,), which surfaces (n,) are of it."""
    each = [kinds == kind for kind in np.unique(kinds)]
    return [mine for mine in each if area[mine].sum() >= LEAST_OF_KIND * area.sum() > 0.0]
