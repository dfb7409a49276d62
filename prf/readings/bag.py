"""From a bag to `Readings`: ``LaserScan`` and ``Range`` messages, placed in the world by tf.

The pose of a sensor is that of its frame in the fixed frame, ``map`` unless another is named, at the time stamp of the
message: transforms are interpolated in time and multiplied along the tree (such as map, odom, base_link, laser), in
three dimensions, so that a scanner mounted upside down is right. The fixed frame may also be a topic of poses of the
robot: odometry such as a simulator's true pose, or PoseStamped and PoseWithCovarianceStamped such as a localizer's.
Without a frame map the best of these is taken, odometry last, with a warning: it drifts. Where a transform is missing,
before the localizer has begun for instance, the scan is dropped and counted.

Ranges follow REP 117 and the message definitions: nan and whatever lies below range_min are error codes (a Hokuyo
writes 0.006 or 0.019) and dropped; at or above range_max, and inf, is no return. One pose holds for a whole scan.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from prf.readings.readings import Kind, LogNotes, NoReadings, Readings, Scan, assemble, spread
from prf.readings.text import FloatArray
from prf.shell.errors import ConfigError, InputError
from prf.shell.poses.bag import Bag, Message, open_bag, seconds
from prf.shell.poses.tf import FrameTree, Rigid, frame_name, turned

FIXED = "map"

TYPES: dict[Kind, str] = {"laser": "sensor_msgs/msg/LaserScan", "sonar": "sensor_msgs/msg/Range"}
TF_TYPES = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
ODOMETRY = "nav_msgs/msg/Odometry"
POSES = (ODOMETRY, "geometry_msgs/msg/PoseWithCovarianceStamped", "geometry_msgs/msg/PoseStamped")
TRUTH = "truth"  # in the name of a topic of odometry that is a simulator's true pose
NO_POSES = ("goal", "initialpose", "target", "setpoint")  # in names of topics of places where a robot should be
BASES = ("base_link", "base_footprint")  # ends of the names of the frame that programs call the robot
WORLDS = ("map", "odom", "world", "earth")

TILT = np.sin(np.radians(5.0))  # sine of the tilt from which on a remark is due

INFRARED = 1  # radiation type of a Range message that is not sound


class _Raw(NamedTuple):
    """A message before it is placed: `bearing` in the sensor's frame; `no_return` if a finite range means it."""

    topic: str
    frame: str
    time: float
    bearing: FloatArray
    ranges: FloatArray
    cone: float
    top: float
    no_return: bool


def read_bag(
    path: Path,
    source: str,
    kind: Kind | None,
    cone: float,
    topic: str | None = None,
    frame: str | None = None,
    on_robot: bool = False,
) -> Readings:
    """Read the readings of a bag: a .bag, .mcap or .db3 file, or the folder of a ROS 2 bag.

    Parameters as of :func:`prf.readings.read_readings`. `topic` may be several with commas; default the only LaserScan
    topic, or all Range topics, since each transducer of a ring usually has its own. `on_robot`: see
    :mod:`prf.readings.poses`; then `frame` is the one that the poses are of, default the robot's.
    """
    with open_bag(path, source) as bag:
        kind, topics = _topics(bag, kind, topic)
        raws = [_raw(kind, message, source, cone) for message in bag.messages(topics)]
        raws = [raw for raw in raws if len(raw.ranges)]
        if not raws:
            raise NoReadings(f"{source}: the messages of {', '.join(topics)} are empty.")
        tree = FrameTree()
        tree.add_messages(bag.messages(bag.of_type(*TF_TYPES)))
        sensor, warning = raws[0].frame, ""
        if on_robot:
            fixed = _robot_frame(tree, sensor, frame, source)
        elif frame is not None:
            fixed = frame if frame in bag.types else frame_name(frame)
        else:
            fixed, warning = _best_frame(tree, bag, sensor)
        if not on_robot and bag.types.get(fixed) in POSES:
            _add_poses(tree, bag, fixed, sensor)
        scans, remarks = _place(raws, tree, bag, fixed)
        remarks += _infrared(bag, kind, topics)
        notes = LogNotes(
            format=bag.format,
            sensor_max=max((raw.top for raw in raws if raw.no_return), default=np.nan),
            poses=fixed if on_robot else f"{_how(fixed, bag)}, interpolated in time",
            lines={name: count for name, count in bag.counts.items() if name not in topics},
            remarks=tuple(remarks),
            warnings=(warning,) if warning else (),
        )
    return assemble(scans, source, notes)


