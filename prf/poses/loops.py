"""Loops closed: pieces of the way matched with earlier ones, as far as the drift's uncertainty allows.

A match counts if it is good, if it agrees with the uncertainty of the way between, and if the graph of all poses can
follow it; what it leaves open (the place along a corridor) is in its covariance. Closures within a small uncertainty
come first: each of them narrows the search for the others.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.sparse.linalg import splu

from prf.poses.graph import Ints, Pull, Relations, derivatives, errors, root_of
from prf.poses.match import Place, place_of, search
from prf.poses.plane import Floats, compose, seen_from, wrapped
from prf.poses.scans import WallPoints

LENGTH = 5.0  # metres of the way that make a piece
TURNED = 2.0  # metres that a radian of turning counts as
APART = 3  # pieces that lie between a piece and one that it may be matched with
RANGE = 15.0  # metres from the sensor that points of a piece lie within
POINTS = 240  # of a piece that are matched
OVERLAP = 8.0  # metres between pieces that see the same
TARGETS = 6  # earlier pieces that one is matched with in a round
ROOMS = (1.5, 4.0, 12.0)  # metres: uncertainty of a place, three standard deviations, searched in a round
TURN = 0.8  # radians searched at most
SIGMAS = 3.0
GOOD = 0.45  # score of a match that counts
PLAUSIBLE = 0.3  # score of one that is worth a try
FAR_OFF = 16.0  # squared distance, in standard deviations, from the prediction and in the settled graph
SOFT = 9.0  # the same from which a closure pulls less (dynamic covariance scaling, Agarwal et al. 2013)
SETTLING = 15  # steps of Gauss and Newton


class LoopMatch(NamedTuple):
    """Where a state may have been, seen from an earlier one."""

    tail: int  # earlier state
    head: int  # later state
    pose: Floats  # (3,) of the later in the frame of the earlier: m, m, rad
    covariance: Floats  # (3, 3)
    score: float  # up to 1: how well the points near both agree
    is_used: bool  # whether the trajectory found goes through it


class _Piece(NamedTuple):
    """A stretch of the way, in the frame of its middle state."""

    anchor: int
    point: Floats  # (n, 2) metres
    place: Place  # of it and its neighbours


def close_loops(scans: WallPoints, poses: Floats, chain: Pull) -> tuple[Floats, list[LoopMatch]]:
    """Return poses (n, 3) with loops closed, and all plausible closures.

    `poses`: right from each to the next, as far as scans can show. `chain`: what is known of each step.
    """
    pieces = _pieces(scans, poses)
    found, tried = list[LoopMatch](), set[tuple[int, int]]()
    for room in ROOMS:
        for a, b, window, spread in _candidates(pieces, poses, _with(chain, found), room):
            if (a, b) not in tried:
                tried.add((a, b))
                found += _matches(pieces[a], pieces[b], poses, window, spread)
        poses, found = _settled(poses, chain, found)
    return poses, found


def _pieces(scans: WallPoints, poses: Floats) -> list[_Piece]:
    """Return the pieces of the way, in order."""
    steps = seen_from(poses[:-1], poses[1:])
    along = np.append(0.0, np.cumsum(np.hypot(steps[:, 0], steps[:, 1]) + TURNED * np.abs(steps[:, 2])))
    number = (along / LENGTH).astype(np.int64)
    near = scans.select(np.hypot(*scans.point.T) < RANGE)
    world, of_point = near.at(poses)[0], number[near.owner]
    found = []
    for k in np.unique(number):
        anchor = int(np.flatnonzero(number == k).mean())
        inside = np.flatnonzero(np.abs(of_point - k) <= 1)
        inside = inside[:: 1 + len(inside) // 4000]
        local = _local(poses[anchor], world[inside])
        origin = _local(poses[anchor], poses[near.owner[inside], :2])
        own = local[of_point[inside] == k]
        own = own[:: 1 + len(own) // POINTS]
        found.append(_Piece(anchor, own, place_of(local, origin, RANGE + LENGTH)))
    return found


def _local(pose: Floats, world: Floats) -> Floats:
    return seen_from(pose, np.column_stack([world, np.zeros(len(world))]))[:, :2]


def _with(chain: Pull, found: list[LoopMatch]) -> Pull:
    """Return the chain with the closures used."""
    used = [match for match in found if match.is_used]
    return chain._replace(relations=chain.relations.join(_relations(used))) if used else chain


def _relations(used: list[LoopMatch]) -> Relations:
    tail, head = (np.array([getattr(match, name) for match in used], np.int64) for name in ("tail", "head"))
    root = root_of(np.array([match.covariance for match in used]))
    return Relations(tail, head, np.array([match.pose for match in used]), root)


def _candidates(pieces: list[_Piece], poses: Floats, graph: Pull, room: float) -> list[tuple[int, int, Floats, Floats]]:
    """Return pairs of pieces that may overlap, the window to search, and the covariance (3, 3) of the prediction."""
    anchor = np.array([piece.anchor for piece in pieces])
    first, second = np.triu_indices(len(pieces), APART)
    spread = _Covariances(graph, poses, anchor)(first, second)
    sigma = SIGMAS * np.sqrt(np.einsum("kii->ki", spread))
    away = np.hypot(*(poses[anchor[first], :2] - poses[anchor[second], :2]).T)
    reach = sigma[:, :2].max(axis=1)
    found = []
    for b in np.unique(second):
        mine = np.flatnonzero((second == b) & (reach <= room) & (away - reach < OVERLAP))
        for k in mine[np.argsort(away[mine], kind="stable")][:TARGETS]:
            window = np.append(np.maximum(sigma[k, :2], 0.3), min(max(sigma[k, 2], 0.05), TURN))
            found.append((int(first[k]), int(b), window, spread[k]))
    return found


class _Covariances:
    """Covariances of poses seen from other poses."""

    def __init__(self, graph: Pull, poses: Floats, states: Ints) -> None:
        matrix, _ = graph.equations(poses)
        columns = (3 * states[:, None] + np.arange(3)).ravel()
        unit = np.zeros((matrix.shape[0], len(columns)))
        unit[columns, np.arange(len(columns))] = 1.0
        self._all = splu(matrix).solve(unit)[columns].reshape(len(states), 3, len(states), 3)
        self._poses, self._states = poses, states

    def __call__(self, first: Ints, second: Ints) -> Floats:
        """Return the covariances (k, 3, 3) of the second in the frame of the first, both indices into the states."""
        n = len(first)
        tail, head = self._states[first], self._states[second]
        unit = Relations(tail, head, np.zeros((n, 3)), np.tile(np.eye(3), (n, 1, 1)))
        parts = list(zip((first, second), derivatives(unit, self._poses), strict=True))
        return np.asarray(
            sum(by @ self._all[a, :, b] @ np.swapaxes(other, 1, 2) for a, by in parts for b, other in parts)
        )


def _matches(tail: _Piece, head: _Piece, poses: Floats, window: Floats, spread: Floats) -> list[LoopMatch]:
    """Return the plausible ways that a piece lies on an earlier one, the best first, which may be used."""
    about = seen_from(poses[tail.anchor], poses[head.anchor])
    ways, covariance = search(tail.place, head.point, about, window)
    found = []
    for k, (pose, score) in enumerate(ways):
        error = pose - about
        error[2] = wrapped(error[2])
        distance = error @ np.linalg.solve(spread + covariance, error)
        is_used = k == 0 and score >= GOOD and distance < FAR_OFF
        if score >= PLAUSIBLE:
            found.append(LoopMatch(tail.anchor, head.anchor, pose, covariance, score, bool(is_used)))
    return found


def _settled(poses: Floats, chain: Pull, found: list[LoopMatch]) -> tuple[Floats, list[LoopMatch]]:
    """Return the poses that fit the chain and the closures best, and the closures, used only if they fit."""
    used = [match for match in found if match.is_used]
    if not used:
        return poses, found
    loops, graph = _relations(used), _with(chain, found)
    ones = np.ones(len(chain.relations.tail))
    for _ in range(SETTLING):
        misfit = np.square(errors(loops, poses)).sum(axis=1)
        pulls = np.square(np.minimum(1.0, 2.0 * SOFT / (SOFT + misfit)))
        matrix, right = graph.equations(poses, weight=np.append(ones, pulls))
        poses = compose(poses, splu(matrix).solve(right).reshape(-1, 3))
    fits = iter((np.square(errors(loops, poses)).sum(axis=1) < FAR_OFF).tolist())
    return poses, [match._replace(is_used=match.is_used and next(fits)) for match in found]
