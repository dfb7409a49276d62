"""The tree of coordinate frames in a bag (tf), and the pose of a frame in another at given times."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from prf.shell.poses.bag import Message, seconds
from prf.shell.poses.files import interpolate

FloatArray = NDArray[np.float64]

STATIC = "tf_static"  # end of the name of the topic whose transforms hold for ever

HOLD = 0.5  # seconds before the first and after the last pose for which a robot is taken to be where it was seen

UNIT_TOL = 0.01  # how far the length of a quaternion may be from 1; tf itself passes over those that are farther


class Rigid(NamedTuple):
    """Rigid motions, one a row."""

    shift: FloatArray  # (m, 3) metres
    turn: FloatArray  # (m, 4) unit quaternions x y z w
    known: NDArray[np.bool_]  # (m,) whether the bag has this motion


@dataclass
class _Edge:
    """Poses of a child frame in its parent."""

    is_static: bool = False
    time: list[float] = field(default_factory=list)
    pose: list[tuple[float, ...]] = field(default_factory=list)

    @property
    def is_rigid(self) -> bool:
        """Whether all poses are one."""
        return self.is_static or all(pose == self.pose[0] for pose in self.pose)


class FrameTree:
    """Frames and the motions between parent and child; a child may have several parents, from several sources."""

    def __init__(self) -> None:
        self._edges: dict[tuple[str, str], _Edge] = {}

    def add(self, parent: str, child: str, time: float, transform: tuple[Any, Any], is_static: bool) -> None:
        """Take up one transform (translation, rotation), unless it has a value that is not sound."""
        shift, turn = transform
        pose = (shift.x, shift.y, shift.z, turn.x, turn.y, turn.z, turn.w)
        if all(map(math.isfinite, pose)) and abs(math.hypot(*pose[3:]) - 1.0) <= UNIT_TOL:
            edge = self._edges.setdefault((parent, child), _Edge(is_static))
            edge.time.append(time)
            edge.pose.append(pose)

    def add_messages(self, messages: Iterable[Message]) -> None:
        """Take up all transforms of tf messages."""
        for message in messages:
            for item in message.body.transforms:
                time = seconds(item.header.stamp, message.received)
                is_static = message.topic.endswith(STATIC)
                transform = (item.transform.translation, item.transform.rotation)
                self.add(frame_name(item.header.frame_id), frame_name(item.child_frame_id), time, transform, is_static)

    def parents(self, frame: str) -> list[str]:
        """Return the frames in which `frame` has a pose."""
        return [parent for parent, child in self._edges if child == frame]

    def roots_above(self, frame: str) -> list[str]:
        """Return the frames at the top, to which going from child to parent leads from `frame`."""
        reached, roots = [frame], []
        for name in reached:
            above = self.parents(name)
            reached += [parent for parent in above if parent not in reached]
            if not above and name != frame:
                roots.append(name)
        return roots

    def rigid_above(self, frame: str) -> list[str]:
        """Return `frame` and those above it to which it never moves, from child to parent."""
        reached = [frame]
        for name in reached:
            reached += [up for up in self.parents(name) if up not in reached and self._edges[up, name].is_rigid]
        return reached

    def is_rigid(self, one: str, other: str) -> bool:
        """Return whether two frames are joined, and never move to one another."""
        steps = self.chain(one, other)
        edges = [self._edges.get(step) or self._edges[step[::-1]] for step in steps or ()]
        return steps is not None and all(edge.is_rigid for edge in edges)

    def chain(self, fixed: str, frame: str) -> list[tuple[str, str]] | None:
        """Return the (parent, child) pairs from `fixed` to `frame`, each may be walked either way; None if none."""
        came_from: dict[str, str] = {fixed: fixed}
        queue = deque([fixed])
        while queue and frame not in came_from:
            here = queue.popleft()
            for parent, child in self._edges:
                there = child if parent == here else parent if child == here else here
                if there not in came_from:
                    came_from[there] = here
                    queue.append(there)
        if frame not in came_from:
            return None
        steps: list[tuple[str, str]] = []
        while frame != fixed:
            steps.insert(0, (came_from[frame], frame))
            frame = came_from[frame]
        return steps

    def poses(self, fixed: str, frame: str, time: FloatArray) -> Rigid | None:
        """Return the poses of `frame` in `fixed` at m times, interpolated; None if the tree does not join them."""
        steps = self.chain(fixed, frame)
        if steps is None:
            return None
        m = len(time)
        total = Rigid(np.zeros((m, 3)), np.tile([0.0, 0.0, 0.0, 1.0], (m, 1)), np.ones(m, dtype=bool))
        for here, there in steps:
            if (here, there) in self._edges:
                total = _joined(total, _at(self._edges[here, there], time))
            else:
                total = _joined(total, _inverse(_at(self._edges[there, here], time)))
        return total


def frame_name(name: str) -> str:
    """Return a frame's name without the leading slash that old bags give it."""
    return name.lstrip("/")


def turned(turn: FloatArray, vector: FloatArray) -> FloatArray:
    """Return vectors (3,) or (m, 3) turned by (m, 4) unit quaternions."""
    return np.asarray(Rotation.from_quat(turn).apply(vector))


def _at(edge: _Edge, time: FloatArray) -> Rigid:
    """Return the motion of one edge at m times, interpolated; of equal time stamps the last one recorded counts."""
    last = dict(zip(edge.time, edge.pose, strict=True))
    stamps = np.array(sorted(last))
    pose = np.array([last[stamp] for stamp in stamps.tolist()])
    if edge.is_rigid:
        found = np.tile(edge.pose[-1], (len(time), 1))
        return Rigid(found[:, :3], found[:, 3:], np.ones(len(time), dtype=bool))
    shift, turn = interpolate(stamps, pose[:, :3], Rotation.from_quat(pose[:, 3:]), time)
    return Rigid(shift, turn.as_quat(), (time >= stamps[0] - HOLD) & (time <= stamps[-1] + HOLD))


def _joined(outer: Rigid, inner: Rigid) -> Rigid:
    turn = Rotation.from_quat(outer.turn) * Rotation.from_quat(inner.turn)
    shift = outer.shift + turned(outer.turn, inner.shift)
    return Rigid(shift, turn.as_quat(), outer.known & inner.known)


def _inverse(motion: Rigid) -> Rigid:
    back = Rotation.from_quat(motion.turn).inv()
    return Rigid(-back.apply(motion.shift), back.as_quat(), motion.known)
