from __future__ import annotations

import json

import numpy as np
import pytest

from mapq.cloud import PointCloud
from mapq.io import write_patches, write_ply
from mapq.io.describe import median_spacing
from tests.cli.mapq_samples import call
from tests.mapq.io.samples import patches, save


def run(capsys, *args: str) -> tuple[int, str, str]:
    return call(capsys, "inspect", *args)


def rows_of(out: str) -> dict[str, str]:
    return {line.split("  ")[0].strip(): line.partition("  ")[2].strip() for line in out.splitlines() if line[0] != " "}


def grid(spacing: float = 0.25, n: int = 40) -> np.ndarray:
    side = np.arange(n) * spacing
    return np.stack([*np.meshgrid(side, side), np.zeros((n, n))], axis=-1).reshape(-1, 3)


def test_a_cloud(capsys, tmp_path):
    world = grid() + np.array([437_000.5, 5_428_000, 0])
    world[0] = np.nan
    cloud = PointCloud.from_world(world, {"label": np.arange(1600, dtype=np.uint16), "void": np.full(1600, np.nan)})
    path = str(tmp_path / "a.ply")
    write_ply(path, cloud)
    code, out, err = run(capsys, path)
    assert (code, err) == (0, "")
    rows = rows_of(out)
    assert rows["kind"] == "cloud (ply)"
    assert rows["points"] == "1,600, 1 of them without coordinates"
    assert rows["extent"].startswith("9.75 x 9.75 x 0.00 m, x 437000.50 to 437010.25")
    assert rows["coordinates"].startswith("float64, ")
    assert rows["shift"].startswith("437000 5428000 0 m")
    assert rows["spacing"].startswith("0.25 m")
    assert "label  uint16  0 to 1599" in out
    assert "void  float64  no finite values" in out


def test_json(capsys, tmp_path):
    path = save(tmp_path, "a.xyz", "1 2 3 7\n1 2 4 8\n")
    code, out, err = run(capsys, path, "--json")
    assert (code, err) == (0, "")
    result = json.loads(out)
    assert result["schema"] == "mapq.inspect/1"
    assert (result["kind"], result["format"], result["patches"]) == ("cloud", "text", None)
    assert result["cloud"] == {
        "n_points": 2,
        "n_finite": 2,
        "low": [1, 2, 3],
        "high": [1, 2, 4],
        "shift": [0, 0, 0],
        "unit": [1, 1, 1],
        "coordinate_type": "float64",
        "fields": [{"name": "column_4", "type": "float64", "n_values": 1, "low": 7, "high": 8}],
        "spacing": 1,
    }


def test_patches(capsys, tmp_path):
    path = str(tmp_path / "a.patches")
    before = patches()
    write_patches(path, before)
    code, out, err = run(capsys, path, "-v")
    assert (code, err) == (0, "")
    rows = rows_of(out)
    assert rows["kind"] == "patches (mapq.patches/1)"
    assert rows["points"] == "60, 1 of them without coordinates"
    assert rows["patches"] == "3"
    assert rows["in patches"].startswith(f"{int(before.counts.sum())} points")
    assert rows["labels"] == "1 plausible, 1 suspicious, 1 unlabelled"
    assert rows["labels set"] == "1 by hand, 1 from a field"
    assert (rows["parameters.radius"], rows["parameters.up"]) == (repr(0.1 + 0.2), "0.0 0.0 1.0")
    assert rows["report.why.nan"] == "1"
    result = json.loads(run(capsys, path, "--json")[1])
    assert result["patches"]["labels"] == {"plausible": 1, "suspicious": 1, "unlabelled": 1}
    assert result["content"]["parameters"] == before.parameters


def result_file(tmp_path) -> str:
    fields = {
        "patch": np.array([0, 0, 0, 1, 1, -1], np.int32),
        "suspicious": np.array([1, 1, 1, 0, 0, 255], np.uint8),
        "p_suspicious": np.array([0.9, 0.9, 0.9, 0.2, 0.2, np.nan], np.float32),
    }
    path = tmp_path / "a.classified.ply"
    write_ply(path, PointCloud.from_world(grid()[:6], fields))
    return str(path)


def test_a_result(capsys, tmp_path):
    path = result_file(tmp_path)
    rows = rows_of(run(capsys, path)[1])
    assert rows["kind"] == "result (ply)"
    assert (rows["patches"], rows["labels"]) == ("2", "1 plausible, 1 suspicious")
    assert rows["in patches"] == "5 points, 2.5 a patch (median)"
    beside = {"schema": "mapq.result/1", "model": {"name": "built in"}, "patches": [{"label": 1}, {"label": 0}]}
    save(tmp_path, "a.classified.json", json.dumps(beside))
    rows = rows_of(run(capsys, path)[1])
    assert rows["model.name"] == "built in"
    assert rows_of(run(capsys, str(tmp_path / "a.classified.json"))[1])["kind"] == "result (mapq.result/1)"
    save(tmp_path, "a.classified.json", "{,}")
    code, out, err = run(capsys, path)
    assert (code, rows_of(out)["kind"]) == (0, "result (ply)")
    assert "a.classified.json:1: damaged" in err


def test_a_model(capsys, tmp_path):
    model = {"schema": "mapq.model/1", "node_names": ["fit", "tilt"], "weights": {"w": [0.5, -1.5], "v": None}}
    model["trained_on"] = [{"path": "a"}, {"path": "b"}]
    path = save(tmp_path, "model.json", json.dumps(model))
    code, out, err = run(capsys, path)
    assert (code, err) == (0, "")
    rows = rows_of(out)
    assert rows["kind"] == "model (mapq.model/1)"
    assert (rows["node_names"], rows["weights.w"], rows["weights.v"]) == ("fit tilt", "0.5 -1.5", "-")
    assert rows["trained_on"] == "2 entries"
    result = json.loads(run(capsys, path, "--json")[1])
    assert (result["kind"], result["cloud"]) == ("model", None)
    assert result["content"]["weights"]["w"] == [0.5, -1.5]


def test_the_spacing_depends_on_the_points_and_not_on_their_order():
    rng = np.random.default_rng(0)
    xyz = np.concatenate([rng.normal(size=(20_000, 3)), rng.normal(size=(3_000, 3)) * 0.01])
    first = median_spacing(xyz)
    assert median_spacing(xyz[rng.permutation(len(xyz))]) == first
    assert 0.8 < first / median_spacing_of_all(xyz) < 1.2
    assert median_spacing(grid(0.3, 60)) == pytest.approx(0.3)
    assert np.isnan(median_spacing(np.zeros((1, 3))))
    assert median_spacing(np.zeros((5, 3))) == 0.0


def median_spacing_of_all(xyz: np.ndarray) -> float:
    from scipy.spatial import cKDTree

    return float(np.median(cKDTree(xyz).query(xyz, k=2)[0][:, 1]))
