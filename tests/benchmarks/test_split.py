from __future__ import annotations

import numpy as np
import pytest

from benchmarks.split import split_by_place
from mapq.cloud import PointCloud
from prf.shell.errors import InputError


def street(shift=0.0):
    rng = np.random.default_rng(1)
    world = np.column_stack([rng.uniform(0, 200, 5000) + shift, rng.uniform(0, 30, 5000), rng.uniform(0, 5, 5000)])
    return PointCloud.from_world(world, {"number": np.arange(5000)}, "street")


@pytest.mark.parametrize("shift", [0.0, 4.5e5])
def test_the_parts_are_apart_by_the_buffer_and_hold_the_share(shift):
    cloud = street(shift)
    parts = split_by_place(cloud, 0.3, 20.0)
    assert parts.axis == 0
    assert parts.train.world()[:, 0].max() <= parts.strip[0]
    assert parts.test.world()[:, 0].min() >= parts.strip[1]
    assert parts.strip[1] - parts.strip[0] == pytest.approx(20.0)
    kept = len(parts.train) + len(parts.test)
    assert len(parts.test) / kept == pytest.approx(0.3, abs=0.02)
    assert kept + parts.n_dropped == len(cloud)
    assert not set(parts.train.fields["number"]) & set(parts.test.fields["number"])


def test_the_strip_is_in_metres_whatever_unit_the_cloud_has():
    plain = split_by_place(street(4.5e5), 0.3, 20.0)
    feet = PointCloud.from_world(street(4.5e5).world() / 0.3048, source="street", unit=0.3048)
    assert feet.shift.any()
    parts = split_by_place(feet, 0.3, 20.0)
    assert parts.strip == pytest.approx(plain.strip, abs=0.01)
    assert parts.test.metric_of(parts.test.xyz)[:, 0].min() >= parts.strip[1]


def test_the_axis_may_be_chosen_and_points_without_coordinates_go():
    cloud = street()
    cloud.xyz[7] = np.nan
    parts = split_by_place(cloud, 0.5, 2.0, axis=1)
    assert parts.axis == 1
    assert 7 not in {*parts.train.fields["number"], *parts.test.fields["number"]}


def test_a_buffer_as_wide_as_the_map_is_refused():
    with pytest.raises(InputError, match=r"street: 19\d m long, a buffer of 250 m leaves no two parts"):
        split_by_place(street(), 0.3, 250.0)
    nothing = PointCloud.from_world(np.full((3, 3), np.nan), source="none")
    with pytest.raises(InputError, match="none: no point"):
        split_by_place(nothing, 0.3, 1.0)
