"""Pieces of the way: what was seen on a few metres of it, which is matched with other pieces."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from prf.poses.graph import Ints
from prf.poses.match import Place, fit, place_of, search
from prf.poses.plane import Floats, seen_from, wrapped
from prf.poses.scans import WallPoints

LENGTH = 5.0  # metres of the way that make a piece
TURNED = 2.0  # metres that a radian of turning counts as
RANGE = 15.0  # metres from the sensor that points of a piece lie within
POINTS = 240  # of a piece that are matched
OVERLAP = 8.0  # metres between pieces that see the same
NEAR = 4.0  # metres between pieces that must
DRIFT = np.array([0.5, 0.5, 0.1])  # m, m, rad that a piece may lie off from where another one's match has it
LEVEL = 0.8  # score, of points where something was seen, that speaks neither for nor against a match
CHANGED = np.array([0.2, 0.2, 0.05])  # m, m, rad by which pieces lie elsewhere to each other
MOST_PAIRS = 600  # of pieces that are compared


class LoopMatch(NamedTuple):
    """Where a state may have been, seen from an earlier one."""

    tail: int  # earlier state
    head: int  # later state
    pose: Floats  # (3,) of the later in the frame of the earlier: m, m, rad
    covariance: Floats  # (3, 3)
    score: float  # up to 1: how well the points near both agree
    is_used: bool  # whether the trajectory found goes through it

    def over(self, step: int) -> bool:
        """Whether a step lies between."""
        return self.tail <= step < self.head

    def is_same(self, other: LoopMatch) -> bool:
        """Whether it joins the same states in the same way."""
        return self.tail == other.tail and self.head == other.head and bool((self.pose == other.pose).all())

    def holds(self, poses: Floats) -> bool:
        """Whether it does at poses (n, 3), about."""
        off = seen_from(poses[self.tail], poses[self.head]) - self.pose
        off[2] = wrapped(off[2])
        return bool((np.abs(off) < DRIFT).all())


class Piece(NamedTuple):
    """A stretch of the way, in the frame of its middle state."""

    anchor: int
    point: Floats  # (n, 2) metres
    place: Place  # of it and its neighbours


def cut(scans: WallPoints, poses: Floats, breaks: Sequence[int] = ()) -> list[Piece]:
    """Return the pieces of the way, in order; no piece goes over a step (k,) of the breaks."""
    steps = seen_from(poses[:-1], poses[1:])
    along = np.append(0.0, np.cumsum(np.hypot(steps[:, 0], steps[:, 1]) + TURNED * np.abs(steps[:, 2])))
    number = (along / LENGTH).astype(np.int64)
    for step in breaks:
        number[step + 1 :] += 2
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
        found.append(Piece(anchor, own, place_of(local, origin, RANGE + LENGTH)))
    return found


def gain(pairs: Ints, pieces: Sequence[Piece], before: Floats, after: Floats) -> float:
    """Return by how much better pieces that overlap lie on each other at poses `after` than at `before`, (n, 3) each.

    Of each later piece counts the mean over earlier ones, for `pairs` (k, 2), earlier and later, that come to lie
    elsewhere to each other.
    """
    anchor = np.array([piece.anchor for piece in pieces])[pairs]
    about = [seen_from(poses[anchor[:, 0]], poses[anchor[:, 1]]) for poses in (before, after)]
    change = about[1] - about[0]
    change[:, 2] = wrapped(change[:, 2])
    differs = (np.abs(change) > CHANGED).any(axis=1)
    total = 0.0
    for sign, each in zip((-1.0, 1.0), about, strict=True):
        near = np.flatnonzero(differs & (np.hypot(each[:, 0], each[:, 1]) < NEAR))
        near = near[:: 1 + len(near) // MOST_PAIRS]
        found: dict[int, list[float]] = {}
        for k in near:
            tail, head = pieces[pairs[k, 0]], pieces[pairs[k, 1]]
            way = search(tail.place, head.point, each[k], DRIFT)[0][0][0]
            share, score = fit(tail.place, head.point, way)
            found.setdefault(head.anchor, []).append(share * (score - LEVEL))
        total += sign * sum(float(np.mean(values)) for values in found.values())
    return total


def _local(pose: Floats, world: Floats) -> Floats:
    return seen_from(pose, np.column_stack([world, np.zeros(len(world))]))[:, :2]
