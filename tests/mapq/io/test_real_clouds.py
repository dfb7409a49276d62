"""Every public cloud beside the project: points and fields as its source tells them, or one line that refuses it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mapq.cloud import PointCloud
from mapq.configuration import ReadOptions
from mapq.io import read_cloud, write_cloud, write_ply
from tests.mapq.io.samples import refusal

INTENSITY = {"intensity": "float32"}
NORMALS = INTENSITY | dict.fromkeys(("normal_x", "normal_y", "normal_z", "curvature"), "float32")

COLOURS = dict.fromkeys(("red", "green", "blue"), "uint8")
GRID = {"rowIndex": "int16", "columnIndex": "int16"}
LAS_BITS = ("return_number", "number_of_returns", "scan_direction_flag", "edge_of_flight_line", "classification")
LAS_TIME = {"intensity": "uint16", **dict.fromkeys((*LAS_BITS, "synthetic", "key_point", "withheld"), "uint8")}
LAS_TIME |= {"scan_angle_rank": "int8", "user_data": "uint8", "point_source_id": "uint16", "gps_time": "float64"}
LAS_SIX = {name: kind for name, kind in LAS_TIME.items() if name != "scan_angle_rank"}
LAS_SIX |= {"scan_angle": "int16", "overlap": "uint8", "scanner_channel": "uint8"}
LAS_COLOURS = dict.fromkeys(("red", "green", "blue"), "uint16")

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
    "3dtk_dat/*.3d.gz": (2, 2 * 81_360, {}),
    "pdal_formats/1.2-with-color.las": (1, 1_065, LAS_TIME | LAS_COLOURS),
    "pdal_formats/1.2-with-color.copc.laz": (1, 1_065, LAS_SIX | LAS_COLOURS),
    "pdal_formats/1.2-with-color.ptx": (1, 1_065, {"intensity": "float64"} | COLOURS),
    "pdal_formats/autzen_trim.laz": (1, 110_000, LAS_TIME | LAS_COLOURS),
    "pdal_formats/lone-star.laz": (1, 518_862, LAS_TIME),
    "pdal_formats/A_B.e57": (1, 6, INTENSITY | COLOURS | {"scan": "int32"}),
    "pye57_e57/pumpA*.e57": (1, 155_201, {"intensity": "float64"} | COLOURS | GRID),
    "pye57_e57/translationWithoutRotation.e57": (1, 4, {}),
}
"""Files, points in all of them together, and the fields beside the coordinates."""

REFUSED = {
    "pdal_formats/*.npy": "scaled coordinates of LAS, without the scale. Give it in metres with --unit",
    "pdal_formats/missingheader.pcd": "no PCD header",
    "*/config/config.json": "JSON",
    "dxmcu_map/derived/*.csv": "no fields x, y, z; there are tile_a",
    "kitti00_map-metrics/derived/calib_Tr.txt": "does not hold 13 numbers",
}

FOOT, SURVEY_FOOT = 0.3048, 1200 / 3937

WIDE = ("csv", "las", "laz", "ptx", "e57", "3d.gz")
"""Ends of names of formats whose coordinates are read in double precision."""

THREE = ("newer_college_01", "gtsam_points_kitti_00")
"""Sets whose .bin files have three columns."""


@pytest.fixture(scope="module")
def clouds(shared_data):
    return shared_data / "mapq"


def read(path: Path) -> PointCloud:
    return read_cloud(str(path), ReadOptions(bin_columns=3 if path.parent.name in THREE else 4))


@pytest.mark.parametrize("pattern", COUNTS)
def test_points_and_fields(clouds, pattern):
    n_files, n_points, fields = COUNTS[pattern]
    if pattern.endswith(".e57"):
        pytest.importorskip("pye57")
    found = [read(path) for path in sorted(clouds.glob(pattern))]
    assert len(found) == n_files
    assert sum(map(len, found)) == n_points
    for cloud in found:
        assert {name: values.dtype.name for name, values in cloud.fields.items()} == fields
        assert cloud.coordinate_type is (np.float64 if pattern.endswith(WIDE) else np.float32)
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


@pytest.mark.parametrize("name", ["1.2-with-color.las", "1.2-with-color.copc.laz", "autzen_trim.laz", "lone-star.laz"])
def test_las_is_written_to_the_last_bit(clouds, tmp_path, name):
    laspy = pytest.importorskip("laspy")
    path, copy = clouds / "pdal_formats" / name, tmp_path / "copy.laz"
    write_cloud(copy, read_cloud(str(path)))
    old, new = laspy.read(path), laspy.read(copy)
    for each in ("scales", "offsets"):
        np.testing.assert_array_equal(getattr(new.header, each), getattr(old.header, each))
    assert new.header.point_format.id == old.header.point_format.id
    assert list(new.point_format.dimension_names) == list(old.point_format.dimension_names)
    for dimension in old.point_format.dimension_names:
        np.testing.assert_array_equal(np.asarray(new[dimension]), np.asarray(old[dimension]), strict=True)
    systems = [[bytes(v.record_data_bytes()) for v in f.vlrs if v.user_id == "LASF_Projection"] for f in (old, new)]
    assert systems[0] == systems[1]


def test_one_cloud_in_five_formats(clouds):
    folder = clouds / "pdal_formats"
    las = read_cloud(str(folder / "1.2-with-color.las"))
    for name, options in (("ptx", ReadOptions()), ("npy", ReadOptions(unit=0.01)), ("copc.laz", ReadOptions(unit=1.0))):
        other = read_cloud(str(folder / f"1.2-with-color.{name}"), options)
        metres = [np.sort(cloud.metric_of(cloud.xyz), axis=0) for cloud in (las, other)]
        np.testing.assert_allclose(metres[1], metres[0], rtol=0, atol=1e-6)


def test_feet(clouds):
    autzen = read_cloud(str(clouds / "pdal_formats" / "autzen_trim.laz"))
    assert autzen.unit.tolist() == [FOOT] * 3
    assert np.ptp(autzen.xyz[:, 2]) == pytest.approx(114.25 * FOOT)
    np.testing.assert_array_equal(autzen.world().max(axis=0).round(2), [637_179.22, 849_497.90, 520.51])
    copc = read_cloud(str(clouds / "pdal_formats" / "1.2-with-color.copc.laz"))
    np.testing.assert_allclose(copc.unit, [1.0, 1.0, SURVEY_FOOT], rtol=1e-12)


def test_3dtk_stands_upright_in_metres(clouds):
    corridor = read_cloud(str(clouds / "3dtk_dat" / "scan000.3d.gz"))
    near = corridor.xyz[np.linalg.norm(corridor.xyz, axis=1) < 30.0]
    assert near.std(axis=0).argmin() == 2
    assert (np.ptp(near, axis=0) > 8.0).all()
