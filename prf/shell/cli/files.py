"""Files that are whole or absent: written beside their place, then moved into it; ``-`` is standard input or output."""

from __future__ import annotations

import errno
import gzip
import os
import shutil
import sys
import tempfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from pathlib import Path
from typing import IO, Any, BinaryIO

from prf.shell.cli.console import is_terminal
from prf.shell.errors import InputError, OutputError, cannot_write, system_reason

STREAM = "-"
ESCAPED = "backslashreplace"
"""How text is encoded: names of files may hold bytes that are not UTF-8, which JSON gives back from their escapes."""
FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
"""What the system answers when there is no room for a result."""

_temporary: set[str] = set()
"""Files and folders that must not outlive this process."""
os.register_at_fork(after_in_child=_temporary.clear)


@contextmanager
def open_input(path: str | os.PathLike[str]) -> Iterator[BinaryIO]:
    """Open `path` for reading bytes; ``-`` is standard input. InputError if it cannot be opened or read."""
    if os.fspath(path) == STREAM:
        with _read_errors("standard input"):
            yield sys.stdin.buffer
        return
    try:
        stream = open(path, "rb")  # noqa: SIM115 - closed below; errors of the block are not of opening
    except OSError as error:
        raise InputError(f"{path}: {system_reason(error)}.") from error
    with _read_errors(path), stream:
        yield stream


@contextmanager
def _read_errors(path: str | os.PathLike[str]) -> Iterator[None]:
    """Turn the system's refusal to read on into an InputError; not what concerns other files, or is of writing."""
    try:
        yield
    except OSError as error:
        if error.filename is not None or error.errno in (None, errno.EPIPE, *FULL):
            raise
        raise InputError(f"{path}: cannot be read ({system_reason(error)}).") from error


@contextmanager
def open_output(path: str | os.PathLike[str], binary: bool = False) -> Iterator[IO[Any]]:
    """Open `path` for an atomic write; ``-`` is standard output, which must be no terminal for a binary result."""
    if os.fspath(path) != STREAM:
        with atomic_write(path, binary=binary) as stream:
            yield stream
        return
    if binary and is_terminal(sys.stdout):
        raise OutputError("standard output is a terminal and the result is binary. Name a file with -o, or use a pipe.")
    yield sys.stdout.buffer if binary else sys.stdout


@contextmanager
def atomic_write(path: str | os.PathLike[str], binary: bool = False, sync: bool = True) -> Iterator[IO[Any]]:
    """Write `path` whole or not at all; an exception inside leaves the old file as it was.

    A symbolic link is followed; a device or a pipe (``/dev/stdout``) is written directly. `binary`: bytes instead of
    UTF-8 text with Unix line ends. `sync`: the disk must have taken the content before the file is moved to its place.
    OutputError if the system refuses.
    """
    target = Path(os.path.realpath(path))
    mode = "wb" if binary else "w"
    text = {} if binary else {"encoding": "utf-8", "errors": ESCAPED, "newline": "\n"}
    if is_device(target):
        with write_errors(path), open(target, mode, **text) as device:  # type: ignore[call-overload]
            yield device
        return
    with write_errors(path):
        descriptor, made = tempfile.mkstemp(prefix=f".{target.name}.", suffix=".tmp", dir=target.parent)
    _temporary.add(made)
    try:
        with write_errors(path), open(descriptor, mode, **text) as stream:  # type: ignore[call-overload]
            yield stream
            if sync:
                flush_to_disk(stream)
            os.chmod(made, _permissions(target))
            _take_place(made, target)
    except BaseException:
        remove_temporary(made)
        raise


class Group:
    """Whole files under temporary names, which take their places together; made by :func:`together`.

    The last one makes the others a result: its predecessor is put aside first, and it is placed last.
    """

    def __init__(self) -> None:
        self._made: dict[Path, str] = {}
        self._dropped: list[Path] = []
        self._old: dict[Path, Path] = {}

    def add(self, made: str, target: Path) -> None:
        """Have the file `made`, on the same disk, become `target` in the end."""
        self._made[target] = made

    def drop(self, target: Path) -> None:
        """Have a file of an older output removed in the end, if there is one."""
        self._dropped.append(Path(os.path.realpath(target)))

    def where(self, target: Path) -> Path | None:
        """Return where the file that will be `target` is until then, None if there will be none."""
        made = self._made.get(Path(os.path.realpath(target)))
        return None if made is None else Path(made)

    def take_places(self) -> None:
        """Move all files to their places; if one cannot be moved, all old files are back in theirs."""
        try:
            for target in (*reversed(self._made), *self._dropped):
                if target.is_file():
                    self._put_aside(target)
            for target, made in self._made.items():
                with write_errors(target):
                    os.replace(made, target)
        except BaseException:
            self._take_back()
            raise
        for aside in self._old.values():
            remove_temporary(str(aside.parent))

    def _put_aside(self, target: Path) -> None:
        """Move an old file into a folder of its own, which a later process takes for a leftover."""
        with write_errors(target):
            folder = tempfile.mkdtemp(prefix=f".{target.name}.", suffix=".work", dir=target.parent)
            self._old[target] = Path(folder, target.name)
            os.replace(target, self._old[target])

    def _take_back(self) -> None:
        for target, made in self._made.items():
            if not os.path.exists(made):  # it has taken its place
                with suppress(OSError):
                    target.unlink()
        for target, aside in self._old.items():
            with suppress(OSError):
                if aside.exists():
                    os.replace(aside, target)
                aside.parent.rmdir()

    def remove(self) -> None:
        """Remove what has not taken its place."""
        for made in self._made.values():
            remove_temporary(made)


