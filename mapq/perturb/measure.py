"""By how much scans disagree where no right poses are known: their pieces are laid onto each other.

A piece of a scan, some twenty metres wide, is registered to every other scan near it. What does not overlap after that
was seen from elsewhere or hidden: not evidence. Of the points of 5 scans of KITTI that both these and right poses
call plausible or suspicious, 7 % are called differently.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from mapq.perturb.cells import mean_of, planes_round
from mapq.perturb.known import Disagreement
from mapq.perturb.register import Piece, Sheet, lies_on, register
from mapq.posed.merge import Merged, cell_keys

Floats = NDArray[np.float64]

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


class Parted(NamedTuple):
    """A scan cut into elements: its sheet, and the element (n,) of each of its points."""

    sheet: Sheet
    element: NDArray[np.int64]
    flat: NDArray[np.bool_]


def measured_disagreement(
    merged: Merged,
    poses: Floats,
    search: float = 3.0,
    sided: bool = True,
    proven: float = 0.3,
    progress: Callable[[int], None] = lambda done: None,
) -> Disagreement:
    """Return how far apart scans, with the poses that are used, put what registration finds to be the same walls.

    Points that are of no wall are not known (nan). Nor are walls that have a wall of another scan within `DOUBT` which
    could not be registered, unless a third scan proves an error: more than `proven` metres of disagreement. Walls that
    no other scan is near are seen once. One scan may lie off another by `search` metres. `sided`: each scan was taken
    from one place, its origin; sub-maps were not.
    """
    points = merged.placed(poses)
    starts = np.searchsorted(merged.scan, np.arange(len(poses) + 1))
    parts = [
        _parted(points[begin:end], poses[scan, :3, 3] if sided else None)
        for scan, (begin, end) in enumerate(pairwise(starts))
    ]
    windows = [list(_windows(part.sheet.place[:, :2])) for part in parts]
    compared: dict[tuple[int, int], Compared] = {}
    for scan, part in enumerate(parts):
        for other in range(len(parts)):
            found = _compare(part, parts[other].sheet, windows[scan], search, sided) if other != scan else None
            if found is not None:
                compared[scan, other] = found
        progress(scan + 1)
    metres, n_others = np.full(len(points), np.nan), np.zeros(len(points), np.int64)
    for scan, part in enumerate(parts):
        rows = slice(int(starts[scan]), int(starts[scan + 1]))
        worst, count = _gathered(part, scan, compared, proven)
        metres[rows], n_others[rows] = worst[part.element], count[part.element]
    return Disagreement(metres, n_others)


def _parted(points: Floats, origin: Floats | None) -> Parted:
    """Return the elements of a scan, of points (n, 3) in the map; normals point to the origin if it is known."""
    if len(points) == 0:
        nothing = np.zeros((0, 3))
        return Parted(
            Sheet(nothing, nothing, np.zeros(0, bool), cKDTree(nothing)), np.zeros(0, np.int64), np.zeros(0, bool)
        )
    _, element = np.unique(cell_keys(points, CELL), return_inverse=True)
    place = mean_of(element, int(element.max()) + 1, points)
    planes = planes_round(place)
    normal = planes.normal
    if origin is not None:
        behind = np.einsum("ij,ij->i", origin - place, normal) < 0.0
        normal = normal * np.where(behind, -1.0, 1.0)[:, None]
    upright = planes.flat & (np.abs(normal[:, 2]) < UPRIGHT)
    return Parted(Sheet(place, normal, upright, cKDTree(place)), element, planes.flat)


def _compare(
    part: Parted, other: Sheet, windows: list[NDArray[np.int64]], search: float, sided: bool
) -> Compared | None:
    """Return the comparison of a scan with another, None if they are not near each other."""
    sheet = part.sheet
    if not (other.upright.any() and sheet.upright.any()):
        return None
    walls = cKDTree(other.place[other.upright])
    distance = walls.query(sheet.place, distance_upper_bound=search)[0]
    near = sheet.upright & np.isfinite(distance)
    if not near.any():
        return None
    found = _displacement(part, other, windows, near, search, sided)
    return found._replace(in_doubt=found.in_doubt & (distance < DOUBT))


def _gathered(
    part: Parted, scan: int, compared: dict[tuple[int, int], Compared], proven: float
) -> tuple[Floats, NDArray[np.int64]]:
    """Return the disagreement (m,) of each element of a scan with all others, and how many of them see it.

    A comparison counts unless the one the other way contradicts it: two wrong registrations seldom agree.
    """
    worst, n_seen = np.zeros(len(part.flat)), np.zeros(len(part.flat), np.int64)
    in_doubt = np.zeros(len(part.flat), bool)
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
    known = part.sheet.upright & (~in_doubt | (worst > proven))
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
    part: Parted,
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
        fitted = register(_piece(part, walls, rows), other, search, sided)
        piece = part.sheet.take(walls)
        if fitted.overlap < OVERLAP:
            continue
        judged[walls] = True
        moved = piece.place @ fitted.motion[:3, :3].T + fitted.motion[:3, 3] - piece.place
        on_it, nearest = lies_on(piece, other, fitted.motion, sided, ON_SHEET)
        seen = on_it & (best[walls] < fitted.overlap)
        along[walls[seen]] = np.einsum("ij,ij->i", moved, piece.normal)[seen]
        best[walls[seen]] = fitted.overlap
        partner[walls[seen]] = nearest[seen]
    return Compared(near & ~judged, along, partner)


def _piece(part: Parted, walls: NDArray[np.int64], rows: NDArray[np.int64]) -> Piece:
    """Return the walls given, and half as many level elements of a window, which hold them level; evenly thinned."""
    level = rows[part.flat[rows] & ~part.sheet.upright[rows]]
    most_walls = MOST_ELEMENTS * 2 // 3
    walls = walls[:: len(walls) // most_walls + 1]
    level = level[:: len(level) // (MOST_ELEMENTS - most_walls) + 1]
    return part.sheet.take(np.concatenate([walls, level]))
