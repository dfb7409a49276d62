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
