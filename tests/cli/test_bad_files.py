"""Every verb on a bad input file: it reports one line that names the file, or does its whole work; never half of it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from tests.cli.calls import VERBS, Verb, call, content

FAULTS: dict[str, Callable[[bytes], bytes]] = {
    "truncated": lambda data: data[: len(data) // 2],
    "another kind": lambda data: b"\x89PNG\r\n\x1a\n" + bytes(64),
}
CASES = {
    f"{verb.title}: {name}: {fault}": (verb, name, fault)
    for verb in VERBS
    for name in verb.reads
    for fault in ("missing", *FAULTS)
}


@pytest.mark.parametrize(("verb", "name", "fault"), CASES.values(), ids=CASES)
def test_a_bad_file_is_named_in_one_line(verb: Verb, name: str, fault: str, folder: Path) -> None:
    path = folder / name
    intact = path.read_bytes()
    try:
        if fault == "missing":
            path.unlink()
        else:
            path.write_bytes(FAULTS[fault](intact))
        before = content(folder)
        done = call(verb.call, folder, "-q")
        changed = {each for each, data in content(folder).items() if before.get(each) != data}
    finally:
        path.write_bytes(intact)
    if done.code == 0:
        assert all((folder / each).exists() for each in verb.writes)
        return
    errors = [line for line in done.err.splitlines() if line.startswith("error: ")]
    assert done.code in (1, 2, 3), done
    if "prf inspect run" not in verb.call:  # shows the state of every file of a RUN first
        assert done.err.splitlines() == errors, done.err
        assert done.out == ""
        assert len(errors) == 1, done.err
    assert changed == set()


def test_the_intact_files_are_read(folder: Path) -> None:
    for verb in VERBS:
        if not verb.writes:
            assert call(verb.call, folder, "-q").code == 0, verb.call
