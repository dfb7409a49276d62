"""The parts of the benchmark on real maps that decide what its figures mean."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks import real_data, real_methods, real_pairs
from benchmarks.entropies import entropies
from mapq.cloud import PointCloud
from mapq.labels import PLAUSIBLE, UNLABELLED
from tests.mapq.factories import make_patches, wall
from tests.mapq.labelled import draw_patches
from tests.mapq.perturb.scenes import pose_at


def test_the_disagreement_of_a_patch_is_the_median_of_what_is_known():
    patches = make_patches([np.zeros((4, 3)), np.ones((3, 3)), np.ones((2, 3))], np.eye(3), loose=1)
    metres = np.array([0.1, 0.2, 0.3, np.nan, np.nan, np.nan, 0.5, 0.7, 0.9, 4.0])
    patches = replace(patches, cloud=patches.cloud.with_fields(disagreement=metres))
    np.testing.assert_allclose(real_data.disagreement_of(patches), [0.2, np.nan, 0.8])


def test_sub_maps_alone_are_plausible():
    patches = real_data.plausible(make_patches([np.zeros((4, 3))], np.eye(3)[:1]))
    assert patches.label.tolist() == [PLAUSIBLE]


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
