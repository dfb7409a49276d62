from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mapq.configuration import FeatureSettings, TrainSettings
from mapq.features.compute import feature_settings
from mapq.io import write_patches
from mapq.io.models import read_model, write_model
from mapq.labels import FROM_FIELD, FROM_HAND, FROM_NOBODY, UNLABELLED, conservative_labels, majority_labels, metres_of
from mapq.patches import label_from_field
from mapq.results.result import assess
from mapq.training import tolerances_of, train_maps
from prf.shell.errors import InputError
from tests.mapq.factories import make_patches
from tests.mapq.labelled import draw_patches

PATCH = np.array([0, 0, 0, 1, 1, 2, 2, -1, -1], np.int32)
TRUTH = np.array([1, 0, 1, 0, 1, 0, 0, 1, 7])


def patches_with(values, **fields):
    points = [np.arange(9.0).reshape(3, 3), np.ones((2, 3)), np.zeros((2, 3))]
    patches = make_patches(points, np.eye(3), loose=2)
    assert patches.patch.tolist() == PATCH.tolist()
    return replace(patches, cloud=patches.cloud.with_fields(truth=np.array(values)), **fields)


def test_the_majority_labels_and_a_tie_is_suspicious():
    label, ties = majority_labels(PATCH, 4, TRUTH)
    assert label.tolist() == [1, 1, 0, UNLABELLED]
    assert ties.tolist() == [False, True, False, False]


@pytest.mark.parametrize("kind", [np.uint8, np.int64, np.float32, bool])
def test_labels_of_a_field_of_any_type(kind):
    labelled, counts = label_from_field(patches_with(TRUTH.clip(0, 1).astype(kind)), "truth", "f")
    assert labelled.label.tolist() == [1, 1, 0]
    assert labelled.label_source.tolist() == [FROM_FIELD] * 3
    assert tuple(counts.values()) == (3, 2, 1, 0, 1, 0)
    assert (labelled.label.dtype, labelled.label_source.dtype) == (np.uint8, np.uint8)


def test_a_patch_is_unlabelled_where_most_of_its_points_are():
    labelled, counts = label_from_field(patches_with([255, 0, 255, 255, 255, 1, 255, 0, 0]), "truth", "f")
    assert labelled.label.tolist() == [UNLABELLED, UNLABELLED, 1]
    assert labelled.label_source.tolist() == [FROM_NOBODY, FROM_NOBODY, FROM_FIELD]
    assert counts["n_unlabelled"] == 2


def test_points_without_a_label_do_not_count_where_they_are_fewer():
    labelled, _ = label_from_field(patches_with([255, 0, 0, 1, 255, 0, 0, 0, 0]), "truth", "f")
    assert labelled.label.tolist() == [0, 1, 0]


def test_labels_by_hand_stay_unless_forced():
    by_hand = {"label": np.array([0, 0, UNLABELLED], np.uint8), "label_source": np.array([2, 1, 2], np.uint8)}
    labelled, counts = label_from_field(patches_with(TRUTH, **by_hand), "truth", "f")
    assert labelled.label.tolist() == [0, 1, UNLABELLED]
    assert labelled.label_source.tolist() == [FROM_HAND, FROM_FIELD, FROM_HAND]
    assert (counts["n_kept"], counts["n_suspicious"], counts["n_plausible"], counts["n_unlabelled"]) == (2, 1, 1, 1)
    forced, counts = label_from_field(patches_with(TRUTH, **by_hand), "truth", "f", overwrite_hand=True)
    assert forced.label.tolist() == [1, 1, 0]
    assert counts["n_kept"] == 0


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ([1, 0, 2, 0, 1, 0, 3, 9, 9], r"must be 0, 1 or 255, but is not at 2 points of patches \(e\.g\. 2\)"),
        ([0.1, 0.2, -0.5, 0, 1, 0, 0, 0, 0], "has metres below 0, such as -0.5"),
        (np.zeros((9, 2)), "has 2 numbers a point"),
    ],
)
def test_what_is_no_label_is_refused(values, message):
    with pytest.raises(InputError, match=message):
        label_from_field(patches_with(values), "truth", "f")


METRES = [0.2, 0.4, 0.25, np.nan, 0.9, 0.31, np.nan, np.nan, 0.0]


def test_metres_apart_are_labels_at_every_tolerance():
    labelled, _ = label_from_field(patches_with(METRES), "truth", "f")
    np.testing.assert_allclose(labelled.apart, [0.25, 0.9, 0.31])
    assert labelled.label.tolist() == [0, 1, 1]
    assert [labelled.label_at(t).tolist() for t in (0.2, 0.28, 0.5, 1.0)] == [[1, 1, 1], [0, 1, 1], [0, 1, 0], [0] * 3]
    by_hand = replace(labelled, label=np.array([1, 1, 0], np.uint8), label_source=np.array([2, 2, 1], np.uint8))
    assert by_hand.label_at(0.5).tolist() == [UNLABELLED, UNLABELLED, 0], "a hand says nothing of other tolerances"
    assert by_hand.label_at(0.3).tolist() == [1, 1, 1]


