"""Small logs, written out by hand."""

from __future__ import annotations

import gzip
from collections.abc import Sequence
from pathlib import Path


def flaser(
    ranges: Sequence[object],
    pose: Sequence[object] = (1, 2, 0),
    robot: Sequence[object] | None = None,
    time: object = 5.0,
    kind: str = "FLASER",
    announced: object = None,
) -> str:
    n = len(ranges) if announced is None else announced
    fields = [kind, n, *ranges, *pose, *(pose if robot is None else robot), time, "host", time]
    return " ".join(map(str, fields)) + "\n"


def robot_laser(
    ranges: Sequence[object],
    start: float = -0.5,
    step: float = 0.25,
    remissions: Sequence[object] = (),
    pose: Sequence[object] = (1, 2, 0.5),
    turn_axis: Sequence[object] = (0.1,),
    kind: str = "ROBOTLASER1",
) -> str:
    head = [kind, 0, start, step * max(len(ranges) - 1, 1), step, 20.0, 0.01, 0]
    body = [len(ranges), *ranges, len(remissions), *remissions, *pose, 9, 9, 9]
    fields = [*head, *body, 0.3, 0.0, 0.5, 0.2, *turn_axis, 7.5, "host", 8.5]
    return " ".join(map(str, fields)) + "\n"


def save(folder: Path, content: str | bytes, name: str = "some.log", zipped: bool = False) -> str:
    data = content.encode() if isinstance(content, str) else content
    path = folder / name
    path.write_bytes(gzip.compress(data) if zipped else data)
    return str(path)
