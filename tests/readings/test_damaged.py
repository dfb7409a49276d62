"""Whatever a file holds, reading it ends in readings that hold what they promise, or in an `InputError`."""

from __future__ import annotations

import gzip

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prf.readings import Kind, Readings, describe, read_readings
from prf.shell.errors import InputError
from tests.readings.samples import flaser, player, player_laser, position, robot_laser

CARMEN = ("# FLASER\nPARAM a b nohost 0\n" + flaser([1.5, 0, 81.83]) + "NEFF 3\n" + robot_laser([1, 2])).encode()
TABLE = b"x,y,theta,range,cone,t,scan\n1,2,0.5,3,0,1,0\n1.5,2,0.5,inf,0,,0\n2,2,0,,0.1,2,1\n"
PLAYER = (
    player("laser", (0.1, 0, 0, 0.1, 0.1), kind="004 001")
    + position(0, 0, 0, 1)
    + player_laser([1, 2], 1.5)
    + player("sonar", (8, *[1.0] * 8), 1.6)
    + position(1, 0, 0, 2)
).encode()
SONAR = b"ODOM 0 0 0 0 0 0 1 h 1\nSONAR 0.3 2 1 2 0.1 0 0.5 0.1 0 -0.5 1.5 h 1.5\nODOM 1 0 0 0 0 0 2 h 2\n"
ZIPPED = gzip.compress(CARMEN, mtime=0)

pieces = st.sampled_from(
    [
        b"",
        b" ",
        b"\n",
        b",",
        b"nan",
        b"-1",
        b"inf",
        b"1e999",
        b"-inf",
        b"1e308",
        b"\0",
        b"_",
        b"\xff",
        b"FLASER",
        b"x,y,theta,range\n",
    ]
)


@st.composite
def damaged(draw):
    data = draw(st.sampled_from([CARMEN, TABLE, ZIPPED, PLAYER, SONAR]))
    for _ in range(draw(st.integers(1, 3))):
        start = draw(st.integers(0, len(data)))
        end = start + draw(st.integers(0, 12))
        data = data[:start] + draw(pieces | st.binary(max_size=4)) + data[end:]
    return data[: draw(st.integers(0, len(data)))] if draw(st.booleans()) else data


def check(path: str, kind: Kind | None = None) -> None:
    try:
        readings = read_readings(path, kind)
    except InputError as error:
        assert "\n" not in str(error)  # noqa: PT017 - nothing need be raised
        return
    check_promises(readings)
    with np.errstate(all="raise", under="ignore"):
        describe(readings, path)


def check_promises(readings: Readings) -> None:
    n = readings.n_beams
    assert n > 0
    assert readings.origin.shape == (n, 2)
    for name in ("angle", "range", "scan", "beam", "time", "cone"):
        array = getattr(readings, name)
        assert array.shape == (n,)
        assert array.flags.c_contiguous
    assert np.isfinite(readings.origin).all()
    assert np.isfinite(readings.angle).all()
    assert (readings.range > 0).all()
    assert not np.isinf(readings.time).any()
    assert (readings.scan >= 0).all()


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    return tmp_path_factory.mktemp("damaged") / "a.log"


@given(data=damaged(), kind=st.sampled_from([None, "laser", "sonar"]))
def test_damaged_logs(place, data, kind):
    place.write_bytes(data)
    check(str(place), kind)


@given(data=st.binary() | st.text().map(str.encode))
def test_anything(place, data):
    place.write_bytes(data)
    check(str(place))


@given(text=st.text(alphabet="FLASER 0123456789.-+einf\n,xytha", max_size=200))
def test_anything_like_a_log(place, text):
    place.write_bytes(b"FLASER 1 1 1 1 1 1 1 1 1 h 1\n" + text.encode())
    check(str(place))
    place.write_bytes(b"x,y,theta,range\n" + text.encode())
    check(str(place))