def test_labels_that_are_given_leave_no_metres_behind():
    labelled, _ = label_from_field(patches_with(METRES), "truth", "f")
    assert labelled.labelled([0, 1, UNLABELLED]).label_at(0.3).tolist() == [0, 1, UNLABELLED]
    surely, _ = label_from_field(patches_with(METRES), "truth", "f", conservative=True)
    assert surely.apart is None
    assert surely.label_at(0.3).tolist() == [1, 1, 1]


def test_labels_without_metres_hold_on_one_side_of_their_tolerance():
    labelled, _ = label_from_field(replace(patches_with(TRUTH), label_tolerance=0.2), "truth", "f")
    assert labelled.apart is None
    assert [labelled.label_at(t).tolist() for t in (0.1, 0.2, 0.3)] == [[1, 1, 255], [1, 1, 0], [255, 255, 0]]
    assert tolerances_of([labelled]) == [0.2]
    metres, _ = label_from_field(patches_with(METRES), "truth", "f")
    assert tolerances_of([labelled, metres]) == [0.2, 0.3, 0.5, 0.8]


def test_the_median_of_metres_is_that_of_known_points():
    rng = np.random.default_rng(0)
    patch = rng.integers(-1, 20, 400).astype(np.int32)
    metres = np.where(rng.random(400) < 0.45, np.nan, rng.uniform(0.0, 1.0, 400))
    for number, found in enumerate(metres_of(patch, 22, metres)):
        own = metres[patch == number]
        known = np.sort(own[np.isfinite(own)])
        expected = known[len(known) // 2] if len(known) and 2 * len(known) >= len(own) else np.nan
        assert found == pytest.approx(expected, nan_ok=True)


def test_conservative_labels_are_plausible_only_if_surely_so():
    patch = np.repeat([0, 1, 2, 3, -1], [10, 10, 10, 2, 1]).astype(np.int32)
    values = np.concatenate([[0] * 9 + [1], [0] * 8 + [1, 255], [0] * 10, [255, 255], [0]])
    label, ties = conservative_labels(patch, 5, values)
    assert label.tolist() == [0, 1, 0, 1, 1]
    assert not ties.any()
    labelled, counts = label_from_field(patches_with([255, 0, 0, 0, 0, 1, 255, 0, 0]), "truth", "f", conservative=True)
    assert labelled.label.tolist() == [1, 0, 1]
    assert (counts["n_unlabelled"], counts["n_ties"]) == (0, 0)


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("maps")
    paths = []
    for seed in (1, 2):
        path = folder / f"{seed}.patches"
        write_patches(path, draw_patches(seed))
        paths.append(str(path))
    return paths


def test_double_walls_are_learnt_and_found_on_another_map(files, tmp_path):
    model = train_maps(files)
    assert model.training["held_out"]["accuracy"] > 0.9
    write_model(tmp_path / "m.json", model)
    other = draw_patches(3)
    label = assess(other, read_model(tmp_path / "m.json")).labelling.label
    assert (label == other.label).mean() > 0.95
    assert model.training["held_out"]["n_folds"] == 5


def test_the_summary_lists_the_training_maps(files):
    features = FeatureSettings(radius=2.5)
    model = train_maps(files, TrainSettings(potential="linear", regularisation=1.0), features)
    summary = model.training
    assert summary["n_patches"] == 64
    assert summary["n_suspicious"] == 32
    assert [row["name"] for row in summary["maps"]] == ["1.patches", "2.patches"]
    assert all(len(row["sha256"]) == 64 for row in summary["maps"])
    assert summary["regularisation"] == 1.0
    assert summary["class_weight"] == "balanced"
    assert summary["pseudo_log_likelihood"] < 0.0
    assert feature_settings(model) == features


def test_training_repeats(files):
    first, again = (train_maps(files) for _ in range(2))
    np.testing.assert_array_equal(first.weights, again.weights)
    assert first.calibration.slope == again.calibration.slope
    np.testing.assert_array_equal(first.operating, again.operating)


def test_conservative_training_counts_what_has_no_label_as_suspicious(tmp_path):
    patches = draw_patches(1)
    label = patches.label.copy()
    label[np.flatnonzero(label == 1)[:6]] = UNLABELLED
    paths = [str(tmp_path / "a.patches"), str(tmp_path / "bare.patches")]
    write_patches(paths[0], replace(patches, label=label))
    write_patches(paths[1], draw_patches(2, labelled=False))
    plain, careful = (train_maps(paths, conservative=each).training for each in (False, True))
    assert careful["n_suspicious"] == plain["n_suspicious"] + 6 == 16
    assert careful["n_patches"] == 32
    assert (plain["labels"], careful["labels"]) == ("given", "conservative")
