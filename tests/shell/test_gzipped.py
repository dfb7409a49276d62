from __future__ import annotations

import gzip

import pytest

from prf.shell import gzipped
from prf.shell.errors import InputError
from prf.shell.gzipped import gunzip

DATA = b"some text\n" * 1000


def test_what_was_packed_comes_back(monkeypatch):
    monkeypatch.setattr(gzipped, "PIECE", 7)
    assert gunzip(gzip.compress(DATA) + gzip.compress(b"more"), "a.gz") == DATA + b"more"
    assert gunzip(gzip.compress(b""), "a.gz") == b""


def test_a_bomb_is_refused_before_it_is_unpacked(monkeypatch):
    monkeypatch.setattr(gzipped, "most_unpacked", lambda: 1 << 20)
    monkeypatch.setattr(gzipped, "PIECE", 1 << 16)
    with pytest.raises(InputError, match=r"^a\.gz: unpacked it is larger than 0\.00105 GB"):
        gunzip(gzip.compress(bytes(1 << 26)), "a.gz")


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (gzip.compress(DATA)[:-9], "cut off"),
        (gzip.compress(DATA)[:20] + b"\xff" * 9, "damaged"),
        (gzip.compress(DATA) + b"tail", "damaged"),
    ],
    ids=["cut", "overwritten", "with a tail"],  # the bytes hold the time of day, and names must not
)
def test_damage_is_reported(data, words):
    with pytest.raises(InputError, match=f"a.gz: the gzip file is {words}"):
        gunzip(data, "a.gz")
