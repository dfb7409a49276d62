"""Every public cloud beside the project: points and fields as its source tells them, or one line that refuses it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mapq.cloud import PointCloud
from mapq.io import read_cloud, write_ply
from tests.mapq.io.samples import refusal

INTENSITY = {"intensity": "float32"}
NORMALS = INTENSITY | dict.fromkeys(("normal_x", "normal_y", "normal_z", "curvature"), "float32")

COUNTS = {
    "dxmcu_map/pcd/*.pcd": (11, 1_829_462, {}),
    "kitti00_map-metrics/pcs/*.bin.gz": (20, 2_452_809, INTENSITY),
    "newer_college_01/planes_*.bin": (5, 103_146, {}),
    "newer_college_01/edges_*.bin": (5, 6_446, {}),
    "small_gicp_pair/source.ply": (1, 69_792, {"scalar_intensity": "float32"}),
    "small_gicp_pair/target.ply": (1, 69_088, {"scalar_intensity": "float32"}),
    "plane_localization_hall/pcd/*.pcd": (11, 292_387, INTENSITY),
    "na_localization_maps/twofloor/*.pcd": (1, 26_491, NORMALS),
    "na_localization_maps/cx_office/*.pcd": (1, 5_378, NORMALS),
    "na_localization_maps/fenchalu/*.pcd": (1, 98_509, NORMALS),
    "pcl_data/room_scan1.pcd": (1, 112_586, {}),
    "pcl_data/room_scan2.pcd": (1, 112_624, {}),
    "pcl_data/region_growing_tutorial.pcd": (1, 108_104, {"rgb": "float32"}),
    "pcl_data/min_cut_segmentation_tutorial.pcd": (1, 9_311, {}),
    "pcl_icp_ndt_room/*.pcd": (4, 107_589, INTENSITY | {"ring": "uint16"}),
    "nclt_keyframes/map.pcd": (1, 22_762, INTENSITY),
    "nclt_keyframes/[0-9]*.pcd": (16, 27_905, INTENSITY),
    "pcl_matching_scan/map.pcd": (1, 49_168, INTENSITY),
    "gtsam_points_kitti_00/000000.bin": (1, 124_668, {}),
    "libpointmatcher/car_cloud400.csv": (1, 24_989, dict.fromkeys(("nx", "ny", "nz"), "float64")),
}
"""Files, points in all of them together, and the fields beside the coordinates."""

REFUSED = {
    "pdal_formats/*.las": "LAS",
    "pdal_formats/*.laz": "LAS or LAZ",
    "pdal_formats/*.e57": "E57",
    "pye57_e57/*.e57": "E57",
    "pdal_formats/*.ptx": "PTX",
    "pdal_formats/*.npy": "scaled coordinates of LAS",
    "pdal_formats/missingheader.pcd": "no PCD header",
    "libpointmatcher/*.vtk": "VTK",
    "3dtk_dat/*.3d.gz": "3DTK",
    "*/config/config.json": "JSON",
    "dxmcu_map/derived/*.csv": "no fields x, y, z; there are tile_a",
    "kitti00_map-metrics/derived/calib_Tr.txt": "x is 'Tr:', not a number",
}

THREE = ("newer_college_01", "gtsam_points_kitti_00")
"""Sets whose .bin files have three columns."""


@pytest.fixture(scope="module")
def clouds(shared_data):
    return shared_data / "mapq"


def read(path: Path) -> PointCloud:
    return read_cloud(str(path), bin_columns=3 if path.parent.name in THREE else 4)


@pytest.mark.parametrize("pattern", COUNTS)
def test_points_and_fields(clouds, pattern):
    n_files, n_points, fields = COUNTS[pattern]
    found = [read(path) for path in sorted(clouds.glob(pattern))]
    assert len(found) == n_files
    assert sum(map(len, found)) == n_points
    for cloud in found:
        assert {name: values.dtype.name for name, values in cloud.fields.items()} == fields
        assert cloud.coordinate_type is (np.float64 if pattern.endswith("csv") else np.float32)
        assert cloud.finite().mean() > 0.5


@pytest.mark.parametrize("pattern", REFUSED)
def test_what_is_refused_in_one_line(clouds, pattern):
    paths = sorted(clouds.glob(pattern))
    assert paths
    for path in paths:
        assert REFUSED[pattern] in refusal(read_cloud, str(path))


def test_survey_coordinates_and_upper_case_names(clouds, tmp_path):
    cloud = read_cloud(str(clouds / "pdal_formats" / "autzen-utm.pcd"))
    assert (len(cloud), cloud.coordinate_type) == (1065, np.float64)
    assert cloud.shift.tolist() == [493_000, 4_877_000, 0]
    assert cloud.fields["Intensity"].dtype == np.uint16
    write_ply(tmp_path / "a.ply", cloud)
    again = read_cloud(str(tmp_path / "a.ply"))
    assert again.world().tobytes() == cloud.world().tobytes()
    assert [values.tobytes() for values in again.fields.values()] == [v.tobytes() for v in cloud.fields.values()]


def test_the_other_number_of_columns_is_noticed(clouds):
    for name in THREE:
        for path in sorted((clouds / name).rglob("*.bin")):
            assert "--bin-columns 3" in refusal(read_cloud, str(path), 4)
    for path in sorted((clouds / "kitti00_map-metrics" / "pcs").glob("*.gz"))[:6]:
        assert "--bin-columns 4" in refusal(read_cloud, str(path), 3)


def test_a_sensors_columns_come_back_bit_for_bit(clouds, tmp_path):
    for name in ("pcl_icp_ndt_room/0.pcd", "pcl_data/region_growing_tutorial.pcd", "small_gicp_pair/source.ply"):
        cloud = read(clouds / name)
        write_ply(tmp_path / "a.ply", cloud)
        again = read(tmp_path / "a.ply")
        assert again.world().tobytes() == cloud.world().tobytes()
        assert list(again.fields) == list(cloud.fields)
        assert [v.tobytes() for v in again.fields.values()] == [v.tobytes() for v in cloud.fields.values()]
