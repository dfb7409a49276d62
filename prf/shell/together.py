"""Several files of one output take their places together: all, or none if one cannot."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from pathlib import Path

from prf.shell import litter
from prf.shell.errors import cannot_write

_current: ContextVar[Group | None] = ContextVar("_current", default=None)


class Group:
    """Files that are on the disk under other names; made by :func:`together`.

    The last one makes the others a result: an old one of its name goes first, and it comes last. What is killed in
    between leaves none.
    """

    def __init__(self) -> None:
        self._made: dict[Path, str] = {}
        self._dropped: list[Path] = []
        self._old: list[tuple[str, Path]] = []
        self._placed: list[Path] = []

    def add(self, made: str, target: Path) -> None:
        """Have the file `made`, on the same disk, become `target` in the end."""
        self._made[target] = made

    def drop(self, target: Path) -> None:
        """Have a file of an older output go in the end, if there is one."""
        self._dropped.append(Path(os.path.realpath(target)))

    def where(self, target: Path) -> Path | None:
        """Return where the file that will be `target` stands until then, None if there will be none."""
        made = self._made.get(Path(os.path.realpath(target)))
        return None if made is None else Path(made)

    def take_places(self) -> None:
        """Move all files to their places.

        Raises
        ------
        OutputError
            If one cannot be moved; then everything is as it was before.
        """
        try:
            for target in [*reversed(self._made), *self._dropped]:
                self._put_aside(target)
            for target, made in self._made.items():
                _moved(made, target)
                self._placed.append(target)
        except BaseException:
            self._take_back()
            raise
        for aside, _ in self._old:
            with suppress(OSError):
                os.remove(aside)

    def remove(self) -> None:
        """Remove what has not taken its place."""
        for made in self._made.values():
            Path(made).unlink(missing_ok=True)
            litter.unmark(made)

    def _put_aside(self, target: Path) -> None:
        """Give an old file a name that a later process takes for a leftover."""
        if not target.is_file():
            return
        try:
            descriptor, aside = tempfile.mkstemp(prefix=f".{target.name}.", suffix=".tmp", dir=target.parent)
        except OSError as error:
            raise cannot_write(target, error) from error
        os.close(descriptor)
        try:
            _moved(str(target), Path(aside), target)
        except BaseException:
            Path(aside).unlink(missing_ok=True)
            raise
        self._old.append((aside, target))

    def _take_back(self) -> None:
        for target in self._placed:
            with suppress(OSError):
                target.unlink(missing_ok=True)
        for aside, target in self._old:
            with suppress(OSError):
                os.rename(aside, target)


@contextmanager
def together() -> Iterator[Group]:
    """Have the files that the block writes (:func:`prf.shell.files.atomic_write`) take their places at its end.

    Raises
    ------
    OutputError
        If one cannot. After this and any other error all old files are as they were, and there is no new one.
    """
    group = Group()
    before = _current.set(group)
    try:
        yield group
        group.take_places()
    finally:
        _current.reset(before)
        group.remove()


def take_place(made: str, target: Path) -> None:
    """Rename the whole file `made` to `target`: at once, or with the others of the group."""
    group = _current.get()
    if group is None:
        os.replace(made, target)
        litter.unmark(made)
    else:
        group.add(made, target)


def _moved(source: str, destination: Path, told: Path | None = None) -> None:
    try:
        os.replace(source, destination)
    except OSError as error:
        raise cannot_write(told or destination, error) from error
