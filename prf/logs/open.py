"""Reading a log of any format: one entry for every command."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

from prf.logs.bag_readings import read_bag
from prf.logs.carmen import read_carmen
from prf.logs.carmen_sonar import SONAR, read_carmen_sonar
from prf.logs.compressed import BYTE_ORDER_MARK, decompress
from prf.logs.player_readings import read_player
from prf.logs.readings import Kind, NoReadings, OwnPoses, Readings
from prf.logs.recognise import ACCEPTED, recognise
from prf.logs.rings import CONE
from prf.logs.table import read_table
from prf.shell.bag import bag_in, bag_suffix, named_bag
from prf.shell.errors import ConfigError
from prf.shell.files import STREAM, open_input

HEAD = 64
"""Bytes that tell a bag."""


class _Choice(NamedTuple):
    """Which readings of a log are asked for."""

    kind: Kind | None
    topic: str | None
    frame: str | None
    cone: float


def read_readings(
    path: str,
    kind: Kind | None = "laser",
    *,
    topic: str | None = None,
    frame: str | None = None,
    cone: float = CONE,
) -> Readings:
    """Read the readings of one kind of sensor from a log; the format is recognised from the content.

    Parameters
    ----------
    path : str
        A CARMEN or Player log or a table, gzipped or not, or a ROS bag, whatever its name; ``-`` is standard input. A
        ROS 2 bag may be its folder or one file.
    kind : {"laser", "sonar"} or None
        Which readings to take; None: laser if there are any, else sonar. Rows of a table are laser's if their cone is
        0, sonar's if not; a table with rows of one sort only is taken as it is.
    topic : str, optional
        Whose readings: a topic of a bag, a device of a Player log (``laser:1``), a kind of line of a CARMEN log
        (``RLASER``). Needed for a bag with several laser topics.
    frame : str, optional
        In what frame: one of a bag's frames or an odometry topic (default ``map``), the position device of a Player log
        (``position2d:1``), the kind of line that gives the robot's pose at CARMEN sonar readings (``ODOM``).
    cone : float, optional
        Full opening angle in radians of sonar readings whose log has none.

    Returns
    -------
    Readings
        All beams, in the order of the file.

    Raises
    ------
    InputError
        If the file is missing, damaged, of another format, or has no readings of this kind.
    ConfigError
        If `topic` or `frame` is needed and missing, or is not in the log.
    """
    choice = _Choice(kind, topic, frame, cone)
    source = "standard input" if path == STREAM else path
    if path != STREAM and Path(path).is_dir():
        bag = bag_in(Path(path), ACCEPTED)
        return _read_bag_file(bag, "" if bag.is_dir() else bag.suffix, source, choice)
    with open_input(path) as stream:
        head = stream.read(HEAD)
        if path != STREAM and bag_suffix(head):
            return _read_bag_file(Path(path), bag_suffix(head), source, choice)
        data = decompress(head + stream.read(), source)
    if bag_suffix(data[:HEAD]):
        with TemporaryDirectory() as folder:
            copy = Path(folder) / "log"
            copy.write_bytes(data)
            return _read_bag_file(copy, bag_suffix(data[:HEAD]), source, choice)
    return _read_text(data.removeprefix(BYTE_ORDER_MARK), source, choice)


def _read_text(data: bytes, source: str, choice: _Choice) -> Readings:
    match recognise(data, source):
        case "table":
            return _read_table(data, source, choice)
        case "player":
            return read_player(data, source, choice.kind, choice.cone, choice.topic, choice.frame)
        case "carmen":
            return _read_carmen(data, source, choice)


def _read_table(data: bytes, source: str, choice: _Choice) -> Readings:
    for flag, value in (("--topic", choice.topic), ("--frame", choice.frame)):
        if value is not None:
            raise ConfigError(f"{flag} {value}: {source} is a table, which has one sensor and one frame. Leave it out.")
    return read_table(data, source, choice.kind, choice.cone)


def _read_carmen(data: bytes, source: str, choice: _Choice) -> Readings:
    if choice.kind != "sonar":
        try:
            readings = read_carmen(data, source, choice.topic)
            if choice.frame is not None:
                raise OwnPoses(
                    f"--frame {choice.frame}: laser lines of {source} carry the laser's pose; a frame can be chosen "
                    f"for SONAR lines alone. Leave it out."
                )
            return readings
        except NoReadings as error:
            if choice.kind == "laser":
                raise
            without_laser = error
    try:
        readings = read_carmen_sonar(data, source, choice.cone, choice.frame)
    except NoReadings:
        if choice.kind is None:
            raise without_laser from None
        raise
    if choice.topic not in (None, SONAR):
        raise ConfigError(
            f"--topic {choice.topic}: the sonar readings of {source} are its {SONAR} lines. Leave it out."
        )
    return readings


def _read_bag_file(file: Path, suffix: str, source: str, choice: _Choice) -> Readings:
    """Read a bag under a name that tells its format; `suffix` is empty for a folder."""
    with named_bag(file, suffix) as path:
        return read_bag(path, source, choice.kind, choice.cone, choice.topic, choice.frame)
