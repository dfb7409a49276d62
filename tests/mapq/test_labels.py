from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mapq.labels import FROM_FIELD, FROM_HAND, FROM_NOBODY, UNLABELLED, conservative_labels, majority_labels
from mapq.patches import label_from_field
from prf.shell.errors import InputError
from tests.mapq.factories import make_patches

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
    assert counts == (3, 2, 1, 0, 1, 0)
    assert (labelled.label.dtype, labelled.label_source.dtype) == (np.uint8, np.uint8)


def test_a_patch_is_unlabelled_where_most_of_its_points_are():
    labelled, counts = label_from_field(patches_with([255, 0, 255, 255, 255, 1, 255, 0, 0]), "truth", "f")
    assert labelled.label.tolist() == [UNLABELLED, UNLABELLED, 1]
    assert labelled.label_source.tolist() == [FROM_NOBODY, FROM_NOBODY, FROM_FIELD]
    assert counts.n_unlabelled == 2


def test_points_without_a_label_do_not_count_where_they_are_fewer():
    labelled, _ = label_from_field(patches_with([255, 0, 0, 1, 255, 0, 0, 0, 0]), "truth", "f")
    assert labelled.label.tolist() == [0, 1, 0]


def test_labels_by_hand_stay_unless_forced():
    by_hand = {"label": np.array([0, 0, UNLABELLED], np.uint8), "label_source": np.array([2, 1, 2], np.uint8)}
    labelled, counts = label_from_field(patches_with(TRUTH, **by_hand), "truth", "f")
    assert labelled.label.tolist() == [0, 1, UNLABELLED]
    assert labelled.label_source.tolist() == [FROM_HAND, FROM_FIELD, FROM_HAND]
    assert (counts.n_kept, counts.n_suspicious, counts.n_plausible, counts.n_unlabelled) == (2, 1, 1, 1)
    forced, counts = label_from_field(patches_with(TRUTH, **by_hand), "truth", "f", overwrite_hand=True)
    assert forced.label.tolist() == [1, 1, 0]
    assert counts.n_kept == 0


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ([1, 0, 2, 0, 1, 0, 3, 9, 9], r"must be 0, 1 or 255, but is not at 2 points of patches \(e\.g\. 2\)"),
        ([1, 0, np.nan, 0, 1, 0, 0, 0, 0], r"at 1 points of patches \(e\.g\. nan\)"),
        (np.zeros((9, 2)), "has 2 numbers a point"),
    ],
)
def test_what_is_no_label_is_refused(values, message):
    with pytest.raises(InputError, match=message):
        label_from_field(patches_with(values), "truth", "f")


def test_a_missing_field_is_refused_with_those_there_are():
    with pytest.raises(InputError, match="city: no point field label; there are truth"):
        label_from_field(patches_with(TRUTH), "label", "city")


def test_no_patches_no_labels():
    none = make_patches([], np.empty((0, 3)), loose=3)
    none = replace(none, cloud=none.cloud.with_fields(truth=np.zeros(3)))
    labelled, counts = label_from_field(none, "truth", "f")
    assert len(labelled.label) == 0
    assert counts == (0, 0, 0, 0, 0, 0)


def test_conservative_labels_are_plausible_only_if_surely_so():
    patch = np.repeat([0, 1, 2, 3, -1], [10, 10, 10, 2, 1]).astype(np.int32)
    values = np.concatenate([[0] * 9 + [1], [0] * 8 + [1, 255], [0] * 10, [255, 255], [0]])
    label, ties = conservative_labels(patch, 5, values)
    assert label.tolist() == [0, 1, 0, 1, 1]
    assert not ties.any()
    labelled, counts = label_from_field(patches_with([255, 0, 0, 0, 0, 1, 255, 0, 0]), "truth", "f", conservative=True)
    assert labelled.label.tolist() == [1, 0, 1]
    assert (counts.n_unlabelled, counts.n_ties) == (0, 0)
