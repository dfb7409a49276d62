from __future__ import annotations

import io
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest

from mapq.axes import TO_SENSOR
from mapq.configuration import ReadOptions
from mapq.io import read_cloud, write_patches
from mapq.io.e57 import take_points
from prf.shell.errors import ArgumentError, UsageError
from tests.mapq.io.samples import check_same, patches, refusal, save, table


def scan(n: int, n_columns: int, seed: int = 0) -> np.ndarray:
    """A scan: far wider than high, intensities within 1."""
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(n, 4)) * (20, 12, 1.5, 0)
    points[:, 3] = rng.uniform(size=n)
    return points[:, :n_columns].astype("<f4")


@pytest.mark.parametrize("n_columns", [3, 4])
@pytest.mark.parametrize("n", [1, 12, 1200, 1201])
def test_the_number_of_columns_is_an_option(tmp_path, n, n_columns):
    points = scan(n, n_columns)
    cloud = read_cloud(save(tmp_path, "0.bin", points.tobytes()), ReadOptions(bin_columns=n_columns))
    assert cloud.coordinate_type is np.float32
    assert np.array_equal(cloud.xyz, points[:, :3])
    assert list(cloud.fields) == ["intensity"][: n_columns - 3]
    if n_columns == 4:
        assert cloud.fields["intensity"].tobytes() == points[:, 3].tobytes()


def test_a_size_that_does_not_divide(tmp_path):
    path = save(tmp_path, "0.bin", scan(5, 3).tobytes())
    assert "It divides by 12: --set cloud.bin_columns=3?" in refusal(read_cloud, path)
    path = save(tmp_path, "0.bin", scan(5, 4).tobytes())
    assert "It divides by 16: --set cloud.bin_columns=4?" in refusal(read_cloud, path, ReadOptions(bin_columns=3))
    assert "expected a multiple of" in refusal(read_cloud, save(tmp_path, "0.bin", bytes(17)))


@pytest.mark.parametrize("n_columns", [3, 4])
def test_content_that_shows_the_other_number(tmp_path, n_columns):
    path = save(tmp_path, "0.bin", scan(1200, n_columns).tobytes())
    assert f"Use --set cloud.bin_columns={n_columns}" in refusal(
        read_cloud, path, ReadOptions(bin_columns=7 - n_columns)
    )


@pytest.mark.parametrize("n_columns", [3, 4])
def test_five_columns_as_nuscenes_has_them_are_not_taken_for_fewer(tmp_path, n_columns):
    rings = (np.arange(24_000) % 32).astype("<f4")
    path = save(tmp_path, "0.pcd.bin", np.column_stack([scan(24_000, 4), rings]).tobytes())
    line = refusal(read_cloud, path, ReadOptions(bin_columns=n_columns))
    assert "the file has 5. Save it as PLY or .npy" in line


def test_content_that_shows_nothing_is_read_as_given(tmp_path):
    points = np.random.default_rng(0).normal(size=(1200, 4)).astype("<f4")  # four columns of one size
    for n_columns in (3, 4):
        assert (
            len(read_cloud(save(tmp_path, "0.bin", points.tobytes()), ReadOptions(bin_columns=n_columns)))
            == 4800 // n_columns
        )


def test_bytes_that_are_no_coordinates(tmp_path):
    for data in (np.arange(4000, dtype="<i4").tobytes(), b"any text at all." * 100, bytes(range(256)) * 12):
        assert "as in a .bin of KITTI" in refusal(read_cloud, save(tmp_path, "0.bin", data))
    assert len(read_cloud(save(tmp_path, "0.bin", bytes(32)))) == 2


def test_the_option_is_checked_and_the_name_needed(tmp_path):
    path = save(tmp_path, "0.dat", scan(100, 4).tobytes())
    assert "binary data of an unknown kind" in refusal(read_cloud, path)
    with pytest.raises(ArgumentError, match="bin_columns = 5"):
        read_cloud(path, ReadOptions(bin_columns=5))


