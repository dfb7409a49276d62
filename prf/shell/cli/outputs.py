"""Outputs are refused before the work for them begins: those that exist, are inputs, or another process is writing."""

from __future__ import annotations

import atexit
import errno
import fcntl
import logging
import os
import re
from collections.abc import Collection, Iterable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from prf.shell.cli.files import STREAM, is_device, mark_temporary, remove_temporary, write_errors
from prf.shell.errors import OutputError, OutputExists, UsageError, system_reason

logger = logging.getLogger(__name__)

FORMATS = (
    *(".3d", ".asc", ".bin", ".e57", ".las", ".laz", ".pcd", ".ply", ".pts", ".ptx", ".vtk", ".xyz"),
    *(".dxf", ".geojson", ".geojsonl", ".nc", ".netcdf", ".pgm"),
    *(".htm", ".html", ".jpeg", ".jpg", ".pdf", ".png", ".svg"),
    *(".bag", ".csv", ".db3", ".mcap", ".txt", ".gz", ".npy", ".npz", ".toml", ".yaml", ".yml", ".zip"),
)
"""Suffixes that name a format. A suffix that is not among them, such as .json, may be that of any output."""

_HELD = (errno.EACCES, errno.EAGAIN)
"""What the system answers where another process holds a lock; other errors are of file systems without locks."""

_claims = ExitStack()
_claimed: set[Path] = set()


def claim_output(
    path: str | os.PathLike[str],
    force: bool,
    *,
    inputs: Iterable[str | os.PathLike[str] | None] = (),
    suffixes: Collection[str] | None = None,
    json: bool = False,
) -> None:
    """Refuse an output before the work for it begins, or hold it until the tool ends.

    `force`: an existing file may be replaced, but none of `inputs`. `suffixes`: those of `FORMATS` that it may have;
    None: any. `json`: standard output is taken by a summary in JSON.
    """
    refuse_json_on_stream(path, json)
    if suffixes is not None:
        refuse_other_format(path, suffixes)
    refuse_existing(path, force)
    refuse_inputs([os.fspath(path)], inputs)
    claim(path)


def beside(path: str | os.PathLike[str], name: str) -> str:
    """Return where an output without -o lies: as `name` beside the input `path`.

    Of standard input, and where that folder cannot be written, it is in the working directory.
    """
    folder = os.path.dirname(os.path.normpath(path)) if os.fspath(path) != STREAM else ""
    return os.path.join(folder, name) if os.access(folder or os.curdir, os.W_OK) else name


def claim(path: str | os.PathLike[str]) -> None:
    """Hold the output `path` (file or folder, existing or not) until the tool ends; errors as :func:`exclusive`."""
    target = Path(path).resolve()
    if target not in _claimed:
        _claims.enter_context(exclusive(path))
        _claimed.add(target)


def release_claims() -> None:
    """Let go of all outputs that :func:`claim` holds."""
    _claimed.clear()
    _claims.close()


atexit.register(release_claims)


@contextmanager
def exclusive(*paths: str | os.PathLike[str]) -> Iterator[None]:
    """Hold outputs (files or folders, existing or not) for this process; a stream or a device is not held.

    The lock file ``.<name>.lock`` is beside the output. The kernel drops the lock with the process, so a killed run
    never leaves an output locked; what one left half written is removed. OutputError if another process holds one.
    """
    targets = [Path(path).resolve() for path in paths if os.fspath(path) != STREAM]
    with ExitStack() as held:
        for target in targets:
            if not is_device(target):
                held.enter_context(_locked(target))
        yield


@contextmanager
def _locked(target: Path) -> Iterator[None]:
    lock = target.with_name(f".{target.name}.lock")
    descriptor = _lock(lock, target)
    # Whoever opened the file before its last holder removed it has locked a file that is no longer there.
    while descriptor is not None and not _is_current(descriptor, lock):
        os.close(descriptor)
        descriptor = _lock(lock, target)
    mark_temporary(str(lock))
    try:
        if descriptor is not None:
            remove_leftovers(target)
        yield
    finally:
        remove_temporary(str(lock))
        if descriptor is not None:
            os.close(descriptor)


