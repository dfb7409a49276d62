"""Whatever a file holds, reading it ends in a cloud that keeps its promises, or in an `InputError`."""

from __future__ import annotations

import gzip
import io
import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mapq.cloud import PointCloud
from mapq.io import read_cloud, write_ply
from prf.shell.errors import InputError
from tests.mapq.io.las_files import FOOT_WKT, geo_keys, las_bytes, wkt
from tests.mapq.io.samples import pcd, ply, table, text_rows
from tests.mapq.io.test_ptx import TURNED, ptx


def stored(save, *args, **arrays) -> bytes:
    stream = io.BytesIO()
    save(stream, *args, **arrays)
    return stream.getvalue()


ROWS = table(20)
FILES = {
    "le.ply": ply(ROWS),
    "be.ply": ply(ROWS, ">"),
    "text.ply": ply(ROWS, ""),
    "text.pcd": pcd(ROWS, "ascii"),
    "binary.pcd": pcd(ROWS),
    "packed.pcd": pcd(np.repeat(ROWS, 3), "binary_compressed"),
    "a.xyz": text_rows(ROWS).encode(),
    "a.csv": b"// made\n# by hand\nx , y,z,i\n" + text_rows(ROWS[["x", "y", "z", "field_u1"]], delimiter=",").encode(),
    "plain.npy": stored(np.save, np.ones((20, 4), np.float32)),
    "rows.npy": stored(np.save, ROWS),
    "a.npz": stored(np.savez, xyz=np.ones((20, 3)), label=np.arange(20)),
    "0.bin": np.random.default_rng(0).normal(size=(20, 4)).astype("<f4").tobytes(),
    "a.las": las_bytes(n=20, records=(wkt(FOOT_WKT),)),
    "a.laz": las_bytes(True, n=20, records=(geo_keys(k1024=1, k3076=9003),)),
    "layers.laz": las_bytes(True, n=20, kind=7, version="1.4"),
    "a.ptx": ptx(["1 2 3 0.5 10 20 255"] * 20, 4, TURNED).encode(),
    "a.3d": text_rows(ROWS[["x", "y", "z"]]).replace("nan", "0").encode(),
    "a.gz": gzip.compress(text_rows(ROWS).encode(), mtime=0),
}
COUNTS = {"packed.pcd": 60}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("damaged")


def check(path: str) -> None:
    try:
        cloud = read_cloud(path)
    except InputError as error:
        assert "\n" not in str(error)  # noqa: PT017 - nothing need be raised
        return
    check_promises(cloud)


def check_promises(cloud: PointCloud) -> None:
    n = len(cloud)
    assert n > 0
    assert cloud.finite().any()
    assert cloud.xyz.dtype == np.float64
    assert cloud.xyz.flags.c_contiguous
    assert cloud.xyz.flags.writeable
    assert np.isfinite(cloud.shift).all()
    for name, values in cloud.fields.items():
        assert isinstance(name, str)
        assert values.shape[0] == n
        assert values.flags.c_contiguous
        assert values.flags.writeable
        assert values.dtype.kind in "biuf"
        assert values.dtype.isnative
    write_ply("/dev/null", cloud)


@st.composite
def damaged(draw):
    # lazrs believes the sizes in a damaged LAZ, and can exhaust memory.
    name = draw(st.sampled_from(sorted(name for name in FILES if not name.endswith("laz"))))
    data = FILES[name]
    numbers = [match.span() for match in re.finditer(rb"\d+", data[:600])]
    for _ in range(draw(st.integers(0, 3))):
        if numbers and draw(st.booleans()):
            start, end = draw(st.sampled_from(numbers))
            piece = str(draw(st.integers(-1, 300) | st.integers(10**9, 10**13))).encode()
        else:
            start = draw(st.integers(0, len(data)))
            end = start + draw(st.integers(0, 12))
            piece = draw(
                st.binary(max_size=6) | st.sampled_from([b"\n", b"nan", b"1e999", b",", b" ", b"-", b"#", b"//"])
            )
        data = data[:start] + piece + data[end:]
    return name, data[: draw(st.integers(0, len(data)))] if draw(st.booleans()) else data


def test_the_whole_files_are_read(folder):
    for name, data in FILES.items():
        (folder / name).write_bytes(data)
        assert len(read_cloud(str(folder / name))) == COUNTS.get(name, 20)


@settings(max_examples=100)
@given(file=damaged())
def test_damaged_files(folder, file):
    name, data = file
    (folder / name).write_bytes(data)
    check(str(folder / name))


@pytest.mark.parametrize("name", FILES)
def test_every_cut(folder, name):
    data = FILES[name]
    for end in range(0, len(data), max(1, len(data) // 20)):
        (folder / name).write_bytes(data[:end])
        check(str(folder / name))
