from __future__ import annotations

import gzip
import io
import logging
import struct

import laspy
import numpy as np
import pytest
from laspy.vlrs import VLR
from laspy.vlrs.vlrlist import VLRList

from mapq.cloud import PointCloud
from mapq.configuration import ReadOptions
from mapq.io import read_cloud, read_patches, write_cloud, write_patches
from mapq.io.las import WAVES
from mapq.io.results import result_cloud
from mapq.patches import Patches
from prf.shell.errors import UsageError
from tests.mapq.io.las_files import FOOT_WKT, geo_keys, las_bytes, las_data, wkt
from tests.mapq.io.samples import patches, refusal, save

KINDS = [(0, "1.1"), (1, "1.2"), (2, "1.2"), (3, "1.2"), (3, "1.4"), (4, "1.3"), (5, "1.3")]
KINDS += [(kind, "1.4") for kind in (6, 7, 8)]
WITH_WAVES = [(9, "1.4"), (10, "1.4")]


def as_read(las: laspy.LasData) -> laspy.LasData:
    """What laspy reads of what it writes."""
    stream = io.BytesIO()
    las.write(stream)
    stream.seek(0)
    return laspy.read(stream)


@pytest.mark.parametrize("compress", [False, True])
@pytest.mark.parametrize(("kind", "version"), KINDS)
def test_every_dimension_is_read(tmp_path, kind, version, compress):
    las = as_read(las_data(kind=kind, version=version))
    path = save(tmp_path, "a.las", las_bytes(compress, kind=kind, version=version))
    cloud = read_cloud(path)
    assert cloud.shift.tolist() == [436_000 if las.x.min() < 437_000 else 437_000, 5_427_000, 0]
    assert cloud.world().tobytes() == np.ascontiguousarray(las.xyz).tobytes()
    assert list(cloud.fields) == list(las.point_format.dimension_names)[3:]
    for name, values in cloud.fields.items():
        np.testing.assert_array_equal(values, np.asarray(las[name]), strict=True)
    assert cloud.fields["normal"].shape == (60, 3)
    assert cloud.fields["height"].dtype == np.float64


@pytest.mark.parametrize("name", ["b.las", "B.LAZ"])
@pytest.mark.parametrize(("kind", "version"), KINDS)
def test_what_is_written_again_is_the_same(tmp_path, kind, version, name):
    path = save(tmp_path, "a.laz", las_bytes(True, kind=kind, version=version, records=(wkt("x"),)))
    write_cloud(tmp_path / name, read_cloud(path))
    old, new = laspy.read(path), laspy.read(tmp_path / name)
    assert new.header.are_points_compressed is name.lower().endswith("z")
    assert new.point_format.id == kind
    assert list(new.point_format.dimension_names) == list(old.point_format.dimension_names)
    for dimension in ("X", "Y", "Z", *old.point_format.extra_dimension_names):
        np.testing.assert_array_equal(new.points.array[dimension], old.points.array[dimension], strict=True)
    for dimension in old.point_format.dimension_names:
        np.testing.assert_array_equal(np.asarray(new[dimension]), np.asarray(old[dimension]), strict=True)
    np.testing.assert_array_equal(new.header.scales, old.header.scales)
    np.testing.assert_array_equal(new.header.offsets, old.header.offsets)
    assert [v.user_id for v in new.vlrs if v.record_id == 2112] == ["LASF_Projection"]
    height = new.point_format.dimension_by_name("height")
    assert (height.scales.tolist(), height.offsets.tolist()) == ([0.01], [50.0])


@pytest.mark.parametrize(("kind", "version"), WITH_WAVES)
def test_wave_packets_are_kept_in_las_and_not_mangled_by_laz(tmp_path, kind, version, caplog):
    path = save(tmp_path, "a.las", las_bytes(kind=kind, version=version))
    cloud = read_cloud(path)
    write_cloud(tmp_path / "b.las", cloud)
    for dimension in (old := laspy.read(path)).point_format.dimension_names:
        np.testing.assert_array_equal(np.asarray(laspy.read(tmp_path / "b.las")[dimension]), np.asarray(old[dimension]))
    packed = read_cloud(save(tmp_path, "c.laz", las_bytes(True, kind=kind, version=version)))
    assert "wavepacket_index" in caplog.text
    assert set(cloud.fields) - set(packed.fields) == set(WAVES)
    for name, values in packed.fields.items():
        np.testing.assert_array_equal(values, cloud.fields[name], strict=True)


