"""Small ROS bags, written for a test: a sensor on a robot that drives along x and turns."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

TYPES1 = get_typestore(Stores.ROS1_NOETIC)
TYPES1.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", "tf2_msgs/msg/TFMessage"))
TYPES2 = get_typestore(Stores.ROS2_HUMBLE)
KINDS = ("ros1", "sqlite3", "mcap")
START = 1000.0

LEVEL = (0.0, 0.0, 0.0, 1.0)
UPSIDE_DOWN = (1.0, 0.0, 0.0, 0.0)


class Note(NamedTuple):
    """A message to be written; `caller` tells publishers of one topic apart."""

    topic: str
    time: float
    body: Any
    caller: str = "/node"


def yaw(angle: float) -> tuple[float, float, float, float]:
    return (0.0, 0.0, float(np.sin(angle / 2)), float(np.cos(angle / 2)))


class Maker:
    """Makes messages of one of the `KINDS` of bag."""

    def __init__(self, kind: str) -> None:
        self.kind = kind
        self.store = TYPES1 if kind == "ros1" else TYPES2

    def _new(self, name: str, *values: Any) -> Any:
        return self.store.types[name](*values)

    def header(self, time: float, frame: str) -> Any:
        stamp = self._new("builtin_interfaces/msg/Time", int(time), round((time - int(time)) * 1e9))
        sequence = (0,) if self.kind == "ros1" else ()
        return self._new("std_msgs/msg/Header", *sequence, stamp, frame)

    def scan(self, time: float, ranges: Sequence[float], frame: str = "laser", **fields: float) -> Any:
        given = {"angle_min": -0.5, "angle_increment": 0.5, "range_min": 0.1, "range_max": 8.0, **fields}
        low, step = given["angle_min"], given["angle_increment"]
        return self._new(
            "sensor_msgs/msg/LaserScan",
            self.header(time, frame),
            low,
            low + step * (len(ranges) - 1),
            step,
            0.0,
            0.1,
            given["range_min"],
            given["range_max"],
            np.array(ranges, dtype=np.float32),
            np.zeros(0, dtype=np.float32),
        )

    def range(self, time: float, distance: float, frame: str, view: float = 0.3, radiation: int = 0) -> Any:
        return self._new("sensor_msgs/msg/Range", self.header(time, frame), radiation, view, 0.1, 4.0, float(distance))

    def tf(self, time: float, parent: str, child: str, shift: Sequence[float], turn: Sequence[float] = LEVEL) -> Any:
        transform = self._new(
            "geometry_msgs/msg/Transform",
            self._new("geometry_msgs/msg/Vector3", *map(float, shift)),
            self._new("geometry_msgs/msg/Quaternion", *map(float, turn)),
        )
        stamped = self._new("geometry_msgs/msg/TransformStamped", self.header(time, parent), child, transform)
        return self._new("tf2_msgs/msg/TFMessage", [stamped])

    def _pose(self, shift: Sequence[float], turn: Sequence[float]) -> Any:
        return self._new(
            "geometry_msgs/msg/Pose",
            self._new("geometry_msgs/msg/Point", *map(float, shift)),
            self._new("geometry_msgs/msg/Quaternion", *map(float, turn)),
        )

    def pose(self, time: float, shift: Sequence[float], frame: str, turn: Sequence[float] = LEVEL) -> Any:
        return self._new("geometry_msgs/msg/PoseStamped", self.header(time, frame), self._pose(shift, turn))

    def odometry(self, time: float, shift: Sequence[float], turn: Sequence[float] = LEVEL, child: str = "") -> Any:
        zero = self._new("geometry_msgs/msg/Vector3", 0.0, 0.0, 0.0)
        pose = self._pose(shift, turn)
        return self._new(
            "nav_msgs/msg/Odometry",
            self.header(time, "odom"),
            child,
            self._new("geometry_msgs/msg/PoseWithCovariance", pose, np.zeros(36)),
            self._new(
                "geometry_msgs/msg/TwistWithCovariance", self._new("geometry_msgs/msg/Twist", zero, zero), np.zeros(36)
            ),
        )

    def write(self, path: Path, notes: Sequence[Note]) -> Path:
        """Write a bag in the order of the notes and return it."""
        if self.kind == "ros1":
            with Writer1(path) as writer:
                callers: dict[tuple[str, str], Any] = {}
                for note in notes:
                    kind = note.body.__msgtype__
                    key = (note.topic, note.caller)
                    if key not in callers:
                        callers[key] = writer.add_connection(
                            note.topic, kind, typestore=self.store, callerid=note.caller
                        )
                    writer.write(callers[key], round(note.time * 1e9), self.store.serialize_ros1(note.body, kind))
            return path
        storage = StoragePlugin.MCAP if self.kind == "mcap" else StoragePlugin.SQLITE3
        with Writer2(path, version=8, storage_plugin=storage) as writer:
            topics: dict[str, Any] = {}
            for note in notes:
                kind = note.body.__msgtype__
                if note.topic not in topics:
                    topics[note.topic] = writer.add_connection(note.topic, kind, typestore=self.store)
                writer.write(topics[note.topic], round(note.time * 1e9), self.store.serialize_cdr(note.body, kind))
        return path


def scans(
    make: Maker, *times: float, topic: str = "/scan", ranges: Sequence[float] = (1, 2, 3), **fields: float
) -> list[Note]:
    return [Note(topic, START + time, make.scan(START + time, ranges, **fields)) for time in times]


def drive(make: Maker, mount: Sequence[float] = LEVEL, shift: Sequence[float] = (0.2, 0.0, 0.3)) -> list[Note]:
    """Return transforms of 2 s: odom -> base_link runs along x at 1 m/s, map -> odom is (10, 20) turned by a quarter.

    So in the map the base is at (10, 20 + t), heading pi/2; `mount` and `shift` are those of the laser on it. Each
    transform has its own publisher.
    """
    notes = [Note("/tf_static", START, make.tf(START, "base_link", "laser", shift, mount), "/static")]
    for t in (0.0, 1.0, 2.0):
        now = START + t
        notes.append(Note("/tf", now, make.tf(now, "/odom", "/base_link", (t, 0, 0)), "/base"))
        notes.append(Note("/tf", now, make.tf(now, "/map", "/odom", (10, 20, 0), yaw(np.pi / 2)), "/localizer"))
    return notes
