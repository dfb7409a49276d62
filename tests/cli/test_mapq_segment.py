from __future__ import annotations

import csv
import io
import json
from pathlib import Path

import laspy
import numpy as np
import pytest

from mapq.cloud import PointCloud
from mapq.features import patch_features
from mapq.features.shape import SHAPE_NAMES
from mapq.io import read_cloud, read_patches, write_cloud, write_patches, write_ply
from mapq.labelling.store import open_store
from prf.shell.cli.outputs import release_claims
from tests.cli.mapq_samples import call, call_json, save_model
from tests.mapq.factories import sample_patches, wall
from tests.mapq.labelled import draw_patches
from tests.reference.mapq_segment import cloud_of, ground
from tests.reference.mapq_segment import wall as noisy_wall


def run(capsys: pytest.CaptureFixture[str], *args: str) -> tuple[int, str, str]:
    return call(capsys, "segment", *args)


@pytest.fixture
def map_ply(tmp_path: Path) -> str:
    cloud, truth = cloud_of(*(noisy_wall(np.random.default_rng(i), 6, 4, offset=0.3 * i) for i in range(2)))
    path = tmp_path / "map.ply"
    write_ply(str(path), cloud.with_fields(plane=truth.astype(np.int32)))
    return str(path)


def test_table_for_a_person_and_the_file_beside_the_cloud(capsys, map_ply):
    code, out, err = run(capsys, map_ply)
    assert (code, err) == (0, "")
    assert len(out.splitlines()) <= 15
    rows = dict(
        line.split(maxsplit=1) for line in out.splitlines() if line.split()[0] in ("patches", "output", "noise")
    )
    assert rows["patches"].startswith("2 of ")
    assert rows["output"] == map_ply.replace(".ply", ".patches")
    for name in ("spacing", "max distance", "dropped", "surfaces"):
        assert f"\n{name}" in out
    patches = read_patches(rows["output"])
    assert len(patches) == 2
    assert "plane" in patches.cloud.fields


def test_patches_that_are_being_labelled_are_not_replaced(capsys, map_ply):
    """Not even with force: labels would be lost."""
    assert run(capsys, map_ply)[0] == 0
    path = Path(map_ply).with_suffix(".patches")
    before = path.read_bytes()
    with open_store(str(path)):
        release_claims()
        code, _, err = run(capsys, map_ply, "-f")
    assert code == 4
    assert "another process" in err
    assert path.read_bytes() == before
    assert run(capsys, map_ply, "-f")[0] == 0


def test_json_has_parameters_and_report(capsys, map_ply, tmp_path):
    output = str(tmp_path / "out.patches")
    code, out, _ = run(capsys, map_ply, "-o", output, "--json", "--set", "segment.noise=0.03")
    result = json.loads(out)
    assert code == 0
    assert (result["schema"], result["output"]) == ("mapq.segment/1", output)
    assert result["parameters"]["noise"] == 0.03
    assert result["report"]["patches"] == len(result["n_points"]) == 2
    areas = patch_features(read_patches(output)).shape[:, SHAPE_NAMES.index("area_m2")]
    assert result["report"]["area"] == pytest.approx(areas.sum()), "as mapq classify has it"


def test_no_patches_is_a_result_with_a_warning(capsys, tmp_path):
    path = tmp_path / "ground.ply"
    write_ply(str(path), PointCloud.from_world(ground(np.random.default_rng(1))))
    code, out, err = run(capsys, str(path), "--surfaces", "upright,tilted")
    assert code == 0
    assert "no patches: all 1 planes found are level. Judge them by --surfaces level." in err
    assert "patches         0 of 0 points" in out
    assert len(read_patches(str(path.with_suffix(".patches")))) == 0


@pytest.mark.parametrize(
    ("name", "options", "fewest"),
    [
        ("dxmcu_map/pcd/0.pcd", (), 40),
        ("newer_college_01/planes_000000.bin", ("--set", "cloud.bin_columns=3"), 8),
        ("na_localization_maps/fenchalu/cloud_map.pcd", (), 15),
        ("pcl_data/region_growing_tutorial.pcd", ("--unit", "mm"), 20),
        ("small_gicp_pair/target.ply", (), 8),
    ],
)
def test_real_clouds(capsys, shared_data, tmp_path, name, options, fewest):
    path = shared_data / "mapq" / name
    code, out, _ = run(capsys, str(path), "-o", str(tmp_path / "p"), *options, "--json")
    report = json.loads(out)["report"]
    assert code == 0
    assert report["patches"] >= fewest
    assert report["warnings"] == []


CORNER = [wall((-5, 0), (5, 0)), wall((-5, 0.3), (5, 0.3)), wall((5, 0), (5, 8))]


@pytest.fixture
def path(tmp_path) -> str:
    write_patches(tmp_path / "map.patches", sample_patches(CORNER, density=10))
    return str(tmp_path / "map.patches")


def run_features(capsys, *args: str) -> tuple[int, str, str]:
    return call(capsys, "features", *args)


def test_json_holds_every_patch_and_pair(capsys, path):
    code, out, err = run_features(capsys, path, "--json")
    assert (code, err) == (0, "")
    result = json.loads(out)
    expected = patch_features(sample_patches(CORNER, density=10))
    assert result["schema"] == "mapq.features/1"
    assert (result["n_patches"], result["n_pairs"]) == (3, 3)
    assert [row["fit"] for row in result["nodes"]] == expected.node[:, 0].tolist()
    assert [row["plausibility"] for row in result["edges"]] == expected.plausibility.tolist()
    assert [[row["i"], row["j"]] for row in result["edges"]] == expected.pairs.tolist()
    for part in ("nodes", "edges"):
        assert list(result["units"][part]) == list(result[part][0])
    assert result["parameters"]["radius"] == 3.0


def test_csv_has_a_block_for_each(capsys, path):
    code, out, err = run_features(capsys, path, "--csv")
    assert (code, err) == (0, "")
    nodes, edges = (list(csv.DictReader(io.StringIO(block))) for block in out.split("\n\n"))
    assert [row["patch"] for row in nodes] == ["0", "1", "2"]
    assert [(row["i"], row["j"]) for row in edges] == [("0", "1"), ("0", "2"), ("1", "2")]
    expected = patch_features(sample_patches(CORNER, density=10))
    assert [float(row["plausibility"]) for row in edges] == expected.plausibility.tolist()
    assert [int(row["n_points"]) for row in nodes] == expected.shape[:, 0].tolist()


def test_table_for_a_person(capsys, path):
    code, out, err = run_features(capsys, path)
    assert (code, err) == (0, "")
    rows = [line.split() for line in out.splitlines()]
    assert len(rows) <= 16
    assert ["patches", "3"] in rows
    assert any(row[:1] == ["thickness_m"] and row[-1] == "m" for row in rows)
    assert len(run_features(capsys, path, "-v")[1].splitlines()) > 20


# LAZ in, LAZ out, through every verb that meets a cloud.


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
    lines = {}
    for unit in ("cm", "m"):
        code, out, _ = call(capsys, "classify", survey, "--model", model, "--unit", unit, "-o", folder / "u.laz", "-f")
        assert code == 0
        lines[unit] = out.splitlines()
    assert "; coordinates in units of 0.01 m)" in lines["cm"][-2]
    assert "; coordinates taken as metres)" in lines["m"][-2]
    assert [line for line in lines["cm"] if " m2 at " in line and "(file units)" not in line] == []
    assert "(file units)" not in "".join(lines["m"])