@pytest.mark.parametrize(("kind", "wanted"), [(0, 2), (1, 3), (3, 3), (6, 7), (7, 7), (8, 8)])
def test_a_result_in_las_has_its_fields_and_16_bit_colours(tmp_path, kind, wanted):
    path = save(tmp_path, "a.laz", las_bytes(True, kind=kind, version="1.4"))
    cloud = read_cloud(path)
    patch = (np.arange(60) % 3 - 1).astype(np.int32)
    result = result_cloud(cloud, patch, np.array([0, 1], np.uint8), np.array([0.25, 0.75], np.float32))
    write_cloud(tmp_path / "r.laz", result)
    new = laspy.read(tmp_path / "r.laz")
    assert new.point_format.id == wanted
    np.testing.assert_array_equal(new.patch, patch, strict=True)
    assert (new.suspicious.dtype, sorted(set(new.suspicious.tolist()))) == (np.uint8, [0, 1, 255])
    assert new.p_suspicious.dtype == np.float32
    assert new.red.dtype == np.uint16
    assert set(new.red[patch == 1].tolist()) == {214 * 257}
    assert set(new.blue[patch == 0].tolist()) == {184 * 257}
    if "red" in cloud.fields:
        np.testing.assert_array_equal(new.original_red, cloud.fields["red"], strict=True)
    again = read_cloud(str(tmp_path / "r.laz"))
    for name, values in result.fields.items():
        if name not in ("red", "green", "blue"):
            np.testing.assert_array_equal(again.fields[name], values, strict=True)
    assert again.world().tobytes() == cloud.world().tobytes()


def test_patches_carry_header_and_unit(tmp_path):
    path = save(tmp_path, "a.las", las_bytes(records=(wkt(FOOT_WKT),)))
    cloud = read_cloud(path)
    none = Patches.unlabelled(cloud, np.full(60, -1, np.int32), np.zeros((0, 3)), np.zeros((0, 3)), {}, {})
    write_patches(tmp_path / "a.patches", none)
    stored = read_patches(tmp_path / "a.patches").cloud
    assert stored.unit.tolist() == cloud.unit.tolist() == [0.304800609601219] * 3
    write_cloud(tmp_path / "b.las", stored)
    for axis in "XYZ":
        np.testing.assert_array_equal(laspy.read(tmp_path / "b.las")[axis], laspy.read(path)[axis], strict=True)


def test_clouds_of_other_formats_become_las(tmp_path, caplog):
    cloud = patches().cloud.with_fields(
        classification=np.arange(60, dtype=np.uint8), intensity=np.linspace(0, 1, 60), red=np.full(60, 255, np.uint8)
    )
    with caplog.at_level(logging.WARNING):
        write_cloud(tmp_path / "b.laz", cloud)
    assert "1 points without coordinates are left out" in caplog.text
    new = read_cloud(str(tmp_path / "b.laz"))
    kept = cloud.take(cloud.finite())
    np.testing.assert_allclose(new.world(), kept.world(), rtol=0, atol=0.5e-4)
    np.testing.assert_array_equal(new.fields["classification"], kept.fields["classification"], strict=True)
    np.testing.assert_array_equal(new.fields["intensity_2"], kept.fields["intensity"], strict=True)
    np.testing.assert_array_equal(new.fields["stamp"], kept.fields["stamp"], strict=True)
    np.testing.assert_array_equal(new.fields["normal_2"], kept.fields["normal"][:, 2], strict=True)
    assert set(new.fields["red"].tolist()) == {65_535}
    assert "mit_Leerzeichen/_" in new.fields


def test_the_scale_grows_with_the_cloud(tmp_path):
    wide = PointCloud.from_world(np.array([[0.0, 0, 0], [5_428_123.456, 1, 2]]))
    write_cloud(tmp_path / "b.las", wide)
    np.testing.assert_allclose(read_cloud(str(tmp_path / "b.las")).world(), wide.world(), rtol=0, atol=0.006)


def test_long_names_stay_distinct(tmp_path):
    names = ["a" * 40 + "1", "a" * 40 + "2"]
    cloud = PointCloud.from_world(np.eye(3), {name: np.arange(3) + i for i, name in enumerate(names)})
    write_cloud(tmp_path / "b.las", cloud)
    fields = read_cloud(str(tmp_path / "b.las")).fields
    assert [fields["a" * 32][0], fields["a" * 30 + "_2"][0]] == [0, 1]


