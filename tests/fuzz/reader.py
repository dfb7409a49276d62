"""One reader of a tool, and what it promises: it returns, or says in one line what is wrong with which file."""

from __future__ import annotations

import contextlib
import resource
import signal
import time
import traceback
import warnings
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from prf.shell.errors import PrfError

LONGEST = 5.0
"""CPU seconds of one read."""
HANGS = 20.0
"""Seconds after which Python is interrupted."""
ROOM = 1 << 30
"""Bytes of address space that a read may take."""
READ_CODES = (2, 3)
"""Exit codes of what stands in a file: bad settings, bad input."""


class Reader(NamedTuple):
    """A reader, and what it is tried on.

    `file` is the name of the file in its folder, `seeds` makes whole files in an empty folder and returns their bytes,
    `surround` writes what must stand beside the file, and `read` takes its path.
    """

    file: str
    seeds: Callable[[Path], Sequence[bytes]]
    read: Callable[[Path], Any]
    surround: Callable[[Path], Any] = lambda _: None


class Hang(BaseException):
    """A read that does not end."""


class Defect(NamedTuple):
    """What a reader did that it must not do; `place` tells one defect from another."""

    what: str
    place: str
    trace: str


def try_reader(reader: Reader, folder: Path, data: bytes) -> Defect | None:
    """Return what is wrong with how `reader` takes `data`, None if all is well."""
    path = folder / reader.file
    path.write_bytes(data)
    begun = time.process_time()
    try:
        with _interrupted_after(HANGS), warnings.catch_warnings():
            warnings.simplefilter("error", RuntimeWarning)  # of numpy, in lines that no user can make use of
            reader.read(path)
    except PrfError as error:
        wrong = _wrong_words(error, path)
        if wrong is not None:
            return _defect(wrong, error)
    except (Exception, Hang) as error:
        return _defect(f"{type(error).__name__}: {error}", error)
    except BaseException as error:
        if type(error).__module__ == "pyo3_runtime":  # a panic of Rust
            return _defect(f"{type(error).__name__}: {error}", error)
        raise
    taken = time.process_time() - begun
    return None if taken < LONGEST else Defect(f"took {taken:.1f} s", "time", "")


@contextlib.contextmanager
def little_room() -> Iterator[None]:
    """Give the process `ROOM` beyond what it has."""
    before = resource.getrlimit(resource.RLIMIT_AS)
    now = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (now + ROOM, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, before)


def _wrong_words(error: PrfError, path: Path) -> str | None:
    message = str(error)
    if not message.isprintable():
        return f"message is not one line of plain text: {message!r}"
    if path.name not in message and str(path.parent) not in message:
        return f"message does not name the file: {message}"
    return None if error.exit_code in READ_CODES else f"exit code {error.exit_code}: {message}"


def _defect(what: str, error: BaseException) -> Defect:
    frames = traceback.extract_tb(error.__traceback__)
    ours = [frame for frame in frames if "/prf/" in frame.filename or "/mapq/" in frame.filename]
    last = (ours or frames)[-1]
    place = f"{type(error).__name__} at {Path(last.filename).name}:{last.name}:{last.lineno}"
    return Defect(what, place, "".join(traceback.format_exception(error)))


@contextlib.contextmanager
def _interrupted_after(seconds: float) -> Iterator[None]:
    def stop(*_: object) -> None:
        raise Hang(f"no end after {seconds:g} s")

    before = signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
