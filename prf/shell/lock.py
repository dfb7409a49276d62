"""One writer an output: the second process is refused, not interleaved."""

from __future__ import annotations

import atexit
import fcntl
import os
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from prf.shell import litter
from prf.shell.errors import OutputError, cannot_write
from prf.shell.files import STREAM, is_device, refuse_existing, remove_leftovers

_claims = ExitStack()
_claimed: set[Path] = set()


def claim_output(path: str | os.PathLike[str], force: bool) -> None:
    """Refuse an output before the work for it begins, as :func:`refuse_existing`, or hold it until the tool ends.

    Raises
    ------
    OutputExists, OutputError
        As :func:`refuse_existing`, and if another process is writing it.
    """
    refuse_existing(path, force)
    claim(path)


def claim(path: str | os.PathLike[str]) -> None:
    """Hold the output `path` (file or folder, existing or not) until the tool ends; nobody holds a stream or a device.

    Raises
    ------
    OutputError
        If another process is writing it, or it cannot be written.
    """
    target = Path(path).resolve()
    if os.fspath(path) == STREAM or is_device(target) or target in _claimed:
        return
    _claims.enter_context(exclusive(target))
    _claimed.add(target)


@contextmanager
def held_outputs(paths: Iterable[str], force: bool) -> Iterator[None]:
    """Refuse outputs as :func:`claim_output`, or hold them as long as the block lasts."""
    with ExitStack() as held:
        for path in paths:
            refuse_existing(path, force)
            if path != STREAM and not is_device(Path(path).resolve()):
                held.enter_context(exclusive(path))
        yield


def release_claims() -> None:
    """Let go of all outputs that :func:`claim_output` holds."""
    _claimed.clear()
    _claims.close()


atexit.register(release_claims)


@contextmanager
def exclusive(path: str | os.PathLike[str]) -> Iterator[None]:
    """Hold the output `path` (file or folder, existing or not) for this process.

    The lock file ``.<name>.lock`` stands beside the output. The kernel drops the lock with the process, so a killed run
    never leaves an output locked. What one left beside the output, half written, is removed.

    Raises
    ------
    OutputError
        If another process holds it, or the lock file cannot be made.
    """
    target = Path(path).resolve()
    lock_path = target.with_name(f".{target.name}.lock")
    descriptor = _acquire(lock_path, target)
    litter.mark(lock_path)
    try:
        remove_leftovers(target)
        yield
    finally:
        # Unlinked while still held: whoever opened the old file sees in _acquire that it is no longer on disk.
        lock_path.unlink(missing_ok=True)
        litter.unmark(lock_path)
        os.close(descriptor)


def _acquire(lock_path: Path, target: Path) -> int:
    """Return the descriptor of the locked file that stands at `lock_path`."""
    while True:
        try:
            lock_path.parent.mkdir(parents=True, exist_ok=True)
            descriptor = os.open(lock_path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666)
        except OSError as error:
            raise cannot_write(target, error) from error
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            holder = os.pread(descriptor, 20, 0).decode(errors="replace").strip() or "unknown"
            os.close(descriptor)
            raise OutputError(
                f"{target}: another process (pid {holder}) is writing it. Wait for it, or choose another output."
            ) from None
        if _is_current(descriptor, lock_path):
            _sign(descriptor, lock_path, target)
            return descriptor
        os.close(descriptor)


def _sign(descriptor: int, lock_path: Path, target: Path) -> None:
    """Write the number of this process into its lock file."""
    try:
        os.ftruncate(descriptor, 0)
        os.pwrite(descriptor, f"{os.getpid()}\n".encode(), 0)
    except OSError as error:
        lock_path.unlink(missing_ok=True)
        os.close(descriptor)
        raise cannot_write(target, error) from error


def _is_current(descriptor: int, lock_path: Path) -> bool:
    """Return whether the open file is still the one at `lock_path`."""
    try:
        return os.path.samestat(os.fstat(descriptor), os.stat(lock_path))
    except FileNotFoundError:
        return False
