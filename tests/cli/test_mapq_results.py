from __future__ import annotations

import json
import re
from dataclasses import replace

import numpy as np
import pytest

from mapq.io import read_cloud, write_patches, write_ply
from mapq.report.drawing import read_picture
from tests.cli.mapq_samples import call, call_json, save_model, save_patches
from tests.mapq.factories import sample_patches, wall

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


def test_a_result_in_its_words(capsys, result, tmp_path):
    code, out, _ = call(capsys, "render", result, "-o", tmp_path / "r.png", "--view", "plan")
    assert (code, out) == (0, "")
    assert (tmp_path / "r.png").read_bytes().startswith(b"\x89PNG")
    head = json.loads(result.with_suffix(".json").read_text())
    verdict = (
        f"{head['counts']['share_of_area']:.1%} of the area at 0.30 m, from p {head['threshold']['p_suspicious']:.2f}"
    )
    assert read_picture(str(result)).subtitle.endswith(f"32 patches  ·  16 suspicious  ·  {verdict}")


def test_a_cloud_with_labels_of_points_is_drawn_by_these(result):
    cloud = read_cloud(str(result))
    write_ply(result, replace(cloud, fields={"suspicious": cloud.fields["suspicious"]}))
    picture = read_picture(str(result))
    assert picture.title == "Field suspicious"
    assert picture.scheme.layer.max() == 2


def test_a_page_of_its_own(capsys, result, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code, out, err = call(capsys, "report", result, "--title", "Ours & <yours>")
    assert (code, out) == (0, "")
    page = result.with_suffix(".html").read_text()
    assert f"wrote {result.with_suffix('.html')}" in err
    assert "<h1>Ours &amp; &lt;yours&gt;</h1>" in page
    assert call(capsys, "report", result)[0] == 4
    assert call(capsys, "report", result, "-f")[0] == 0


def test_fewer_points_are_reported(capsys, result, tmp_path):
    _, _, err = call(capsys, "report", result, "--max-points", 1000, "-o", tmp_path / "x.html")
    shown = int(err.partition("views show ")[2].partition(" of ")[0].replace(",", ""))
    assert shown <= 1000
    assert f"{shown:,} of 7,680 points shown" in (tmp_path / "x.html").read_text()


def test_the_json_of_another_result_is_refused(capsys, result, tmp_path):
    """Of the same patches with other labels, as a process leaves it that is killed between the two files."""
    beside = result.with_suffix(".json")
    text = beside.read_text()
    assert '"label": "plausible"' in text
    beside.write_text(text.replace('"label": "plausible"', '"label": "suspicious"', 1))
    code, out, err = call(capsys, "report", result, "-o", tmp_path / "x.html")
    assert (code, out, err.count("\n")) == (3, "", 1)
    assert "which has other labels" in err


STREET = [wall((14.0 * k + 1, 2), (14.0 * k + 9, 2)) for k in range(4)]


@pytest.fixture
def files(tmp_path):
    clean, bad = tmp_path / "clean.patches", tmp_path / "bad.patches"
    write_patches(clean, sample_patches(STREET, density=20.0))
    write_patches(bad, sample_patches([*STREET, wall((1, 2.4), (9, 2.4))], density=20.0))
    return clean, bad, save_model(tmp_path)


def test_a_run_of_prf_is_named_before_any_output(capsys, tmp_path):
    (tmp_path / "my_map").mkdir()
    (tmp_path / "my_map" / "manifest.json").write_text("{}")
    (tmp_path / "my_map.html").write_text("kept")
    for force in ((), ("--force",)):
        code, _, err = call(capsys, "report", tmp_path / "my_map", *force)
        assert code == 3
        assert f"a RUN of prf, whose maps are of the plane. Show it: prf report {tmp_path / 'my_map'}" in err
    assert (tmp_path / "my_map.html").read_text() == "kept"


def test_it_prints_which_is_better_and_where(capsys, files):
    clean, bad, model = files
    code, out, err = call(capsys, "compare", bad, clean, "--model", model)
    assert (code, err) == (0, "")
    assert "B is better at 1 place:" in out
    assert re.search(r"B is better: [\d.]+% less of the area of B than of A is expected to be wrong", out)
    assert "in 0 0 0 to 10 5 5" in out


@pytest.mark.parametrize(("limit", "code"), [("1%", 1), ("0.9", 0), ("0", 1)])
def test_fail_over_fails_where_the_second_is_worse(capsys, files, limit, code):
    clean, bad, model = files
    found, out, err = call(capsys, "compare", clean, bad, "--model", model, "--fail-over", limit, "--json")
    assert found == code
    content = json.loads(out)
    assert content["schema"] == "mapq.compare/1"
    assert content["verdict"]["passed"] is (code == 0)
    assert ("the suspicious share of the area rose by" in err) == (code == 1)


def test_results_are_compared_by_their_labels(capsys, files, tmp_path):
    clean, bad, model = files
    results = [tmp_path / "a.ply", tmp_path / "b.ply"]
    for path, result in zip((clean, bad), results, strict=True):
        assert call(capsys, "classify", path, "--model", model, "-o", result)[0] == 0
    found = call_json(capsys, "compare", *results)
    assert found["better"] == "first"
    again = call_json(capsys, "compare", clean, bad, "--model", model)
    assert found["second"]["share_of_area"] == pytest.approx(again["second"]["share_of_area"], rel=1e-3)


def test_maps_that_share_little_are_doubted(capsys, files, tmp_path):
    model = files[2]
    far = [wall((200.0 + 14.0 * k, 2), (208.0 + 14.0 * k, 2)) for k in range(20)]
    first, second = tmp_path / "first.patches", tmp_path / "second.patches"
    write_patches(first, sample_patches([*STREET[:1], *far], density=20.0))
    write_patches(
        second, sample_patches([*STREET[:1], *(wall((0, -90.0 * k), (90, -90.0 * k)) for k in (1, 2))], density=20.0)
    )
    code, _, err = call(capsys, "compare", first, second, "--model", model)
    assert code == 0
    assert "are both in one frame?" in err
