"""Points matched with a place, whatever the offset: correlation over turns and shifts, coarse first (Olson 2009)."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt, maximum_filter

from prf.kernels.poses.scan_match import correlate
from prf.poses.plane import Floats, compose

CELL = 0.1  # metres
COARSE, ROUGH = 3, 6  # cells along a side of a coarse one, and of a rough one
BLUR = 0.12  # metres from a seen point at which a point still fits fairly
FREE = -0.5  # what a point counts that lies where beams passed
UNSEEN = 0.05  # value of a cell up to which nothing was seen there
CLEAR = 0.3  # metres round seen points that are not called free
RAY = 0.15  # metres between places of a beam that are marked as free
LEVER = 8.0  # metres: a turn moves points so far away by one cell
SHARP = 60.0  # independent points that a score is the mean of, for the precision of a match
PEAKS = 4  # places kept for alternatives
MOST_PEAKS = 24  # of a search everywhere that are looked at more closely
MOST_PULL = 12.0  # nats that a pose pulls at most: what it comes from may have slipped
FLOOR = np.array([0.05, 0.05, 0.01])  # standard deviations (m, m, rad) of a match at least


class Place(NamedTuple):
    """What was seen of a place, in a frame of its own: 1 on what returned beams, FREE where beams passed."""

    corner: Floats  # (2,) metres, of the first cell
    fine: NDArray[np.float32]  # (height, width)
    coarse: NDArray[np.float32]  # the largest of COARSE x COARSE cells, each
    rough: NDArray[np.float32]  # the largest of ROUGH x ROUGH cells, each


def place_of(point: Floats, origin: Floats, reach: float) -> Place:
    """Return the place of points (n, 2) that were seen from origins (n, 2), metres; `reach`: of its frame's middle."""
    n = ROUGH * math.ceil(2.0 * reach / (CELL * ROUGH))
    corner = np.full(2, -0.5 * n * CELL)
    steps = np.arange(0.0, 1.0, RAY / (2.0 * reach))
    passed = (origin[:, None] + (point - origin)[:, None] * steps[:, None]).reshape(-1, 2)
    free, seen = _marked(passed, corner, n), _marked(point, corner, n)
    distance = np.asarray(distance_transform_edt(~seen)) * CELL if seen.any() else np.full((n, n), reach)
    fine = np.where(free & (distance > CLEAR), FREE, np.exp(-0.5 * np.square(distance / BLUR))).astype(np.float32)
    coarse, rough = (
        np.ascontiguousarray(fine.reshape(n // side, side, n // side, side).max(axis=(1, 3)))
        for side in (COARSE, ROUGH)
    )
    return Place(corner, fine, coarse, rough)


def _marked(xy: Floats, corner: Floats, n: int) -> NDArray[np.bool_]:
    column, row = np.floor((xy - corner) / CELL).astype(np.int64).T
    inside = (column >= 0) & (column < n) & (row >= 0) & (row < n)
    marked = np.zeros((n, n), np.bool_)
    marked[row[inside], column[inside]] = True
    return marked


def search(
    place: Place, point: Floats, about: Floats, window: Floats, prior: Floats | None = None
) -> tuple[list[tuple[Floats, float]], Floats]:
    """Return the best ways to lay points (n, 2) on a place, the best first, and the covariance (3, 3) of each.

    Of each way the pose (3,) of the points' frame in that of the place, and its score, from FREE to 1: the mean over
    points of how well each fits.

    Searched are poses within `window` (3,) of `about` (3,): x, y in metres and turn in radians, in the place's frame.
    `prior` (3, 3): information of `about`, the deviation from which is then part of the score.
    """
    side = CELL * COARSE
    volume = _volume(place.coarse, side, place.corner, point, about, window, side / LEVER)
    score = volume.score if prior is None else volume.score - _cost(volume, about, prior)
    highest = maximum_filter(score, size=3, mode="nearest")
    at = np.argwhere((score == highest) & (score > score.max() - 0.3))
    at = at[np.argsort(-score[tuple(at.T)], kind="stable")][:PEAKS]
    spread = _moments(volume, score)
    narrow = np.array([side, side, side / LEVER])
    found = []
    for turn, y, x in at:
        start = np.array([volume.x[x], volume.y[y], volume.turn[turn]])
        fine = _volume(place.fine, CELL, place.corner, point, start, narrow, CELL / LEVER)
        total = fine.score if prior is None else fine.score - _cost(fine, about, prior)
        k = np.unravel_index(int(np.argmax(total)), total.shape)
        pose = np.array([fine.x[k[2]], fine.y[k[1]], fine.turn[k[0]]])
        found.append((pose, float(total[k])))
    return sorted(found, key=lambda way: -way[1]), spread


def search_everywhere(place: Place, point: Floats, reach: float) -> tuple[list[tuple[Floats, float]], Floats]:
    """Return the best ways to lay points (n, 2) on a place, as :func:`search`, at any turn; `reach`: shifts, metres."""
    side = CELL * ROUGH
    window = np.array([reach, reach, np.pi])
    volume = _volume(place.rough, side, place.corner, point[::3], np.zeros(3), window, side / LEVER)
    peaks = np.argwhere(volume.score == maximum_filter(volume.score, size=3, mode="nearest"))
    peaks = peaks[np.argsort(-volume.score[tuple(peaks.T)], kind="stable")][:MOST_PEAKS]
    narrow = np.array([side, side, side / LEVER])
    found = [
        search(place, point, np.array([volume.x[x], volume.y[y], volume.turn[turn]]), narrow) for turn, y, x in peaks
    ]
    ways, spread = max(found, key=lambda way: way[0][0][1])
    best: list[tuple[Floats, float]] = []
    for pose, score in sorted((way for each, _ in found for way in each[:1]), key=lambda way: -way[1]):
        if all(np.abs(pose - other)[:2].max() > side or abs(pose[2] - other[2]) > 2.0 * narrow[2] for other, _ in best):
            best.append((pose, score))
    return best[:PEAKS] or ways, spread


def fit(place: Place, point: Floats, pose: Floats) -> tuple[float, float]:
    """Return how points (n, 2) lie on a place at a pose (3,): the share where something was seen, and their score."""
    world = compose(np.broadcast_to(pose, (len(point), 3)), np.column_stack([point, np.zeros(len(point))]))[:, :2]
    column, row = np.floor((world - place.corner) / CELL).astype(np.int64).T
    height, width = place.fine.shape
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    value = place.fine[row[inside], column[inside]]
    known = value[np.abs(value) > UNSEEN]
    return len(known) / max(len(point), 1), float(known.mean()) if len(known) else 0.0


class _Volume(NamedTuple):
    score: Floats  # (n_turns, n_y, n_x)
    turn: Floats
    y: Floats
    x: Floats


def _volume(
    field: NDArray[np.float32], side: float, corner: Floats, point: Floats, about: Floats, window: Floats, turn: float
) -> _Volume:
    """Return the scores of all poses within a window, in steps of a cell and of a turn."""
    reach = np.ceil(window / [side, side, turn]).astype(np.int64)
    turns = about[2] + turn * np.arange(-reach[2], reach[2] + 1)
    cosine, sine = np.cos(turns)[:, None], np.sin(turns)[:, None]
    x = cosine * point[:, 0] - sine * point[:, 1] + about[0] - corner[0]
    y = sine * point[:, 0] + cosine * point[:, 1] + about[1] - corner[1]
    column, row = (np.floor(each / side).astype(np.int64) for each in (x, y))
    total = np.zeros((len(turns), 2 * reach[1] + 1, 2 * reach[0] + 1), np.float32)
    correlate(field, column - reach[0], row - reach[1], total)
    steps = [about[k] + side * np.arange(-reach[k], reach[k] + 1) for k in (1, 0)]
    return _Volume(total.astype(np.float64) / max(len(point), 1), turns, steps[0], steps[1])


def _cost(volume: _Volume, about: Floats, prior: Floats) -> Floats:
    """Return what the deviation from a pose takes off each score."""
    turn, y, x = np.meshgrid(volume.turn - about[2], volume.y - about[1], volume.x - about[0], indexing="ij")
    error = np.stack([x, y, turn], axis=-1)
    pull = 0.5 * np.asarray(np.einsum("...i,ij,...j->...", error, prior, error))
    return np.asarray(np.minimum(pull, MOST_PULL) / SHARP)


def _moments(volume: _Volume, score: Floats) -> Floats:
    """Return the covariance (3, 3) of the pose if scores are means of independent log likelihoods."""
    weight = np.exp(SHARP * (score - score.max()))
    weight /= weight.sum()
    turn, y, x = np.meshgrid(volume.turn, volume.y, volume.x, indexing="ij")
    value = np.stack([x.ravel(), y.ravel(), turn.ravel()])
    off = value - (value @ weight.ravel())[:, None]
    return np.asarray((weight.ravel() * off) @ off.T + np.diag(np.square(FLOOR)))
