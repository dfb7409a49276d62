"""Steps over which the robot was carried, or slipped far: the way before and the way after laid on each other anew.

Where scans lie worst on what was seen just before, pieces after are matched with pieces before, at any turn. Each match
says where all that follows lies; the one that most other pieces bear out is taken.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from prf.poses.match import fit, search, search_everywhere
from prf.poses.pieces import OVERLAP, LoopMatch, Piece
from prf.poses.plane import Floats, compose, seen_from, wrapped

DOUBTFUL = 2.5  # standard deviations that the fit of such a step lies below the others
MOST = 4  # steps that are looked at, the worst first
AGREE = 0.5  # score of pieces that see the same
NEAR = 4.0  # metres between pieces that must
LEVEL = 0.8  # score, of points where something was seen, that speaks neither for nor against it
MOST_PAIRS = 400  # of pieces that are matched
MOST_WAYS = 12  # that are judged by the other pieces, a step
DRIFT = np.array([0.5, 0.5, 0.1])  # m, m, rad that a piece may lie off from where another one's match has it
LEAST = 0.2  # by which scores must add up to more than for the step as it was measured


class Landing(NamedTuple):
    """Where the robot may have been put down after a step."""

    step: int
    match: LoopMatch  # of the piece that says so
    poses: Floats  # (n, 3) with all that follows moved there
    gain: float  # by which scores of pieces add up to more than if it had not been carried


def doubtful(fits: Floats) -> list[int]:
    """Return the steps whose scans fit (n - 1,) worse than others, the worst first."""
    known = fits[np.isfinite(fits)]
    if not len(known):
        return []
    middle = np.median(known)
    limit = middle - DOUBTFUL * 1.4826 * np.median(np.abs(known - middle))
    worst = np.argsort(np.where(np.isfinite(fits), fits, np.inf), kind="stable")[:MOST]
    return [int(step) for step in worst if fits[step] < limit]


def landings(pieces: Sequence[Piece], poses: Floats, steps: Sequence[int]) -> list[Landing]:
    """Return where the robot may have been put down after one of some steps, the best borne out first.

    `poses` (n, 3): as they are if it was not carried.
    """
    pairs = [pair for pair in itertools.combinations(pieces, 2) if _parted(*pair, steps)]
    some = np.random.default_rng(0).permutation(len(pairs))[:MOST_PAIRS]
    matches = [match for k in np.sort(some) for match in _matches(*pairs[k]) if not _holds(match, poses)]
    matches.sort(key=lambda match: -match.score)
    found = list[Landing]()
    for step in steps:
        across = [pair for pair in pairs if _parted(*pair, [step])]
        base, judged = _borne_out(across, poses), list[Floats]()
        for match in matches:
            if not match.over(step) or any(_holds(match, other) for other in judged):
                continue
            judged.append(_moved(poses, step, match))
            found.append(Landing(step, match, judged[-1], _borne_out(across, judged[-1]) - base))
            if len(judged) == MOST_WAYS:
                break
    return sorted((each for each in found if each.gain > LEAST), key=lambda landing: -landing.gain)


def _parted(tail: Piece, head: Piece, steps: Sequence[int]) -> bool:
    """Whether one of some steps lies between two pieces."""
    return any(tail.anchor <= step < head.anchor for step in steps)


def _matches(tail: Piece, head: Piece) -> list[LoopMatch]:
    """Return the good ways to lay a piece on an earlier one, at any turn."""
    ways, covariance = search_everywhere(tail.place, head.point, OVERLAP)
    return [LoopMatch(tail.anchor, head.anchor, way, covariance, score, True) for way, score in ways if score > AGREE]


def _holds(match: LoopMatch, poses: Floats) -> bool:
    """Whether a match holds at poses, about."""
    off = seen_from(poses[match.tail], poses[match.head]) - match.pose
    off[2] = wrapped(off[2])
    return bool((np.abs(off) < DRIFT).all())


def _moved(poses: Floats, step: int, match: LoopMatch) -> Floats:
    """Return poses with all that follow a step moved so that a match holds."""
    head = compose(poses[match.tail], match.pose)
    rest = compose(head, seen_from(poses[match.head], poses[step + 1 :]))
    return np.concatenate([poses[: step + 1], rest])


def _borne_out(pairs: list[tuple[Piece, Piece]], poses: Floats) -> float:
    """Return the sum over later pieces of how well they lie, on average, on the earlier ones that they overlap."""
    found: dict[int, list[float]] = {}
    for tail, head in pairs:
        about = seen_from(poses[tail.anchor], poses[head.anchor])
        if np.hypot(about[0], about[1]) < NEAR:
            way = search(tail.place, head.point, about, DRIFT)[0][0][0]
            share, score = fit(tail.place, head.point, way)
            found.setdefault(head.anchor, []).append(share * (score - LEVEL))
    return float(sum(np.mean(values) for values in found.values()))
