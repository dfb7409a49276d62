"""A folder for what is made on the way, beside the output, so that files need only be renamed into their places."""

from __future__ import annotations

import errno
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from prf.shell import litter
from prf.shell.errors import OutputError, cannot_write, system_reason

FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
"""What the system answers when there is no room for a result."""


@contextmanager
def work_folder(beside: str | os.PathLike[str]) -> Iterator[str]:
    """Give a folder beside the output `beside`, and remove it with what is in it; of the null device, a temporary one.

    Raises
    ------
    OutputError
        If it cannot be made, or the disk is full.
    """
    target = Path(tempfile.gettempdir(), "work") if os.fspath(beside) == os.devnull else Path(beside).resolve()
    try:
        folder = tempfile.mkdtemp(prefix=f".{target.name}.", suffix=litter.WORK, dir=target.parent)
    except OSError as error:
        raise cannot_write(beside, error) from error
    litter.mark(folder)
    try:
        yield folder
    except OSError as error:
        if error.errno not in FULL:
            raise
        raise OutputError(
            f"{beside}: cannot be written ({system_reason(error)}, in the work folder beside it)."
        ) from error
    finally:
        shutil.rmtree(folder, ignore_errors=True)
        litter.unmark(folder)


@contextmanager
def made_folder(path: str | os.PathLike[str]) -> Iterator[None]:
    """Make the folder of an output if there is none; an error in the block takes it away again if it stayed empty.

    Raises
    ------
    OutputError
        If it cannot be made.
    """
    place = Path(path)
    stood = place.is_dir()
    try:
        place.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise cannot_write(place, error) from error
    if not stood:
        litter.mark(place)
    try:
        yield
    except BaseException:
        if not stood:
            with suppress(OSError):
                place.rmdir()
        raise
    finally:
        litter.unmark(place)
