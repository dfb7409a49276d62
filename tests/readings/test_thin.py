from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prf.readings import Readings, thin
from prf.readings.carmen import read_carmen
from prf.shell.errors import ConfigError, InputError
from tests.readings.samples import flaser

N_SCANS, N_BEAMS = 20, 6


@pytest.fixture(scope="module")
def readings() -> Readings:
    return read_carmen((flaser([1] * N_BEAMS) * N_SCANS).encode(), "a.log")


def scans_of(readings: Readings) -> list[int]:
    return np.unique(readings.scan).tolist()


def test_without_conditions_nothing_is_lost(readings):
    assert thin(readings).n_beams == N_SCANS * N_BEAMS


def test_every_scan_and_every_beam(readings):
    some = thin(readings, every_scan=7, every_beam=4)
    assert scans_of(some) == [0, 7, 14]
    assert np.unique(some.beam).tolist() == [0, 4]
    assert some.n_beams == 6


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("3:6", [3, 4, 5]),
        (":2", [0, 1]),
        ("18:", [18, 19]),
        ("5::8", [5, 13]),
        ("-2:", [18, 19]),
        (":-18", [0, 1]),
    ],
)
def test_slices(readings, text, expected):
    assert scans_of(thin(readings, scans=text)) == expected
    skipped = scans_of(thin(readings, skip_scans=text))
    assert skipped == [i for i in range(N_SCANS) if i not in expected]


def test_conditions_speak_of_scan_numbers_in_the_log(readings):
    assert scans_of(thin(readings, every_scan=3, scans="2:10")) == [3, 6, 9]
    assert scans_of(thin(readings, every_scan=2, scans="4:12", skip_scans="6:8")) == [4, 8, 10]


@given(st.integers(1, 25), st.integers(0, 9), st.integers(1, 9))
def test_mapped_and_held_out_scans_never_meet(readings, every, start, step):
    text = f"{start}::{step}"
    held_out = set(scans_of(thin(readings, scans=text)))
    try:
        mapped = set(scans_of(thin(readings, every_scan=every, skip_scans=text)))
    except InputError:
        mapped = set()
    assert not mapped & held_out
    assert mapped | held_out >= set(range(0, N_SCANS, every))


def test_thinning_twice_is_thinning_by_both(readings):
    twice = thin(thin(readings, every_scan=2), scans="-5:")
    np.testing.assert_array_equal(twice.scan, thin(readings, every_scan=2, scans="-5:").scan)


def test_dropped_beams_do_not_shift_the_others():
    some = thin(read_carmen(flaser([0, 1, 2, 3, 4]).encode(), "a.log"), every_beam=2)
    np.testing.assert_array_equal(some.range, [2, 4])


@pytest.mark.parametrize("text", ["", "5", "1:2:3:4", "a:b", "1.5:3", "::0", "::-1", "1:2:x"])
@pytest.mark.parametrize(("argument", "flag"), [("scans", "--scans"), ("skip_scans", "--skip-scans")])
def test_malformed_slices_name_the_option(readings, text, argument, flag):
    with pytest.raises(ConfigError, match=rf"^{flag} '"):
        thin(readings, **{argument: text})


@pytest.mark.parametrize(("argument", "flag"), [("every_scan", "--every-scan"), ("every_beam", "--every-beam")])
def test_steps_below_one_name_the_option(readings, argument, flag):
    for step in (0, -3):
        with pytest.raises(ConfigError, match=rf"^{flag} {step}"):
            thin(readings, **{argument: step})


def test_steps_of_any_size(readings):
    assert thin(readings, every_scan=10**30, every_beam=2**31).n_beams == 1


@pytest.mark.parametrize("wanted", [{"scans": "20:"}, {"scans": "5:5"}, {"skip_scans": ":"}])
def test_nothing_left(readings, wanted):
    with pytest.raises(InputError, match="no reading is left of 120 in scans 0 to 19"):
        thin(readings, **wanted)


def test_nothing_to_choose_from(readings):
    with pytest.raises(InputError, match="no readings"):
        thin(readings.select(np.zeros(readings.n_beams, dtype=bool)))
