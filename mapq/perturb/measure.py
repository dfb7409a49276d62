"""By how much scans disagree where no right poses are known: their pieces are laid onto each other.

A piece of a scan, some twenty metres wide, is registered to every other scan near it. What does not overlap after that
was seen from elsewhere or hidden: not evidence. Of the points of 5 scans of KITTI that both these and right poses
call plausible or suspicious, 7 % are called differently.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from mapq.perturb.known import mean_of, planes_round
from mapq.posed.merge import Merged, cell_keys

Floats = NDArray[np.float64]

FIT = 0.2
"""Metres from the other scan's surface at which a point lies on it."""
TRIMS = (1.0, 1.0, 0.7, 0.7, 0.5, 0.5, 0.35, 0.35, 0.25, 0.25)
"""Metres, step after step: points farther from the other scan do not pull."""
PARALLEL = np.cos(np.radians(35.0))
"""Cosine between normals of points that may be the same."""
START_STEP = 0.5
"""Metres between the displacements that are tried."""
STARTS = 4
"""Displacements that are refined: none, and the best others."""
START_FIT = 0.4
"""Metres within which a point of a start counts; about the step."""
FEW_STARTING = 120
"""Points by which starts are compared."""
DAMPING = 1e-3
"""Of the mean diagonal: directions that the piece does not determine stay as they are."""
NEARLY_AS_GOOD = 0.05
"""Of overlap: then the smaller displacement is believed."""


class Sheet(NamedTuple):
    """Elements of surface of one scan in the map: places and normals (m, 3), which (m,) have a plane, are of walls."""

    place: Floats
    normal: Floats
    flat: NDArray[np.bool_]
    upright: NDArray[np.bool_]
    tree: Any = None  # cKDTree of the places; a piece, which is laid onto another sheet, has none

    def take(self, index: NDArray[np.int64]) -> Sheet:
        """Return a piece: some of the elements."""
        return Sheet(self.place[index], self.normal[index], self.flat[index], self.upright[index])


def register(piece: Sheet, sheet: Sheet, search: float, sided: bool) -> tuple[Floats, float]:
    """Return the motion (4, 4) that lays most of a piece onto a sheet, of displacements up to `search` metres.

    And the share of its elements of walls that then lie on it.
    Of motions that fit nearly alike the one that displaces least is taken: a straight wall fits at every wall that is
    parallel to it.
    """
    found = []
    for start in _starts(piece, sheet, search, sided):
        motion = _refine(piece, sheet, start, sided)
        found.append((motion, overlap(piece, sheet, motion, sided)))
    best = max(share for _, share in found)
    good = [each for each in found if each[1] >= best - NEARLY_AS_GOOD]
    middle = piece.place.mean(axis=0)
    return min(good, key=lambda each: float(np.linalg.norm(_put(each[0], middle) - middle)))


def overlap(piece: Sheet, sheet: Sheet, motion: Floats, sided: bool) -> float:
    """Return the share of the piece's elements of walls that lie on the sheet after a motion (4, 4)."""
    on_it, _ = lies_on(piece, sheet, motion, sided, FIT)
    return float(on_it[piece.upright].mean()) if piece.upright.any() else 0.0


def lies_on(
    piece: Sheet, sheet: Sheet, motion: Floats, sided: bool, within: float
) -> tuple[NDArray[np.bool_], NDArray[np.int64]]:
    """Return which elements (p,) lie `within` metres of a parallel element of the sheet after a motion, and which."""
    place = _put(motion, piece.place)
    distance, nearest = sheet.tree.query(place, distance_upper_bound=within)
    on_it = _facing(piece.normal @ motion[:3, :3].T, sheet, nearest, sided) & np.isfinite(distance)
    return np.asarray(on_it), nearest


def _facing(normal: Floats, sheet: Sheet, nearest: NDArray[np.int64], sided: bool) -> NDArray[np.bool_]:
    """Return which normals (p, 3) are parallel to those of the nearest elements; no element: any."""
    cosine = np.einsum("ij,ij->i", normal, sheet.normal[np.minimum(nearest, len(sheet.normal) - 1)])
    return np.asarray((cosine if sided else np.abs(cosine)) > PARALLEL)


