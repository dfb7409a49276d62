"""Clouds of any format: the format is recognised from the content, and from the name where that is not enough."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Literal

import numpy as np

from mapq.cloud import PointCloud
from mapq.configuration import AS_IT_IS, ReadOptions
from mapq.io.bag import read_bag
from mapq.io.content import ACCEPTED, Content, damage_in_one_line, suffix_of
from mapq.io.e57 import read_e57
from mapq.io.kitti import read_kitti
from mapq.io.las import read_las
from mapq.io.npy import MAGIC as NPY_MAGIC
from mapq.io.npy import ZIP_MAGIC, read_npy, read_npz
from mapq.io.pcd import read_pcd
from mapq.io.ply import MAGIC as PLY_MAGIC
from mapq.io.ply import read_ply
from mapq.io.ptx import read_ptx
from mapq.io.results import RESULT_FIELDS, stated_unit
from mapq.io.text import read_text
from mapq.io.uos import read_uos
from prf.shell.cli.files import STREAM
from prf.shell.errors import InputError
from prf.shell.poses.bag import bag_suffix
from prf.shell.poses.files import slam_state

Format = Literal["ply", "pcd", "las", "e57", "ptx", "npy", "npz", "3d", "kitti", "bag", "text"]

READERS: Mapping[Format, Callable[[Content, ReadOptions], PointCloud]] = {
    "ply": read_ply,
    "pcd": read_pcd,
    "las": read_las,
    "e57": read_e57,
    "ptx": read_ptx,
    "npy": read_npy,
    "npz": read_npz,
    "3d": read_uos,
    "kitti": read_kitti,
    "bag": read_bag,
    "text": read_text,
}

MAGICS: tuple[tuple[bytes, Format], ...] = (
    *((magic, "ply") for magic in PLY_MAGIC),
    (b"LASF", "las"),
    (b"ASTM-E57", "e57"),
    (NPY_MAGIC, "npy"),
    *((magic, "npz") for magic in ZIP_MAGIC),
)
"""How files of some formats begin."""

REFUSED = (
    (b"#ROSBAG", "a ROS 1 bag of an old version, which rosbag fix can convert"),
    (b"# vtk DataFile", "a VTK file; save it as PLY"),
    (b"\xff\xfe", "text in UTF-16; save it as UTF-8"),
    (b"\xfe\xff", "text in UTF-16; save it as UTF-8"),
    (b"{", "a JSON document"),
    (b"<", "an XML or HTML document"),
)
"""Contents that are known and not read."""

HEADERS = {
    **{".ply": "PLY", ".pcd": "PCD", ".npy": "NPY", ".npz": "NPZ", ".las": "LAS", ".laz": "LAS", ".e57": "E57"},
    **{".ptx": "PTX", ".bag": "ROS bag", ".db3": "SQLite", ".mcap": "MCAP"},
}
"""Formats that need a header, by their suffix."""

_LOG_2D = re.compile(rb"(?m)^(?:## Player version|(?:FLASER|RLASER|ROBOTLASER\d|SONAR|ODOM|PARAM|Odometry)[ \t])")
_PCD = re.compile(rb"\A(?:[ \t\r]*(?:#[^\n]*)?\n)*[ \t]*(?:VERSION[ \t]+\.?\d|(?:FIELDS|COLUMNS)[ \t])")
_PTX = re.compile(rb"\A\s*\d+\s*\n\s*\d+\s*\n(?:[ \t]*\S+[ \t]+\S+[ \t]+\S+\s*\n){4}")


def read_cloud(path: str, options: ReadOptions = AS_IT_IS) -> PointCloud:
    """Read a cloud of points; the format is recognised from the content.

    Parameters
    ----------
    path : str
        PLY, PCD, LAS, LAZ, E57, PTX, XYZ/TXT/CSV, .npy, .npz, 3DTK .3d, KITTI .bin or a ROS bag, gzipped or not;
        ``-`` is standard input (not for .bin and .3d, which only their names identify).
    options : ReadOptions
        What the file does not state itself.

    Returns
    -------
    PointCloud
        All points in the order of the file, those without a return (nan) too, with all fields that are numbers.

    Raises
    ------
    InputError
        If the file is missing, damaged, cut off or of another format, or has no finite point.
    """
    return parse_cloud(Content(path), options)[1]


@np.errstate(over="ignore", invalid="ignore")  # numpy would warn of coordinates that are refused later
def parse_cloud(content: Content, options: ReadOptions = AS_IT_IS) -> tuple[Format, PointCloud]:
    """Return format and cloud of an input; parameters and errors as :func:`read_cloud`.

    A result is in the unit in which it was classified, as the JSON beside it states, for PLY cannot.
    """
    kind = recognise(content)
    with damage_in_one_line(content.source):
        cloud = READERS[kind](content, options)
    if options.unit is not None or content.path == STREAM or not set(RESULT_FIELDS) <= set(cloud.fields):
        return kind, cloud
    unit = stated_unit(Path(content.path).with_suffix(".json"))
    return kind, cloud if unit is None else cloud.in_unit(unit)


def recognise(content: Content) -> Format:
    """Return the format of an input; InputError if no reader takes it, with what it looks like and what is read."""
    if content.is_folder:
        return "bag"
    head, suffix = content.head, suffix_of(content.name)
    known = _by_content(head)
    if known is not None:
        return known
    if suffix == ".bin" and head:
        return "kitti"
    if (state := slam_state(head)) is not None:
        raise InputError(f"{content.source}: {state}.")
    looks_like = _unreadable(head, suffix)
    if looks_like:
        raise InputError(f"{content.source}: {looks_like}. {ACCEPTED}")
    return "3d" if suffix == ".3d" else "text"


def _by_content(head: bytes) -> Format | None:
    for magic, kind in MAGICS:
        if head.startswith(magic):
            return kind
    if bag_suffix(head):
        return "bag"
    if _PCD.match(head[:4096]):
        return "pcd"
    return "ptx" if _PTX.match(head[:1024]) else None


def _unreadable(head: bytes, suffix: str) -> str | None:
    """Return what content without a known magic number looks like, None for text that may be points."""
    if not head.strip():
        return "the file is empty"
    if _LOG_2D.search(head):
        return "this is a log of a 2D laser or sonar, of which prf makes maps: prf info FILE"
    for magic, name in REFUSED:
        if head.startswith(magic):
            return f"this is {name}"
    if suffix in HEADERS:
        return f"no {HEADERS[suffix]} header: the file is damaged, or its name is wrong"
    return "this is binary data of an unknown kind" if b"\0" in head[:4096] else None
