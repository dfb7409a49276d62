from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mapq.cloud import PointCloud
from mapq.io import is_patches, read_patches, write_patches
from mapq.patches import Patches
from prf.shell.errors import OutputError
from tests.mapq.io.samples import patches, refusal, save

ARRAYS = ("patch", "normal", "centroid", "label", "label_source")


def check_equal(one: Patches, other: Patches) -> None:
    for name in ARRAYS:
        a, b = getattr(one, name), getattr(other, name)
        assert (a.dtype, a.shape, a.tobytes()) == (b.dtype, b.shape, b.tobytes())
        assert b.flags.writeable
        assert b.flags.c_contiguous
    assert (one.parameters, one.report) == (other.parameters, other.report)
    assert (one.cloud.source, one.cloud.coordinate_type) == (other.cloud.source, other.cloud.coordinate_type)
    assert one.cloud.xyz.tobytes() == other.cloud.xyz.tobytes()
    assert one.cloud.shift.tobytes() == other.cloud.shift.tobytes()
    assert list(one.cloud.fields) == list(other.cloud.fields)
    for name, values in one.cloud.fields.items():
        again = other.cloud.fields[name]
        assert (values.dtype, values.shape, values.tobytes()) == (again.dtype, again.shape, again.tobytes())


@pytest.mark.parametrize("n_patches", [0, 1, 3])
def test_round_trip_is_exact(tmp_path, n_patches):
    before = patches(n_patches=n_patches)
    write_patches(tmp_path / "a.patches", before)
    after = read_patches(tmp_path / "a.patches")
    check_equal(before, after)
    assert is_patches(tmp_path / "a.patches")
    write_patches(tmp_path / "b.patches", after)
    check_equal(before, read_patches(str(tmp_path / "b.patches")))


def test_numbers_that_json_lacks_become_null(tmp_path):
    before = replace(patches(), parameters={"a": np.float64(np.inf), "b": (1, np.int32(2)), "c": np.array([0.1])})
    write_patches(tmp_path / "a", before)
    assert read_patches(tmp_path / "a").parameters == {"a": None, "b": [1, 2], "c": [0.1]}


def test_a_plain_reader_needs_nothing_of_ours(tmp_path):
    before = patches()
    write_patches(tmp_path / "a.patches", before)
    with np.load(tmp_path / "a.patches", allow_pickle=False) as stored:
        assert str(stored["schema"]) == "mapq.patches/1"
        assert np.array_equal(stored["xyz"] + stored["shift"], before.cloud.world(), equal_nan=True)


def change(path, **replaced) -> str:
    """Write the file anew with arrays replaced, or left out (None)."""
    with np.load(path, allow_pickle=False) as stored:
        arrays = {name: stored[name] for name in stored.files} | replaced
    np.savez(path.with_suffix(".npz"), **{name: values for name, values in arrays.items() if values is not None})
    return str(path.with_suffix(".npz"))


@pytest.mark.parametrize(
    ("replaced", "line"),
    [
        ({"schema": "mapq.patches/2"}, "version 2 of mapq.patches is not known"),
        ({"schema": "mapq.model/1"}, "schema mapq.model/1, expected mapq.patches/1"),
        ({"schema": None}, "no schema"),
        ({"xyz": None}, "array xyz is missing"),
        ({"xyz": np.zeros((60, 2))}, "array xyz has shape (60, 2)"),
        ({"coordinate_type": "float16"}, "damaged"),
        ({"patch": np.zeros(60)}, "array patch is float64"),
        ({"patch": np.full(60, 3, np.int32)}, "patch numbers are not within -1 and 2"),
        ({"patch": np.full(60, -1, np.int32)}, "patch 0 has no points"),
        ({"normal": np.zeros((2, 3))}, "array centroid has shape (3, 3), not (2, 3)"),
        ({"centroid": np.full((3, 3), np.inf)}, "a point of a patch or a centroid is not finite"),
        ({"label": np.full(3, 7, np.uint8)}, "a label is neither 0 nor 1 nor 255"),
        ({"field_names": '["a", "b", "c", "d", "e"]'}, "'field_4' is missing"),
        ({"field_0": np.zeros(59)}, "has not 60 rows"),
        ({"report": None}, "'report' is missing"),
    ],
)
def test_what_contradicts_itself_is_refused(tmp_path, replaced, line):
    path = tmp_path / "a.patches"
    write_patches(path, patches())
    assert line in refusal(read_patches, change(path, **replaced))


def test_other_files_are_no_patches(tmp_path):
    for data in (b"", b"1 2 3\n", b"PK\x03\x04 and so on"):
        path = save(tmp_path, "a", data)
        assert not is_patches(path)
        refusal(read_patches, path)
    np.savez(tmp_path / "b.npz", xyz=np.zeros((3, 3)))
    assert not is_patches(tmp_path / "b.npz")
    np.savez(tmp_path / "b.npz", schema=np.array(["x"], dtype=object))
    assert not is_patches(tmp_path / "b.npz")
    assert not is_patches(tmp_path / "none")
    assert not is_patches(tmp_path)
    assert "no such file" in refusal(read_patches, tmp_path / "none")


def test_any_version_is_recognised(tmp_path):
    write_patches(tmp_path / "a.patches", patches())
    assert is_patches(change(tmp_path / "a.patches", schema="mapq.patches/77"))


def test_writing_is_whole_or_not_at_all(tmp_path):
    path = tmp_path / "a.patches"
    path.write_text("old")
    with pytest.raises(TypeError):
        write_patches(path, replace(patches(), parameters={"a": object()}))
    assert path.read_text() == "old"
    with pytest.raises(OutputError):
        write_patches(tmp_path / "no" / "a.patches", patches())


def test_a_cloud_without_fields(tmp_path):
    cloud = PointCloud.from_world(np.zeros((4, 3), np.float32))
    none = np.empty((0, 3))
    before = Patches.unlabelled(cloud, np.full(4, -1, np.int32), none, none, {}, {})
    write_patches(tmp_path / "a", before)
    check_equal(before, read_patches(tmp_path / "a"))
