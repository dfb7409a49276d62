"""LAZ in, LAZ out, through every verb that meets a cloud."""

from __future__ import annotations

import json
from pathlib import Path

import laspy
import numpy as np
import pytest

from mapq.io import read_cloud, write_cloud
from tests.cli.mapq_samples import call, call_json, save_model
from tests.mapq.labelled import draw_patches


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("las")


@pytest.fixture(scope="module")
def survey(folder) -> str:
    """Walls on a survey grid, as LAZ with the simulated truth as an extra dimension."""
    cloud = draw_patches(1).cloud
    path = str(folder / "survey.laz")
    far = type(cloud).from_world(cloud.world() + np.array([437_000.0, 5_428_000.0, 0.0]), cloud.fields)
    write_cloud(path, far)
    return path


@pytest.fixture(scope="module")
def model(folder) -> Path:
    return save_model(folder)


def test_laz_in_laz_out(capsys, folder, survey, model):
    target = folder / "result.laz"
    content = call_json(capsys, "classify", survey, "--model", model, "-o", target, "-f")
    assert content["output"] == str(target)
    assert json.loads((folder / "result.json").read_text())["counts"] == content["counts"]
    old, new = laspy.read(survey), laspy.read(target)
    for name in ("X", "Y", "Z", "truth"):
        np.testing.assert_array_equal(new[name], old[name], strict=True)
    assert {"patch", "suspicious", "p_suspicious"} <= set(new.point_format.extra_dimension_names)
    assert new.red.max() > 255
    found = call_json(capsys, "inspect", target)
    assert (found["kind"], found["format"]) == ("result", "las")
    assert found["patches"]["n_patches"] == content["counts"]["n_patches"]
    place = np.array(content["patches"][0]["centroid"])
    mine = new.patch == 0
    np.testing.assert_allclose(place, new.xyz[mine].mean(axis=0), atol=1e-3)


def test_by_way_of_patches_it_is_the_same(capsys, folder, survey, model):
    patches, target = folder / "survey.patches", folder / "again.laz"
    assert call(capsys, "segment", survey, "-o", patches, "-f")[0] == 0
    assert call(capsys, "classify", patches, "--model", model, "-o", target, "-f")[0] == 0
    assert call(capsys, "classify", survey, "--model", model, "-o", folder / "once.laz", "-f")[0] == 0
    first, second = (read_cloud(str(folder / name)) for name in ("again.laz", "once.laz"))
    assert first.world().tobytes() == second.world().tobytes()
    assert {k: v.tobytes() for k, v in first.fields.items()} == {k: v.tobytes() for k, v in second.fields.items()}


def test_results_in_las_are_read_by_the_other_verbs(capsys, folder, survey, model):
    target = folder / "r.las"
    assert call(capsys, "classify", survey, "--model", model, "-o", target, "-f")[0] == 0
    scores = call_json(capsys, "evaluate", target, "--truth-field", "truth")
    assert scores["n"] > 10
    compared = call_json(capsys, "compare", target, target)
    assert compared["better"] == "same"
    assert call(capsys, "render", target, "--view", "plan", "-o", folder / "r.png", "-f")[0] == 0


def test_places_are_in_the_unit_of_the_file_and_sizes_in_metres(capsys, folder, survey, model):
    content = call_json(capsys, "classify", survey, "--model", model, "--unit", "cm", "-o", folder / "cm.laz", "-f")
    las = laspy.read(folder / "cm.laz")
    low, high = las.header.mins - 0.01, las.header.maxs + 0.01
    for row in content["patches"]:
        mine = las.patch == row["patch"]
        np.testing.assert_allclose(row["centroid"], las.xyz[mine].mean(axis=0), atol=1e-3)
        sides = np.ptp(las.xyz[mine], axis=0)
        assert row["area_m2"] < 2e-4 * sides[2] * np.hypot(*sides[:2])
    for region in content["regions"]:
        assert (low <= region["low"]).all()
        assert (high >= region["high"]).all()


def test_the_unit_is_an_option(capsys, survey):
    plain, feet = call_json(capsys, "inspect", survey), call_json(capsys, "inspect", survey, "--unit", "ft")
    assert feet["cloud"]["spacing"] == pytest.approx(0.3048 * plain["cloud"]["spacing"], rel=0.05)
    assert feet["cloud"]["low"] == plain["cloud"]["low"]
    assert feet["cloud"]["unit"] == [0.3048] * 3
    assert "unit" in call(capsys, "inspect", survey, "--unit", "ft")[1]
    code, _, err = call(capsys, "inspect", survey, "--unit", "yard")
    assert (code, err.count("\n")) == (2, 1)
    assert "'yard': must be one of" in err
