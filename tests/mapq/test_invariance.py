"""A cloud in another order, place or unit, or turned by quarters: the same patches, labels and probabilities."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from mapq.axes import GroundPlan, turn, turn_cloud
from mapq.cloud import PointCloud
from mapq.configuration import SIZES, SegmentSettings, SimulateSettings
from mapq.features import measure_shapes
from mapq.io import read_cloud
from mapq.results.result import Result, assess
from mapq.segmentation import segment
from mapq.simulate import simulate
from tests.mapq.factories import moved
from tests.mapq.town import town

Floats = NDArray[np.float64]
N_POINTS = 60_000
FOOT = 0.3048


@pytest.fixture(scope="module")
def cloud(data_dir):
    whole = read_cloud(str(data_dir / "demo-town.ply.gz"))
    return whole.take(np.sort(np.random.default_rng(0).permutation(len(whole))[:N_POINTS]))


@pytest.fixture(scope="module")
def known(cloud):
    result = assess(segment(cloud))
    assert 10 < int(result.labelling.label.sum()) < len(result.patches) - 10
    return result


def elsewhere(cloud: PointCloud, there: Callable[[Floats], Floats], unit: float = 1.0) -> Result:
    """Return what is said of a cloud whose world coordinates were changed."""
    return assess(segment(PointCloud.from_world(there(cloud.world()), cloud.fields, unit=unit)))


def check_same(known: Result, other: Result, tolerance: float) -> None:
    np.testing.assert_array_equal(other.patches.patch, known.patches.patch)
    np.testing.assert_array_equal(other.labelling.label, known.labelling.label)
    np.testing.assert_array_equal(other.features.pairs, known.features.pairs)
    np.testing.assert_allclose(other.features.node, known.features.node, rtol=0, atol=tolerance)
    np.testing.assert_allclose(other.features.edge, known.features.edge, rtol=0, atol=tolerance)
    np.testing.assert_allclose(other.labelling.probability, known.labelling.probability, rtol=0, atol=1e-6)


def test_points_in_another_order_change_nothing_to_the_last_bit(cloud, known):
    order = np.random.default_rng(1).permutation(len(cloud))
    other = assess(segment(cloud.take(order)))
    np.testing.assert_array_equal(other.patches.patch, known.patches.patch[order])
    for name in ("node", "edge", "plausibility", "shape"):
        np.testing.assert_array_equal(getattr(other.features, name), getattr(known.features, name))
    for one, two in zip(other.labelling, known.labelling, strict=True):
        np.testing.assert_array_equal(one, two)


SHIFTS = ((500_000.0, 5_000_000.0, 300.0), (1.37, -2.93, 0.11), (-8.4, -136.1, 93.8), (4662334.4, 279041.4, 427.1))


@pytest.mark.parametrize("shift", SHIFTS)
def test_a_cloud_at_another_place_has_the_same_patches_and_labels(cloud, known, shift):
    check_same(known, elsewhere(cloud, lambda xyz: xyz + np.array(shift)), 1e-7)


def test_a_cloud_in_feet_has_the_same_patches_and_labels(cloud, known):
    check_same(known, elsewhere(cloud, lambda xyz: xyz / FOOT, FOOT), 1e-7)


def test_a_cloud_that_differs_is_seen(cloud, known):
    noise = np.random.default_rng(4).normal(0.0, 0.02, (len(cloud), 3))
    other = elsewhere(cloud, lambda xyz: xyz + noise)
    assert not np.array_equal(other.patches.patch, known.patches.patch)


def turned(cloud: PointCloud, quarter: int, shift: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> PointCloud:
    """Return a cloud turned by quarters, then shifted, as if it had been written like that."""
    moved = turn_cloud(cloud, quarter)
    return PointCloud.from_world(moved.world() + np.array(shift), moved.fields)


@pytest.mark.parametrize("quarter", [1, 2, 3])
def test_a_cloud_turned_by_90_degrees_changes_nothing_to_the_last_bit(cloud, known, quarter):
    other = assess(segment(turned(cloud, quarter)))
    check_same(known, other, 0.0)
    np.testing.assert_array_equal(other.features.shape, known.features.shape)
    np.testing.assert_array_equal(other.labelling.difference, known.labelling.difference)
    np.testing.assert_array_equal(turn(other.patches.normal, -quarter), known.patches.normal)
    np.testing.assert_array_equal(turn(other.patches.centroid, -quarter), known.patches.centroid)
    assert other.patches.parameters == known.patches.parameters
    assert other.patches.report == known.patches.report


def test_a_cloud_turned_and_shifted_in_another_order_has_the_same_patches_and_labels(cloud, known):
    order = np.random.default_rng(3).permutation(len(cloud))
    other = assess(segment(turned(cloud, 3, SHIFTS[0]).take(order)))
    back = replace(other.patches, patch=other.patches.patch[np.argsort(order)])
    check_same(known, replace(other, patches=back), 1e-7)


def test_a_cloud_in_the_axes_of_its_file_would_differ_when_turned(cloud, known, monkeypatch):
    """What the axes of a map's own are for: else another sample tells its noise, and walks begin elsewhere."""
    monkeypatch.setattr(GroundPlan, "quarter", lambda plan: 0)
    other = segment(turned(cloud, 1))
    assert other.parameters["noise"] != known.patches.parameters["noise"]
    assert not np.array_equal(other.patch, known.patches.patch)


