from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mapq.cloud import SHIFT_ABOVE, PointCloud, choose_shift

FAR = st.floats(1e4, 1e9) | st.floats(-1e9, -1e4)
ANY = st.floats(-1e9, 1e9) | st.sampled_from([0.0, -0.0, np.nan, np.inf, -np.inf, 5e-324, 1e4, -1e4])


def bits(values) -> np.ndarray:
    return np.ascontiguousarray(values, dtype=np.float64).view(np.int64)


def check_exact(world: np.ndarray) -> np.ndarray:
    """The shift, after the one promise: taking it off and adding it again changes no bit of a finite coordinate."""
    shift = choose_shift(world)
    assert (shift == np.round(shift / 1000) * 1000).all()
    finite = np.isfinite(world)
    back = (world - shift) + shift
    moved = np.broadcast_to(shift != 0, world.shape) & finite
    assert np.array_equal(bits(back[moved]), bits(world[moved]))
    cloud = PointCloud.from_world(world)
    assert np.array_equal(cloud.shift, shift)
    assert np.array_equal(bits(cloud.world()[finite]), bits(world[finite]))
    assert np.array_equal(np.isnan(cloud.world()), np.isnan(world))
    return shift


@given(st.lists(st.tuples(FAR, FAR, FAR), min_size=1, max_size=20))
def test_far_coordinates(rows):
    check_exact(np.array(rows))


@given(st.lists(st.tuples(ANY, ANY, ANY), max_size=20))
def test_any_coordinates(rows):
    check_exact(np.array(rows, dtype=np.float64).reshape(-1, 3))


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("size", [1e4, 3.2e5, 5.4e6, 1e8])
def test_survey_grids(sign, size):
    rng = np.random.default_rng(1)
    world = sign * (size + rng.uniform(0, 3 * size, (1000, 3)))
    shift = check_exact(world)
    assert (np.abs(shift) > SHIFT_ABOVE - 1000).all()
    assert (np.sign(shift) == sign).all()


def test_points_of_zeros_do_not_spoil_the_shift():
    rng = np.random.default_rng(2)
    world = np.round(rng.uniform(0, 200, (500, 3)) + np.array([437000, 5428000, -300]), 3)
    world[::50] = 0.0
    assert check_exact(world).tolist() == [437000, 5428000, 0]
    world[7] = (0.1, -0.1, 0.3)  # no kilometre that is exact for the rest is exact for these
    assert check_exact(world).tolist() == [0, 0, 0]


def test_no_shift_near_the_origin():
    assert choose_shift(np.array([[9e3, -9e3, 0.0], [-1e4, 1e4, 5.0]])).tolist() == [0, 0, 0]
    assert choose_shift(np.array([[-2e4, 1.0, 1.0], [2e4, 2.0, 1.0], [1.0, 1.0, 1.0]])).tolist() == [0, 0, 0]
    assert choose_shift(np.empty((0, 3))).tolist() == [0, 0, 0]
    assert choose_shift(np.full((3, 3), np.nan)).tolist() == [0, 0, 0]


def test_the_shift_does_not_depend_on_the_order():
    rng = np.random.default_rng(3)
    world = rng.uniform(-100, 100, (99, 3)) + np.array([500_000, 0, -40_000])
    world[:3] = 0
    shift = choose_shift(world)
    assert np.array_equal(shift, choose_shift(world[rng.permutation(len(world))]))


def test_types_points_and_fields():
    world = np.array([[1, 2, 3], [np.nan, 5, 6], [7, 8, 9]], np.float32)
    cloud = PointCloud.from_world(world, {"label": np.array([1, 2, 3], np.uint8)})
    assert (cloud.coordinate_type, len(cloud)) == (np.float32, 3)
    assert PointCloud.from_world(world.astype(np.float64)).coordinate_type is np.float64
    assert cloud.finite().tolist() == [True, False, True]
    part = cloud.take(cloud.finite()).with_fields(more=np.array([0.5, 1.5]))
    assert part.fields["label"].tolist() == [1, 3]
    assert part.xyz.tolist() == [[1, 2, 3], [7, 8, 9]]
    assert part.xyz.flags.c_contiguous
    assert list(part.fields) == ["label", "more"]
    assert list(cloud.fields) == ["label"]
