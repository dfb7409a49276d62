"""Every writer on a disk that is full or refuses: one line, exit code 4, and the folder as it was before."""

from __future__ import annotations

import errno
import os
import resource
import shutil
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from unittest import mock

import pytest

from prf.shell.errors import OutputError
from prf.shell.files import atomic_write
from prf.shell.together import together
from tests.fuzz.calls import Said, call
from tests.fuzz.verbs import VERBS, Verb, make_samples, marked

WRITING = [verb for verb in VERBS if verb.writes]
SYSTEM: dict[str, Any] = {"fsync": os, "replace": os, "chmod": os, "mkstemp": tempfile}
"""What the system is asked for on the way of a file to its place."""


@pytest.fixture(scope="module")
def samples(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("samples")
    make_samples(folder)
    return folder


@pytest.fixture
def folder(samples: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(samples, tmp_path / "work"))


def content(folder: Path) -> dict[str, bytes]:
    """Return all that is in a folder, hidden files and folders among it."""
    return {str(path.relative_to(folder)): path.read_bytes() if path.is_file() else b"" for path in folder.rglob("*")}


def made(folder: Path, verb: Verb) -> list[int]:
    """Return the sizes of the files of a whole result."""
    paths = [
        path for name in verb.writes for path in ([folder / name] if name[-1] != "/" else (folder / name).iterdir())
    ]
    return sorted(path.stat().st_size for path in paths)


def clear(folder: Path) -> None:
    for path in folder.glob("out*"):
        shutil.rmtree(path) if path.is_dir() else path.unlink()


@contextmanager
def room_for(n_bytes: int) -> Iterator[None]:
    """Let no file grow beyond so many bytes: writing fails as on a full disk, wherever it is done."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (n_bytes, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


class Failing:
    """A call of the system that fails the n-th time; counts calls."""

    def __init__(self, real: Callable[..., Any], nth: int = -1) -> None:
        self.real, self.nth, self.calls = real, nth, 0

    def __call__(self, *args: Any, **keywords: Any) -> Any:
        self.calls += 1
        if self.calls - 1 == self.nth:
            raise OSError(errno.EIO, os.strerror(errno.EIO))
        return self.real(*args, **keywords)


def refused(said: Said, before: dict[str, bytes], folder: Path, is_run: bool) -> None:
    """A run that replaces another takes that away when it begins, as it may take hours; all others keep the old."""
    assert (said.code, said.err.count("\n"), said.out) == (4, 1, ""), said
    assert "out" in said.err, said.err
    after = content(folder)
    if is_run:
        after, before = ({name: each[name] for name in each if "out" not in name} for each in (after, before))
        assert not [path for path in folder.iterdir() if "out" in path.name]
    assert [name for name in {*before, *after} if before.get(name) != after.get(name)] == []


@pytest.mark.parametrize("has_old", [False, True], ids=["new", "over an old one"])
@pytest.mark.parametrize("verb", marked(WRITING))
class TestFaults:
    def begin(self, verb: Verb, folder: Path, has_old: bool) -> tuple[dict[str, bytes], list[str]]:
        clear(folder)
        if has_old:
            assert call(verb.call, folder).code == 0
        return content(folder), ["--force"] if has_old else []

    def test_a_full_disk(self, verb: Verb, folder: Path, has_old: bool) -> None:
        assert call(verb.call, folder).code == 0
        sizes = made(folder, verb)
        # A file may be some bytes shorter the next time: times that stand in it are compressed.
        for room in sorted({0, sizes[0] // 2, sizes[-1] * 9 // 10}):
            before, force = self.begin(verb, folder, has_old)
            with room_for(room):
                said = call(verb.call, folder, *force)
            refused(said, before, folder, "prf sample" in verb.call and room > 0)

    @pytest.mark.parametrize("name", SYSTEM)
    def test_a_disk_that_fails(self, verb: Verb, folder: Path, has_old: bool, name: str) -> None:
        before, force = self.begin(verb, folder, has_old)
        real = getattr(SYSTEM[name], name)
        with mock.patch.object(SYSTEM[name], name, counted := Failing(real)):
            assert call(verb.call, folder, *force).code == 0
        for nth in {counted.calls - 1, 0}:
            before, force = self.begin(verb, folder, has_old)
            with mock.patch.object(SYSTEM[name], name, Failing(real, nth)):
                said = call(verb.call, folder, *force)
            # What workers do between is done again.
            if not (said.code == 0 and "--workers" in verb.call and nth == 0):
                refused(said, before, folder, "prf sample" in verb.call)


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs /dev/full")
@pytest.mark.parametrize(
    "verb", marked([verb for verb in WRITING if len(verb.writes) == 1 and verb.writes[0][-1] != "/"])
)
def test_a_device_without_room(verb: Verb, folder: Path) -> None:
    words = verb.call.replace(verb.output(), "/dev/full")

    said = call(words, folder)
    assert (said.code, said.err.count("\n"), said.out) == (4, 1, ""), said
    assert "/dev/full" in said.err


def test_together_all_or_none(tmp_path: Path) -> None:
    for name in ("a", "b", "stale"):
        (tmp_path / name).write_text("old")

    def write(fault: bool) -> None:
        with together() as group:
            for name in ("a", "b"):
                with atomic_write(tmp_path / name) as stream:
                    stream.write("new")
            assert group.where(tmp_path / "a").read_text() == "new"
            assert group.where(tmp_path / "c") is None
            group.drop(tmp_path / "stale")
            assert (tmp_path / "a").read_text() == "old"
            if fault:
                raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write(fault=True)
    assert content(tmp_path) == dict.fromkeys(("a", "b", "stale"), b"old")
    for nth in range(5):
        with mock.patch("os.replace", Failing(os.replace, nth)), pytest.raises(OutputError, match="cannot be written"):
            write(fault=False)
        assert content(tmp_path) == dict.fromkeys(("a", "b", "stale"), b"old")
    write(fault=False)
    assert content(tmp_path) == dict.fromkeys(("a", "b"), b"new")
