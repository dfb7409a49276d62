"""The parts of the benchmark on real maps that decide what its figures mean."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks import causes, real_methods, real_pairs
from benchmarks.drawn_labels import draw_labels
from benchmarks.entropies import entropies
from benchmarks.map_metrics import map_metrics
from benchmarks.plane_scores import score_segmentation
from benchmarks.split import split_by_place
from mapq.cloud import PointCloud
from mapq.configuration import SimulateSettings
from mapq.labels import UNLABELLED
from mapq.perturb import build
from mapq.results.causes import LOCAL, MISSED_LOOP
from mapq.simulate import simulate
from tests.mapq.factories import make_patches, wall
from tests.mapq.labelled import draw_patches
from tests.mapq.perturb.scenes import pose_at


def test_errors_of_a_pair_have_the_given_size():
    pose = pose_at(3.0, 4.0, 20.0)
    moved = real_pairs.wrong_pose(pose, 0.03, 0.3, np.random.default_rng(1))
    assert np.linalg.norm(moved[:3, 3] - pose[:3, 3]) == pytest.approx(0.3)
    turned = moved[:3, :3] @ pose[:3, :3].T
    assert np.arccos((np.trace(turned) - 1.0) / 2.0) == pytest.approx(0.03)


def test_maps_are_judged_by_what_other_sets_teach():
    source = np.repeat(["a", "b", "c"], 20)
    wrong = np.tile([False, True], 30)
    rng = np.random.default_rng(3)
    clear, noise = wrong + 0.1 * rng.standard_normal(60), rng.standard_normal(60)
    right = (real_pairs.foreseen(np.column_stack([clear, noise]), wrong, source) > 0.0) == wrong
    assert right.all()
    # A set whose numbers are ten higher is parted well by itself, and not at all by what the others teach.
    shifted = np.column_stack([clear + 10.0 * (source == "b")])
    said = real_pairs.foreseen(shifted, wrong, source)
    assert (said[source == "b"] > 0.0).all()
    assert real_pairs._auc(said[source == "b"], wrong[source == "b"]) == 1.0


def test_accuracies_are_listed_by_level_and_set():
    maps = [
        real_pairs.Pair(name, level, wrong, {"clear": [float(wrong) + 0.01 * at], "blind": [1.0]})
        for name in ("one", "two")
        for level in (0, 1)
        for wrong in (False, True)
        for at in range(4)
    ]
    found = real_pairs.accuracies(maps)
    assert found["clear"][0] == {"all": 1.0, "auc": 1.0, "one": 1.0, "two": 1.0}
    assert found["blind"][1]["all"] == 0.5
    table = list(real_pairs.lines(maps, found))
    assert any(line.startswith("FACT") and "0.974" in line for line in table)


def test_joint_entropy_rises_with_an_error_and_separate_entropy_does_not():
    rng = np.random.default_rng(1)
    seen = [wall((0, 0), (8, 0)).sample(rng, 60.0, 0.02) for _ in range(2)]
    found = []
    for error in (0.0, 0.2):
        xyz = np.concatenate([seen[0], seen[1] + [0.0, error, 0.0]])
        ray = np.array([4.0, -6.0, 1.5]) - xyz
        fields = {"scan": np.repeat([0, 1], [len(each) for each in seen])}
        fields |= {f"to_sensor_{axis}": ray[:, k] for k, axis in enumerate("xyz")}
        found.append(entropies(PointCloud(xyz, np.zeros(3), fields)))
    (joint, separate), (worse, same) = found
    assert joint == pytest.approx(separate, abs=0.2)
    assert worse > joint + 0.7
    assert same == pytest.approx(separate, abs=0.1)


def test_methods_are_trained_and_scored_beside_the_majority():
    train, test = draw_patches(1, 48), draw_patches(2, 48)
    models = {name: real_methods.train_on([train], name) for name in real_methods.METHODS}
    scores = real_methods.score(models, [test], [train])
    assert list(scores) == ["majority", "nodes only", "paper-literal", "default"]
    assert scores["default"].auc >= max(scores["nodes only"].auc, 0.9)
    assert scores["majority"].auc == 0.5
    lines = real_methods.table(scores)
    assert len(lines) == 6
    assert real_methods.number(float("nan")) == "-"
    called = real_methods.share_called([test], "default", models["default"])
    assert called["patches"] == len(test)
    assert UNLABELLED not in real_methods.say(test, "default", models["default"]).label


# The parts of the benchmark on causes that decide what its figures mean.


def test_a_drive_that_is_cut_and_merged_is_the_map_again():
    cloud = simulate(SimulateSettings.of_size("small", {"n_points": 3000, "drift": 0.0}), 1)
    scans = causes.cut(cloud, 20.0)
    again = build(scans, reference=scans.poses).cloud
    np.testing.assert_allclose(again.xyz, cloud.xyz, atol=1e-4)
    assert len(scans) == len(np.unique(np.floor(cloud.fields["time"] / 20.0)))


def test_patches_belong_to_the_scans_that_most_of_their_points_are_of():
    patches = make_patches([np.zeros((10, 3)), np.ones((10, 3)), np.ones((10, 3))], np.eye(3), loose=1)
    cloud = patches.cloud.with_fields(scan=np.repeat([0, 9, 0, 9, 9], [10, 10, 5, 5, 1]))
    chosen = [causes.chosen(causes.Case("", cause, "", cloud, 5), patches).tolist() for cause in (MISSED_LOOP, LOCAL)]
    assert chosen == [[True, False, False], [False, True, False]]
    assert causes.chosen(causes.Case("", LOCAL, "", cloud), patches).all()


def test_a_limited_number_of_patches_is_drawn_in_places():
    maps = [draw_patches(1), draw_patches(2)]
    labels = draw_labels(maps, 20, seed=3)
    assert sum(int((label != UNLABELLED).sum()) for label in labels) == 20
    for patches, label in zip(maps, labels, strict=True):
        known = label != UNLABELLED
        np.testing.assert_array_equal(label[known], patches.label[known])
    assert any(len(a) and (a != b).any() for a, b in zip(labels, draw_labels(maps, 20, seed=4), strict=True))
    np.testing.assert_array_equal(labels[0], draw_labels(maps, 20, seed=3)[0])
    everything = draw_labels(maps, 1000, seed=1)
    np.testing.assert_array_equal(everything[1], maps[1].label)


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


def cloud_of(xyz: np.ndarray) -> PointCloud:
    return PointCloud(np.asarray(xyz, np.float64), np.zeros(3))


def sheet(n: int = 4000, noise: float = 0.02, double: float = 0.0, seed: int = 1) -> np.ndarray:
    """A level square of 5 m, half of whose points lie `double` metres higher."""
    rng = np.random.default_rng(seed)
    z = rng.normal(0.0, noise, n) + double * (np.arange(n) % 2)
    return np.column_stack([rng.uniform(0, 5, (n, 2)), z])


def by_definition(xyz: np.ndarray, radius: float) -> tuple[float, float]:
    """Both means, point by point."""
    entropy, variance = [], []
    for point in xyz:
        near = xyz[np.linalg.norm(xyz - point, axis=1) <= radius]
        if len(near) >= 5:
            sigma = np.cov(near.T)
            entropy.append(0.5 * np.log(np.linalg.det(2 * np.pi * np.e * sigma)))
            variance.append(np.linalg.eigvalsh(sigma)[0])
    return float(np.mean(entropy)), float(np.mean(variance))


@pytest.mark.parametrize("radius", [0.3, 0.8])
def test_it_is_the_definition(radius):
    xyz = sheet(600)
    found = map_metrics(cloud_of(xyz), radius)
    assert (found.mean_map_entropy, found.mean_plane_variance) == pytest.approx(by_definition(xyz, radius), rel=1e-9)


def test_a_doubled_surface_has_more_of_both():
    clean, double = (map_metrics(cloud_of(sheet(double=d))) for d in (0.0, 0.2))
    assert clean.mean_map_entropy < double.mean_map_entropy
    assert clean.mean_plane_variance == pytest.approx(0.02**2, rel=0.1)
    assert double.mean_plane_variance == pytest.approx(0.1**2 + 0.02**2, rel=0.1)


def repeat(*runs: tuple[int, int]) -> np.ndarray:
    return np.concatenate([np.full(n, value, np.int32) for value, n in runs])


def test_a_perfect_segmentation() -> None:
    truth = repeat((4, 50), (-1, 10), (9, 30))
    score = score_segmentation(repeat((1, 50), (-1, 10), (0, 30)), truth)
    assert (score.n_planes, score.n_patches, score.n_matched) == (2, 2, 2)
    assert (score.precision, score.recall, score.mean_iou, score.mean_dice) == (1, 1, 1, 1)
    assert (score.over_segmented, score.under_segmented, score.missed, score.noise) == (0, 0, 0, 0)
    assert score.plane.tolist() == [4, 9]
    assert score.best_patch.tolist() == [1, 0]


def test_a_plane_in_two_pieces_is_over_segmented() -> None:
    score = score_segmentation(repeat((0, 60), (1, 40)), repeat((0, 100)))
    assert (score.over_segmented, score.n_matched, score.missed, score.noise) == (1, 0, 0, 0)
    assert score.iou.tolist() == [0.6]
    assert score.mean_dice == pytest.approx(2 * 60 / 160)


def test_two_planes_in_one_patch_are_under_segmented() -> None:
    score = score_segmentation(repeat((0, 100)), repeat((0, 50), (1, 50)))
    assert (score.under_segmented, score.over_segmented, score.n_matched, score.missed) == (1, 0, 0, 0)


def test_missed_planes_and_noise() -> None:
    score = score_segmentation(repeat((-1, 80), (0, 20), (1, 30)), repeat((0, 100), (-1, 30)))
    assert (score.missed, score.noise) == (1, 1)
    assert (score.precision, score.recall) == (0, 0)
    assert score_segmentation(repeat((-1, 9)), repeat((0, 9))).best_patch.tolist() == [-1]


def test_the_threshold_is_strict() -> None:
    patch, truth = repeat((0, 75), (-1, 25)), repeat((0, 100))
    assert score_segmentation(patch, truth).n_matched == 0
    assert score_segmentation(patch, truth, 0.5).n_matched == 1
