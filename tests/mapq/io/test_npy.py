from __future__ import annotations

import io
import zipfile

import numpy as np
import pytest

from mapq.io import ReadOptions, read_cloud, write_patches
from tests.mapq.io.samples import check_same, patches, refusal, save, table


def npy(array: np.ndarray, **options) -> bytes:
    stream = io.BytesIO()
    np.save(stream, array, **options)
    return stream.getvalue()


@pytest.mark.parametrize("zipped", [False, True])
@pytest.mark.parametrize("order", ["C", "F"])
@pytest.mark.parametrize("kind", ["<f4", "<f8", ">f4", ">f8", "<i4", "<f2"])
def test_plain_arrays(tmp_path, kind, order, zipped):
    array = np.asarray(np.arange(40).reshape(8, 5), kind, order=order)
    cloud = read_cloud(save(tmp_path, "a.npy", npy(array), zipped))
    assert cloud.coordinate_type is (np.float32 if kind[1:] == "f4" else np.float64)
    assert cloud.xyz.tolist() == array[:, :3].tolist()
    assert list(cloud.fields) == ["column_4", "column_5"]
    assert cloud.fields["column_5"].dtype == np.dtype(kind).newbyteorder("=")
    assert cloud.fields["column_5"].tolist() == array[:, 4].tolist()


def test_structured_arrays(tmp_path):
    rows = table(coordinates="f8")
    check_same(read_cloud(save(tmp_path, "a.npy", npy(rows))), rows)
    big = rows.astype(rows.dtype.newbyteorder(">"))
    check_same(read_cloud(save(tmp_path, "a.npy", npy(big))), rows)
    upper = np.zeros(2, [("Z", "f8"), ("Y", "f8"), ("X", "f8"), ("größe", "?"), ("rgb", "u1", (3,))])  # format 3.0
    cloud = read_cloud(save(tmp_path, "a.npy", npy(upper)))
    assert {name: (values.dtype.name, values.shape) for name, values in cloud.fields.items()} == {
        "größe": ("bool", (2,)),
        "rgb": ("uint8", (2, 3)),
    }


def test_integers_of_las_are_refused_and_other_integers_are_not(tmp_path):
    rows = np.zeros(3, [("X", "i4"), ("Y", "i4"), ("Z", "i4")])
    rows["X"], rows["Z"] = (1, 2, 3), -7
    path = save(tmp_path, "a.npy", npy(rows))
    assert "--unit 0.01" in refusal(read_cloud, path)
    cloud = read_cloud(path, ReadOptions(unit=0.01))
    assert cloud.xyz[1].tolist() == [0.02, 0.0, -0.07]
    np.testing.assert_allclose(cloud.world()[1], [2.0, 0.0, -7.0], rtol=1e-15)
    rows.dtype.names = ("x", "y", "z")
    assert len(read_cloud(save(tmp_path, "a.npy", npy(rows)))) == 3


def test_archives(tmp_path):
    xyz = np.random.default_rng(0).normal(size=(7, 3)).astype(np.float32)
    path = str(tmp_path / "a.npz")
    for save_archive in (np.savez, np.savez_compressed):
        save_archive(path, label=np.arange(7, dtype=np.int64), xyz=xyz, version=np.str_("3"), other=np.zeros(6))
        cloud = read_cloud(path)
        assert cloud.xyz.astype(np.float32).tobytes() == xyz.tobytes()
        assert {name: values.tolist() for name, values in cloud.fields.items()} == {"label": list(range(7))}
    np.savez(path, x=xyz[:, 0], y=xyz[:, 1], z=xyz[:, 2])
    assert np.array_equal(read_cloud(path).xyz, xyz)


def test_a_patches_file_is_no_cloud(tmp_path):
    write_patches(tmp_path / "a.patches", patches())
    assert "this is mapq.patches/1, not a cloud" in refusal(read_cloud, str(tmp_path / "a.patches"))


@pytest.mark.parametrize(
    ("array", "line"),
    [
        (np.zeros((0, 3)), "no points"),
        (np.zeros((5, 2)), "of shape (5, 2)"),
        (np.zeros((5, 3), complex), "complex128"),
        (np.zeros(2, [("a", "f4"), ("y", "f4")]), "there are a, y"),
        (np.zeros(2, [("x", "f4", (2,)), ("y", "f4"), ("z", "f4")]), "not one real number a point"),
        (np.full((2, 3), np.nan), "all 2 points"),
    ],
)
def test_refused_arrays(tmp_path, array, line):
    assert line in refusal(read_cloud, save(tmp_path, "a.npy", npy(array)))


def test_fields_that_are_no_numbers_are_dropped(tmp_path, caplog):
    rows = np.zeros(2, [("x", "f4"), ("y", "f4"), ("z", "f4"), ("name", "U4"), ("when", "M8[s]"), ("id", "u8")])
    assert list(read_cloud(save(tmp_path, "a.npy", npy(rows))).fields) == ["id"]
    assert "fields name, when are dropped" in caplog.text


def test_pickles_and_other_archives_are_refused(tmp_path):
    data = npy(np.array([[1, 2, "x"]], dtype=object), allow_pickle=True)
    assert "pickle" in refusal(read_cloud, save(tmp_path, "a.npy", data))
    np.savez(tmp_path / "a.npz", xyz=np.array([[1, 2, None]], dtype=object))
    assert "pickle" in refusal(read_cloud, str(tmp_path / "a.npz"))
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as archive:
        archive.writestr("scan.pcd", "x")
    assert "there are scan.pcd" in refusal(read_cloud, str(tmp_path / "a.zip"))
    np.savez(tmp_path / "b.npz", x=np.zeros(3), y=np.zeros(3), z=np.zeros(4))
    assert "there are x, y" in refusal(read_cloud, str(tmp_path / "b.npz"))