def _starts(piece: Sheet, sheet: Sheet, search: float, sided: bool) -> list[Floats]:
    """Return the motions to begin with: none, and the horizontal displacements that fit best."""
    walls = np.flatnonzero(piece.upright)
    some = walls[:: max(1, len(walls) // FEW_STARTING)]
    n_steps = int(search / START_STEP)
    steps = START_STEP * np.arange(-n_steps, n_steps + 1)
    shifts = np.array([(x, y, 0.0) for x in steps for y in steps if np.hypot(x, y) <= search])
    places = (piece.place[some][None] + shifts[:, None]).reshape(-1, 3)
    distance, nearest = sheet.tree.query(places, distance_upper_bound=START_FIT)
    facing = _facing(np.tile(piece.normal[some], (len(shifts), 1)), sheet, nearest, sided)
    score = (facing & np.isfinite(distance)).reshape(len(shifts), -1).mean(axis=1)
    # The smaller of two displacements that fit alike is first; those next to one that is taken are no other.
    order = np.lexsort((np.hypot(shifts[:, 0], shifts[:, 1]), -score))
    chosen = [np.zeros(3)]
    for row in order.tolist():
        if len(chosen) == STARTS:
            break
        if all(np.hypot(*(shifts[row] - other)[:2]) > 1.5 * START_STEP for other in chosen):
            chosen.append(shifts[row])
    motions = np.tile(np.eye(4), (len(chosen), 1, 1))
    motions[:, :3, 3] = chosen
    return list(motions)


def _refine(piece: Sheet, sheet: Sheet, motion: Floats, sided: bool) -> Floats:
    """Return the motion after least squares of distances to the sheet's planes, nearer and nearer ones alone."""
    middle = piece.place.mean(axis=0)
    for trim in TRIMS:
        place = _put(motion, piece.place)
        distance, nearest = sheet.tree.query(place, distance_upper_bound=trim)
        use = np.isfinite(distance) & _facing(piece.normal @ motion[:3, :3].T, sheet, nearest, sided)
        if np.count_nonzero(use) < 6:
            return motion
        motion = _step(place[use], sheet.place[nearest[use]], sheet.normal[nearest[use]], middle) @ motion
    return motion


def _step(place: Floats, target: Floats, normal: Floats, middle: Floats) -> Floats:
    """Return the small motion (4, 4) about `middle` that brings places (p, 3) nearest to planes."""
    arm = place - middle
    rows = np.column_stack([np.cross(arm, normal), normal])
    left = np.einsum("ij,ij->i", target - place, normal)
    square = rows.T @ rows
    # Turns and displacements have different units; each block is damped on its own scale.
    scale = np.concatenate([np.full(3, np.trace(square[:3, :3])), np.full(3, np.trace(square[3:, 3:]))]) / 3.0
    found = np.linalg.solve(square + np.diag(DAMPING * np.maximum(scale, 1e-9)), rows.T @ left)
    motion = np.eye(4)
    motion[:3, :3] = _rotation(found[:3])
    motion[:3, 3] = middle - motion[:3, :3] @ middle + found[3:]
    return motion


def _rotation(vector: Floats) -> Floats:
    """Return the rotation (3, 3) about a vector by its length in radians."""
    angle = float(np.linalg.norm(vector))
    if angle < 1e-12:
        return np.eye(3)
    x, y, z = vector / angle
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * (cross @ cross))


def _put(motion: Floats, place: Floats) -> Floats:
    return np.asarray(place @ motion[:3, :3].T + motion[:3, 3])


CELL = 0.25
"""Metres: side of the cells whose means are registered."""
WINDOW, STRIDE = 20.0, 10.0
"""Metres: side of the pieces, and from one to the next."""
FEWEST_WALLS = 40
"""Elements of walls that a piece must have, of those that have a wall of the other scan near them."""
MOST_ELEMENTS = 360
"""Of a piece: more make its fit no better."""
OVERLAP = 0.5
"""Least share of the walls of a piece that lie on the other scan after a registration that is believed."""
ON_SHEET = 0.3
"""Metres off the other scan, after registration, at which it still sees an element."""
DOUBT = 1.5
"""Metres: a wall of another scan so close, in no piece that fits, may be the same wall; farther ones seldom are."""
CONSISTENT = 0.1
"""Metres by which the comparisons of two scans, either way, may differ."""
UPRIGHT = 0.5
"""Largest upward component of the normal of a wall."""


class Compared(NamedTuple):
    """The elements (m,) of one scan compared with another.

    `in_doubt`: walls that have a wall of the other scan within `DOUBT`, but lie in no piece that fits it. `along`: how
    far the other scan has each displaced along its normal, nan where unknown. `partner`: the element of the other scan
    on which it then lies, any where unknown.
    """

    in_doubt: NDArray[np.bool_]
    along: Floats
    partner: NDArray[np.int64]


def measured_disagreement(
    merged: Merged,
    poses: Floats,
    search: float = 3.0,
    sided: bool = True,
    proven: float = 0.3,
    progress: Callable[[int], None] = lambda done: None,
) -> tuple[Floats, NDArray[np.int64]]:
    """Return how far apart scans, with the poses that are used, put what registration finds to be the same walls.

    In metres (n,), and how many other scans (n,) see each point's wall, as :func:`known_disagreement`.

    Points that are of no wall are not known (nan). Nor are walls that have a wall of another scan within `DOUBT` which
    could not be registered, unless a third scan proves an error: more than `proven` metres of disagreement. Walls that
    no other scan is near are seen once. One scan may lie off another by `search` metres. `sided`: each scan was taken
    from one place, its origin; sub-maps were not.
    """
    points = merged.placed(poses)
    starts = np.searchsorted(merged.scan, np.arange(len(poses) + 1))
    parts = [
        _cut_up(points[begin:end], poses[scan, :3, 3] if sided else None)
        for scan, (begin, end) in enumerate(pairwise(starts))
    ]
    windows = [list(_windows(sheet.place[:, :2])) for sheet, _ in parts]
    compared: dict[tuple[int, int], Compared] = {}
    for scan, (sheet, _) in enumerate(parts):
        for other, (theirs, _) in enumerate(parts):
            found = _compare(sheet, theirs, windows[scan], search, sided) if other != scan else None
            if found is not None:
                compared[scan, other] = found
        progress(scan + 1)
    metres, n_others = np.full(len(points), np.nan), np.zeros(len(points), np.int64)
    for scan, (sheet, element) in enumerate(parts):
        rows = slice(int(starts[scan]), int(starts[scan + 1]))
        worst, count = _gathered(sheet, scan, compared, proven)
        metres[rows], n_others[rows] = worst[element], count[element]
    return metres, n_others


def _cut_up(points: Floats, origin: Floats | None) -> tuple[Sheet, NDArray[np.int64]]:
    """Return the elements of a scan, of points (n, 3) in the map, and the element (n,) of each point.

    Normals point to the origin if it is known.
    """
    if len(points) == 0:
        nothing, none = np.zeros((0, 3)), np.zeros(0, bool)
        return Sheet(nothing, nothing, none, none, cKDTree(nothing)), np.zeros(0, np.int64)
    _, element = np.unique(cell_keys(points, CELL), return_inverse=True)
    place = mean_of(element, int(element.max()) + 1, points)
    normal, flat = planes_round(place)
    if origin is not None:
        behind = np.einsum("ij,ij->i", origin - place, normal) < 0.0
        normal = normal * np.where(behind, -1.0, 1.0)[:, None]
    upright = flat & (np.abs(normal[:, 2]) < UPRIGHT)
    return Sheet(place, normal, flat, upright, cKDTree(place)), element


def _compare(
    sheet: Sheet, other: Sheet, windows: list[NDArray[np.int64]], search: float, sided: bool
) -> Compared | None:
    """Return the comparison of a scan with another, None if they are not near each other."""
    if not (other.upright.any() and sheet.upright.any()):
        return None
    walls = cKDTree(other.place[other.upright])
    distance = walls.query(sheet.place, distance_upper_bound=search)[0]
    near = sheet.upright & np.isfinite(distance)
    if not near.any():
        return None
    found = _displacement(sheet, other, windows, near, search, sided)
    return found._replace(in_doubt=found.in_doubt & (distance < DOUBT))


def _gathered(
    sheet: Sheet, scan: int, compared: dict[tuple[int, int], Compared], proven: float
) -> tuple[Floats, NDArray[np.int64]]:
    """Return the disagreement (m,) of each element of a scan with all others, and how many of them see it.

    A comparison counts unless the one the other way contradicts it: two wrong registrations seldom agree.
    """
    worst, n_seen = np.zeros(len(sheet.flat)), np.zeros(len(sheet.flat), np.int64)
    in_doubt = np.zeros(len(sheet.flat), bool)
    for (one, other), found in compared.items():
        if one != scan:
            continue
        back = compared[other, scan].along[found.partner] if (other, scan) in compared else np.full_like(worst, np.nan)
        with np.errstate(invalid="ignore"):
            contradicted = np.abs(np.abs(found.along) - np.abs(back)) > CONSISTENT
        seen = np.isfinite(found.along) & ~contradicted
        worst[seen] = np.maximum(worst[seen], np.abs(found.along[seen]))
        n_seen += seen
        in_doubt |= found.in_doubt | contradicted
    # With another scan in doubt what is found is a lower bound, which proves that there is an error or nothing.
    known = sheet.upright & (~in_doubt | (worst > proven))
    return np.where(known, worst, np.nan), n_seen


def _windows(place: Floats) -> list[NDArray[np.int64]]:
    """Return the places (m, 2) that lie in each of the overlapping squares that have any."""
    if len(place) == 0:
        return []
    low = place.min(axis=0)
    last = np.floor((place - low) / STRIDE).astype(np.int64)
    reach = round(WINDOW / STRIDE)
    members: dict[tuple[int, int], list[NDArray[np.int64]]] = {}
    cells, cell = np.unique(last, axis=0, return_inverse=True)
    order = np.argsort(cell.ravel(), kind="stable")
    ends = np.cumsum(np.bincount(cell.ravel(), minlength=len(cells)))
    for (column, row), rows in zip(cells.tolist(), np.split(order, ends[:-1]), strict=True):
        for left in range(column - reach + 1, column + 1):
            for bottom in range(row - reach + 1, row + 1):
                members.setdefault((left, bottom), []).append(rows)
    return [np.sort(np.concatenate(members[key])) for key in sorted(members)]


def _displacement(
    sheet: Sheet,
    other: Sheet,
    windows: list[NDArray[np.int64]],
    near: NDArray[np.bool_],
    search: float,
    sided: bool,
) -> Compared:
    """Return by how much the other scan has each element displaced along its normal.

    Of the windows that an element lies in, the one that overlaps best counts.
    """
    along, best = np.full(len(near), np.nan), np.zeros(len(near))
    partner, judged = np.zeros(len(near), np.int64), np.zeros(len(near), bool)
    for rows in windows:
        walls = rows[near[rows]]
        if len(walls) < FEWEST_WALLS:
            continue
        motion, share = register(_piece(sheet, walls, rows), other, search, sided)
        piece = sheet.take(walls)
        if share < OVERLAP:
            continue
        judged[walls] = True
        moved = piece.place @ motion[:3, :3].T + motion[:3, 3] - piece.place
        on_it, nearest = lies_on(piece, other, motion, sided, ON_SHEET)
        seen = on_it & (best[walls] < share)
        along[walls[seen]] = np.einsum("ij,ij->i", moved, piece.normal)[seen]
        best[walls[seen]] = share
        partner[walls[seen]] = nearest[seen]
    return Compared(near & ~judged, along, partner)


def _piece(sheet: Sheet, walls: NDArray[np.int64], rows: NDArray[np.int64]) -> Sheet:
    """Return the walls given, and half as many level elements of a window, which hold them level; evenly thinned."""
    level = rows[sheet.flat[rows] & ~sheet.upright[rows]]
    most_walls = MOST_ELEMENTS * 2 // 3
    walls = walls[:: len(walls) // most_walls + 1]
    level = level[:: len(level) // (MOST_ELEMENTS - most_walls) + 1]
    return sheet.take(np.concatenate([walls, level]))
