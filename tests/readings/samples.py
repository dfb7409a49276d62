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


def player(
    interface: str, payload: Sequence[object], time: float = 0.0, kind: str = "001 001", index: str = "00"
) -> str:
    """Return a line of Player 2.x."""
    return f"{time:014.3f} 16777343 6665 {interface} {index} {kind} {' '.join(map(str, payload))}\n"


def player1(interface: str, payload: Sequence[object], time: float = 0.0, index: str = "00") -> str:
    """Return a line of Player 1.x, logged a tenth of a second after its data were taken."""
    return f"{time + 0.1:014.3f} rossum 6665 {interface} {index} {time:014.3f} {' '.join(map(str, payload))}\n"


def position(x: float, y: float, heading: float, time: float = 0.0, **where: str) -> str:
    return player("position2d", (x, y, heading, 0, 0, 0, 0), time, **where)


def player_laser(
    ranges: Sequence[object], time: float = 0.0, low: float = -0.5, step: float = 0.5, top: float = 8.0, **where: str
) -> str:
    pairs = [field for distance in ranges for field in (distance, 7)]
    high = low + step * (len(ranges) - 1)
    return player("laser", ("0000", low, high, step, top, len(ranges), *pairs), time, **where)