def test_a_column_without_a_number_is_read_without_a_warning(tmp_path, recwarn):
    values = scan(300, 4)
    values[:, 3] = np.nan
    assert len(read_cloud(save(tmp_path, "0.bin", values.tobytes()))) == 300
    assert not recwarn.list


def npy(array: np.ndarray, **options) -> bytes:
    stream = io.BytesIO()
    np.save(stream, array, **options)
    return stream.getvalue()


@pytest.mark.parametrize("order", ["C", "F"])
@pytest.mark.parametrize("kind", ["<f4", "<f8", ">f4", ">f8", "<i4", "<f2"])
def test_plain_arrays(tmp_path, kind, order):
    array = np.asarray(np.arange(40).reshape(8, 5), kind, order=order)
    cloud = read_cloud(save(tmp_path, "a.npy", npy(array)))
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
        (np.zeros(2, [("x", "f4", (2,)), ("y", "f4"), ("z", "f4")]), "must be one real number each per point"),
        (np.full((2, 3), np.nan), "all 2 points"),
    ],
)
def test_refused_arrays(tmp_path, array, line):
    assert line in refusal(read_cloud, save(tmp_path, "a.npy", npy(array)))


def test_arrays_that_are_cut_off_are_refused(tmp_path):
    np.savez(tmp_path / "a.npz", xyz=np.ones((20, 3)))
    for name, data in (("a.npy", npy(np.ones((20, 4)))), ("a.npz", (tmp_path / "a.npz").read_bytes())):
        refusal(read_cloud, save(tmp_path, name, data[: len(data) // 2]))


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


TURNED = ((0, 1, 0, 0), (-1, 0, 0, 0), (0, 0, 1, 0), (437_000.25, 5_428_000.5, 20, 1))
"""A quarter turn for row vectors, then a translation."""
PLAIN = ((1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1))


def ptx(rows: list[str], n_columns: int = 1, matrix=PLAIN, newline: str = "\n") -> str:
    head = [str(n_columns), str(len(rows) // n_columns), "0 0 0", "1 0 0", "0 1 0", "0 0 1"]
    return newline.join([*head, *(" ".join(map(str, row)) for row in matrix), *rows, ""])


@pytest.mark.parametrize("newline", ["\n", "\r\n"])
def test_the_matrix_is_applied_and_empty_cells_left_out(tmp_path, newline):
    rows = ["1 2 3 0.5 10 20 255", "0 0 0 0.5 0 0 0", "-1.5 0 0 0.25 1 2 3", "4 5 6 1 7 8 9"]
    cloud = read_cloud(save(tmp_path, "a.ptx", ptx(rows, 2, TURNED, newline)))
    expected = np.array([[-2, 1, 3], [0, -1.5, 0], [-5, 4, 6]]) + TURNED[3][:3]
    assert cloud.world().tolist() == expected.tolist()
    assert cloud.shift.tolist() == [436_000, 5_427_000, 0]
    assert cloud.fields["intensity"].tolist() == [0.5, 0.25, 1.0]
    assert (cloud.fields["blue"].dtype, cloud.fields["blue"].tolist()) == (np.uint8, [255, 3, 9])
    assert "scan" not in cloud.fields


def test_several_scans(tmp_path):
    text = ptx(["1 0 0 0.5", "2 0 0 0.5"]) + ptx(["1 0 0 0.75"], matrix=TURNED)
    cloud = read_cloud(save(tmp_path, "a.txt", text))
    assert cloud.fields["scan"].tolist() == [0, 0, 1]
    assert cloud.world()[2].tolist() == [437_000.25, 5_428_001.5, 20.0]
    assert list(cloud.fields) == ["intensity", "scan", *TO_SENSOR]
    assert cloud.fields["to_sensor_x"][:2].tolist() == [-1.0, -2.0]


@pytest.mark.parametrize(
    ("text", "line"),
    [
        (ptx(["1 2 3 0.5"] * 4)[:-4], ":14: '1 2 3' does not hold 4 numbers"),
        (ptx(["1 2 3 0.5"] * 4).replace("\n4\n", "\n9\n"), "promises 9 points, 4 follow"),
        (ptx(["1 2 3 0.5", "1 2 x 0.5"]), ":12: '1 2 x 0.5'"),
        (ptx(["1 2 3 0.5 1 2 256"]), ":11: '1 2 3 0.5 1 2 256'"),
        (ptx(["1 2"]), ":11: 2 columns; PTX has"),
        (ptx(["1 2 3 0.5"], matrix=np.array(TURNED).T), ":7: the last column of this matrix is not 0 0 0 1"),
        (ptx(["1 2 3 0.5"]) + "1\n", ":12: not the header of a scan"),
        (ptx(["1 2 3 0.5", "", "4 5 6 0.5"]), "promises 3 points, 2 follow"),
        (ptx(["0 0 0 0.5"]), "no points"),
    ],
)
def test_refusals(tmp_path, text, line):
    assert line in refusal(read_cloud, save(tmp_path, "a.ptx", text))


TEXT = "100 20 300 7\n-50 0 25 8\n"


@pytest.mark.parametrize("zipped", [False, True])
@pytest.mark.parametrize("head", ["", "2\n"])
def test_axes_and_centimetres(tmp_path, head, zipped):
    cloud = read_cloud(save(tmp_path, "scan000.3d", head + TEXT, zipped))
    assert cloud.xyz.tolist() == [[3.0, -1.0, 0.2], [0.25, 0.5, 0.0]]
    assert cloud.fields["column_4"].tolist() == [7.0, 8.0]


def test_another_unit(tmp_path):
    cloud = read_cloud(save(tmp_path, "scan000.3d", TEXT), ReadOptions(unit=1.0))
    assert cloud.xyz[0].tolist() == [300.0, -100.0, 20.0]


@pytest.mark.parametrize(
    ("text", "line"),
    [("3\n" + TEXT, "not the number of points, 2"), ("1 2\n", ":1: 2 columns"), ("1 2 x\n", ":1: '1 2 x'")],
)
def test_refusals_uos(tmp_path, text, line):
    assert line in refusal(read_cloud, save(tmp_path, "scan000.3d", text))


pye57 = pytest.importorskip("pye57")
QUARTER = np.array([np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)])


def scan_e57(n: int = 40, seed: int = 0) -> dict[str, np.ndarray]:
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
    data = scan_e57()
    cloud = read_cloud(write(tmp_path / "a.e57", data))
    np.testing.assert_allclose(cloud.xyz, places(data), atol=1e-4)
    assert len(cloud) == 36
    valid = data["cartesianInvalidState"] == 0
    for name, source in (("intensity", "intensity"), ("red", "colorRed"), ("blue", "colorBlue")):
        np.testing.assert_array_equal(cloud.fields[name], data[source][valid], strict=True)
    assert set(cloud.fields) == {"intensity", "red", "green", "blue"}


def test_several_scans_are_placed_and_numbered(tmp_path):
    parts = [scan_e57(seed=0), scan_e57(seed=1, n=20)]
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
    other = {name: values for name, values in scan_e57().items() if name != "intensity"}
    cloud = read_cloud(write(tmp_path / "a.e57", scan_e57(), other))
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
    whole = write(tmp_path / "a.e57", scan_e57(2000))
    data = Path(whole).read_bytes()
    for cut in range(48, len(data), len(data) // 7):
        (tmp_path / "b.e57").write_bytes(data[:cut])
        assert "cannot be opened as E57" in refusal(read_cloud, str(tmp_path / "b.e57"))
    middle = len(data) // 3
    (tmp_path / "b.e57").write_bytes(data[:middle] + b"\xff" * 40 + data[middle + 40 :])
    assert "scan 0: the points are damaged" in refusal(read_cloud, str(tmp_path / "b.e57"))


def test_without_pye57_the_extra_is_named(tmp_path, monkeypatch):
    path = write(tmp_path / "a.e57", scan_e57())
    monkeypatch.setitem(sys.modules, "pye57", None)
    with pytest.raises(UsageError, match=r"pip install '\.\[e57\]'"):
        read_cloud(path)
