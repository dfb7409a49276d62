"""Steps over which the robot was carried, or slipped far: the way before and the way after laid on each other anew.

Where scans lie worst on what was seen just before, pieces after are matched with pieces before, at any turn. Each match
says where all that follows lies; the one that most other pieces bear out is taken.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from prf.poses.errors import MEDIAN
from prf.poses.match import search_everywhere
from prf.poses.pieces import OVERLAP, LoopMatch, Piece, gain
from prf.poses.plane import Floats, compose, seen_from

DOUBTFUL, LEAST_DOUBT = 2.5, 0.12  # standard deviations, and score, that the fit of such a step lies below the others
MOST = 4  # steps that are looked at, the worst first
AGREE = 0.5  # score of pieces that see the same
MOST_MATCHED = 400  # pairs of pieces that are
MOST_WAYS = 12  # that are judged by the other pieces, a step
CLEAR = 0.8  # score of a match that hardly lies
LEAST, LEAST_UNCLEAR = 0.2, 3.5  # by which scores must add up to more than for the step as it was measured


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
    limit = middle - max(DOUBTFUL * float(np.median(np.abs(known - middle))) / MEDIAN, LEAST_DOUBT)
    worst = np.argsort(np.where(np.isfinite(fits), fits, np.inf), kind="stable")[:MOST]
    return [int(step) for step in worst if fits[step] < limit]


def landings(pieces: Sequence[Piece], poses: Floats, steps: Sequence[int]) -> list[Landing]:
    """Return where the robot may have been put down after one of some steps, the best borne out first.

    `poses` (n, 3): as they are if it was not carried.
    """
    pairs, anchor = np.column_stack(np.triu_indices(len(pieces), 1)), np.array([piece.anchor for piece in pieces])
    over = {step: pairs[(anchor[pairs[:, 0]] <= step) & (step < anchor[pairs[:, 1]])] for step in steps}
    parted = np.unique(np.concatenate(list(over.values())), axis=0)
    some = np.sort(np.random.default_rng(0).permutation(len(parted))[:MOST_MATCHED])
    matches = [match for a, b in parted[some] for match in _matches(pieces[a], pieces[b]) if not match.holds(poses)]
    matches.sort(key=lambda match: -match.score)
    found = list[Landing]()
    for step in steps:
        judged = list[Floats]()
        for match in matches:
            if len(judged) == MOST_WAYS:
                break
            if match.over(step) and not any(match.holds(other) for other in judged):
                judged.append(_moved(poses, step, match))
                found.append(Landing(step, match, judged[-1], gain(over[step], pieces, poses, judged[-1])))
    kept = (each for each in found if each.gain > (LEAST if each.match.score > CLEAR else LEAST_UNCLEAR))
    return sorted(kept, key=lambda landing: -landing.gain)


def _matches(tail: Piece, head: Piece) -> list[LoopMatch]:
    """Return the good ways to lay a piece on an earlier one, at any turn."""
    ways, covariance = search_everywhere(tail.place, head.point, OVERLAP)
    return [LoopMatch(tail.anchor, head.anchor, way, covariance, score, True) for way, score in ways if score > AGREE]


def _moved(poses: Floats, step: int, match: LoopMatch) -> Floats:
    """Return poses with all that follow a step moved so that a match holds."""
    head = compose(poses[match.tail], match.pose)
    rest = compose(head, seen_from(poses[match.head], poses[step + 1 :]))
    return np.concatenate([poses[: step + 1], rest])