@pytest.mark.slow
def test_a_map_with_passes_and_sensors_is_the_same_turned_and_shifted():
    """What lies over a patch is found by cells of space, and from which side it was seen."""
    cloud = simulate(SimulateSettings(**SIZES["small"]), 3)
    known = assess(segment(cloud))
    for shift, tolerance in (((0.0, 0.0, 0.0), 0.0), (SHIFTS[1], 1e-7)):
        other = assess(segment(turned(cloud, 3, shift)))
        check_same(known, other, tolerance)
        assert {patch: cause.text for patch, cause in other.causes.items()} == {
            patch: cause.text for patch, cause in known.causes.items()
        }
    away = known.features.edge_names.index("facing_away")
    assert np.count_nonzero(known.features.edge[:, away]) > 10


def test_a_direction_of_up_is_turned_with_the_map(cloud):
    up = (0.1, 0.02, 1.0)
    known = assess(segment(cloud, SegmentSettings(up=up)))
    other = assess(segment(turned(cloud, 1), SegmentSettings(up=(-0.02, 0.1, 1.0))))
    check_same(known, other, 0.0)
    for found in (known.patches, known.features):
        assert found.parameters["up"] == pytest.approx(np.array(up) / np.linalg.norm(up))


@pytest.mark.parametrize("quarter", [1, 2, 3])
@pytest.mark.parametrize("n_fold", [2, 4])
def test_a_symmetrical_map_has_the_same_answer_at_each_place(n_fold, quarter):
    """Its own axes are not to be told from those turned by its symmetry, nor the points of one wall from another's."""
    rng = np.random.default_rng(5)
    side = np.column_stack([rng.uniform(-6.0, 8.0, 4000), 9.0 + rng.normal(0.0, 0.02, 4000), rng.uniform(0, 4, 4000)])
    xyz = np.concatenate([turn(side, k * 4 // n_fold) for k in range(n_fold)])
    answers = []
    for here in (xyz, turn(xyz, quarter)):
        found = assess(segment(PointCloud.from_world(here), SegmentSettings(min_extent=0.5)))
        assert len(found.patches) >= n_fold
        own = turn(here, GroundPlan.of(here).quarter())
        answers.append((own[np.lexsort(own.T)], found.patches.patch[np.lexsort(own.T)], found.labelling.probability))
    for one, two in zip(*answers, strict=True):
        np.testing.assert_array_equal(one, two)


def test_the_area_of_a_small_patch_does_not_hang_on_where_it_stands():
    patches = town(8)
    known = measure_shapes(patches)
    rng = np.random.default_rng(2)
    for _ in range(40):
        other = measure_shapes(moved(patches, np.eye(3), rng.uniform(-300.0, 300.0, 3)))
        np.testing.assert_allclose(other.cell, known.cell, rtol=1e-9)
        np.testing.assert_allclose(other.area, known.area, rtol=1e-9)
