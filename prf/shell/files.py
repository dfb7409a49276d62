"""Files that are whole or absent: written beside their place, then moved into it; ``-`` stands for the streams."""

from __future__ import annotations

import io
import os
import re
import shutil
import stat
import sys
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any, BinaryIO

from prf.shell import litter
from prf.shell.console import is_terminal
from prf.shell.errors import InputError, OutputError, OutputExists, UsageError, cannot_write, system_reason
from prf.shell.input_stream import buffered
from prf.shell.together import take_place

STREAM = "-"

ESCAPED = "backslashreplace"
"""How text is encoded: names of files may hold bytes that are no UTF-8, which JSON gives back from their escapes."""


def refuse_existing(path: str | os.PathLike[str], force: bool) -> None:
    """Refuse an output file before the work for it begins: one that stands, or one that could not be written.

    Raises
    ------
    OutputExists
        If `path` stands and `force` is not given; streams and devices never "exist".
    OutputError
        If its folder does not exist or is not writable, or it is a folder itself.
    """
    refuse_standing(path, force)
    target = Path(os.path.realpath(path))
    if target.is_dir() and os.fspath(path) != STREAM:
        raise OutputError(f"{path}: a folder is in the way. Name a file.")
    if os.fspath(path) == STREAM or is_device(target):
        return
    if not target.parent.is_dir():
        raise OutputError(f"{path}: cannot be written (there is no folder {target.parent}). Make it first.")
    if not os.access(target.parent, os.W_OK | os.X_OK):
        raise OutputError(f"{path}: cannot be written (the folder {target.parent} is not writable).")


def is_device(target: Path) -> bool:
    """Return whether a device or a pipe stands there, which is written directly."""
    return target.exists() and not target.is_file() and not target.is_dir()


def remove_leftovers(path: str | os.PathLike[str]) -> None:
    """Remove what killed processes left beside the output `path`: files half written, and work folders.

    The caller holds the output (:mod:`prf.shell.lock`), so that nobody is still writing them.
    """
    target = Path(path)
    if not target.parent.is_dir():
        return
    for entry in target.parent.iterdir():
        if not is_leftover(entry.name, target.name):
            continue
        if entry.is_dir():
            shutil.rmtree(entry, ignore_errors=True)
        else:
            entry.unlink(missing_ok=True)


def is_leftover(name: str, output: str) -> bool:
    """Return whether a file called `name` is what a killed process left of one called `output`."""
    return re.fullmatch(rf"\.{re.escape(output)}\.[a-z0-9_]{{8}}\.(tmp|work)", name) is not None


def refuse_standing(path: str | os.PathLike[str], force: bool) -> None:
    """Raise :class:`OutputExists` if `path` stands and `force` is not given; streams and devices never "exist".

    A name that no file can have, or a folder that may not be looked into, raises :class:`OutputError`.
    """
    target = Path(path)
    with _reported(path):
        is_dangling = target.is_symlink() and not target.exists()
        stands = target.is_file() or target.is_dir() or is_dangling
    if os.fspath(path) != STREAM and stands and not force:
        raise OutputExists(f"{path} already exists. Use --force to overwrite.")


def refuse_inputs(outputs: Iterable[str], inputs: Iterable[str | None]) -> None:
    """Refuse an output file that is an input, even under --force: a slip would cost a log, or labels set by hand.

    Parameters
    ----------
    outputs : iterable of str
    inputs : iterable of str
        Those that are None, streams, folders or not there at all are passed over.

    Raises
    ------
    UsageError
    """
    files = [path for path in inputs if path is not None and os.path.isfile(path)]
    for output in outputs:
        if os.path.isfile(output) and any(os.path.samefile(output, path) for path in files):
            raise UsageError(f"{output} is an input and would be overwritten. Name another output with -o.")


@contextmanager
def open_input(path: str | os.PathLike[str]) -> Iterator[BinaryIO]:
    """Open `path` for reading bytes; ``-`` is standard input.

    Raises
    ------
    InputError
        If there is no such file, it is a folder or a device without end, or it may not be read; and later, if the
        system fails to read on.
    """
    if os.fspath(path) == STREAM:
        with buffered(sys.stdin.buffer, "standard input") as told:
            yield told
        return
    try:
        stream = open(path, "rb", buffering=0)  # noqa: SIM115 - closed below; errors of the block are not of opening
    except OSError as error:
        raise InputError(f"{path}: {system_reason(error)}.") from error
    with stream:
        if _is_endless(stream):
            raise InputError(f"{path}: a device, not a file.")
        with buffered(stream, path) as told:
            yield told


def _is_endless(stream: io.FileIO) -> bool:
    """Return whether a device is read that may never end: all but terminals and the null device."""
    state = os.fstat(stream.fileno())
    is_null = os.path.exists(os.devnull) and state.st_rdev == os.stat(os.devnull).st_rdev
    return stat.S_ISCHR(state.st_mode) and not is_null and not stream.isatty()


@contextmanager
def open_output(path: str | os.PathLike[str], binary: bool = False) -> Iterator[IO[Any]]:
    """Open `path` for an atomic write; ``-`` is standard output.

    Raises
    ------
    OutputError
        If a binary result would go to a terminal, or the file cannot be written.
    """
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

    Within :func:`prf.shell.together.together` it takes its place with the others, at the end of that block.

    Parameters
    ----------
    path : path
        A symbolic link is followed; a device or a pipe (``/dev/stdout``) is written directly.
    binary : bool
        Bytes instead of UTF-8 text with Unix line ends.
    sync : bool
        Whether the disk must have taken it before it takes its place; False where the caller has seen to that.

    Yields
    ------
    file object

    Raises
    ------
    OutputError
        If the folder does not exist, or is not writable, or the disk is full.
    """
    target = Path(os.path.realpath(path))
    mode = "wb" if binary else "w"
    text = {} if binary else {"encoding": "utf-8", "errors": ESCAPED, "newline": "\n"}
    if is_device(target):
        with _reported(path), open(target, mode, **text) as device:  # type: ignore[call-overload]
            yield device
        return
    with _reported(path):
        descriptor, name = tempfile.mkstemp(prefix=f".{target.name}.", suffix=".tmp", dir=target.parent)
    litter.mark(name)
    try:
        with _reported(path), open(descriptor, mode, **text) as stream:  # type: ignore[call-overload]
            yield stream
            if sync:
                flush_to_disk(stream)
            os.chmod(name, _permissions(target, 0o666))
            take_place(name, target)
    except BaseException:
        Path(name).unlink(missing_ok=True)
        litter.unmark(name)
        raise


def encoded(text: str) -> bytes:
    """Return the bytes that :func:`atomic_write` makes of `text`."""
    return text.encode("utf-8", ESCAPED)


def flush_to_disk(stream: IO[Any]) -> None:
    """Have the disk take what was written so far."""
    stream.flush()
    os.fsync(stream.fileno())


def _permissions(target: Path, default: int) -> int:
    """Return the mode that `target` has or, new, would get from `default` and the umask (mkstemp gives 0600)."""
    if target.exists():
        return target.stat().st_mode & 0o777
    umask = os.umask(0)
    os.umask(umask)
    return default & ~umask


@contextmanager
def _reported(path: str | os.PathLike[str]) -> Iterator[None]:
    """Turn the system's refusal to write `path` into an :class:`OutputError`; a closed pipe stays what it is."""
    try:
        yield
    except BrokenPipeError:
        raise
    except OSError as error:
        raise cannot_write(path, error) from error
