from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from mapq.cloud import PointCloud
from mapq.features import patch_features
from mapq.features.shape import SHAPE_NAMES
from mapq.io import read_patches, write_ply
from mapq.labelling.store import open_store
from prf.shell.cli.outputs import release_claims
from tests.cli.mapq_samples import call
from tests.reference.mapq_segment import cloud_of, ground, wall


def run(capsys: pytest.CaptureFixture[str], *args: str) -> tuple[int, str, str]:
    return call(capsys, "segment", *args)


@pytest.fixture
def map_ply(tmp_path: Path) -> str:
    cloud, truth = cloud_of(*(wall(np.random.default_rng(i), 6, 4, offset=0.3 * i) for i in range(2)))
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
    for name in ("spacing", "max distance", "dropped", "max tilt"):
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
    code, out, err = run(capsys, str(path))
    assert code == 0
    assert "no patches: all 1 found are tilted too far from vertical" in err
    assert "patches         0 of 0 points" in out
    assert len(read_patches(str(path.with_suffix(".patches")))) == 0


@pytest.mark.parametrize(
    ("name", "columns", "fewest"),
    [
        ("dxmcu_map/pcd/0.pcd", "4", 40),
        ("newer_college_01/planes_000000.bin", "3", 8),
        ("na_localization_maps/fenchalu/cloud_map.pcd", "4", 15),
        ("pcl_data/region_growing_tutorial.pcd", "4", 20),
        ("small_gicp_pair/target.ply", "4", 8),
    ],
)
def test_real_clouds(capsys, shared_data, tmp_path, name, columns, fewest):
    path = shared_data / "mapq" / name
    code, out, _ = run(capsys, str(path), "-o", str(tmp_path / "p"), "--set", f"cloud.bin_columns={columns}", "--json")
    report = json.loads(out)["report"]
    assert code == 0
    assert report["patches"] >= fewest
    assert report["warnings"] == []