@pytest.mark.parametrize(
    ("records", "unit"),
    [
        ((), [1, 1, 1]),
        ((wkt(FOOT_WKT),), [0.304800609601219] * 3),
        ((wkt(f'COMPD_CS["f",{FOOT_WKT},VERT_CS["g",UNIT["metre",1.0]]]'),), [0.304800609601219] * 2 + [1]),
        ((wkt('PROJCRS["a",BASEGEOGCRS["b"],CS[Cartesian,2],LENGTHUNIT["foot",0.3048]]'),), [0.3048] * 3),
        ((wkt('VERT_CS["g",UNIT["foot",0.3048]]'),), [1, 1, 0.3048]),
        ((geo_keys(k1024=1, k3076=9002),), [0.3048] * 3),
        ((geo_keys(k1024=1, k3076=9003, k4099=9001),), [1200 / 3937, 1200 / 3937, 1]),
        ((geo_keys(k1024=1, k3072=25832),), [1, 1, 1]),
        ((geo_keys(k1024=1, k3076=9005),), [0.3047972654] * 3),
        ((wkt('PROJECTEDCRS["a",BASEGEODCRS["b"],CS[Cartesian,2],LENGTHUNIT["foot",0.3048]]'),), [0.3048] * 3),
        ((wkt('PROJCS["a",UNIT["Meter",1.0]],VERTCS["b",UNIT["Foot_US",0.3]]'),), [1, 1, 0.3]),
        ((wkt('LOCAL_CS["site",LOCAL_DATUM["d",0],UNIT["foot",0.3048],AXIS["x",EAST]]'),), [0.3048] * 3),
        ((wkt('GEOCCS["a",DATUM["b"],PRIMEM["c",0],UNIT["kilometre",1000.0]]'),), [1000.0] * 3),
        ((wkt("no system at all ]["),), [1, 1, 1]),
    ],
)
def test_units_of_the_reference_system(tmp_path, records, unit):
    path = save(tmp_path, "a.las", las_bytes(records=records))
    cloud, plain = read_cloud(path), read_cloud(path, ReadOptions(unit=1.0))
    assert cloud.unit.tolist() == pytest.approx(unit, rel=1e-12)
    np.testing.assert_allclose(cloud.xyz, plain.xyz * unit, rtol=1e-12)
    np.testing.assert_allclose(cloud.world(), plain.world(), rtol=1e-15)


def test_an_unknown_unit_is_reported(tmp_path, caplog):
    path = save(tmp_path, "a.las", las_bytes(records=(geo_keys(k1024=1, k3076=9084),)))
    assert read_cloud(path).unit.tolist() == [1, 1, 1]
    assert "code 9084 is not known" in caplog.text
    caplog.clear()
    assert read_cloud(path, ReadOptions(unit=0.9)).unit.tolist() == [0.9, 0.9, 0.9]
    assert "is not known" not in caplog.text


def test_withheld_points_are_reported(tmp_path, caplog):
    las = las_data()
    for n_withheld, told in ((0, False), (7, True)):
        las["withheld"] = np.arange(60) < n_withheld
        las.write(tmp_path / "a.las")
        assert len(read_cloud(str(tmp_path / "a.las"))) == 60
        assert ("7 points are marked withheld" in caplog.text) is told


@pytest.mark.parametrize("compress", [False, True])
def test_a_reference_system_behind_the_points(tmp_path, compress):
    las = las_data(kind=6, version="1.4")
    las.evlrs = VLRList([VLR("other", 7, "", b"content"), wkt(FOOT_WKT)])
    las.write(tmp_path / "a.laz", do_compress=compress)
    cloud = read_cloud(str(tmp_path / "a.laz"))
    assert cloud.unit.tolist() == [0.304800609601219] * 3
    write_cloud(tmp_path / "b.laz", cloud)
    again = read_cloud(str(tmp_path / "b.laz"))
    assert again.world().tobytes() == cloud.world().tobytes()
    assert again.unit.tolist() == cloud.unit.tolist()
    assert [v.record_id for v in laspy.read(tmp_path / "b.laz").vlrs if v.user_id == "LASF_Projection"] == [2112]


@pytest.mark.parametrize(
    "record",
    [
        wkt('GEOGCS["b",UNIT["degree",0.01745]]'),
        wkt('GEOGRAPHICCRS["b",CS[ellipsoidal,2],ANGLEUNIT["degree",0.01745]]'),
        geo_keys(k1024=2),
    ],
)
def test_degrees_are_refused(tmp_path, record):
    assert "degrees of longitude" in refusal(read_cloud, save(tmp_path, "a.las", las_bytes(records=(record,))))


def test_damaged_files_are_refused(tmp_path):
    data, packed = las_bytes(n=5000), las_bytes(True, n=5000)
    assert "damaged or cut off" in refusal(read_cloud, save(tmp_path, "a.las", data[:150]))
    assert "cut off: 5000 points are promised" in refusal(read_cloud, save(tmp_path, "a.las", data[:-72]))
    assert "damaged" in refusal(read_cloud, save(tmp_path, "a.laz", packed[: len(packed) // 2]))
    damaged = data[:100] + struct.pack("<I", 10**9) + data[104:]
    assert "records in the LAS header" in refusal(read_cloud, save(tmp_path, "a.las", damaged))
    assert "no points" in refusal(read_cloud, save(tmp_path, "a.las", las_bytes(n=0)))


def test_copc_is_not_written(tmp_path):
    with pytest.raises(UsageError, match="COPC is not written"):
        write_cloud(tmp_path / "a.copc.laz", patches().cloud)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["a.e57", "a.E57", "a.ply.gz", "a.npy"])
def test_a_name_of_what_is_not_written_is_refused(tmp_path, name):
    with pytest.raises(UsageError, match=r"Name a \.ply"):
        write_cloud(tmp_path / name, patches().cloud)
    assert list(tmp_path.iterdir()) == []


def test_a_gzipped_cloud_from_a_pipe(tmp_path, monkeypatch):
    stream = io.TextIOWrapper(io.BytesIO(gzip.compress(las_bytes(True))))
    monkeypatch.setattr("sys.stdin", stream)
    assert len(read_cloud("-")) == 60
