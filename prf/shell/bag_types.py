"""Whether the message types that a bag brings with it have the fields of ROS's own types of these names."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from prf.shell.errors import InputError

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

RENAMED = {"tf/msg/tfMessage": "tf2_msgs/msg/TFMessage"}
"""Old names of types."""
TEXTS = ("string", "wstring")


def refuse_other_types(found: Typestore, usual: Typestore, name: str, source: str) -> None:
    """Raise InputError if a type of messages, or one within it, has fields of ROS that hold something else.

    Numbers may be of any width, and fields may be more or fewer: one that is missed is told when it is needed.

    Parameters
    ----------
    found, usual : Typestore
        The types of the bag, and those of ROS.
    name : str
        Such as ``sensor_msgs/msg/LaserScan``.
    source : str
        Name of the bag, for the message.
    """
    waiting, seen = [name], {name}
    while waiting:
        name = waiting.pop()
        own, standard = found.fielddefs.get(name), usual.fielddefs.get(RENAMED.get(name, name))
        if own is None or standard is None:
            continue
        kinds: dict[str, Any] = dict(own[1])
        for field, kind in standard[1]:
            if field not in kinds:
                continue
            if _shape(kinds[field]) != _shape(kind):
                package, _, short = name.partition("/msg/")
                raise InputError(
                    f"{source}: the field {field} of its {package}/{short} holds something else than that of ROS. "
                    f"Record it with the standard messages of ROS."
                )
            inner = {each for each in _names(kind) if each not in seen}
            seen |= inner
            waiting += sorted(inner)


def _shape(kind: Any) -> Any:
    """Return what a field holds, as far as a reader needs to know."""
    from rosbags.interfaces import Nodetype

    node, content = kind
    if node == Nodetype.BASE:
        return "text" if content[0] in TEXTS else "number"
    return content if node == Nodetype.NAME else ("several", _shape(content[0]))


def _names(kind: Any) -> Iterator[str]:
    """Give the types of messages within a field."""
    from rosbags.interfaces import Nodetype

    node, content = kind
    if node == Nodetype.NAME:
        yield content
    elif node != Nodetype.BASE:
        yield from _names(content[0])
