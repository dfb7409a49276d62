"""Every verb on files with one fault: it refuses them in one line that names the file, or does its work; never half."""

from __future__ import annotations

import random
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.fuzz.calls import Said, call
from tests.fuzz.faults import bomb, faults
from tests.fuzz.reader import little_room
from tests.fuzz.test_outputs import clear, content
from tests.fuzz.values import exchanged
from tests.fuzz.verbs import QUICK, VERBS, Verb, make_samples, marked

RUN_PARTS = ("manifest.json", "draws.npz", "posterior.npz", "readings.npz", "map.geojson", "diagnostics.json")
MOST_VARIANTS = 30
"""Of a file, for each verb."""
GENTLE = settings(max_examples=20, suppress_health_check=list(HealthCheck), database=None)


def damageable(verb: Verb) -> list[str]:
    """Return the files among the inputs of a call, those of a folder one by one."""
    parts = {"run": [f"run/{part}" for part in RUN_PARTS], "scans": ["scans/3.ply", "scans/poses.txt"]}
    return [file for name in verb.reads for file in parts.get(name, [name])]


CASES = [(verb, name) for verb in VERBS for name in dict.fromkeys(damageable(verb))]

ZIPPED = [case for case in CASES if case[1].endswith((".log", ".csv", ".ply"))]
"""What may come gzipped."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    place = tmp_path_factory.mktemp("damage") / "work"
    place.mkdir()
    make_samples(place)
    (place.parent / "beside").write_text("")
    return place


def judged(verb: Verb, name: str, said: Said, before: dict[str, bytes], folder: Path) -> None:
    """A call that ends well has its whole output; one that does not has changed nothing and says one line."""
    outputs = [folder / each for each in verb.writes]
    if said.code == 0:
        assert all(path.exists() for path in outputs), outputs
        return
    if said.code == 1 and "config check" in verb.call:
        return
    assert said.code in (2, 3), said
    assert said.err.count("\n") == 1, said
    assert said.out == "" or "inspect run" in verb.call, "this one shows the state of all files first"
    assert said.err.startswith("error: ")
    assert said.err.rstrip("\n").isprintable()
    after = content(folder)
    assert [each for each in {*before, *after} if before.get(each) != after.get(each)] == [], said.err
    assert not list(folder.parent.rglob("*slipped*"))


@pytest.mark.parametrize(("verb", "name"), marked(CASES))
@GENTLE
@given(data=st.data())
def test_one_fault(verb: Verb, name: str, folder: Path, data: st.DataObject) -> None:
    whole = (folder / name).read_bytes()
    kept = {each: (folder / each).read_bytes() for each in ("bare.patches",)}
    try:
        (folder / name).write_bytes(data.draw(faults(whole)))
        before = content(folder)
        with little_room():
            said = call(verb.call, folder)
        judged(verb, name, said, before, folder)
    finally:
        clear(folder)
        for each, value in {**kept, name: whole}.items():
            (folder / each).write_bytes(value)


@pytest.mark.slow
@pytest.mark.parametrize(("verb", "name"), marked(CASES))
def test_one_value(verb: Verb, name: str, folder: Path) -> None:
    """What a reader lets pass must not stop the work behind it either."""
    whole = (folder / name).read_bytes()
    variants = list(exchanged(whole))
    kept = {each: (folder / each).read_bytes() for each in ("bare.patches",)}
    try:
        for data in random.Random(name).sample(variants, min(MOST_VARIANTS, len(variants))):
            (folder / name).write_bytes(data)
            before = content(folder)
            judged(verb, name, call(verb.call, folder), before, folder)
            clear(folder)
            for each, value in kept.items():
                (folder / each).write_bytes(value)
    finally:
        (folder / name).write_bytes(whole)


@pytest.mark.slow
@pytest.mark.parametrize(("verb", "name"), marked(ZIPPED))
def test_a_gzip_bomb(verb: Verb, name: str, folder: Path) -> None:
    """It is read within a gigabyte, or refused; what is unpacked to more than half of the memory always is."""
    whole = (folder / name).read_bytes()
    try:
        (folder / name).write_bytes(bomb(whole))
        before = content(folder)
        with little_room():
            said = call(verb.call, folder)
        judged(verb, name, said, before, folder)
    finally:
        clear(folder)
        (folder / name).write_bytes(whole)


def test_the_whole_inputs_are_taken(folder: Path) -> None:
    """Else the tests above would only show that everything is refused."""
    shutil.copy(folder / "bare.patches", folder / "kept")
    for verb in VERBS:
        if verb.name.startswith(QUICK) or verb.call.startswith(("prf config", "prf inspect")):
            assert call(verb.call, folder).code == 0
    shutil.move(folder / "kept", folder / "bare.patches")
