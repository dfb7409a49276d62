"""A disk that fails, or a server that is gone, while a file is read: one line with the file, whoever reads it."""

from __future__ import annotations

import errno
import io
import os
import stat
import sys

import pytest

from prf.shell import files
from prf.shell.errors import InputError
from tests.fuzz.readers import READERS

SUMMARISED = {"run-checkpoint", "run-picture"}
"""A summary says what is wrong with them, and goes on."""
ELSEWHERE = {"ros1", "ros2-sqlite", "ros2-mcap"}
"""rosbags opens these itself, once their heads are known; and metadata.yaml."""
CASES = [(name, 0.0) for name in READERS if name not in {*SUMMARISED, "ros2-metadata"}]
CASES += [(name, 0.5) for name, _ in CASES if name not in ELSEWHERE]
TOLD = "cannot be read (input/output error)."


class Failing(io.FileIO):
    """A file whose bytes from `after` on cannot be had."""

    after = 0

    def readinto(self, buffer):
        left = self.after - self.tell()
        if left <= 0:
            raise OSError(errno.EIO, os.strerror(errno.EIO))
        return super().readinto(memoryview(buffer)[:left])

    def read(self, size=-1):
        found = b""
        while size < 0 or len(found) < size:
            piece = bytearray(1 << 16 if size < 0 else size - len(found))
            n = self.readinto(piece)
            found += piece[:n]
            if not n:
                break
        return found


@pytest.fixture
def failing(monkeypatch):
    """Have what `open_input` opens under a name fail after some bytes."""

    def fail(path, after):
        def opened(name, *args, **kwargs):
            if os.fspath(name) != os.fspath(path):
                return open(name, *args, **kwargs)
            stream = Failing(name)
            stream.after = after
            return stream

        monkeypatch.setattr(files, "open", opened, raising=False)

    return fail


@pytest.mark.parametrize(("name", "part"), CASES)
def test_the_file_is_named_in_one_line(name, part, tmp_path, failing):
    reader = READERS[name]
    (tmp_path / "aside").mkdir()
    data = reader.seeds(tmp_path / "aside")[0]
    reader.surround(tmp_path)
    path = tmp_path / reader.file
    path.write_bytes(data)
    failing(path, int(part * len(data)))
    with pytest.raises(InputError) as refusal:
        reader.read(path)
    named_by = f"{tmp_path / 'map.yaml'}: image " if name == "cell-image" else ""
    assert str(refusal.value) == f"{named_by}{path}: {TOLD}"


def test_what_standard_input_cannot_give_is_said(monkeypatch, tmp_path):
    class Device(io.BytesIO):
        def read(self, *_):
            raise OSError(errno.EIO, os.strerror(errno.EIO))

        readinto = readline = read

    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(Device()))
    with (
        pytest.raises(InputError, match=r"^standard input: cannot be read \(input/output error\)\.$"),
        files.open_input("-") as stream,
    ):
        stream.read()


def test_what_was_not_read_of_standard_input_is_there_for_the_next(monkeypatch):
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(b"one\ntwo\n")))
    with files.open_input("-") as stream:
        assert stream.read() == b"one\ntwo\n"
    with files.open_input("-") as stream:
        assert stream.read() == b""


def test_a_stream_is_what_libraries_expect(tmp_path):
    path = tmp_path / "a"
    path.write_bytes(bytes(range(256)) * 4096)
    with files.open_input(path) as stream:
        assert stat.S_ISREG(os.fstat(stream.fileno()).st_mode)
        assert (stream.seekable(), stream.readable(), stream.writable(), stream.isatty()) == (True, True, False, False)
        assert stream.name == str(path)
        assert stream.read(3) == b"\x00\x01\x02"
        assert stream.seek(-2, os.SEEK_END) == (1 << 20) - 2
        assert stream.read() == b"\xfe\xff"
        assert stream.seek(255) == stream.tell() == 255
        assert len(stream.readline()) == 12
    assert stream.closed
