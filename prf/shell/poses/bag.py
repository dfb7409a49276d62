"""ROS 1 and ROS 2 bags: opening one, and its messages with their times.

`rosbags` does the reading. Types are taken from the bag, so custom ones and those of `tf2_msgs` need no ROS; only ROS 2
bags from before Iron carry none, and there the standard types of Humble hold.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, NamedTuple

from prf.shell.errors import InputError, system_reason

if TYPE_CHECKING:
    from rosbags.highlevel import AnyReader


MAGICS = ((b"#ROSBAG V2.0", ".bag"), (b"\x89MCAP", ".mcap"), (b"SQLite format 3\0", ".db3"))
"""How bags begin, and the ends of name under which their reader knows them."""

SUFFIXES = tuple(suffix for _, suffix in MAGICS)

HEAD = 64  # bytes that show a bag

METADATA = "metadata.yaml"  # what makes a folder a ROS 2 bag


class Message(NamedTuple):
    """One message."""

    topic: str
    received: float  # when it was recorded, seconds
    body: Any  # its fields, as `rosbags` makes them


class Bag:
    """An open bag. `reader`: open. `source`: name of the bag, for messages."""

    def __init__(self, reader: AnyReader, source: str) -> None:
        self._reader = reader
        self.source = source
        self.format = "ROS 2 bag" if reader.is2 else "ROS 1 bag"
        self.types: dict[str, str] = {}  # of the messages of each topic, such as ``sensor_msgs/msg/LaserScan``
        self.counts: dict[str, int] = {}  # of these messages
        # Several publishers of one topic, usual for /tf, are several connections.
        for connection in sorted(reader.connections, key=lambda connection: connection.topic):
            name = connection.topic
            self.types[name] = connection.msgtype
            self.counts[name] = self.counts.get(name, 0) + connection.msgcount

    @property
    def contents(self) -> str:
        """Topics and their types, for messages."""
        return ", ".join(f"{name} ({kind.rpartition('/')[2]})" for name, kind in self.types.items()) or "no topics"

    def of_type(self, *types: str) -> list[str]:
        """Return the topics of any of these message types that hold messages, by name."""
        return [name for name, kind in self.types.items() if kind in types and self.counts[name]]

    def messages(self, topics: Collection[str]) -> Iterator[Message]:
        """Yield the messages of some topics in the order of recording."""
        connections = [connection for connection in self._reader.connections if connection.topic in topics]
        if not connections:
            return
        with _refusing_damage(self.source):
            stream = self._reader.messages(connections)
            for connection, nanoseconds, raw in stream:
                body = self._reader.deserialize(raw, connection.msgtype)
                yield Message(connection.topic, nanoseconds / 1e9, body)


def bag_suffix(head: bytes) -> str:
    """Return the end of name that fits a bag beginning with `head`, or "" if it is not a bag."""
    return next((suffix for magic, suffix in MAGICS if head.startswith(magic)), "")


def bag_in(folder: Path, accepted: str) -> Path:
    """Return what to open of a folder: itself if it is a ROS 2 bag, or the only bag file in it."""
    if (folder / METADATA).is_file():
        return folder
    files = [file for suffix in SUFFIXES for file in sorted(folder.glob(f"*{suffix}"))]
    if len(files) != 1:
        has = f"{len(files)} bag files" if files else "no bag file"
        first = next((file for file in files or sorted(folder.iterdir()) if file.is_file()), None)
        mend = accepted if first is None else f"Give one of its files, such as {first}."
        raise InputError(f"{folder}: this is a folder without {METADATA} and with {has}. {mend}")
    return files[0]


@contextmanager
def open_bag(path: Path, source: str) -> Iterator[Bag]:
    """Open a bag: a file of any name, or the folder of a ROS 2 bag with its metadata.yaml."""
    from rosbags import highlevel
    from rosbags import typesys as types

    with TemporaryDirectory() as folder:
        with _refusing_damage(source):
            reader = highlevel.AnyReader(
                [_named(path, Path(folder))], default_typestore=types.get_typestore(types.Stores.ROS2_HUMBLE)
            )
            reader.open()
        try:
            yield Bag(reader, source)
        except AttributeError as error:
            _refuse_own_type(error, source)
            raise
        finally:
            reader.close()


def _refuse_own_type(error: AttributeError, source: str) -> None:
    """Raise InputError if it is a message that lacks something: a bag brings the definitions of its types with it."""
    package, found, name = type(error.obj).__name__.partition("__msg__")
    if found:
        lacks = f"its {package}/{name} has no {error.name}"
        raise InputError(f"{source}: {lacks}. Record it with the standard messages of ROS.") from error


def _named(path: Path, folder: Path) -> Path:
    """Return a bag, or a link to it in `folder`, under a name with the suffix by which the library knows its format."""
    suffix = "" if path.is_dir() else bag_suffix(_head(path))
    if suffix == path.suffix:
        return path
    link = folder / f"bag{suffix}"
    link.symlink_to(path.resolve())
    return link


def _head(path: Path) -> bytes:
    with path.open("rb") as stream:
        return stream.read(HEAD)


def seconds(stamp: Any, received: float) -> float:
    """Return the time in a message's header in seconds, or when it was received if the header has none (0)."""
    time = float(stamp.sec) + stamp.nanosec / 1e9
    return time if time > 0 else received


@contextmanager
def _refusing_damage(source: str) -> Iterator[None]:
    """Turn whatever `rosbags` stumbles on, bare assertions among it, into one line."""
    try:
        yield
    except (InputError, GeneratorExit):
        raise
    except Exception as error:
        if isinstance(error, OSError) and error.strerror and error.filename is None:
            raise InputError(f"{source}: cannot be read ({system_reason(error)}).") from error
        too_large = "its header announces more than memory holds" if isinstance(error, MemoryError) else ""
        words = too_large or " ".join(str(error).split())[:120] or type(error).__name__
        raise InputError(
            f"{source}: the bag is damaged, or of a version that cannot be read ({words}). "
            "Record it anew, or mend it (rosbag reindex or fix, ros2 bag reindex)."
        ) from error
