"""Why a suspicious patch is wrong: an edge of the graph, a scan, a loop that was not closed, drift, or a moving thing.

Where poses were checked, the motions that their scans ask for tell. Elsewhere the heights of points over the patch's
plane do, analysed as nested groups: visits, scans within a visit, points within a scan (Searle, Casella and McCulloch
1992, "Variance Components", chapter 5; Henderson's first method). What only parts visits arose while the sensor was
elsewhere; what parts scans of one visit is local.
"""

from __future__ import annotations

import logging
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.axes import keys_of
from mapq.configuration import SURFACES
from mapq.features.shape import charted
from mapq.features.table import PatchFeatures
from mapq.patches import Patches
from mapq.posed.breaks import Breaks, Parts, breaks_of
from mapq.posed.check_poses import CheckedPoses
from mapq.results.visits import Visits

MISSED_LOOP, LOCAL, UNKNOWN = "missed loop closure", "local mapping error", "unknown"
WRONG_EDGE, WRONG_SCAN, DRIFT, MOVED = "wrong edge", "wrong scan", "drift", "moving thing"
CAUSES = (UNKNOWN, MISSED_LOOP, LOCAL, WRONG_EDGE, WRONG_SCAN, DRIFT, MOVED)
"""In the order of their codes in the point field `cause` of a result."""

CELL = 1.0
"""Metres: side of the cells of a patch in which scans are compared; along a wall they may see different things."""
MIN_SHARED = 0.05
"""Overlap or crossing from which another patch may be a second copy of the surface."""
TURNED = 15.0
"""Degrees between planes up to which it may."""
FARTHEST = 3.0
"""Metres off the plane up to which its points are looked at."""
BEYOND = 0.15
"""Metres by which they may lie farther off than scans disagree, where that is known: noise of three sigma."""
LEAST = 0.05
"""Metres: a smaller offset does not make a surface doubled."""
CLEARLY = np.sqrt(2.0)
"""Factor by which visits must disagree more than scans of one visit, whose errors separate visits a little too."""
CLEAR = 0.1
"""Metres by which motions must part scans that see a patch, or else its own points must."""
EXPLAINED = 0.5
"""Share of the lower bound of what scans disagree by, from which a single scan or a jump explains it."""
BESIDE = 2
"""Scans before and after those that see a patch, that may see it too."""
FEWEST = 5
"""Points of a moment that sees a patch."""
MOST_POINTS = 20_000
"""Of a patch and its copies that are looked at."""
MANY = 500
"""Suspicious patches from which on their causes take seconds."""
MOST_NORMALS = 16
"""Of a curved patch along which the motions of scans are compared."""

logger = logging.getLogger(__name__)

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


class Spread(NamedTuple):
    """How far points of a surface are apart, in metres."""

    visits: float  # root mean square difference between visits; nan where there is one only
    scans: float  # between scans of one visit, likewise
    points: float  # standard deviation within scans; nan where no scan has two points in a cell
    n_visits: int  # the most visits of a cell
    n_scans: int
    gap: tuple[int, int] | None  # moments between which the surface was out of sight, the middle one of such gaps
    seen: tuple[int, ...] = ()  # moments that see it with some points, ascending


class Cause(NamedTuple):
    """What made a patch suspicious, as far as it is known."""

    kind: str  # one of `CAUSES`
    text: str  # for people
    measures: dict[str, Any]  # what the text is made of

    def row(self, decimals: int) -> dict[str, Any]:
        """Return the cause as JSON."""
        rounded = {name: round(x, decimals) if isinstance(x, float) else x for name, x in self.measures.items()}
        return {"kind": self.kind, "text": self.text, **rounded}


