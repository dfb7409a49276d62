"""Reading a log of any format: one entry for every command; the format is recognised from the content alone."""

from __future__ import annotations

import io
import logging
import re
from collections.abc import Iterator, Sequence
from itertools import islice
from pathlib import Path
from tempfile import NamedTemporaryFile
from typing import Literal

from prf.model.sensors import CONE
from prf.readings.bag import read_bag
from prf.readings.carmen import KNOWN_KINDS, read_carmen
from prf.readings.directions import usual_angles
from prf.readings.matrix import FEWEST, has_directions, header_names, looks_like_matrix, ranges_of, read_matrix
from prf.readings.player import read_player
from prf.readings.poses import GivenPoses, placed
from prf.readings.readings import Kind, OwnPoses, Readings
from prf.readings.several import join_logs, warn_of_frames
from prf.readings.table import REQUIRED, read_table
from prf.readings.text import BYTE_ORDER_MARK, column_names, content_lines, decompress
from prf.readings.units import in_metres
from prf.shell.cli.files import STREAM, open_input
from prf.shell.errors import ConfigError, InputError
from prf.shell.poses.bag import HEAD, bag_in, bag_suffix
from prf.shell.poses.files import slam_state

Format = Literal["carmen", "player", "table", "ranges"]

logger = logging.getLogger(__name__)

ACCEPTED = (
    "Accepted are CARMEN logs with laser poses, Player logs, ROS bags, CSV tables with the columns "
    "x,y,theta,range, and ranges a row a scan with --beam-angles and --poses; also gzipped."
)

MOST_SHOWN = 40
"""Characters of a line that a message shows."""
LINES_TRIED = 2000
"""A text log may begin with hundreds of lines that an older tool wrote; a known first field is among these."""

CLOUDS = ((b"ply", "PLY"), (b"# .PCD", "PCD"), (b"VERSION .7", "PCD"), (b"LASF", "LAS"), (b"ASTM-E57", "E57"))

MAGICS = (
    (b"#ROSBAG", "a ROS 1 bag of an old version, which rosbag fix can convert"),
    (b"#ROSRECORD", "a ROS 1 bag of a version before 1.3, which rosbag fix can convert"),
    (b"\x1f\x8b", "a file that was gzipped twice"),
    (b"\x28\xb5\x2f\xfd", "a zstd archive"),
    (b"PK\x03\x04", "a zip archive"),
    (b"\x89PNG", "a PNG picture"),
    (b"P5", "a PGM picture"),
    *((magic, f"a 3D point cloud ({name}), which mapq takes: mapq classify FILE") for magic, name in CLOUDS),
    (b"{", "a JSON document"),
)

SUFFIXES = (".bag", ".mcap", ".db3", ".csv", ".txt", ".log", ".clf", ".npy", ".npz", ".mat", ".gz")
"""Ends of the names of logs; several may follow one another."""

_PLAYER = re.compile(rb"^## Player version|^\d+\.\d+ \S+ \d+ (laser|sonar|position(2d)?) \d+", re.MULTILINE)
_ODOMETRY = re.compile(rb"^Odometry\s+[-+\d.e]+\s+[-+\d.e]+\s+[-+\d.e]+\s*$", re.MULTILINE)
_CARMEN_HEADER = re.compile(rb"^#+\s*message formats defined:", re.MULTILINE)


def log_stem(log: str) -> str:
    """Return the name of a log without the part that names its format; empty for standard input."""
    name = "" if log == STREAM else Path(log).name or Path(log).resolve().name
    while Path(name).suffix.lower() in SUFFIXES:
        name = Path(name).stem
    return name


def read_readings(
    path: str,
    kind: Kind | None = "laser",
    *,
    topic: str | None = None,
    frame: str | None = None,
    cone: float = CONE,
    poses: GivenPoses | None = None,
    odometry: bool = False,
    beam_angles: str | None = None,
) -> Readings:
    """Read the readings of one kind of sensor from a log; the format is recognised from the content.

    `path`: a CARMEN or Player log or a table, gzipped or not, or a ROS bag, whatever its name; ``-`` is standard input.
    A ROS 2 bag may be its folder or one file. `kind`: which readings to take; None: laser if there are any, else sonar.
    Rows of a table are laser's if their cone is 0, sonar's if not; a table with rows of one sort only is taken as it
    is. `topic`: whose readings: a topic of a bag, a device of a Player log (``laser:1``), a kind of line of a CARMEN
    log (``RLASER``). Needed for a bag with several laser topics. `frame`: in what frame: one of a bag's frames or an
    odometry topic (default ``map``), the position device of a Player log (``position2d:1``), the kind of CARMEN line
    that gives the robot's pose (``ODOM``). `cone`: full opening angle in radians of sonar readings
    whose log has none. `poses`: of a file, instead of the log's; then `frame` names the frame of a bag that they are
    of. `odometry`: whether the poses may be raw odometry: logs are then read that have nothing else, and `frame`
    counts for CARMEN's laser lines too. `beam_angles`: directions of the columns of ranges alone, FIRST:STEP:LAST in
    degrees; such ranges are taken for centimetres or millimetres where they are surely that
    (:mod:`prf.readings.units`). Returns: all beams, in the order of the file.
    """
    on_robot = poses is not None
    found = _read(path, kind, topic, frame, cone, on_robot, odometry, beam_angles)
    if poses is None:
        return found
    found = placed(found, poses)
    return in_metres(found) if found.notes.format == "ranges" else found


