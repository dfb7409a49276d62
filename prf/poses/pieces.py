"""Pieces of the way: what was seen on a few metres of it, which is matched with other pieces."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from prf.poses.match import Place, place_of
from prf.poses.plane import Floats, seen_from
from prf.poses.scans import WallPoints

LENGTH = 5.0  # metres of the way that make a piece
TURNED = 2.0  # metres that a radian of turning counts as
RANGE = 15.0  # metres from the sensor that points of a piece lie within
POINTS = 240  # of a piece that are matched
OVERLAP = 8.0  # metres between pieces that see the same


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


def _local(pose: Floats, world: Floats) -> Floats:
    return seen_from(pose, np.column_stack([world, np.zeros(len(world))]))[:, :2]
