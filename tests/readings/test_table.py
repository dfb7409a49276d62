from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prf.readings import Readings, read_readings, write_table
from prf.readings.table import read_table
from prf.shell.errors import InputError


def read(text: str):
    return read_table(text.encode(), "a.csv")


def refusal(text: str) -> str:
    with pytest.raises(InputError) as caught:
        read(text)
    return str(caught.value)


class TestColumns:
    def test_the_four_columns(self):
        readings = read("x,y,theta,range\n1,2,0.5,3\n1,2,0.6,4\n")
        np.testing.assert_array_equal(readings.origin, [[1, 2], [1, 2]])
        np.testing.assert_array_equal(readings.angle, [0.5, 0.6])
        np.testing.assert_array_equal(readings.range, [3, 4])
        np.testing.assert_array_equal(readings.cone, [0, 0])
        assert np.isnan(readings.time).all()

    def test_order_case_blanks_quotes_comments_and_further_columns(self):
        text = '# made by hand\n\n"Range", THETA ,y,x,quality\n# beam\n 3 , 0.5 ,2, 1 ,good\n\n'
        readings = read(text)
        assert (readings.range[0], readings.angle[0], *readings.origin[0]) == (3, 0.5, 1, 2)
        assert readings.notes.lines == {"further columns": 1}

    def test_cone_time_and_scan(self):
        readings = read("x,y,theta,range,cone,t,scan\n1,2,0,3,0.349,7.5,4\n1,2,0,3,0.349,,2\n1,2,0,5,0.3,8,4\n")
        np.testing.assert_array_equal(readings.cone, [0.349, 0.349, 0.3])
        np.testing.assert_array_equal(readings.time, [7.5, np.nan, 8])
        np.testing.assert_array_equal(readings.scan, [4, 2, 4])
        np.testing.assert_array_equal(readings.beam, [0, 0, 1])
        np.testing.assert_array_equal(readings.notes.scans.number, [2, 4])

    def test_no_return_is_empty_or_inf(self):
        readings = read("x,y,theta,range\n1,2,0,\n1,2,0,inf\n1,2,0, \n1,2,0,3\n")
        np.testing.assert_array_equal(readings.range, [np.inf, np.inf, np.inf, 3])
        assert readings.largest_range == 3

    def test_range_zero_is_dropped_and_counted(self):
        readings = read("x,y,theta,range\n1,2,0,0\n1,2,0.1,3\n")
        assert (readings.n_beams, readings.beam[0], readings.notes.n_zero_ranges) == (1, 1, 1)

    def test_rows_at_one_place_and_time_are_one_scan(self):
        text = "x,y,theta,range,t\n0,0,0,1,1\n0,0,1,1,1\n1,0,0,1,1\n1,0,1,1,2\n0,0,0,1,2\n"
        np.testing.assert_array_equal(read(text).scan, [0, 0, 1, 2, 3])
        np.testing.assert_array_equal(read("x,y,theta,range\n0,0,0,1\n0,0,1,1\n1,0,0,1\n").scan, [0, 0, 1])


class TestRefusals:
    @pytest.mark.parametrize(
        ("text", "words"),
        [
            ("x,y,value\n1,2,3\n", "no column theta, range. Point observations (x,y,value) are given as --point-data."),
            ("x,y,theta,range\n", "without a row"),
            ("x,y,theta,range\n1,2,3,4\n1,2,3\n", "a.csv:3: row of 3 fields under a header of 4."),
            ("x,y,theta,range\n\n1,2,3,four\n", "a.csv:3: could not convert string 'four' to float64."),
            ("x,y,theta,range\n1,,3,4\n", "could not convert string ''"),
            ("x,y,theta,range\n1,2,3,-0.5\n", "range is -0.5"),
            ("x,y,theta,range,cone\n1,2,3,4,7\n", "cone is 7"),
            ("x,y,theta,range,scan\n1,2,3,4,1.5\n", "scan is 1.5"),
            ("x,y,theta,range\n1,2,3,0\n", "every range is 0"),
        ],
    )
    def test_message(self, text, words):
        assert words in refusal(text)


class TestKinds:
    MIXED = "x,y,theta,range,cone\n1,2,0,3,0\n1,2,0,4,0.3\n"

    @pytest.mark.parametrize(("kind", "ranges"), [("laser", [3]), ("sonar", [4]), (None, [3, 4])])
    def test_the_cone_separates_them(self, kind, ranges):
        assert read_table(self.MIXED.encode(), "a.csv", kind).range.tolist() == ranges

    @pytest.mark.parametrize("cone", [0, 0.3])
    def test_rows_of_one_sort_are_taken_as_they_are(self, cone):
        text = f"x,y,theta,range,cone\n1,2,0,3,{cone}\n".encode()
        for kind in ("laser", "sonar"):
            assert read_table(text, "a.csv", kind).cone.tolist() == [cone]

    def test_a_sonar_table_without_the_column_gets_the_cone_of_the_option(self):
        text = b"x,y,theta,range\n1,2,0,3\n"
        assert read_table(text, "a.csv", "sonar").cone.tolist() == [0.349]
        assert read_table(text, "a.csv", "sonar", 0.5).cone.tolist() == [0.5]
        assert read_table(text, "a.csv", "laser").cone.tolist() == [0]


finite = st.floats(-1e6, 1e6)
rows = st.lists(
    st.tuples(
        finite,
        finite,
        st.floats(-10, 10),
        st.floats(0, exclude_min=True, allow_infinity=True),
        st.floats(0, 6),
        st.floats(-1e9, 1e9) | st.just(np.nan),
        st.integers(0, 2**40),
    ),
    min_size=1,
)


@given(rows)
def test_round_trip_is_exact(tmp_path_factory, some):
    x, y, angle, ranges, cone, time, scan = map(np.array, zip(*some, strict=True))
    written = Readings.from_arrays(np.column_stack((x, y)), angle, ranges, scan=scan, time=time, cone=cone)
    path = tmp_path_factory.getbasetemp() / "round.csv"
    write_table(path, written)
    read_back = read_readings(str(path), None)
    for name in ("origin", "angle", "range", "scan", "beam", "time", "cone"):
        before, after = getattr(written, name), getattr(read_back, name)
        np.testing.assert_array_equal(after, before)
        assert after.dtype == before.dtype
        assert after.flags.c_contiguous
