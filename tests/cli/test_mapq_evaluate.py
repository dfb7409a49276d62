from __future__ import annotations

import numpy as np
import pytest

from mapq.io import read_cloud, write_ply
from tests.cli.mapq_samples import call, call_json, save_model, save_patches

KEYS = {"n", "accuracy", "confusion", "precision", "recall", "f1", "mcc", "ece", "auc"}


@pytest.fixture
def result(capsys, tmp_path):
    target = tmp_path / "r.ply"
    assert call(capsys, "classify", save_patches(tmp_path), "--model", save_model(tmp_path), "-o", target)[0] == 0
    return target


def test_a_result_is_compared_with_its_field_truth(capsys, result):
    scores = call_json(capsys, "evaluate", result)
    assert scores["schema"] == "mapq.evaluate/1"
    assert set(scores) >= KEYS | {"balanced_accuracy", "base_rate"}
    assert (scores["n"], scores["confusion"], scores["accuracy"]) == (32, [[16, 0], [0, 16]], 1.0)


def test_rows_are_inferred_and_columns_truth(capsys, result):
    cloud = read_cloud(str(result))
    patch = cloud.fields["patch"]
    wrong = np.where(np.isin(patch, np.flatnonzero(np.arange(32) % 4 == 0)), 0, cloud.fields["truth"])
    write_ply(result, cloud.with_fields(other=wrong.astype(np.uint8)))
    scores = call_json(capsys, "evaluate", result, "--truth-field", "other")
    label = np.array([cloud.fields["suspicious"][patch == number][0] for number in range(32)])
    truth = np.array([wrong[patch == number][0] for number in range(32)])
    expected = [[int(((label == row) & (truth == column)).sum()) for column in (0, 1)] for row in (0, 1)]
    assert scores["confusion"] == expected
    assert expected[1][0] > 0
    assert scores["precision"] == expected[1][1] / sum(expected[1])


def test_patches_are_classified_and_compared_with_their_labels(capsys, tmp_path):
    model = save_model(tmp_path)
    stored = call_json(capsys, "evaluate", save_patches(tmp_path), "--model", model)
    assert (stored["truth"], stored["accuracy"]) == ("labels of the patches", 1.0)
    field = call_json(capsys, "evaluate", save_patches(tmp_path, labelled=False), "--model", model)
    assert (field["truth"], field["accuracy"]) == ("point field truth", 1.0)
    named = call_json(capsys, "evaluate", save_patches(tmp_path), "--model", model, "--truth-field", "truth")
    assert named["truth"] == "point field truth"


def test_the_table_has_the_matrix_and_every_score(capsys, result):
    assert len(call(capsys, "evaluate", result)[1].splitlines()) <= 15
    code, out, err = call(capsys, "evaluate", result, "-v")
    assert (code, err) == (0, "")
    rows = [line.split() for line in out.splitlines()]
    assert ["plausible", "16", "0"] in rows
    assert ["suspicious", "0", "16"] in rows
    assert ["balanced", "accuracy", "1.0000"] in rows


def test_a_part_of_a_result_is_compared_by_the_patches_in_it(capsys, result):
    cloud = read_cloud(str(result))
    patch = cloud.fields["patch"]
    write_ply(result, cloud.with_fields(patch=np.where(patch >= 0, patch + 10**6, -1).astype(np.int32)))
    assert call_json(capsys, "evaluate", result)["n"] == 32
    write_ply(result, cloud.take(np.flatnonzero(patch == 31)[:5]))
    assert call_json(capsys, "evaluate", result)["n"] == 1
