from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from mapq.io import ReadOptions, read_cloud
from mapq.io.e57 import take_points
from tests.mapq.io.samples import refusal

pye57 = pytest.importorskip("pye57")
QUARTER = np.array([np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)])


def scan(n: int = 40, seed: int = 0) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(seed)
    data = {f"cartesian{axis}": rng.uniform(-20, 20, n) for axis in "XYZ"}
    data["intensity"] = rng.uniform(size=n).astype(np.float32)
    for colour in ("Red", "Green", "Blue"):
        data[f"color{colour}"] = rng.integers(0, 256, n).astype(np.uint8)
    data["cartesianInvalidState"] = (np.arange(n) % 10 == 3).astype(np.int8)
    return data


def write(path, *scans, poses=None):
    file = pye57.E57(str(path), mode="w")
    for data, (rotation, translation) in zip(scans, poses or [(None, None)] * len(scans), strict=True):
        file.write_scan_raw(data, rotation=rotation, translation=translation)
    file.close()
    return str(path)


def places(data) -> np.ndarray:
    valid = data["cartesianInvalidState"] == 0
    return np.column_stack([data[f"cartesian{axis}"] for axis in "XYZ"])[valid].astype(np.float32)


def test_a_scan_without_its_invalid_points(tmp_path):
    data = scan()
    cloud = read_cloud(write(tmp_path / "a.e57", data))
    np.testing.assert_allclose(cloud.xyz, places(data), atol=1e-4)
    assert len(cloud) == 36
    valid = data["cartesianInvalidState"] == 0
    for name, source in (("intensity", "intensity"), ("red", "colorRed"), ("blue", "colorBlue")):
        np.testing.assert_array_equal(cloud.fields[name], data[source][valid], strict=True)
    assert set(cloud.fields) == {"intensity", "red", "green", "blue"}


def test_several_scans_are_placed_and_numbered(tmp_path):
    parts = [scan(seed=0), scan(seed=1, n=20)]
    far = np.array([437_000.0, 5_428_000.0, 50.0])
    path = write(tmp_path / "a.e57", *parts, poses=[(None, far), (QUARTER, far)])
    cloud = read_cloud(path)
    assert cloud.shift[1] == pytest.approx(5_427_000)
    assert cloud.fields["scan"].tolist() == [0] * 36 + [1] * 18
    local = places(parts[1]).astype(np.float64)
    turned = np.column_stack([-local[:, 1], local[:, 0], local[:, 2]])
    np.testing.assert_allclose(cloud.world()[36:], turned + far, atol=1e-4)
    assert read_cloud(path, ReadOptions(unit=0.5)).unit.tolist() == [0.5] * 3


def test_fields_that_only_one_scan_has_are_dropped(tmp_path, caplog):
    other = {name: values for name, values in scan().items() if name != "intensity"}
    cloud = read_cloud(write(tmp_path / "a.e57", scan(), other))
    assert "intensity" not in cloud.fields
    assert "field intensity is dropped: not alike in every scan" in caplog.text


def test_spherical_coordinates():
    columns = {
        "sphericalRange": np.array([2.0, 2.0]),
        "sphericalAzimuth": np.array([0.0, np.pi / 2]),
        "sphericalElevation": np.array([0.0, np.pi / 6]),
        "intensity": np.zeros(2),
    }
    np.testing.assert_allclose(take_points(columns, ""), [[2, 0, 0], [0, np.sqrt(3), 1]], atol=1e-12)
    assert set(columns) == {"intensity"}
    assert "neither cartesian nor spherical" in refusal(take_points, columns, "")


def test_damage_is_reported(tmp_path):
    whole = write(tmp_path / "a.e57", scan(2000))
    data = Path(whole).read_bytes()
    for cut in range(48, len(data), len(data) // 7):
        (tmp_path / "b.e57").write_bytes(data[:cut])
        assert "no E57 file that can be opened" in refusal(read_cloud, str(tmp_path / "b.e57"))
    middle = len(data) // 3
    (tmp_path / "b.e57").write_bytes(data[:middle] + b"\xff" * 40 + data[middle + 40 :])
    assert "scan 0: the points are damaged" in refusal(read_cloud, str(tmp_path / "b.e57"))


def test_without_pye57_the_extra_is_named(tmp_path, monkeypatch):
    path = write(tmp_path / "a.e57", scan())
    monkeypatch.setitem(sys.modules, "pye57", None)
    assert "pip install '.[e57]'" in refusal(read_cloud, path)
