"""Worlds for training: the same seed makes the same map, and labels say what was done to its poses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from data.training_scenes import SITES
from data.training_worlds import ScannedWorld, labelled, make_world, training_clouds
from data.true_ranges import true_ranges
from mapq.api import point_cloud
from mapq.cloud import PointCloud
from mapq.labels import SUSPICIOUS
from mapq.perturb import build
from tests.mapq.factories import make_patches

SHIFT = 0.5
FIELDS = {"scan", "time", "pass_id", "to_sensor_x", "to_sensor_y", "to_sensor_z", "suspicious", "disagreement"}


@pytest.fixture(scope="module")
def world() -> ScannedWorld:
    """A hall that ten scans or so see, thinned."""
    whole = make_world(3, "hall")
    return whole.take(np.random.default_rng(0).random(len(whole.scan)) < 60_000 / len(whole.scan))


def half_shifted(world: ScannedWorld, by: tuple[float, float, float]) -> PointCloud:
    used = world.poses.copy()
    used[::2, :3, 3] += by
    return labelled(world, used, "half shifted")


@pytest.mark.slow
def test_the_same_seed_makes_the_same_maps_and_another_one_does_not() -> None:
    one, again, other = (next(training_clouds(seed, "office")) for seed in (5, 5, 6))
    np.testing.assert_array_equal(one.xyz, again.xyz)
    assert one.source == again.source
    assert one.xyz.shape != other.xyz.shape


@pytest.mark.slow
@pytest.mark.parametrize("kind", SITES)
def test_right_maps_have_nothing_suspicious(kind: str) -> None:
    right, wrong = training_clouds(11, kind)
    assert set(right.fields) == set(wrong.fields) == FIELDS
    assert not (right.fields["suspicious"] == SUSPICIOUS).any()
    assert len(right) > 20_000
    assert np.isfinite(right.xyz).all()


def test_disagreement_is_the_part_of_a_shift_that_lies_along_the_normal(world: ScannedWorld) -> None:
    shifted = half_shifted(world, (SHIFT, 0.0, 0.0))
    normal = world.site.world.normal[np.maximum(world.surface, 0)]
    found = shifted.fields["disagreement"][world.surface >= 0]
    expected = SHIFT * np.abs(normal[world.surface >= 0, 0])
    # What only scans of one half see agrees with itself.
    moved = found > 1e-4
    assert 0.2 < moved.mean() < 0.95
    np.testing.assert_allclose(found[moved], expected[moved], atol=1e-4)


def test_a_shift_of_all_scans_together_is_no_error(world: ScannedWorld) -> None:
    used = world.poses.copy()
    used[:, :3, 3] += (SHIFT, SHIFT, 0.0)
    found = labelled(world, used, "all shifted").fields["disagreement"]
    assert np.nanmax(found) < 1e-6


def test_the_truth_is_that_of_build_where_both_know_it(world: ScannedWorld) -> None:
    """As `mapq.perturb.build` finds it by the points alone; that one cannot tell all surfaces apart."""
    used = world.poses.copy()
    used[::2, 0, 3] += SHIFT
    theirs = build(world.posed().with_poses(used, "shifted"), reference=world.poses).cloud.fields["suspicious"]
    ours = labelled(world, used, "shifted").fields["suspicious"]
    both = (theirs < 2) & (ours < 2)
    assert both.mean() > 0.5
    assert (theirs == ours)[both].mean() > 0.9


def test_true_ranges_are_of_scans_with_ten_points_on_the_surface():
    rng = np.random.default_rng(0)
    shifts = np.array([0.0, 0.12, -0.05, 0.9])
    scan = np.repeat(np.arange(4), [2000, 60, 10, 9])
    places = np.column_stack([rng.uniform(0.0, 4.0, (len(scan), 2)), np.zeros(len(scan))])[:, [0, 2, 1]]
    moved = np.tile(np.eye(4), (4, 1, 1))
    moved[:, 1, 3] = shifts
    moved[:, 0, 3] = 0.3  # along the wall, which leaves it where it is
    used = places + moved[scan, :3, 3]
    patches = make_patches([used[scan == 0]], np.array([[0.0, 1.0, 0.0]]), loose=0)
    cloud = point_cloud(np.vstack([used[scan == 0], used[scan != 0]]), {"scan": scan})
    patch = np.where(scan == 0, 0, -1).astype(np.int32)
    found = true_ranges(replace(patches, cloud=cloud, patch=patch), places, moved)
    assert found == pytest.approx([0.17]), "the last scan has nine points"
    alone = replace(patches, cloud=cloud.take(scan == 0), patch=patch[scan == 0])
    assert np.isnan(true_ranges(alone, places[scan == 0], moved)).all()
