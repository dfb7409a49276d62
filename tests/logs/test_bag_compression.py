"""Bags whose chunks, messages or files are compressed are read like plain ones; other compression is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode
from rosbags.rosbag2 import Writer as Writer2

from prf.logs import read_readings
from prf.shell.errors import InputError
from tests.logs import bags
from tests.logs.bags import START, Maker, Note, drive


def make(kind: str, path: Path) -> Path:
    maker = Maker(kind)
    notes = [*drive(maker), Note("/scan", START + 0.5, maker.scan(START + 0.5, [1.0, 2.0, np.inf]))]
    return maker.write(path, sorted(notes, key=lambda note: note.time))


def ranges(path: Path) -> list[float]:
    return list(read_readings(str(path)).range)


@pytest.mark.parametrize("packing", list(Writer1.CompressionFormat), ids=lambda packing: packing.name)
def test_chunks_of_ros1(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, packing: Writer1.CompressionFormat) -> None:
    class Packing(Writer1):
        def open(self) -> None:
            self.set_compression(packing)
            super().open()

    whole = ranges(make("ros1", tmp_path / "plain.bag"))
    monkeypatch.setattr(bags, "Writer1", Packing)
    packed = make("ros1", tmp_path / "packed.bag")
    assert ranges(packed) == whole
    name = {"LZ4": b"lz4", "BZ2": b"bz2"}[packing.name]
    data = packed.read_bytes()
    assert b"compression=" + name in data
    packed.write_bytes(data.replace(b"compression=" + name, b"compression=xyz"))
    with pytest.raises(InputError, match=r"packed\.bag: the bag is damaged, or of a version .*reindex"):
        ranges(packed)


@pytest.mark.parametrize("mode", [CompressionMode.FILE, CompressionMode.MESSAGE], ids=lambda mode: mode.name)
@pytest.mark.parametrize("kind", ["sqlite3", "mcap"])
def test_ros2_in_zstd(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str, mode: CompressionMode) -> None:
    if kind == "mcap" and mode is CompressionMode.MESSAGE:
        pytest.skip("MCAP packs chunks, not messages")

    class Packing(Writer2):
        def open(self) -> None:
            self.set_compression(mode, CompressionFormat.ZSTD)
            super().open()

    whole = ranges(make(kind, tmp_path / "plain"))
    monkeypatch.setattr(bags, "Writer2", Packing)
    assert ranges(make(kind, tmp_path / "packed")) == whole
