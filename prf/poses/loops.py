"""Loops closed: pieces of the way matched with earlier ones, as far as the drift's uncertainty allows.

A match counts if it is good, if it agrees with the uncertainty of the way between, and if the graph of all poses can
follow it; what it leaves open (the place along a corridor) is in its covariance. Closures within a small uncertainty
come first: each of them narrows the search for the others.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.sparse.linalg import splu

from prf.poses.carried import doubtful, landings
from prf.poses.follow import Followed
from prf.poses.graph import Ints, Pull, Relations, derivatives, errors, root_of
from prf.poses.match import search
from prf.poses.model import FAR_OFF, NO_CLOSURES, Closures
from prf.poses.pieces import OVERLAP, LoopMatch, Piece, cut, gain
from prf.poses.plane import Floats, compose, seen_from, wrapped
from prf.poses.scans import WallPoints

APART = 3  # pieces that lie between a piece and one that it may be matched with
TARGETS = 6  # earlier pieces that one is matched with in a round
ROOMS = (1.5, 4.0, 12.0)  # metres: uncertainty of a place, three standard deviations, searched in a round
TURN = 0.8  # radians searched at most
SIGMAS = 3.0
GOOD = 0.45  # score of a match that counts
PLAUSIBLE = 0.3  # score of one that is worth a try
SOFT = 9.0  # the same from which a closure pulls less (dynamic covariance scaling, Agarwal et al. 2013)
SETTLING = 15  # steps of Gauss and Newton
CONTRARY, MOST_CONTRARY = 0.6, 20  # score of a closure left out that may be right instead, and how many are tried
FORCE = 10.0  # times that it holds what it joins
POINTS_WORTH = 30.0  # nats that a score of one piece is worth
LEAST_ODDS, MOST_WAYS = -3.0, 4  # log odds of a way that is kept, and how many are
BROKEN = 1e-3  # share of what holds a step that is left where the robot was carried
LEAST_RELIEF = 20.0  # nats by which given poses must fit better for that, about what its prior costs
NO_LOOPS = Relations(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros((0, 3, 3)))


class Way(NamedTuple):
    """A way that the robot may have gone."""

    poses: Floats  # (n, 3)
    loops: list[LoopMatch]  # plausible closures of loops, used or not
    log_odds: float  # against the others found, about
    apart: tuple[LoopMatch, ...] = ()  # the closure that sets it apart


def close_loops(scans: WallPoints, followed: Followed, chain: Pull) -> list[Way]:
    """Return the ways with loops closed, the most likely first; `chain`: what else holds poses.

    Steps as followed give the shape of the way, given poses with their errors where it lies, if there are any: loops
    are looked for as far as both leave open.
    """
    steps, root = doubtful(followed.fits), followed.steps.root.copy()
    chain = chain._replace(relations=followed.steps._replace(root=root))
    # Begun where the steps lead, not at given poses: a bent way is straightened, headings that jitter may not be.
    poses = _fitted(followed.poses, chain, NO_LOOPS)
    pieces = cut(scans, poses, steps)
    if chain.sharpness.all():
        # Given poses say where a robot that was carried was put down: what only looks alike there has no say.
        poses, steps = _put_down(poses, chain, steps), []
    poses, found = _closed(pieces, poses, chain, [])
    while steps and (ways := landings(pieces, poses, steps)):
        step, match = ways[0].step, ways[0].match
        root[step] *= BROKEN
        steps.remove(step)
        poses, found = _closed(pieces, ways[0].poses, chain, [match, *(each for each in found if not each.over(step))])
    return _ways(pieces, chain, Way(poses, found, 0.0))


def _put_down(poses: Floats, chain: Pull, steps: Sequence[int]) -> Floats:
    """Return the poses (n, 3) that fit when the robot may have been carried where given poses have it so.

    `steps`: those that scans doubt. The ones over which it was are weakened in `chain`.
    """
    root = chain.relations.root
    for step in steps:
        strain, held = chain.strain(poses), root[step].copy()
        root[step] *= BROKEN
        loose = _fitted(poses, chain, NO_LOOPS)
        if strain - chain.strain(loose) > LEAST_RELIEF:
            poses = loose
        else:
            root[step] = held
    return poses


def _ways(pieces: list[Piece], chain: Pull, first: Way) -> list[Way]:
    """Return a way and others, in which a closure that it leaves out holds instead of those that contradict it."""
    pairs = np.column_stack(np.triu_indices(len(pieces), APART))
    left = [match for match in first.loops if match.score >= CONTRARY and not match.holds(first.poses)]
    ways, tried = [first], list[Floats]()
    for match in sorted(left, key=lambda match: -match.score)[:MOST_CONTRARY]:
        if any(match.holds(poses) for poses in tried):
            continue
        poses, loops = _settled(first.poses, chain, first.loops, match)
        tried.append(poses)
        if match.holds(poses):
            strain = chain.strain(poses) - chain.strain(first.poses)
            odds = POINTS_WORTH * gain(pairs, pieces, first.poses, poses) - strain
            if odds > LEAST_ODDS:
                ways.append(Way(poses, loops, odds, (match,)))
    ways.sort(key=lambda way: -way.log_odds)
    most = ways[0].log_odds
    return [way._replace(log_odds=way.log_odds - most) for way in ways[:MOST_WAYS] if way.log_odds - most > LEAST_ODDS]


def closures(matches: Sequence[LoopMatch]) -> Closures:
    """Return matches as closures."""
    if not matches:
        return NO_CLOSURES
    tail, head, pose, covariance = (np.array([match[k] for match in matches]) for k in range(4))
    return Closures(tail, head, pose, covariance)


def _closed(pieces: list[Piece], poses: Floats, chain: Pull, found: list[LoopMatch]) -> tuple[Floats, list[LoopMatch]]:
    """Return the poses that fit closures found and those found anew, and all of these."""
    tried = set[tuple[int, int]]()
    for room in ROOMS:
        for a, b, window, spread in _candidates(pieces, poses, _with(chain, found), room):
            if (a, b) not in tried:
                tried.add((a, b))
                found = [*found, *_matches(pieces[a], pieces[b], poses, window, spread)]
        poses, found = _settled(poses, chain, found)
    return poses, found


def _with(chain: Pull, found: list[LoopMatch]) -> Pull:
    """Return the chain with the closures used."""
    used = [match for match in found if match.is_used]
    return chain._replace(relations=chain.relations.join(_relations(used))) if used else chain


def _relations(used: list[LoopMatch]) -> Relations:
    tail, head = (np.array([getattr(match, name) for match in used], np.int64) for name in ("tail", "head"))
    root = root_of(np.array([match.covariance for match in used]))
    return Relations(tail, head, np.array([match.pose for match in used]), root)


def _candidates(pieces: list[Piece], poses: Floats, graph: Pull, room: float) -> list[tuple[int, int, Floats, Floats]]:
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


def _matches(tail: Piece, head: Piece, poses: Floats, window: Floats, spread: Floats) -> list[LoopMatch]:
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


def _settled(
    poses: Floats, chain: Pull, found: list[LoopMatch], forced: LoopMatch | None = None
) -> tuple[Floats, list[LoopMatch]]:
    """Return the poses that fit the chain and the closures best, and the closures, used only if they fit.

    `forced`: one of these that the others have to fit.
    """
    found = [match._replace(is_used=True) if match is forced else match for match in found]
    used = [match for match in found if match.is_used]
    if not used:
        return poses, found
    loops = _relations(used)
    if forced is not None:
        loops.root[[match.is_same(forced) for match in used]] *= FORCE
    poses = _fitted(poses, chain, loops)
    fits = iter((np.square(errors(loops, poses)).sum(axis=1) < FAR_OFF).tolist())
    return poses, [match._replace(is_used=match.is_used and next(fits)) for match in found]


def _fitted(poses: Floats, chain: Pull, loops: Relations) -> Floats:
    """Return the poses that fit the chain and loops best, near `poses` (n, 3); loops far off are scaled away."""
    graph = chain._replace(relations=chain.relations.join(loops))
    ones = np.ones(len(chain.relations.tail))
    for _ in range(SETTLING):
        misfit = np.square(errors(loops, poses)).sum(axis=1)
        pulls = np.square(np.minimum(1.0, 2.0 * SOFT / (SOFT + misfit)))
        matrix, right = graph.equations(poses, weight=np.append(ones, pulls))
        poses = compose(poses, splu(matrix).solve(right).reshape(-1, 3))
    return poses
