"""LAS a piece at a time: the same points as read at once, the same file as written at once."""

from __future__ import annotations

import laspy
import numpy as np
import pytest

from mapq.cloud import choose_shift
from mapq.configuration import AS_IT_IS, ReadOptions
from mapq.io import read_cloud, write_cloud
from mapq.io.las import read_las_head, read_las_pieces
from mapq.io.write import open_las_pieces
from prf.shell.errors import OutputError
from tests.mapq.io.las_files import las_data


@pytest.fixture(params=[(3, "1.2"), (7, "1.4")], ids=["old", "layered"])
def path(request, tmp_path) -> str:
    kind, version = request.param
    target = tmp_path / "some.laz"
    las_data(n=5000, kind=kind, version=version).write(str(target))
    return str(target)


@pytest.fixture(autouse=True)
def small_pieces(monkeypatch) -> None:
    monkeypatch.setattr("mapq.io.las.PIECE", 700)


def test_pieces_are_the_points_read_at_once(path):
    cloud = read_cloud(path)
    shift = choose_shift(cloud.world())
    pieces = list(read_las_pieces(path, AS_IT_IS, shift))
    assert max(map(len, pieces)) == 700
    np.testing.assert_array_equal(np.concatenate([each.xyz for each in pieces]), cloud.xyz)
    for name, values in cloud.fields.items():
        np.testing.assert_array_equal(np.concatenate([each.fields[name] for each in pieces]), values)


def test_only_chosen_fields_are_read(path):
    cloud = read_cloud(path)
    for names in ((), ("gps_time", "no_such_field")):
        pieces = list(read_las_pieces(path, AS_IT_IS, cloud.shift, names))
        assert all(set(each.fields) == set(names) & set(cloud.fields) for each in pieces)
        np.testing.assert_array_equal(np.concatenate([each.xyz for each in pieces]), cloud.xyz)


def test_the_head_has_points_box_and_unit(path):
    cloud, head = read_cloud(path), read_las_head(path, ReadOptions(unit=0.5))
    assert head.n_points == len(cloud)
    np.testing.assert_allclose(head.low, cloud.world().min(axis=0), atol=1e-9)
    assert head.unit.tolist() == [0.5, 0.5, 0.5]
    assert set(head.fields) == set(cloud.fields)


def test_written_in_pieces_it_is_the_file_written_at_once(path, tmp_path):
    cloud = read_cloud(path)
    write_cloud(tmp_path / "once.laz", cloud)
    with open_las_pieces(tmp_path / "pieces.laz") as pieces:
        for piece in read_las_pieces(path, AS_IT_IS, cloud.shift):
            pieces.write(piece)
    once, others = (laspy.read(tmp_path / name) for name in ("once.laz", "pieces.laz"))
    assert list(once.point_format.dimension_names) == list(others.point_format.dimension_names)
    np.testing.assert_array_equal(once.points.array, others.points.array)
    np.testing.assert_array_equal(once.header.scales, others.header.scales)


def test_pieces_with_other_fields_are_refused(path, tmp_path):
    first = next(read_las_pieces(path, AS_IT_IS, np.zeros(3)))
    other = first.with_fields(more=np.zeros(len(first), np.float32))
    with open_las_pieces(tmp_path / "r.laz") as pieces:
        pieces.write(first)
        with pytest.raises(OutputError, match="other fields"):
            pieces.write(other)


def las_with_height(path, params, value):
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.add_extra_dims([params])
    las = laspy.LasData(header)
    las.x = las.y = las.z = np.arange(3.0)
    las["height"] = np.full(3, value)
    las.write(str(path))
    return next(read_las_pieces(str(path), AS_IT_IS, np.zeros(3)))


def test_a_wider_type_is_refused(tmp_path):
    pieces = [las_with_height(tmp_path / "0.las", laspy.ExtraBytesParams("height", kind), 7) for kind in ("u1", "u2")]
    with open_las_pieces(tmp_path / "r.las") as writer:
        writer.write(pieces[0])
        with pytest.raises(OutputError, match="other fields"):
            writer.write(pieces[1])


def test_numbers_of_another_scale_are_written_under_the_first_one(tmp_path):
    with open_las_pieces(tmp_path / "r.las") as writer:
        for scale in (0.01, 0.1):
            params = laspy.ExtraBytesParams("height", "i4", scales=np.array([scale]), offsets=np.zeros(1))
            writer.write(las_with_height(tmp_path / "0.las", params, 7.5))
    np.testing.assert_allclose(read_cloud(str(tmp_path / "r.las")).fields["height"], 7.5)