def _topics(bag: Bag, kind: Kind | None, topic: str | None) -> tuple[Kind, list[str]]:
    """Return the kind and the topics to read."""
    found = {name: bag.of_type(message_type) for name, message_type in TYPES.items()}
    if topic is not None:
        return _named_topics(bag, found, kind, topic)
    if kind is None:
        kind = "laser" if found["laser"] or not found["sonar"] else "sonar"
    topics = found[kind]
    if not topics:
        clouds = " Its clouds are for mapq." if "(PointCloud2)" in bag.contents else ""
        raise NoReadings(f"{bag.source}: no {TYPES[kind]} messages. The bag has {bag.contents}.{clouds}")
    if kind == "laser" and len(topics) > 1:
        raise ConfigError(f"{bag.source}: several laser topics, {', '.join(topics)}. Choose one with --topic.")
    return kind, topics


def _named_topics(bag: Bag, found: dict[Kind, list[str]], kind: Kind | None, topic: str) -> tuple[Kind, list[str]]:
    names = [name for name in topic.split(",") if name]
    kinds: list[Kind] = [kind] if kind is not None else ["laser", "sonar"]
    for candidate in kinds:
        # ROS itself takes a name without the slash for the same topic.
        topics = [name if name in found[candidate] else f"/{name}" for name in names]
        if topics and all(name in found[candidate] for name in topics):
            return candidate, topics
    fitting = ", ".join(name for candidate in kinds for name in found[candidate])
    has = f"has {fitting}" if fitting else f"has {bag.contents}, none of them {kind or 'laser or sonar'}"
    raise ConfigError(f"--topic {topic}: {bag.source} {has}.")


def _raw(kind: Kind, message: Message, source: str, cone: float) -> _Raw:
    """Return a message's ranges by REP 117: nan for error codes, inf for no return."""
    body, header = message.body, message.body.header
    time = seconds(header.stamp, message.received)
    if kind == "laser":
        start, step, low, top, opening = body.angle_min, body.angle_increment, body.range_min, body.range_max, 0.0
        with np.errstate(invalid="ignore"):  # of signalling nan
            ranges = np.asarray(body.ranges, dtype=np.float64)
    else:
        start, step, low, top, ranges = 0.0, 1.0, body.min_range, body.max_range, np.array([body.range], np.float64)
        opening = body.field_of_view if 0 < body.field_of_view <= 2 * np.pi else cone
    try:
        bearing = spread(start, step, len(ranges))
    except ValueError as error:
        raise InputError(f"{source}: {message.topic} at {time:.3f} s: {error}. Leave this topic out.") from error
    if not (np.isfinite(top) and top > max(low, 0.0)):
        top = np.inf
    too_far, bad = ranges >= top, ~(ranges >= max(low, 0.0))
    has_number = bool((too_far & np.isfinite(ranges)).any())
    ranges = np.where(bad, np.nan, np.where(too_far, np.inf, ranges))
    return _Raw(message.topic, frame_name(header.frame_id), time, bearing, ranges, opening, top, has_number)


def _best_frame(tree: FrameTree, bag: Bag, sensor: str) -> tuple[str, str]:
    """Return the fixed frame or the topic of poses to take unasked, and what to warn of; the best if there are more."""
    if tree.chain(FIXED, sensor) is not None:
        return FIXED, ""
    held = tree.rigid_above(sensor)
    found = [(2 + ("odom" in root), root) for root in tree.roots_above(sensor) if root in WORLDS or root not in held]
    for topic in bag.of_type(*POSES):
        if not any(word in topic for word in NO_POSES):
            parent = frame_name(next(bag.messages([topic])).body.header.frame_id)
            is_odometry = bag.types[topic] == ODOMETRY or "odom" in parent
            found.append((0 if parent == FIXED else 1 if TRUTH in topic else 4 if is_odometry else 1, topic))
    if not found:
        return FIXED, ""
    (rank, best), *others = sorted(found)
    warning = f"tf has no frame {FIXED!r}: poses are those of {best!r}"
    if rank > 2:
        warning += ", odometry, which drifts: localize the log and give its trajectory with --poses"
    return best, warning + (f"; --frame can choose {', '.join(name for _, name in others)}" if others else "")


def _robot_frame(tree: FrameTree, sensor: str, frame: str | None, source: str) -> str:
    """Return the frame that poses of a file are of: as asked, else the robot's that carries the sensor."""
    held = tree.rigid_above(sensor)
    if frame is None:
        bases = [name for base in BASES for name in held if name.endswith(base)]
        return [sensor, *(name for name in held if name not in WORLDS), *bases[:1]][-1]
    name = frame_name(frame)
    if not tree.is_rigid(name, sensor):
        raise ConfigError(
            f"--frame {frame}: with --poses it names the frame of the poses, which must be fixed to the sensor; "
            f"{source} has {', '.join(held)}."
        )
    return name


