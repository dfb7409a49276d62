from __future__ import annotations

import numpy as np
import pytest

from mapq.io import read_cloud
from tests.mapq.io.samples import refusal, save

XYZ = np.array([[1.5, 2, 3], [4, 5, 6], [-7, 8, 9.25]])
LEVEL = np.array([3, -1, 7])


def vtk(binary: bool, kind: str = "float", tail: bool = True) -> bytes:
    """A file with cells, a scalar, normals and an array of a field."""
    points = {"float": ">f4", "double": ">f8"}[kind]

    def block(values, dtype):
        values = np.asarray(values)
        if binary:
            return values.astype(dtype).tobytes() + b"\n"
        return "\n".join(" ".join(map(str, row)) for row in np.atleast_2d(values)).encode() + b"\n"

    parts = [
        f"# vtk DataFile Version 3.0\nmade by hand\n{'BINARY' if binary else 'ASCII'}\nDATASET POLYDATA\n".encode()
    ]
    parts += [
        f"POINTS 3 {kind}\n".encode(),
        block(XYZ, points),
        b"VERTICES 3 6\n",
        block([[1, 0], [1, 1], [1, 2]], ">i4"),
    ]
    if tail:
        parts += [b"POINT_DATA 3\nSCALARS level int\nLOOKUP_TABLE default\n", block(LEVEL, ">i4")]
        parts += [b"NORMALS normal float\n", block(np.eye(3, dtype=int), ">f4")]
        parts += [b"FIELD more 1\nring 1 3 unsigned_char\n", block([0, 1, 255], ">u1")]
    return b"".join(parts)


@pytest.mark.parametrize("zipped", [False, True])
@pytest.mark.parametrize("kind", ["float", "double"])
@pytest.mark.parametrize("binary", [False, True])
def test_points_and_what_stands_at_them(tmp_path, binary, kind, zipped):
    cloud = read_cloud(save(tmp_path, "a.vtk", vtk(binary, kind), zipped))
    assert cloud.xyz.tolist() == XYZ.tolist()
    assert cloud.coordinate_type is (np.float32 if kind == "float" else np.float64)
    assert {name: values.dtype.name for name, values in cloud.fields.items()} == {
        "level": "int32",
        "normal": "float32",
        "ring": "uint8",
    }
    assert cloud.fields["level"].tolist() == LEVEL.tolist()
    assert cloud.fields["normal"].tolist() == np.eye(3).tolist()
    assert cloud.fields["ring"].tolist() == [0, 1, 255]
    assert read_cloud(save(tmp_path, "b.vtk", vtk(binary, kind, tail=False))).fields == {}


@pytest.mark.parametrize("binary", [False, True])
def test_data_of_cells_stand_before_those_of_points_as_vtk_writes_them(tmp_path, binary, caplog):
    one = np.array([0.5] * 2, ">f4").tobytes() if binary else b"0.5 0.5"
    ids = np.array([7] * 2, ">i4").tobytes() if binary else b"7 7"
    cells = b"CELL_DATA 2\nSCALARS level float\nLOOKUP_TABLE default\n" + one + b"\nFIELD more 1\nids 1 2 vtkIdType\n"
    before = vtk(binary).replace(b"POINT_DATA", cells + ids + b"\nPOINT_DATA")
    fields = read_cloud(save(tmp_path, "a.vtk", before)).fields
    assert fields["level"].tolist() == LEVEL.tolist()
    assert list(fields) == ["level", "normal", "ring"]
    after = vtk(binary) + b"CELL_DATA 2\nSCALARS what bit\n"
    assert list(read_cloud(save(tmp_path, "b.vtk", after)).fields) == ["level", "normal", "ring"]
    assert caplog.messages == []


@pytest.mark.parametrize("binary", [False, True])
def test_metadata_and_fields_of_the_whole_file_are_passed_over(tmp_path, binary):
    time = np.array([0.5], ">f8").tobytes() if binary else b"0.5"
    about = b"METADATA\nINFORMATION 1\nNAME L2_NORM_RANGE LOCATION vtkDataArray\nDATA 2 0 1\n\n"
    data = vtk(binary).replace(
        b"POINTS 3", b"FIELD FieldData 1\nTIME 1 1 double\n" + time + b"\n" + about + b"POINTS 3"
    )
    data = data.replace(b"VERTICES", about + b"VERTICES").replace(b"NORMALS", about + b"NORMALS")
    data = data.replace(
        b"FIELD more 1", b"FIELD more 2\nother 1 3 unsigned_char\n" + (b"\0\1\2\n" if binary else b"0 1 2\n") + about
    )
    cloud = read_cloud(save(tmp_path, "a.vtk", data + about))
    assert cloud.xyz.tolist() == XYZ.tolist()
    assert list(cloud.fields) == ["level", "normal", "other", "ring"]


@pytest.mark.parametrize(
    ("old", "new", "line"),
    [
        (b"POLYDATA", b"STRUCTURED_POINTS", "no data set with points"),
        (b"ASCII", b"TEXT", "neither ASCII nor BINARY"),
        (b"POINTS 3", b"POINTS 1000000000000", "cut off: 3000000000000 values"),
        (b"POINTS 3", b"POINTS three", "no count in the line 'POINTS three float'"),
        (b"3 float", b"3 text", "type 'text' is not one of VTK"),
        (b"8.0 9.25", b"8.0 x", "not 9 values of type float32"),
        (b"POINT_DATA 3", b"POINT_DATA 4", "3 points, but data of 4"),
        (b"VERTICES", b"VORTICES", "section 'VORTICES' is not known"),
        (b"ring 1 3", b"ring 1 4", "is no array of 3 points"),
    ],
)
def test_refusals(tmp_path, old, new, line):
    assert line in refusal(read_cloud, save(tmp_path, "a.vtk", vtk(False).replace(old, new)))