def find_causes(
    patches: Patches,
    features: PatchFeatures,
    suspicious: NDArray[np.bool_],
    visits: Visits | None,
    poses: CheckedPoses | None = None,
) -> dict[int, Cause]:
    """Return the cause of each suspicious patch by its number; of level ones it says that errors are of height.

    `features`: their pairs show which patches may be copies of one surface. `suspicious` (m,). `visits`: None: when
    points were seen is not known, and so no cause. `poses`: of the scans, where they were checked.
    """
    if visits is None:
        nothing = Cause(UNKNOWN, "the map does not record by which scans or when it was seen", {})
        return {int(patch): nothing for patch in np.flatnonzero(suspicious)}
    if (n := np.count_nonzero(suspicious)) >= MANY:
        logger.info(f"finding causes of {n:,} suspicious patches ...")
    copies, reach, apart = copies_of(features, len(patches)), reach_of(features), features.disagreement
    scans, level = _ScanMotions.of(patches, visits, poses), patches.kinds == SURFACES.index("level")
    found = {}
    for patch in np.flatnonzero(suspicious).tolist():
        spread = measure_spread(patches, patch, copies[patch], visits, reach[patch])
        along = " in height" if level[patch] else ""
        if scans is None:
            found[patch] = cause_of(spread, visits, apart[patch], along)
        else:
            points, start = patches.members
            normals = _over(patches, patch, points[start[patch] : start[patch + 1]])[2]
            place = patches.centroid[patch], normals[:: 1 + len(normals) // MOST_NORMALS]
            found[patch] = scans.cause_of(spread, *place, apart[patch], along)
    return found


def reach_of(features: PatchFeatures) -> Floats:
    """Return the metres (m,) off each patch up to which points may be of its surface, from what scans disagree by."""
    return np.asarray(np.fmin(np.maximum(features.disagreement[:, 2], LEAST) + BEYOND, FARTHEST))


def copies_of(features: PatchFeatures, n_patches: int) -> list[list[int]]:
    """Return for each patch those that may be copies of its surface: over it or across, nearly parallel."""
    overlap, crossing, angle = (
        features.edge[:, features.edge_names.index(name)] for name in ("overlap", "crossing", "angle_deg")
    )
    found: list[list[int]] = [[] for _ in range(n_patches)]
    for one, other in features.pairs[(np.maximum(overlap, crossing) > MIN_SHARED) & (angle < TURNED)].tolist():
        found[one].append(other)
        found[other].append(one)
    return found


def cause_of(spread: Spread, visits: Visits, apart: Floats, along: str = "") -> Cause:
    """Return the cause that a spread shows, if it is clear.

    `apart` (3,): lower bound, value and upper bound of what scans disagree by, metres; nan where that is not known, and
    the spread alone counts. `along`: words for the direction in which it lies apart.
    """
    measures: dict[str, Any] = {
        "between_visits_m": spread.visits,
        "within_visits_m": spread.scans,
        "within_scans_m": spread.points,
        "n_visits": spread.n_visits,
        "n_scans": spread.n_scans,
    }
    if spread.n_scans < 2:
        return Cause(UNKNOWN, f"one {visits.unit} alone saw it", measures)
    by_visit, by_scan, thickness = (float(np.nan_to_num(x)) for x in (spread.visits, spread.scans, spread.points))
    several = {"scan": "scans", "pass": "passes"}.get(visits.unit, "moments")
    low, metres, high = (float(x) for x in apart) if np.isfinite(apart[1]) else (0.0, max(by_visit, by_scan), 0.0)
    if metres < LEAST:
        return Cause(UNKNOWN, f"{several} that see it agree within {max(high, LEAST):.2f} m", measures)
    bounds = f" ({low:.2f} to {high:.2f})" if high else ""
    if max(by_visit, by_scan) < np.sqrt(2.0) * thickness:
        return Cause(UNKNOWN, f"within each {visits.unit} it spreads as far as from one to another", measures)
    if visits.unit != "pass" and not np.isfinite(spread.scans):
        return Cause(UNKNOWN, f"no two {several} of one visit saw it, which could show the cause", measures)
    if by_visit < CLEARLY * by_scan:
        return Cause(LOCAL, f"{several} of one visit put it {metres:.2f} m{bounds} apart{along}", measures)
    if spread.gap is None or visits.unit == "pass":
        return Cause(MISSED_LOOP, f"passes put it {metres:.2f} m{bounds} apart{along}", measures)
    lengths = _gap(visits, *spread.gap)
    after = " and ".join(f"{value:.0f} {name}" for name, value in lengths.items())
    named = {f"away_{name}": value for name, value in lengths.items()}
    return Cause(MISSED_LOOP, f"seen again after {after}, it lies {metres:.2f} m{bounds} off{along}", measures | named)


def moved_by(spread: Spread) -> float:
    """Return the metres from scan to scan that the points of a surface show; 0 unless they exceed those within one."""
    between, within = (np.nan_to_num([*each]) for each in ((spread.visits, spread.scans), (spread.points,)))
    return float(between.max()) if between.max() > np.sqrt(2.0) * within.max() else 0.0


class _ScanMotions(NamedTuple):
    """What checked poses say of a map."""

    breaks: Breaks
    number: Ints  # (k,) scan of each moment

    @classmethod
    def of(cls, patches: Patches, visits: Visits, poses: CheckedPoses | None) -> _ScanMotions | None:
        """Return what poses say; None where they were not checked."""
        if poses is None or not len(poses.motion):
            return None
        rows = np.flatnonzero(visits.moment >= 0)
        number = np.zeros(int(visits.moment.max(initial=-1)) + 1, np.int64)
        number[visits.moment[rows]] = patches.cloud.fields["scan"][rows]
        return cls(breaks_of(poses), number)

    def cause_of(self, spread: Spread, at: Floats, normals: Floats, apart: Floats, along: str = "") -> Cause:
        """Return the cause that motions show at a place (3) of a patch.

        Along that of its normals (k, 3) by which scans are farthest apart. `apart` (3,): lower bound, value and upper
        bound of what they disagree by.
        """
        scans = self.number[list(spread.seen)]
        ranges = [float(np.ptp(self.breaks.offsets(scans, at, each))) if len(scans) else 0.0 for each in normals]
        normal = normals[int(np.argmax(ranges))]
        offset = self.breaks.offsets(scans, at, normal)
        if len(scans) and np.ptp(offset) < CLEAR and apart[1] > LEAST:
            # What other scans have of it may lie in no patch: then those beside the ones that see it are asked too.
            near = np.unique(scans[:, None] + np.arange(-BESIDE, BESIDE + 1))
            scans = near[(near >= 0) & (near < len(self.breaks.motion))]
            offset = self.breaks.offsets(scans, at, normal)
        if not len(scans):
            return Cause(UNKNOWN, "no scan is known to have seen it", {})
        one, other = sorted((int(scans[np.argmin(offset)]), int(scans[np.argmax(offset)])))
        parts, least = self.breaks.split(one, other, at, normal), float(np.nan_to_num(apart[0]))
        return self._named(one, other, parts, moved_by(spread), least, along)

    def _named(self, one: int, other: int, parts: Parts, moved: float, least: float, along: str) -> Cause:
        """Return the cause of the largest of the parts that put two scans apart.

        `moved`: metres by which the surface itself lies apart, from scan to scan; `least`: that scans disagree by.
        """
        alone = int(np.argmax(np.abs(parts.alone)))
        by_scan, by_jump, by_drift = (abs(x) for x in (parts.alone[alone], parts.jump, parts.drift))
        metres = max(abs(parts.alone[1] - parts.alone[0] - parts.jump - parts.drift), by_scan)
        scan, between = (one, other)[alone], {"between_scans": [one, other]} if one != other else {}
        measures: dict[str, Any] = {**between, "metres": metres}
        if metres < CLEAR <= moved:
            text = f"scans put it {moved:.2f} m apart, and their poses agree there within {metres:.2f} m"
            return Cause(MOVED, text, measures | {"moved_m": moved})
        edge, is_sudden = self.breaks.edge_over(one, other), max(by_scan, by_jump) > by_drift
        if metres < CLEAR or (edge is None and is_sudden and metres < EXPLAINED * least):
            if one == other:
                return Cause(UNKNOWN, "the scans that see it could not be compared", measures)
            disagree = f", and scans disagree by {least:.2f} m at least" if metres >= CLEAR else ""
            text = f"the motions of scans {one} and {other} put it {metres:.2f} m apart only{disagree}"
            return Cause(UNKNOWN, text, measures)
        is_apart = edge is None or min(abs(scan - end) for end in edge.ends) > BESIDE
        if len(self.breaks.motion) == 2 and edge is None:
            text = f"scans {one} and {other} put it {metres:.2f} m apart{along}; which is wrong two do not show"
            return Cause(WRONG_SCAN, text, measures)
        if by_scan > max(by_jump, by_drift) and is_apart:
            return Cause(WRONG_SCAN, f"scan {scan} puts it {by_scan:.2f} m off{along}", measures | {"scan": scan})
        if edge is not None:
            bends = f"scans {one} and {other}, {metres:.2f} m apart{along} there"
            text = f"the edge from {edge.ids[0]} to {edge.ids[1]} is wrong and bends {bends}"
            return Cause(WRONG_EDGE, text, measures | {"edge": list(edge.ids)})
        if by_jump > by_drift:
            return Cause(MISSED_LOOP, f"scans jump by {by_jump:.2f} m{along} between {one} and {other}", measures)
        return Cause(DRIFT, f"scans drift by {by_drift:.2f} m{along} from {one} to {other}", measures)


def _gap(visits: Visits, before: int, after: int) -> dict[str, float]:
    """Return how long a surface was out of sight, by units."""
    lengths = {}
    if visits.way is not None:
        lengths["m"] = float(visits.way[after] - visits.way[before])
    if visits.seconds is not None:
        lengths["s"] = float(visits.seconds[after] - visits.seconds[before])
    return lengths or {"scans": float(after - before)}


def measure_spread(patches: Patches, patch: int, copies: list[int], visits: Visits, reach: float) -> Spread:
    """Return how the points of a patch and of its copies, up to `reach` metres off, are apart, by visits and scans."""
    points, start = patches.members
    own = points[start[patch] : start[patch + 1]]
    rows = np.concatenate([own, *(points[start[other] : start[other + 1]] for other in copies)])
    rows = _thinned(rows[visits.moment[rows] >= 0], patches.cloud.xyz, visits.moment)
    height, place, normal = _over(patches, patch, rows)
    cell = keys_of(np.floor(place / CELL).astype(np.int64))
    is_own = patches.patch[rows] == patch
    near = (np.abs(height) < reach) & np.isin(cell, cell[is_own])
    if visits.to_sensor is not None:
        near &= _same_side((visits.to_sensor[rows] * normal).sum(axis=1), is_own)
    return nested_spread(height[near], cell[near], visits.moment[rows[near]], visits)


def _thinned(rows: Ints, xyz: Floats, moment: NDArray[np.integer[Any]]) -> Ints:
    """Return every n-th of the rows (k,), at most `MOST_POINTS`, by moment and place, not by order."""
    if len(rows) <= MOST_POINTS:
        return rows
    x, y, z = xyz[rows].T
    return rows[np.lexsort((z, y, x, moment[rows]))][:: -(-len(rows) // MOST_POINTS)]


def _over(patches: Patches, patch: int, rows: Ints) -> tuple[Floats, Floats, Floats]:
    """Return heights (n,) of points over a patch, their places (n, 2) in it, and its normal (1 or n, 3) below them."""
    normal, apart = patches.normal[patch], patches.cloud.xyz[rows] - patches.centroid[patch]
    if patches.bend is None or not patches.bend[patch].any():
        return apart @ normal, _in_plane(apart, normal), normal[None]
    bend = float(np.linalg.norm(patches.bend[patch]))
    along = patches.bend[patch] / bend
    across = np.cross(along, normal)
    axes = across[None], along[None], normal[None]
    u, v, height = charted(apart, np.zeros(len(rows), np.int64), axes, np.array([bend]))
    angle = bend * u[:, None]
    return height, np.column_stack([u, v]), np.cos(angle) * normal + np.sin(angle) * across


def _in_plane(apart: Floats, normal: Floats) -> Floats:
    """Return coordinates (n, 2) of points along two directions in the plane of a normal."""
    across = np.cross(normal, np.eye(3)[int(np.argmin(np.abs(normal)))])
    across /= np.linalg.norm(across)
    return np.column_stack([apart @ across, apart @ np.cross(normal, across)])


def _same_side(towards: Floats, is_own: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return which points (n,) were not seen from the other side than most of the patch's own: its back is no copy."""
    known = np.nan_to_num(towards)
    side = np.sign(np.sum(np.sign(known[is_own])))
    return np.asarray(np.sign(known) != -side) if side else np.ones(len(towards), bool)


def nested_spread(height: Floats, cell: Ints, moment: Ints, visits: Visits) -> Spread:
    """Return the spread of heights (n,), metres, in cells of these numbers (n,), seen at moments (n,)."""
    if len(height) == 0:
        return Spread(np.nan, np.nan, np.nan, 0, 0, None)
    place = np.unique(cell, return_inverse=True)[1]
    order = np.lexsort((moment, place))
    height, place, moment = height[order], place[order], moment[order]
    other_cell = np.diff(place) != 0
    other_scan = other_cell | (np.diff(moment) != 0)
    gap = ~other_cell & other_scan & visits.new_visit(moment[:-1], moment[1:])
    scan, visit = _numbers(other_scan), _numbers(other_cell | gap)
    within = _variance(height, np.arange(len(height)), scan, 0.0)
    noise = float(np.nan_to_num(within))
    by_scan, by_visit = _variance(height, scan, visit, noise), _variance(height, visit, place, noise)
    n_visits = int(np.bincount(place[np.flatnonzero(np.diff(visit, prepend=-1))]).max())
    return Spread(
        float(np.sqrt(2.0 * by_visit)),
        float(np.sqrt(2.0 * by_scan)),
        float(np.sqrt(within)),
        n_visits,
        len(np.unique(moment)),
        _middle_gap(moment[:-1][gap], moment[1:][gap]),
        tuple(np.flatnonzero(np.bincount(moment) >= FEWEST).tolist()),
    )


def _numbers(begins: NDArray[np.bool_]) -> Ints:
    """Return the number (n,) of the group of each row, given whether each but the first begins another (n - 1,)."""
    return np.concatenate([[0], np.cumsum(begins)])


def _variance(height: Floats, inner: Ints, outer: Ints, noise: float) -> float:
    """Return the variance that parts inner groups (n,) of one outer group, but for what noise does; nan if none can.

    Its expectation is free of `noise`, the variance of points within a scan, for groups of any sizes.
    """
    n_inner, n_outer = np.bincount(inner), np.bincount(outer)
    first = np.flatnonzero(np.diff(inner, prepend=-1))
    holder = outer[first]
    mean, whole = np.bincount(inner, height) / n_inner, np.bincount(outer, height) / n_outer
    squares = float(n_inner @ (mean - whole[holder]) ** 2)
    freedom = len(height) - float(np.sum(n_inner**2 / n_outer[holder]))
    if len(n_inner) == len(n_outer) or freedom <= 0.0:
        return float("nan")
    return max(squares - noise * (len(n_inner) - len(n_outer)), 0.0) / freedom


def _middle_gap(before: Ints, after: Ints) -> tuple[int, int] | None:
    """Return the gap of median length, of gaps between moments (g,)."""
    if len(before) == 0:
        return None
    middle = np.argsort(after - before, kind="stable")[len(before) // 2]
    return int(before[middle]), int(after[middle])