_group: ContextVar[Group | None] = ContextVar("_group", default=None)


@contextmanager
def together() -> Iterator[Group]:
    """Move files that :func:`atomic_write` writes in the block to their places at its end.

    After an error, of moving too, all old files are as they were, and there is no new one.
    """
    group = Group()
    before = _group.set(group)
    try:
        yield group
        group.take_places()
    finally:
        _group.reset(before)
        group.remove()


def _take_place(made: str, target: Path) -> None:
    """Rename the whole file `made` to `target`: at once, or with the others of the group."""
    group = _group.get()
    if group is None:
        os.replace(made, target)
        _temporary.discard(made)
    else:
        group.add(made, target)


@contextmanager
def work_folder(beside: str | os.PathLike[str]) -> Iterator[str]:
    """Give a folder beside the output `beside`, removed with its content; of the null device, in the temporary one."""
    target = Path(tempfile.gettempdir(), "work") if os.fspath(beside) == os.devnull else Path(beside).resolve()
    with write_errors(beside):
        folder = tempfile.mkdtemp(prefix=f".{target.name}.", suffix=".work", dir=target.parent)
    _temporary.add(folder)
    try:
        yield folder
    finally:
        remove_temporary(folder)


@contextmanager
def made_folder(path: str | os.PathLike[str]) -> Iterator[None]:
    """Make the folder of an output if there is none; it is removed again if the block leaves it empty."""
    place = Path(path)
    is_new = not place.is_dir()
    with write_errors(path):
        place.mkdir(parents=True, exist_ok=True)
    try:
        yield
    finally:
        if is_new:
            with suppress(OSError):
                place.rmdir()


def mark_temporary(path: str) -> None:
    """Have a file removed with the others by :func:`remove_all_temporary`."""
    _temporary.add(path)


def remove_temporary(path: str) -> None:
    """Remove a temporary file or folder, if it is still there."""
    if os.path.isdir(path):
        shutil.rmtree(path, ignore_errors=True)
    with suppress(OSError):
        os.unlink(path)
    _temporary.discard(path)


def remove_all_temporary() -> None:
    """Remove all temporary files of a process that ends where no exception passes, in a compiler for instance."""
    for path in tuple(_temporary):
        remove_temporary(path)


def gunzip(data: bytes, source: str) -> bytes:
    """Return what a gzipped file holds; InputError, which names `source`, if it is damaged or cut off."""
    try:
        return gzip.decompress(data)
    except EOFError:
        raise InputError(f"{source}: the gzip file is cut off at its end. Copy or download it again.") from None
    except (OSError, zlib.error):
        raise InputError(f"{source}: the gzip file is damaged. Copy or download it again.") from None


def encoded(text: str) -> bytes:
    """Return the bytes that :func:`atomic_write` makes of `text`."""
    return text.encode("utf-8", ESCAPED)


def flush_to_disk(stream: IO[Any]) -> None:
    """Have the disk take what was written so far."""
    stream.flush()
    os.fsync(stream.fileno())


def is_device(target: Path) -> bool:
    """Return whether `target` is a device or a pipe, which is written directly."""
    return target.exists() and not target.is_file() and not target.is_dir()


def _permissions(target: Path) -> int:
    """Return the mode that `target` has or, new, would get from the umask (mkstemp gives 0600)."""
    if target.exists():
        return target.stat().st_mode & 0o777
    umask = os.umask(0)
    os.umask(umask)
    return 0o666 & ~umask


@contextmanager
def write_errors(path: str | os.PathLike[str]) -> Iterator[None]:
    """Turn the system's refusal to write `path` into an :class:`OutputError`; a closed pipe stays what it is."""
    try:
        yield
    except BrokenPipeError:
        raise
    except OSError as error:
        raise cannot_write(path, error) from error
