"""The formats of clouds: how their files begin, and what reads them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Literal

from mapq.cloud import PointCloud
from mapq.io.bag import read_bag
from mapq.io.content import Content
from mapq.io.e57 import read_e57
from mapq.io.fields import Array
from mapq.io.las import read_las
from mapq.io.npy import MAGIC as NPY_MAGIC
from mapq.io.npy import ZIP_MAGIC, read_npz
from mapq.io.options import ReadOptions
from mapq.io.pcd import read_pcd
from mapq.io.ply import MAGIC as PLY_MAGIC
from mapq.io.ply import read_ply
from mapq.io.ptx import read_ptx
from mapq.io.text import read_text
from mapq.io.uos import read_uos
from mapq.io.vtk import read_vtk

Format = Literal["ply", "pcd", "las", "e57", "ptx", "vtk", "npy", "npz", "3d", "kitti", "bag", "text"]

MAGICS: tuple[tuple[bytes, Format], ...] = (
    *((magic, "ply") for magic in PLY_MAGIC),
    (b"LASF", "las"),
    (b"ASTM-E57", "e57"),
    (b"# vtk DataFile", "vtk"),
    (NPY_MAGIC, "npy"),
    *((magic, "npz") for magic in ZIP_MAGIC),
)
"""How files begin that say what they are."""

COLUMN_READERS: Mapping[Format, Callable[[bytes, str], dict[str, Array]]] = {
    "ply": read_ply,
    "pcd": read_pcd,
    "npz": read_npz,
    "ptx": read_ptx,
    "vtk": read_vtk,
    "text": read_text,
}
"""Readers that make columns of the bytes of a file, given its name for messages."""

CLOUD_READERS: Mapping[Format, Callable[[Content, ReadOptions], PointCloud]] = {
    "las": read_las,
    "e57": read_e57,
    "3d": read_uos,
    "bag": read_bag,
}
"""Readers of formats that say more of a cloud than columns do: its unit, axes, poses."""
