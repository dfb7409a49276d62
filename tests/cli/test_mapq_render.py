from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mapq.io import read_cloud, write_ply
from mapq.report.drawing import read_picture
from tests.cli.mapq_samples import call, save_model, save_patches


@pytest.fixture
def result(capsys, tmp_path):
    target = tmp_path / "r.ply"
    assert call(capsys, "classify", save_patches(tmp_path), "--model", save_model(tmp_path), "-o", target)[0] == 0
    return target


def test_a_result_in_its_words(capsys, result, tmp_path):
    code, out, _ = call(capsys, "render", result, "-o", tmp_path / "r.png", "--view", "plan")
    assert (code, out) == (0, "")
    assert (tmp_path / "r.png").read_bytes().startswith(b"\x89PNG")
    assert read_picture(str(result)).subtitle.endswith("32 patches  ·  16 suspicious")


def test_a_part_of_a_result_counts_the_patches_in_it(result):
    cloud = read_cloud(str(result))
    write_ply(result, cloud.take(np.flatnonzero(cloud.fields["patch"] == 31)))
    assert "1 patches" in read_picture(str(result)).subtitle


def test_a_cloud_with_labels_of_points_is_drawn_by_these(result):
    cloud = read_cloud(str(result))
    write_ply(result, replace(cloud, fields={"suspicious": cloud.fields["suspicious"]}))
    picture = read_picture(str(result))
    assert picture.title == "Field suspicious"
    assert picture.scheme.layer.max() == 2
