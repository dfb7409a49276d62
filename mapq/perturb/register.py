"""A small piece of one scan laid onto another scan: several starts, then point-to-plane least squares."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

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
    """Elements of surface of one scan in the map: places and normals (m, 3), which (m,) are of walls, their tree."""

    place: Floats
    normal: Floats
    upright: NDArray[np.bool_]
    tree: cKDTree

    def take(self, index: NDArray[np.int64]) -> Piece:
        """Return some of the elements."""
        return Piece(self.place[index], self.normal[index], self.upright[index])


class Piece(NamedTuple):
    """Elements to be laid onto a sheet: places and normals (p, 3), and which (p,) are of walls."""

    place: Floats
    normal: Floats
    upright: NDArray[np.bool_]


class Fitted(NamedTuple):
    """The motion (4, 4) that takes a piece to a sheet, and the share of its elements of walls that then lie on it."""

    motion: Floats
    overlap: float


def register(piece: Piece, sheet: Sheet, search: float, sided: bool) -> Fitted:
    """Return the motion that lays most of a piece onto a sheet, of displacements up to `search` metres.

    Of motions that fit nearly alike the one that displaces least is taken: a straight wall fits at every wall that is
    parallel to it.
    """
    found = []
    for start in _starts(piece, sheet, search, sided):
        motion = _refine(piece, sheet, start, sided)
        found.append(Fitted(motion, overlap(piece, sheet, motion, sided)))
    best = max(fitted.overlap for fitted in found)
    good = [fitted for fitted in found if fitted.overlap >= best - NEARLY_AS_GOOD]
    middle = piece.place.mean(axis=0)
    return min(good, key=lambda fitted: float(np.linalg.norm(_put(fitted.motion, middle) - middle)))


def overlap(piece: Piece, sheet: Sheet, motion: Floats, sided: bool) -> float:
    """Return the share of the piece's elements of walls that lie on the sheet after a motion (4, 4)."""
    on_it, _ = lies_on(piece, sheet, motion, sided, FIT)
    return float(on_it[piece.upright].mean()) if piece.upright.any() else 0.0


def lies_on(
    piece: Piece, sheet: Sheet, motion: Floats, sided: bool, within: float
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


def _starts(piece: Piece, sheet: Sheet, search: float, sided: bool) -> list[Floats]:
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
    # The smaller of two displacements that fit alike is first; those next to one that is taken are the same.
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


def _refine(piece: Piece, sheet: Sheet, motion: Floats, sided: bool) -> Floats:
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
