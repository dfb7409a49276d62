"""What a process that ends at once takes with it."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from prf.shell import litter


@pytest.fixture(autouse=True)
def _nothing_else() -> Iterator[None]:
    before = dict(litter._marked)
    litter._marked.clear()
    yield
    litter._marked.clear()
    litter._marked.update(before)


def test_only_marked_files_are_removed(tmp_path: Path) -> None:
    made, work, half, whole = (tmp_path / name for name in ("made", ".run.1.work", "made/half.tmp", "made/whole"))
    made.mkdir()
    work.mkdir()
    (work / "tile").touch()
    half.touch()
    for path in (made, work, half):
        litter.mark(path)
    litter.sweep()
    assert list(tmp_path.iterdir()) == []
    made.mkdir()
    for path in (whole, half):
        path.touch()
        litter.mark(path)
    litter.unmark(whole)
    litter.mark(made)
    litter.sweep()
    assert [*tmp_path.rglob("*")] == [made, whole], "a folder that holds something stays"


def test_what_is_gone_already_is_no_fault(tmp_path: Path) -> None:
    litter.mark(tmp_path / "gone")
    litter.mark(tmp_path / "gone.work")
    litter.sweep()


def test_what_another_process_marked_is_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "theirs"
    path.touch()
    litter.mark(path)
    monkeypatch.setattr(os, "getpid", lambda: -1)
    litter.sweep()
    assert path.exists()
