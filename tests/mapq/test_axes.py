"""The axes of a map's own: they turn with the map, and hang on neither the order nor the parts of its points."""

from __future__ import annotations

from functools import reduce

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mapq.axes import TO_SENSOR, GroundPlan, corner_of, from_corner, turn, turn_cloud, turn_patches
from mapq.cloud import SHIFT_ABOVE, PointCloud, choose_shift
from tests.mapq.factories import make_patches, sample_patches, wall

POINTS = np.array([[-4.0, 2.0, 1.0], [3.0, 0.0, 5.0], [1.0, 1.0, 1.0]])
SHIFT = np.array([500_000.0, 5_000_000.0, 300.0])


def clouds() -> list[np.ndarray]:
    rng = np.random.default_rng(3)
    middles = rng.uniform(-80.0, 80.0, (12, 3))
    return [middle + rng.gamma(1.0, (9.0, 4.0, 2.0), (200, 3)) * rng.choice([-1.0, 1.0], 3) for middle in middles]


def quarter_of(xyz: np.ndarray) -> int:
    return GroundPlan.of(xyz).quarter()


def test_a_turn_is_exact_and_leaves_no_negative_zero():
    xyz = np.array([[0.0, 3.5, -0.0], [-1e-300, 0.0, 2.0]])
    assert turn(xyz, 1).tolist() == [[-3.5, 0.0, 0.0], [0.0, -1e-300, 2.0]]
    assert not np.signbit(turn(xyz, 1)[1, 0])
    for quarter in range(-4, 5):
        np.testing.assert_array_equal(turn(turn(xyz, quarter), -quarter), xyz)
        np.testing.assert_array_equal(turn(turn(xyz, quarter), 1), turn(xyz, quarter + 1))


@pytest.mark.parametrize("quarter", [1, 2, 3])
def test_axes_turn_with_the_map(quarter):
    found = set()
    for xyz in clouds():
        own = quarter_of(xyz)
        found.add(own)
        assert quarter_of(turn(xyz, quarter)) == (own - quarter) % 4
        assert quarter_of(turn(xyz, quarter) + SHIFT) == (own - quarter) % 4
    assert found == {0, 1, 2, 3}


def test_a_plan_hangs_on_neither_order_nor_parts():
    for xyz in clouds():
        known = GroundPlan.of(xyz)
        broken = np.concatenate([xyz, [[np.nan, 1e5, 0.0], [np.inf, 0.0, 0.0]]])
        shuffled = broken[np.random.default_rng(1).permutation(len(broken))]
        parts = [GroundPlan.of(part) for part in np.array_split(shuffled, 7)]
        for other in (GroundPlan.of(shuffled), reduce(GroundPlan.joined, parts, GroundPlan())):
            assert (other.n_points, other.sums) == (known.n_points, known.sums)
            np.testing.assert_array_equal([other.low, other.high], [known.low, known.high])


def test_no_axis_of_symmetry_is_a_border_of_the_choice():
    """The mean of a map with a mirror lies on its axis but for rounding, which must not decide."""
    for degrees in range(0, 360, 45):
        direction = np.array([np.cos(np.radians(degrees)), np.sin(np.radians(degrees)), 0.0])
        xyz = np.array([[-1.0, -1.0, 0.0], [1.0, 1.0, 0.0], 0.9 * direction])
        off = np.array([[0, 0, 0], [0, 0, 0], [1e-9, 0, 0]])
        assert len({quarter_of(xyz + turn(off, quarter)) for quarter in range(4)}) == 1


@pytest.mark.parametrize("shift", [0.0, 1234.567])
def test_a_map_with_its_mean_in_the_middle_lies_along_x(shift):
    corners = np.array([[x, y, 0.0] for x in (-1.0, 1.0) for y in (-3.0, 3.0)])
    for quarter in range(4):
        own = quarter_of(turn(corners, quarter) + shift)
        assert np.ptp(turn(turn(corners, quarter), own), axis=0).tolist() == [6.0, 2.0, 0.0]
    assert quarter_of(np.array([[x, y, 0.0] for x in (-1.0, 1.0) for y in (-1.0, 1.0)]) + shift) == 0


def test_a_cloud_turns_with_its_frame_and_the_ways_to_its_sensors():
    rng = np.random.default_rng(2)
    way = rng.normal(0.0, 1.0, (5, 3)).astype(np.float32)
    fields = {**dict(zip(TO_SENSOR, way.T, strict=True)), "scan": np.arange(5)}
    cloud = PointCloud.from_world(rng.normal(0.0, 9.0, (5, 3)) + SHIFT, fields, unit=np.array([2.0, 1.0, 0.5]))
    other = turn_cloud(cloud, 1)
    np.testing.assert_array_equal(other.world(), turn(cloud.world(), 1))
    np.testing.assert_array_equal(np.column_stack([other.fields[name] for name in TO_SENSOR]), turn(way, 1))
    np.testing.assert_array_equal(other.fields["scan"], cloud.fields["scan"])
    assert turn_cloud(cloud, 4) is cloud


def test_patches_turn_with_their_planes():
    patches = sample_patches([wall((0, 0), (9, 0)), wall((0, 5), (3, 9))])
    other = turn_patches(patches, 3)
    np.testing.assert_array_equal(other.cloud.xyz, turn(patches.cloud.xyz, 3))
    np.testing.assert_array_equal(other.normal, turn(patches.normal, 3))
    np.testing.assert_array_equal(other.centroid, turn(patches.centroid, 3))
    assert turn_patches(patches, 0) is patches


def test_places_are_counted_from_the_corner_of_all_patches():
    broken = np.concatenate([POINTS, [[np.nan, -9.0, 0.0]]])
    patches = make_patches([broken], [[0.0, 1.0, 0.0]], loose=3)
    corner = corner_of(patches)
    assert corner.tolist() == [-4.0, 0.0, 1.0]
    other = from_corner(patches, corner)
    np.testing.assert_array_equal(other.cloud.xyz, patches.cloud.xyz - corner)
    np.testing.assert_array_equal(other.centroid, patches.centroid - corner)
    np.testing.assert_array_equal(other.cloud.world(), patches.cloud.world())
    assert corner_of(make_patches([], [], loose=2)).tolist() == [0.0, 0.0, 0.0]


FAR = st.floats(1e4, 1e9) | st.floats(-1e9, -1e4)


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
