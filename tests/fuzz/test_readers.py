"""Every reader on damage at random for a moment; ``python -m tests.fuzz`` takes longer, and is guided."""

from __future__ import annotations

import random

import pytest

from tests.fuzz.damage import crc32c, damaged
from tests.fuzz.reader import Reader, try_reader
from tests.fuzz.readers import READERS
from tests.fuzz.run import prepared, run_plain

SECONDS = 2.0


@pytest.mark.slow
@pytest.mark.parametrize("name", READERS)
def test_no_damage_breaks_a_reader(name):
    record = run_plain(READERS[name], SECONDS)
    assert {place: defect.what for place, (defect, _) in record.defects.items()} == {}


def test_the_whole_files_are_read(tmp_path):
    n_read = 0
    for name in ("carmen", "settings", "ply", "poses"):
        folder = tmp_path / name
        folder.mkdir()
        for data in prepared(READERS[name], folder):
            (folder / READERS[name].file).write_bytes(data)
            READERS[name].read(folder / READERS[name].file)
            n_read += 1
    assert n_read >= 4, "a reader without a whole file to damage finds nothing"


@pytest.mark.parametrize(
    ("read", "words"),
    [
        (lambda path: 1 / 0, "ZeroDivisionError"),
        (lambda path: [][0], "IndexError"),
    ],
)
def test_a_reader_that_breaks_is_found(tmp_path, read, words):
    assert words in try_reader(Reader("a", lambda _: [b"a"], read), tmp_path, b"a").what


def test_damage_repeats_with_its_seed():
    data = bytes(range(256)) * 4
    made = [[damaged(data, random.Random(seed)) for seed in range(50)] for _ in range(2)]
    assert made[0] == made[1]
    assert len(set(made[0])) > 40


def test_the_check_sum_of_castagnoli():
    assert crc32c(b"123456789") == 0xE3069283