def _read(
    path: str,
    kind: Kind | None,
    topic: str | None,
    frame: str | None,
    cone: float,
    on_robot: bool,
    odometry: bool,
    beam_angles: str | None,
) -> Readings:
    source = "standard input" if path == STREAM else path
    place = Path(path)
    if path != STREAM and place.is_dir():
        return read_bag(bag_in(place, ACCEPTED), source, kind, cone, topic, frame, on_robot)
    with open_input(path) as stream:
        head = stream.read(HEAD)
        if path != STREAM and bag_suffix(head):
            return read_bag(place, source, kind, cone, topic, frame, on_robot)
        data = decompress(head + stream.read(), source)
    if bag_suffix(data[:HEAD]):
        with NamedTemporaryFile() as copy:
            copy.write(data)
            copy.flush()
            return read_bag(Path(copy.name), source, kind, cone, topic, frame, on_robot)
    data = data.removeprefix(BYTE_ORDER_MARK)
    found = recognise(data, source, on_robot or odometry, beam_angles)
    if on_robot and frame is not None:
        raise ConfigError(
            f"--frame {frame}: with --poses it names a frame of a bag, which {source} is not. Leave it out."
        )
    if found == "player":
        return read_player(data, source, kind, cone, topic, frame, on_robot)
    if found == "carmen":
        return read_carmen(data, source, kind, cone, topic, frame, on_robot, odometry)
    for flag, value in (("--topic", topic), ("--frame", frame)):
        if value is not None:
            raise ConfigError(f"{flag} {value}: {source} is a table, which has one sensor and one frame. Leave it out.")
    if found == "ranges":
        return read_matrix(data, source, beam_angles)
    return read_table(data, source, kind, cone, on_robot)


def read_logs(
    laser: Sequence[str],
    sonar: Sequence[str],
    *,
    topic: str | None = None,
    frame: str | None = None,
    sonar_topic: str | None = None,
    cone: float = CONE,
    poses: Sequence[GivenPoses] = (),
    odometry: bool = False,
    beam_angles: str | None = None,
) -> tuple[Readings | None, Readings | None]:
    """Read the logs of a laser, of a sonar or of both, in one frame; None for a sensor without log.

    `laser`, `sonar`: logs, which may be the same files; several are joined (:func:`prf.readings.several.join_logs`).
    `topic`, `sonar_topic`: whose readings to take of each, see :func:`read_readings`. `frame`: in what frame, for both;
    laser lines of CARMEN carry their poses, so there it is for the sonar alone, but with `odometry`. `cone`: full
    opening angle in radians of sonar readings whose log has none. `poses`: of a file for all logs, or of one for each,
    instead of those of the logs. `odometry`, `beam_angles` (of the laser): as there. What a person must know of poses
    is logged.
    """
    if topic is not None and not laser:
        raise ConfigError(
            f"--topic {topic}: names readings of --laser, which is not given. For a sonar: --set "
            "readings.sonar_topic=NAME."
        )
    if sonar_topic is not None and not sonar:
        raise ConfigError(f"readings.sonar_topic {sonar_topic}: names readings of --sonar, which is not given.")
    own_poses = (_poses_of_each(laser, "--laser", poses), _poses_of_each(sonar, "--sonar", poses))
    if poses and not laser and not sonar:
        raise ConfigError(f"--poses {poses[0].source}: is for scans of --laser or --sonar, which is not given.")
    beams = [
        _read_laser(log, topic, frame, given, odometry, beam_angles, bool(sonar))
        for log, given in zip(laser, own_poses[0], strict=True)
    ]
    cones = [
        read_readings(log, "sonar", topic=sonar_topic, frame=frame, cone=cone, poses=given, odometry=odometry)
        for log, given in zip(sonar, own_poses[1], strict=True)
    ]
    for found in (*beams, *cones):
        if poses:
            logger.info(f"{found.source}: poses of {found.notes.poses}")
        if found.notes.range_unit:
            logger.info(f"{found.source}: ranges {found.notes.range_unit}")
        for warning in found.notes.warnings:
            logger.warning(f"{found.source}: {warning}")
    warn_of_frames(beams)
    return join_logs(beams) if beams else None, join_logs(cones) if cones else None


def _poses_of_each(logs: Sequence[str], flag: str, poses: Sequence[GivenPoses]) -> Sequence[GivenPoses | None]:
    """Return the poses of each log of a kind: those of one file for all, of a file each, or None."""
    if len(poses) > 1 and logs and len(poses) != len(logs):
        raise ConfigError(
            f"--poses: {len(poses)} files for {len(logs)} logs of {flag}. Give one for all, or one for each in order."
        )
    return poses if len(poses) > 1 and logs else [*poses, None][:1] * len(logs)


