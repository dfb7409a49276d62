from __future__ import annotations

import numpy as np
import pytest

from mapq.io import ReadOptions, read_cloud
from prf.shell.errors import UsageError
from tests.mapq.io.samples import refusal, save


def scan(n: int, n_columns: int, seed: int = 0) -> np.ndarray:
    """A scan: far wider than high, intensities within 1."""
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(n, 4)) * (20, 12, 1.5, 0)
    points[:, 3] = rng.uniform(size=n)
    return points[:, :n_columns].astype("<f4")


@pytest.mark.parametrize("zipped", [False, True])
@pytest.mark.parametrize("n_columns", [3, 4])
@pytest.mark.parametrize("n", [1, 12, 1200, 1201])
def test_the_number_of_columns_is_an_option(tmp_path, n, n_columns, zipped):
    points = scan(n, n_columns)
    cloud = read_cloud(save(tmp_path, "0.bin", points.tobytes(), zipped), ReadOptions(n_columns))
    assert cloud.coordinate_type is np.float32
    assert np.array_equal(cloud.xyz, points[:, :3])
    assert list(cloud.fields) == ["intensity"][: n_columns - 3]
    if n_columns == 4:
        assert cloud.fields["intensity"].tobytes() == points[:, 3].tobytes()


def test_a_size_that_does_not_divide(tmp_path):
    path = save(tmp_path, "0.bin", scan(5, 3).tobytes())
    assert "It divides by 12: --set cloud.bin_columns=3?" in refusal(read_cloud, path)
    path = save(tmp_path, "0.bin", scan(5, 4).tobytes())
    assert "It divides by 16: --set cloud.bin_columns=4?" in refusal(read_cloud, path, ReadOptions(3))
    assert "no whole number of points" in refusal(read_cloud, save(tmp_path, "0.bin", bytes(17)))


@pytest.mark.parametrize("n_columns", [3, 4])
def test_content_that_shows_the_other_number(tmp_path, n_columns):
    path = save(tmp_path, "0.bin", scan(1200, n_columns).tobytes())
    assert f"Use --set cloud.bin_columns={n_columns}" in refusal(read_cloud, path, ReadOptions(7 - n_columns))


@pytest.mark.parametrize("n_columns", [3, 4])
def test_five_columns_as_nuscenes_has_them_are_not_taken_for_fewer(tmp_path, n_columns):
    rings = (np.arange(24_000) % 32).astype("<f4")
    path = save(tmp_path, "0.pcd.bin", np.column_stack([scan(24_000, 4), rings]).tobytes())
    line = refusal(read_cloud, path, ReadOptions(n_columns))
    assert "the file has 5. Save it as PLY or .npy" in line


def test_content_that_shows_nothing_is_read_as_given(tmp_path):
    points = np.random.default_rng(0).normal(size=(1200, 4)).astype("<f4")  # four columns of one size
    for n_columns in (3, 4):
        assert len(read_cloud(save(tmp_path, "0.bin", points.tobytes()), ReadOptions(n_columns))) == 4800 // n_columns


def test_bytes_that_are_no_coordinates(tmp_path):
    for data in (np.arange(4000, dtype="<i4").tobytes(), b"any text at all." * 100, bytes(range(256)) * 12):
        assert "no .bin of KITTI" in refusal(read_cloud, save(tmp_path, "0.bin", data))
    assert len(read_cloud(save(tmp_path, "0.bin", bytes(32)))) == 2


def test_the_option_is_checked_and_the_name_needed(tmp_path):
    path = save(tmp_path, "0.dat", scan(100, 4).tobytes())
    assert "binary data of an unknown kind" in refusal(read_cloud, path)
    with pytest.raises(UsageError, match="bin_columns 5"):
        read_cloud(path, ReadOptions(5))


def test_a_column_without_a_number_is_read_without_a_warning(tmp_path, recwarn):
    values = scan(300, 4)
    values[:, 3] = np.nan
    assert len(read_cloud(save(tmp_path, "0.bin", values.tobytes()))) == 300
    assert not recwarn.list
