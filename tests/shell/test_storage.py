"""Archives and JSON of ours that somebody else wrote, or a disk damaged."""

from __future__ import annotations

import io
import zipfile

import numpy as np
import pytest

from prf.shell.cli.storage import load_arrays, load_object
from prf.shell.errors import InputError

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
        with_header("{'descr': '|O', 'fortran_order': False, 'shape': (3,)}"),
        b"",
        stored(np.ones(9))[:-1],
    ],
    ids=["terabytes", "pickled", "empty", "cut"],
)
def test_damaged_arrays_are_reported(tmp_path, member, recwarn):
    path = archive(tmp_path / "a.npz", schema=stored(np.str_(SCHEMA)), values=member)
    assert str(path) in refusal(load_arrays, path, SCHEMA)
    assert len(recwarn) == 0


@pytest.mark.parametrize("text", ["[" * 100_000, '{"a": ' + "9" * 5000 + "}"])
def test_truncated_json_is_reported(tmp_path, text):
    (tmp_path / "a.json").write_text(text)
    assert "damaged" in refusal(load_object, tmp_path / "a.json", SCHEMA)
