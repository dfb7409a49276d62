"""What motions of scans are made of: single scans off the others, jumps from one scan to the next, and drift."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mapq.posed.check_poses import WRONG, CheckedPoses
from mapq.posed.check_scans import LEVER
from mapq.posed.register import Floats, Ints
from mapq.posed.solve import twists

AROUND = 2
"""Scans before and after each of which the most central motion is what it would have without an error of its own."""
OFF = 0.1
"""Metres off that, or off the next scan, from which a scan is off by itself, or the motions jump."""
ABRUPT = 4.0
"""Of the median change from scan to scan: a larger one is a jump."""
MANY = 1 / 3
"""Share of scans off by themselves from which on there is nothing but such scans."""


Pair = tuple[int, int]


class WrongEdge(NamedTuple):
    """An edge that is wrong."""

    ids: Pair  # vertices
    ends: Pair  # their scans, in the order of time
    span: Pair  # first and last scan of those that it bends


class Parts(NamedTuple):
    """Metres that part two scans along a normal."""

    alone: tuple[float, float]  # by which each is off by itself
    jump: float  # that came between two neighbouring scans
    drift: float  # that came little by little


class Breaks(NamedTuple):
    """Motions that scans ask for, and where they break."""

    motion: Floats  # (n, 4, 4) in the frame of the map
    like: Ints  # (n,) of each scan the one near it whose motion it would have without an error of its own
    jumps: Ints  # (j,) scans after which the motions jump
    edges: tuple[WrongEdge, ...]  # worst first

    def split(self, one: int, other: int, at: Floats, normal: Floats) -> Parts:
        """Return what parts two scans, the `one` before the `other`, at a place (3) along its normal (3)."""
        scans = self.like[[one, other]]
        first, last = (self.offsets(scans, at, normal) - self.offsets(np.array([one, other]), at, normal)).tolist()
        inside = self.jumps[(self.jumps >= one) & (self.jumps < other)]
        jumps = self.offsets(self.like[inside + 1], at, normal) - self.offsets(self.like[inside], at, normal)
        smooth = float(np.diff(self.offsets(scans, at, normal))[0])
        return Parts((first, last), float(jumps.sum()), smooth - float(jumps.sum()))

    def edge_over(self, one: int, other: int) -> WrongEdge | None:
        """Return the worst edge that bends what lies between two scans; None if none does."""
        return next((edge for edge in self.edges if edge.span[0] < other and edge.span[1] > one), None)

    def offsets(self, scans: Ints, at: Floats, normal: Floats) -> Floats:
        """Return by how much (s,) scans ask a place (3) to be moved along its normal (3), in metres."""
        return np.asarray((self.motion[scans, :3, :3] @ at + self.motion[scans, :3, 3] - at) @ normal)


def breaks_of(poses: CheckedPoses) -> Breaks:
    """Return where the motions of scans break.

    Where some scans are probably wrong, none but these is off by itself: of others it is the map that bends.
    """
    twist = twists(poses.motion, poses.places) * np.repeat([1.0, LEVER], 3)
    like, every = _like(twist), np.arange(len(twist))
    wrong = [row.scan for row in poses.scans if row.p_wrong > WRONG]
    if wrong:
        like = np.where(np.isin(every, wrong), like, every)
    steps = np.linalg.norm(np.diff(twist[like], axis=0), axis=1)
    limit = max(OFF, ABRUPT * float(np.median(steps))) if len(steps) else OFF
    jumps = np.flatnonzero(steps > limit) if poses.drift is None else np.zeros(0, np.int64)
    return Breaks(poses.motion, like, jumps, _wrong_edges(poses))


def _like(twist: Floats) -> Ints:
    """Return for each scan the one near it of the most central motion, itself where its motion (n, 6) is no other."""
    n = len(twist)
    near = [np.arange(max(scan - AROUND, 0), min(scan + AROUND + 1, n)) for scan in range(n)]
    central = np.array([_central(twist, some) for some in near], np.int64)
    off = np.linalg.norm(twist - twist[central], axis=1) > OFF
    if off.sum() > MANY * n:
        central[:] = _central(twist, np.arange(n))
        off = np.linalg.norm(twist - twist[central], axis=1) > OFF
    return np.where(off, central, np.arange(n))


def _central(twist: Floats, some: Ints) -> int:
    """Return that of some scans whose motion is closest to those of the others, in sum."""
    apart = np.linalg.norm(twist[some][:, None] - twist[some], axis=2).sum(axis=1)
    return int(some[np.argmin(apart)])


def _wrong_edges(poses: CheckedPoses) -> tuple[WrongEdge, ...]:
    """Return the wrong edges; each bends the scans between its ends, those of loops over these, and so on."""
    ends = {edge.row: (min(edge.scans), max(edge.scans)) for edge in poses.edges if min(edge.scans) >= 0}
    found = []
    for edge in poses.edges:
        if edge.row in ends and edge.p_wrong > WRONG:
            found.append(WrongEdge(edge.ids, ends[edge.row], _joined(ends[edge.row], list(ends.values()))))
    return tuple(found)


def _joined(span: Pair, others: list[Pair]) -> Pair:
    """Return a span with those that overlap it, or what overlaps it already."""
    while True:
        over = [span, *(each for each in others if each[0] < span[1] and each[1] > span[0])]
        wider = min(begin for begin, _ in over), max(end for _, end in over)
        if wider == span:
            return span
        span = wider
