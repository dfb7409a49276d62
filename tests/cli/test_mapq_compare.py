from __future__ import annotations

import json
import re

import pytest

from mapq.io import read_patches, write_patches
from tests.cli.mapq_samples import call, call_json, save_model
from tests.mapq.factories import sample_patches, wall

STREET = [wall((14.0 * k + 1, 2), (14.0 * k + 9, 2)) for k in range(4)]


@pytest.fixture
def files(tmp_path):
    clean, bad = tmp_path / "clean.patches", tmp_path / "bad.patches"
    write_patches(clean, sample_patches(STREET, density=20.0))
    write_patches(bad, sample_patches([*STREET, wall((1, 2.4), (9, 2.4))], density=20.0))
    return clean, bad, save_model(tmp_path)


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


def test_a_result_without_its_json_is_named(capsys, files, tmp_path):
    clean, _, model = files
    result = tmp_path / "a.ply"
    assert call(capsys, "classify", clean, "--model", model, "-o", result)[0] == 0
    result.with_suffix(".json").unlink()
    code, _, err = call(capsys, "compare", result, result)
    assert (code, err.count("\n")) == (3, 1)
    assert "the JSON of this result is not beside it" in err


def test_columns_of_kitti_are_for_the_cloud_alone(capsys, files, tmp_path):
    clean, _, model = files
    scan = tmp_path / "scan.bin"
    scan.write_bytes(read_patches(clean).cloud.world().astype("<f4").tobytes())
    args = ("compare", clean, scan, "--model", model)
    assert call(capsys, *args, "--set", "cloud.bin_columns=3")[0] == 0
    assert call(capsys, *args, "--set", "cloud.bin_columns=5")[0] == 2