def _read_laser(
    log: str,
    topic: str | None,
    frame: str | None,
    poses: GivenPoses | None,
    odometry: bool,
    beam_angles: str | None,
    has_sonar: bool,
) -> Readings:
    """Read a laser's log; a frame that it cannot have is the sonar's."""
    try:
        return read_readings(log, topic=topic, frame=frame, poses=poses, odometry=odometry, beam_angles=beam_angles)
    except OwnPoses:
        if not has_sonar:
            raise
        return read_readings(log, topic=topic, poses=poses, odometry=odometry)


def recognise(data: bytes, source: str, raw: bool = False, beam_angles: str | None = None) -> Format:
    """Return the format of decompressed content other than a bag (InputError with what it looks like if unknown).

    `raw`: whether logs are taken that have no poses, or raw odometry. `beam_angles`: directions of ranges alone.
    """
    head = _head(data)
    if beam_angles is None and has_directions(data, source):
        if raw:
            return "ranges"
        raise InputError(f"{source}: ranges without poses. Give them with --poses FILE; prf info FILE says more.")
    if beam_angles is not None and looks_like_matrix(data, fewest=1):
        if raw:
            return "ranges"
        raise ConfigError(f"--beam-angles {beam_angles}: ranges alone have no poses. Give them with --poses FILE.")
    found = _recognised(data, head, source, raw)
    if beam_angles is not None:
        raise ConfigError(
            f"--beam-angles {beam_angles}: the beams of {source} have directions of their own. Leave it out."
        )
    return found


def _recognised(data: bytes, head: bytes, source: str, raw: bool) -> Format:
    if not data.strip():
        looks_like = "the file is empty"
    elif (state := slam_state(data)) is not None:
        raise InputError(f"{source}: {state}.")
    elif looks_like_matrix(data):
        looks_like = _matrix_of(data, source)
    elif names := [name for magic, name in MAGICS if data.startswith(magic)]:
        looks_like = f"this is {names[0]}"
    elif b"\0" in data:
        looks_like = "this is binary data of an unknown kind"
    elif _is_table(head):
        return "table"
    elif _PLAYER.search(head):
        return "player"
    elif _is_carmen(head) or (raw and _ODOMETRY.search(head)):
        return "carmen"
    else:
        looks_like = _text_of(head)
    raise InputError(f"{source}: {looks_like}. {ACCEPTED}")


def _head(data: bytes) -> bytes:
    """Return the first `LINES_TRIED` lines."""
    return b"".join(islice(io.BytesIO(data), LINES_TRIED))


def _content(head: bytes) -> Iterator[bytes]:
    return (line for line in head.splitlines() if line.strip() and not line.lstrip().startswith(b"#"))


def _is_table(head: bytes) -> bool:
    names = column_names(next(_content(head), b""))
    return sum(name in names for name in REQUIRED) >= 2


def _is_carmen(head: bytes) -> bool:
    if _CARMEN_HEADER.search(head):
        return True
    return any(line.split(None, 1)[0].decode("latin-1") in KNOWN_KINDS for line in _content(head))


def _matrix_of(data: bytes, source: str) -> str:
    """Return what is missing to ranges alone."""
    n, width = ranges_of(data, source).ranges.shape
    return (
        f"this is numbers alone, {width} a row. If these are the ranges of {n:,} scans, say where the beams point, "
        f"--beam-angles FIRST:STEP:LAST in degrees ({usual_angles(width)} if they see half a turn), and give --poses "
        "FILE; prf info with all your files says more"
    )


def _text_of(head: bytes) -> str:
    """Return what unreadable text looks like."""
    if _ODOMETRY.search(head):
        return (
            "this is an unlocalized log: its scans come with odometry, not with corrected sensor poses. "
            "Sample them too (prf sample --odometry wheels), or localize it first and give the trajectory with --poses"
        )
    first = next(_content(head), b"").decode("latin-1").lower()
    if set(REQUIRED) <= set(re.split(r"[;\s|]+", first)):
        return "this is a table whose columns are not separated by commas"
    if re.fullmatch(r"[-+\d.e\s]+(,[-+\d.e\s]*)+", first):
        return "this is a CSV table without a header line"
    return f"this is text of an unknown format{_first_lines(head)}"


def _first_lines(head: bytes) -> str:
    """Return what its first lines are, as far as that helps."""
    first, second = (list(islice(content_lines(head), 2)) + [(0, b"")] * 2)[:2]
    names, numbers = header_names(first[1]), re.split(rb"[\s,;]+", second[1].strip(b" \t\r,;"))
    start = first[1].decode("utf-8", "replace").strip()
    words = f": line {first[0]} begins {start[:MOST_SHOWN]!r}"
    if re.fullmatch(rb"[-+\d.eEnaif\s,;]+", second[1]) and len(numbers) >= FEWEST != len(names):
        words += f" and has {len(names)} fields, line {second[0]} has {len(numbers)} numbers"
    return words
