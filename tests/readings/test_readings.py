from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prf.readings import Readings
from prf.readings.readings import beam_numbers


def test_scalars_hold_for_every_beam():
    readings = Readings.from_arrays((1, 2), [0.1, 0.2, 0.3], [3, 4, np.inf], scan=7, cone=0.3)
    assert readings.origin.shape == (3, 2)
    np.testing.assert_array_equal(readings.scan, [7, 7, 7])
    np.testing.assert_array_equal(readings.beam, [0, 1, 2])
    assert (readings.n_beams, readings.n_scans, readings.largest_range) == (3, 1, 4.0)
    assert repr(readings) == "<prf.Readings: 3 sonar readings in 1 scans, arrays, within 0.0 x 0.0 m, up to 4.00 m>"
    assert "3 sonar readings in 1 scans" in readings._repr_html_()


def test_arrays_have_the_promised_types_and_own_their_memory():
    origin = np.zeros((2, 2))
    readings = Readings.from_arrays(origin, [0, 0], [1, 2])
    names = ("origin", "angle", "range", "time", "cone", "scan", "beam")
    assert [getattr(readings, name).dtype.str for name in names] == ["<f8"] * 5 + ["<i8", "<i4"]
    origin[:] = 5
    assert readings.origin.max() == 0


def test_shapes_that_do_not_agree():
    with pytest.raises(ValueError, match="shape"):
        Readings.from_arrays(np.zeros((2, 2)), [0, 0, 0], [1, 2, 3])


def test_no_finite_range():
    assert np.isnan(Readings.from_arrays((0, 0), [0], [np.inf]).largest_range)


@pytest.mark.parametrize("pick", [np.array([True, False, True]), np.array([2, 0])])
def test_select(pick):
    readings = Readings.from_arrays([[0, 0], [1, 1], [2, 2]], [0, 1, 2], [1, 2, 3], scan=[0, 0, 1])
    some = readings.select(pick)
    np.testing.assert_array_equal(some.range, readings.range[pick])
    np.testing.assert_array_equal(some.origin, readings.origin[pick])
    np.testing.assert_array_equal(some.beam, readings.beam[pick])
    assert some.origin.flags.c_contiguous
    assert some.notes is readings.notes


@given(st.lists(st.integers(0, 5)))
def test_beam_numbers_count_within_each_scan(scans):
    expected = [scans[:i].count(scan) for i, scan in enumerate(scans)]
    np.testing.assert_array_equal(beam_numbers(np.array(scans, dtype=np.int64)), expected)
