"""A cloud in another order, place or unit: the same patches, labels and probabilities; turned, nearly the same."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from mapq.assess import Result, assess
from mapq.cloud import PointCloud
from mapq.features import measure_shapes
from mapq.io import read_cloud
from mapq.segmentation import segment
from tests.load.town import town
from tests.mapq.factories import moved, turn

Floats = NDArray[np.float64]
N_POINTS = 40_000
FOOT = 0.3048
QUARTER = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


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


def test_a_cloud_turned_by_90_degrees_has_nearly_the_same_patches_and_labels(data_dir):
    """Parameters are estimated from another sample then, about 1 per cent off, and pieces of walls end elsewhere."""
    cloud = read_cloud(str(data_dir / "demo-town.ply.gz"))
    known, other = assess(segment(cloud)), elsewhere(cloud, lambda xyz: xyz @ QUARTER.T)
    for name in ("spacing", "noise", "max_distance", "max_gap", "max_angle"):
        assert other.patches.parameters[name] == pytest.approx(known.patches.parameters[name], rel=0.02)
    assert abs(len(other.patches) - len(known.patches)) <= 0.05 * len(known.patches)
    both = (known.patches.patch >= 0) & (other.patches.patch >= 0)
    either = (known.patches.patch >= 0) | (other.patches.patch >= 0)
    assert both.sum() > 0.95 * either.sum()
    labels = [found.labelling.label[found.patches.patch[both]] for found in (known, other)]
    assert np.mean(labels[0] == labels[1]) > 0.9


def test_the_area_of_a_small_patch_does_not_hang_on_where_it_stands():
    patches = town(8)
    known = measure_shapes(patches)
    rng = np.random.default_rng(2)
    for _ in range(40):
        other = measure_shapes(moved(patches, turn(0.0), rng.uniform(-300.0, 300.0, 3)))
        np.testing.assert_allclose(other.cell, known.cell, rtol=1e-9)
        np.testing.assert_allclose(other.area, known.area, rtol=1e-9)
