"""Point clouds of a ROS bag: ``PointCloud2`` messages, taken into the frame of the map by tf."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.cloud import PointCloud
from mapq.configuration import ReadOptions
from mapq.io.content import ACCEPTED, Content
from mapq.io.fields import (
    TIME,
    Array,
    axes_of,
    cloud_of_world,
    fields_of_scans,
    joined_fields,
    original_names,
    refuse_doubles,
)
from prf.shell.errors import ConfigError, InputError
from prf.shell.poses.bag import Bag, Message, bag_in, open_bag, seconds
from prf.shell.poses.tf import FrameTree, Rigid, frame_name, turned

logger = logging.getLogger(__name__)

CLOUD = "sensor_msgs/msg/PointCloud2"
TF_TYPES = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
FIXED = "map"

TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
"""Types of numpy by the numbers of PointField."""


class _Scan(NamedTuple):
    """A message: coordinates as in the message (n, 3), and its other fields."""

    frame: str
    time: float
    points: Array
    fields: dict[str, Array]


def read_bag(content: Content, options: ReadOptions) -> PointCloud:
    """Return the points of all PointCloud2 messages of a topic as one cloud.

    A single message, and messages in the frame of the map, are taken as they are; others by tf into the frame of the
    map, each at its time. A message that repeats the one before, as a map that is published again and again, counts
    once. Where there are several the field `scan` numbers them, `time` has their times, and
    `to_sensor_x/y/z` lead to where the sensor was.
    """
    source = content.source
    with _bag_path(content) as path, open_bag(path, source) as bag:
        topic = _topic(bag, options.topic)
        scans = _scans(bag, topic)
        if not scans:
            raise InputError(f"{source}: the messages of {topic} are empty.")
        poses = _poses(bag, scans, options.frame)
    unit = options.unit or 1.0
    rows = [row for row in range(len(scans)) if poses is None or poses.known[row]]
    if not rows:
        raise InputError(f"{source}: no message of {topic} lies within the time of the transforms.")
    n_lost = len(scans) - len(rows)
    if n_lost:
        logger.warning(
            "%s: %d of %d messages lie outside the time of the transforms: left out", source, n_lost, len(scans)
        )
    placed = [_placed(scans[row].points, poses, row, unit) for row in rows]
    counts, world = list(map(len, placed)), np.concatenate(placed)
    fields = joined_fields([scans[row].fields for row in rows], counts, source)
    if len(rows) > 1:
        fields = original_names(fields, (TIME,))  # points may have times of their own, within a turn of the laser
        fields[TIME] = np.repeat([scans[row].time for row in rows], counts)
    if poses is not None:
        fields |= fields_of_scans(world, poses.shift[rows] / unit, counts, unit)
    return cloud_of_world(world, fields, source, unit)


@contextmanager
def _bag_path(content: Content) -> Iterator[Path]:
    """Give the file or folder of the bag."""
    if content.is_folder:
        yield bag_in(Path(content.path), f"Folders of scans are for mapq classify, segment and perturb. {ACCEPTED}")
        return
    with content.file() as file:
        yield file


def _topic(bag: Bag, named: str | None) -> str:
    """Return the topic to read."""
    topics = bag.of_type(CLOUD)
    if not topics:
        is_log = bag.of_type("sensor_msgs/msg/LaserScan", "sensor_msgs/msg/Range")
        advice = " prf makes maps of laser scans: prf info FILE." if is_log else ""
        raise InputError(f"{bag.source}: no {CLOUD} messages. The bag has {bag.contents}.{advice}")
    if named is None:
        if len(topics) > 1:
            raise ConfigError(f"{bag.source}: several topics of clouds, {', '.join(topics)}. Choose one with --topic.")
        return topics[0]
    # ROS itself takes a name without the slash for the same topic.
    for name in (named, f"/{named}"):
        if name in topics:
            return name
    raise ConfigError(f"--topic {named}: {bag.source} has {', '.join(topics)}.")


def _scans(bag: Bag, topic: str) -> list[_Scan]:
    """Return the messages of a topic that have points, without repetitions."""
    scans: list[_Scan] = []
    before = b""
    for number, message in enumerate(bag.messages([topic])):
        data = bytes(message.body.data)
        if data and data != before:
            scans.append(_parse(message, f"{bag.source}: message {number} of {topic}"))
            before = data
    return [scan for scan in scans if len(scan.points)]


def _parse(message: Message, where: str) -> _Scan:
    """Return the points of a message, whose rows may be padded."""
    body = message.body
    dtype, data, width = _row_type(body, where), np.asarray(body.data, np.uint8), int(body.width)
    if body.height > 1 and body.row_step < width * dtype.itemsize:
        raise InputError(f"{where}: a row of {width} points does not fit into {body.row_step} bytes. Record it anew.")
    lines = [np.frombuffer(data, dtype, width, row * int(body.row_step)) for row in range(int(body.height))]
    rows = np.concatenate([np.empty(0, dtype), *lines])
    names = list(dtype.names or ())
    axes = axes_of(names, where)
    points = np.column_stack([rows[name] for name in axes])
    fields = {name: rows[name].copy() for name in names if name not in axes}
    return _Scan(frame_name(body.header.frame_id), seconds(body.header.stamp, message.received), points, fields)


def _row_type(body: Any, where: str) -> np.dtype[np.void]:
    """Return the type of a point; between the fields there may be padding."""
    order = ">" if body.is_bigendian else "<"
    names, formats, offsets = [], [], []
    for field in body.fields:
        count = max(1, int(field.count))  # old drivers write 0
        names.append(str(field.name))
        formats.append((order + TYPES[field.datatype], (count,) if count > 1 else ()))
        offsets.append(int(field.offset))
    refuse_doubles(names, where)
    return np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": int(body.point_step)})


def _poses(bag: Bag, scans: list[_Scan], named: str | None) -> Rigid | None:
    """Return the poses of the messages' frames in that of the map; None where they are in it, or there is but one."""
    frames = {scan.frame for scan in scans}
    fixed = frame_name(named or FIXED)
    if frames == {fixed} or (len(scans) == 1 and named is None):
        return None
    tree = FrameTree()
    tree.add_messages(bag.messages(bag.of_type(*TF_TYPES)))
    m = len(scans)
    found = Rigid(np.zeros((m, 3)), np.tile([0.0, 0.0, 0.0, 1.0], (m, 1)), np.ones(m, bool))
    for frame in frames - {fixed}:
        rows = np.array([row for row, scan in enumerate(scans) if scan.frame == frame])
        poses = tree.poses(fixed, frame, np.array([scans[row].time for row in rows]))
        if poses is None:
            tops = ", ".join([*tree.roots_above(frame), frame])
            raise InputError(
                f"{bag.source}: {m} clouds in frame {frame}, and tf does not lead there from {fixed}. Choose the frame "
                f"of the map by --set cloud.frame=NAME, one of: {tops}; {frame} takes the clouds as they are."
            )
        found.shift[rows], found.turn[rows], found.known[rows] = poses
    return found


def _placed(points: Array, poses: Rigid | None, row: int, unit: float) -> NDArray[Any]:
    """Return points (n, 3), in units of this many metres, in the frame of the map; tf is in metres."""
    if poses is None:
        return points
    wide = points.astype(np.float64)
    moved: NDArray[np.float64] = turned(np.tile(poses.turn[row], (len(wide), 1)), wide) + poses.shift[row] / unit
    return moved
