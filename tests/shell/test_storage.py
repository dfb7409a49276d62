"""Archives and JSON of ours that somebody else wrote, or a disk damaged."""

from __future__ import annotations

import io
import zipfile

import numpy as np
import pytest

from prf.shell import gzipped
from prf.shell.errors import InputError
from prf.shell.storage import is_text, load_arrays, load_object, save_arrays

SCHEMA = "prf.some/1"


def archive(path, packing=zipfile.ZIP_STORED, **members: bytes):
    with zipfile.ZipFile(path, "w", packing) as stream:
        for name, data in members.items():
            stream.writestr(f"{name}.npy", data)
    return path


def stored(array) -> bytes:
    stream = io.BytesIO()
    np.save(stream, array)
    return stream.getvalue()


def with_header(text: str) -> bytes:
    head = text.encode().ljust(117) + b"\n"
    return b"\x93NUMPY\x01\x00" + len(head).to_bytes(2, "little") + head


def refusal(read, *args) -> str:
    with pytest.raises(InputError) as caught:
        read(*args)
    assert str(caught.value).isprintable()
    return str(caught.value)


@pytest.mark.parametrize(
    "member",
    [
        with_header("{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000000,)}"),
        with_header("{'descr': '<f8', 'fortran_order': False, 'shape': (4611686018427387904, 9)}"),
        with_header("{'descr': '<f8', 'fortran_order': False, 'shape': (9223372036854775808, 50)}"),
        with_header("{'descr': '<f8', 'fortran_order': False, 'shape': (-1,)}"),
        with_header("{'descr': '|O', 'fortran_order': False, 'shape': (3,)}"),
        with_header("{'descr': [[]], 'fortran_order': False, 'shape': 3}"),
        with_header("[" * 100),
        b"no array",
        b"",
        stored(np.ones(9))[:-1],
    ],
    ids=["terabytes", "overflow", "unsigned", "negative", "pickled", "types", "nesting", "other", "empty", "cut"],
)
def test_damaged_arrays_are_reported(tmp_path, member, recwarn):
    path = archive(tmp_path / "a.npz", schema=stored(np.str_(SCHEMA)), values=member)
    assert str(path) in refusal(load_arrays, path, SCHEMA)
    assert len(recwarn) == 0


def test_text_with_characters_that_do_not_exist(tmp_path):
    wild = np.array(["abc"]).view("<u4") + np.uint32(2**31)
    text = wild.view("<U3")
    assert not is_text(text)
    assert not is_text(text.astype(">U3"))
    assert is_text(np.array(["ab", "\U0010ffff"]))
    assert is_text(np.array([], "U3"))
    path = archive(tmp_path / "a.npz", schema=stored(text.reshape(())))
    assert "no array, or text" in refusal(load_arrays, path, SCHEMA)


@pytest.mark.parametrize("packing", [zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
def test_packing_that_numpy_never_uses_is_refused(tmp_path, packing):
    """100 kB of it unpack to gigabytes."""
    path = archive(tmp_path / "a.npz", packing, schema=stored(np.str_(SCHEMA)), values=stored(np.zeros(1 << 20)))
    assert path.stat().st_size < 10_000
    assert "packed as numpy never does" in refusal(load_arrays, path, SCHEMA)


def test_an_archive_larger_than_memory_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(gzipped, "most_unpacked", lambda: 1 << 20)
    save_arrays(tmp_path / "a.npz", SCHEMA, {"values": np.zeros(1 << 20)})
    assert "unpacked it is larger" in refusal(load_arrays, tmp_path / "a.npz", SCHEMA)


@pytest.mark.parametrize("text", ["[" * 100_000, '{"a": ' + "9" * 5000 + "}"])
def test_truncated_json_is_reported(tmp_path, text):
    (tmp_path / "a.json").write_text(text)
    assert "damaged" in refusal(load_object, tmp_path / "a.json", SCHEMA)
