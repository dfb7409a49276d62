"""Clouds as files, written here by hand so that readers and writers are not checked against themselves."""

from __future__ import annotations

import gzip
from pathlib import Path

import lzf
import numpy as np
import pytest

from mapq.cloud import PointCloud
from mapq.patches import Patches
from prf.shell.errors import InputError

PLY_TYPES = {"i1": "char", "u1": "uchar", "i2": "short", "u2": "ushort", "i4": "int", "u4": "uint"}
PLY_TYPES |= {"f4": "float", "f8": "double", "i8": "int64", "u8": "uint64"}


def save(folder: Path, name: str, data: bytes | str, zipped: bool = False) -> str:
    """Write a file and return its name."""
    data = data.encode() if isinstance(data, str) else data
    path = folder / (name + (".gz" if zipped else ""))
    path.write_bytes(gzip.compress(data, mtime=0) if zipped else data)
    return str(path)


def table(n: int = 50, coordinates: str = "f4", seed: int = 0) -> np.ndarray:
    """A structured array with fields of every type that PLY has, values that are not round, one point nan."""
    rng = np.random.default_rng(seed)
    fields = [(axis, coordinates) for axis in "xyz"]
    fields += [(f"field_{kind}", kind) for kind in ("i1", "u1", "i2", "u2", "i4", "u4", "f4", "f8")]
    rows = np.zeros(n, fields)
    for name, kind in fields:
        if kind.startswith("f"):
            rows[name] = rng.normal(0, 30, n)
        else:
            limits = np.iinfo(kind)
            rows[name] = rng.integers(limits.min, limits.max, n, dtype=kind, endpoint=True)
    rows["x"][3] = np.nan
    rows["y"][4] = -0.0
    return rows


def ply(rows: np.ndarray, order: str = "<", newline: str = "\n", extra: str = "", tail: bytes = b"") -> bytes:
    """A PLY file; `order` is < or > or "" for text."""
    name = {"<": "binary_little_endian", ">": "binary_big_endian", "": "ascii"}[order]
    lines = ["ply", f"format {name} 1.0", "comment made by hand", f"element vertex {len(rows)}"]
    lines += [f"property {PLY_TYPES[rows.dtype[field].str[1:]]} {field}" for field in rows.dtype.names]
    lines += [*extra.splitlines(), "end_header", ""]
    body = rows.astype(rows.dtype.newbyteorder(order)).tobytes() if order else text_rows(rows, newline).encode()
    return newline.join(lines).encode() + body + tail


def text_rows(rows: np.ndarray, newline: str = "\n", delimiter: str = " ") -> str:
    """Rows as text with all digits."""
    out = []
    for row in rows:
        values = [value for field in row for value in np.atleast_1d(field)]
        out.append(delimiter.join(str(value) for value in values))
    return newline.join(out) + newline


def pcd_header(rows: np.ndarray, data: str, **replaced: str) -> str:
    """The header of a PCD file; entries can be replaced, or left out with an empty text."""
    names = rows.dtype.names
    base = [rows.dtype[name].base for name in names]
    counts = [rows.dtype[name].shape[0] if rows.dtype[name].shape else 1 for name in names]
    entries = {
        "VERSION": "0.7",
        "FIELDS": " ".join("_" if name.startswith("pad") else name for name in names),
        "SIZE": " ".join(str(kind.itemsize) for kind in base),
        "TYPE": " ".join({"f": "F", "i": "I", "u": "U"}[kind.kind] for kind in base),
        "COUNT": " ".join(map(str, counts)),
        "WIDTH": str(len(rows)),
        "HEIGHT": "1",
        "VIEWPOINT": "0 0 0 1 0 0 0",
        "POINTS": str(len(rows)),
        "DATA": data,
    }
    lines = [f"{key} {value}" for key, value in (entries | replaced).items() if value]
    return "\n".join(["# .PCD v0.7 - Point Cloud Data file format", *lines, ""])


def pcd(rows: np.ndarray, data: str = "binary", **replaced: str) -> bytes:
    """A PCD file, laid out as PCL does it."""
    head = pcd_header(rows, data, **replaced).encode()
    if data == "ascii":
        return head + text_rows(rows).encode()
    if data == "binary":
        return head + rows.tobytes()
    raw = b"".join(np.ascontiguousarray(rows[name]).tobytes() for name in rows.dtype.names)
    packed = lzf.compress(raw) or raw
    return head + np.array([len(packed), len(raw)], "<u4").tobytes() + packed


def check_same(cloud: PointCloud, rows: np.ndarray, skip: tuple[str, ...] = ()) -> None:
    """Hold a cloud to the rows it was written from, bit for bit."""
    world = cloud.world().astype(cloud.coordinate_type)
    for axis, name in enumerate("xyz"):
        assert world[:, axis].tobytes() == np.ascontiguousarray(rows[name]).tobytes()
    names = [name for name in rows.dtype.names if name not in ("x", "y", "z", *skip)]
    assert list(cloud.fields) == names
    for name in names:
        values = cloud.fields[name]
        assert values.dtype == rows[name].dtype.newbyteorder("=")
        assert values.dtype.isnative
        assert values.flags.c_contiguous
        assert values.tobytes() == np.ascontiguousarray(rows[name]).tobytes()


def refusal(function, *args) -> str:
    """The one line with which an input is refused."""
    with pytest.raises(InputError) as caught:
        function(*args)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def patches(n_points: int = 60, n_patches: int = 3, seed: int = 0) -> Patches:
    """Patches with awkward fields, shift and labels."""
    rng = np.random.default_rng(seed)
    fields = {
        "intensity": rng.normal(size=n_points).astype(np.float32),
        "stamp": rng.integers(2**62, 2**63, n_points, dtype=np.uint64),
        "mit Leerzeichen/ü": rng.integers(0, 2, n_points).astype(bool),
        "normal": rng.normal(size=(n_points, 3)),
    }
    world = rng.uniform(0, 30, (n_points, 3)) + np.array([437_000, 5_428_000, 0])
    world[5] = np.nan
    cloud = PointCloud.from_world(world, fields, "a map.ply")
    patch = rng.integers(-1, n_patches, n_points).astype(np.int32)
    patch[5] = -1
    patch[6 : 6 + n_patches] = np.arange(n_patches)
    normal = rng.normal(size=(n_patches, 3))
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    label = np.array([0, 1, 255] * n_patches, np.uint8)[:n_patches]
    source = np.array([1, 2, 0] * n_patches, np.uint8)[:n_patches]
    parameters = {"radius": 0.1 + 0.2, "up": [0.0, 0.0, 1.0], "mode": "auto", "none": None}
    report = {"n_dropped": 3, "why": {"nan": 1, "sparse": 2}}
    return Patches(cloud, patch, normal, rng.normal(size=(n_patches, 3)), label, source, parameters, report)