def _add_poses(tree: FrameTree, bag: Bag, topic: str, sensor: str) -> None:
    """Hang the frame whose pose messages give below a frame of the topic's name: the robot's, unless they name it."""
    child = ""
    for message in bag.messages([topic]):
        body = message.body
        pose = getattr(body.pose, "pose", body.pose)
        child = child or frame_name(getattr(body, "child_frame_id", ""))
        if not child and bag.types[topic] == ODOMETRY:
            child = _moving_frame(tree, frame_name(body.header.frame_id), sensor)
        child = child or _robot_frame(tree, sensor, None, bag.source)
        time = seconds(body.header.stamp, message.received)
        tree.add(topic, child, time, (pose.position, pose.orientation), is_static=False)


def _moving_frame(tree: FrameTree, parent: str, sensor: str) -> str:
    """Return the frame that odometry without a child frame (Stage's) means: the next after `parent` to the sensor."""
    steps = tree.chain(parent, sensor)
    return steps[0][1] if steps else ""


def _place(raws: list[_Raw], tree: FrameTree, bag: Bag, fixed: str) -> tuple[list[Scan], list[str]]:
    """Return the scans whose pose is known, in the order of the messages, and remarks."""
    scans: list[Scan | None] = [None] * len(raws)
    several_frames = len({raw.frame for raw in raws}) > len({raw.topic for raw in raws})
    tilt = 0.0
    for frame in dict.fromkeys(raw.frame for raw in raws):
        rows = [i for i, raw in enumerate(raws) if raw.frame == frame]
        poses = tree.poses(fixed, frame, np.array([raws[i].time for i in rows]))
        if poses is None:
            raise InputError(_unfixed(tree, bag, fixed, frame))
        ahead, aside = turned(poses.turn, np.array([1.0, 0.0, 0.0])), turned(poses.turn, np.array([0.0, 1.0, 0.0]))
        tilt = max(tilt, float(np.abs(ahead[:, 2]).max()), float(np.abs(aside[:, 2]).max()))
        for row, i in enumerate(rows):
            if poses.known[row]:
                device = f"{raws[i].topic} {frame}" if several_frames else raws[i].topic
                scans[i] = _scan(raws[i], device, i, poses, row, ahead[row], aside[row])
    placed = [scan for scan in scans if scan is not None]
    if not placed:
        raise InputError(f"{bag.source}: no message of the sensor lies within the time of the transforms from {fixed}.")
    remarks = []
    if len(placed) < len(raws):
        missing = len(raws) - len(placed)
        remarks.append(f"{missing} of {len(raws)} scans lie outside the time of the transforms from {fixed}: dropped")
    if tilt > TILT:
        remarks.append(
            f"the sensor is tilted by up to {np.degrees(np.arcsin(min(tilt, 1.0))):.0f} degrees: projected to the plane"
        )
    return placed, remarks


def _scan(raw: _Raw, device: str, number: int, poses: Rigid, row: int, ahead: FloatArray, aside: FloatArray) -> Scan:
    cosine, sine = np.cos(raw.bearing), np.sin(raw.bearing)
    angle = np.arctan2(cosine * ahead[1] + sine * aside[1], cosine * ahead[0] + sine * aside[0])
    where = poses.shift[row, :2]
    pose = np.array([where[0], where[1], np.arctan2(ahead[1], ahead[0])])
    return Scan(device, number + 1, raw.time, pose, where, angle, raw.ranges, raw.cone)


def _unfixed(tree: FrameTree, bag: Bag, fixed: str, sensor: str) -> str:
    """Return why the sensor has no pose, and what could be chosen."""
    roots, topics = tree.roots_above(sensor), bag.of_type(*POSES)
    has = f"tf leads from {sensor!r} up to {', '.join(map(repr, roots))}" if roots else f"tf has no {sensor!r}"
    with_poses = f", topics of poses are {', '.join(topics)}" if topics else ""
    advice = "Record /tf and /tf_static too, give a trajectory with --poses, or leave --frame out if it was given."
    return f"{bag.source}: no transforms lead from the fixed frame {fixed!r} to the sensor: {has}{with_poses}. {advice}"


def _infrared(bag: Bag, kind: Kind, topics: list[str]) -> list[str]:
    if kind == "laser":
        return []
    lit = sorted({message.topic for message in bag.messages(topics) if message.body.radiation_type == INFRARED})
    return [f"{', '.join(lit)}: infrared, not sound; leave it out with --topic"] if lit else []


def _how(fixed: str, bag: Bag) -> str:
    return f"messages of {fixed}" if fixed in bag.types else f"tf from {fixed}"