def _lock(lock: Path, target: Path) -> int | None:
    """Return the descriptor of the lock file of `target`, open and locked; None where the file system has no locks."""
    with write_errors(target):
        lock.parent.mkdir(parents=True, exist_ok=True)
        descriptor = os.open(lock, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        os.close(descriptor)
        if error.errno in _HELD:
            message = f"{target}: another process is writing it. Wait for it, or choose another output."
            raise OutputError(message) from None
        logger.warning(f"{target}: cannot be locked here ({system_reason(error)}). Let no other process write it.")
        return None
    return descriptor


def _is_current(descriptor: int, lock: Path) -> bool:
    """Return whether the open file is still the one at `lock`."""
    try:
        return os.path.samestat(os.fstat(descriptor), os.stat(lock))
    except FileNotFoundError:
        return False


def refuse_existing(path: str | os.PathLike[str], force: bool, is_folder: bool = False) -> None:
    """Raise OutputExists for an output that exists, without `force`; OutputError for a file that cannot be written.

    Streams and devices never "exist".
    """
    target = Path(os.path.realpath(path))
    with write_errors(path):
        if os.fspath(path) == STREAM or is_device(target):
            return
    if os.path.lexists(path) and not force:
        raise OutputExists(f"{path} already exists. Use --force to overwrite.")
    if is_folder:
        return
    if target.is_dir():
        raise OutputError(f"{path}: is a folder, but a file is expected. Name a file.")
    if not target.parent.is_dir():
        raise OutputError(f"{path}: cannot be written (folder {target.parent} does not exist). Make it first.")
    if not os.access(target.parent, os.W_OK | os.X_OK):
        raise OutputError(f"{path}: cannot be written (the folder {target.parent} is not writable).")


def refuse_json_on_stream(path: str | os.PathLike[str] | None, json: bool) -> None:
    """Raise UsageError if an output and a summary in JSON are both asked for on standard output."""
    if json and path == STREAM:
        raise UsageError("--json and -o - both want standard output. Name a file with -o.")


def refuse_inputs(outputs: Iterable[str], inputs: Iterable[str | os.PathLike[str] | None]) -> None:
    """Raise UsageError for an output that is an input: a mistake would cost a log, or labels set by hand.

    Inputs that are None, streams or missing are passed over.
    """
    there = [path for path in inputs if path is not None and os.path.exists(path)]
    for output in outputs:
        if os.path.exists(output) and any(os.path.samefile(output, path) for path in there):
            raise UsageError(f"{output} is an input and would be overwritten. Name another output with -o.")


def refuse_other_format(path: str | os.PathLike[str], own: Collection[str]) -> None:
    """Raise UsageError for a name that promises another format than its `own`: other programs believe it."""
    name = os.fspath(path).lower()
    if name.endswith(os.sep):
        raise UsageError(f"{path}: this is the name of a folder. Name a file.")
    if name.endswith(FORMATS) and not name.endswith(tuple(own)):
        raise UsageError(f"{path}: this format is not written. Name a {' or '.join(own)}.")


def remove_leftovers(path: str | os.PathLike[str]) -> None:
    """Remove what killed processes left beside the output `path`, which the caller holds: files and work folders."""
    target = Path(path)
    if target.parent.is_dir():
        for entry in target.parent.iterdir():
            if is_leftover(entry.name, target.name):
                remove_temporary(str(entry))


def is_leftover(name: str, output: str) -> bool:
    """Return whether a file called `name` is what a killed process left of one called `output`."""
    return re.fullmatch(rf"\.{re.escape(output)}\.[a-z0-9_]{{8}}\.(tmp|work)", name) is not None
