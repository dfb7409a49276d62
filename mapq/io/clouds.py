"""Reading a cloud of any format: one entry for every command."""

from __future__ import annotations

import gzip
import zlib
from pathlib import Path

from mapq.cloud import PointCloud
from mapq.io.fields import make_cloud
from mapq.io.kitti import read_kitti
from mapq.io.npy import read_npy, read_npz
from mapq.io.pcd import read_pcd
from mapq.io.ply import read_ply
from mapq.io.recognise import ACCEPTED, recognise
from mapq.io.text import read_text
from prf.shell.errors import InputError, UsageError
from prf.shell.files import STREAM, open_input

GZIP_MAGIC = b"\x1f\x8b\x08"
"""With the only method that there is: two bytes alone begin one in 65,536 files of plain float32."""

BYTE_ORDER_MARK = b"\xef\xbb\xbf"
"""UTF-8's, which spreadsheets put before a CSV header."""


def read_cloud(path: str, bin_columns: int = 4) -> PointCloud:
    """Read a cloud of points; the format is recognised from the content.

    Parameters
    ----------
    path : str
        PLY, PCD, XYZ/TXT/CSV, .npy, .npz or KITTI .bin, gzipped or not; ``-`` is standard input (not for .bin, which
        only its name tells).
    bin_columns : {3, 4}
        Columns of a KITTI .bin; other formats say it themselves.

    Returns
    -------
    PointCloud
        All points in the order of the file, those without a return (nan) too, with all fields that are numbers.

    Raises
    ------
    InputError
        If the file is missing, damaged, cut off or of another format, or has no finite point.
    """
    return parse_cloud(read_bytes(path), path, bin_columns)[1]


def parse_cloud(data: bytes, path: str, bin_columns: int = 4) -> tuple[str, PointCloud]:
    """Return format and cloud of a file's decompressed bytes; parameters and errors as :func:`read_cloud`."""
    if bin_columns not in (3, 4):
        raise UsageError(f"--bin-columns {bin_columns} is neither 3 nor 4.")
    source = source_of(path)
    kind = recognise(data, "" if path == STREAM else Path(path).name, source)
    if kind == "kitti":
        return kind, make_cloud(read_kitti(data, source, bin_columns), source)
    read = {"ply": read_ply, "pcd": read_pcd, "npy": read_npy, "npz": read_npz, "text": read_text}[kind]
    return kind, make_cloud(read(data, source), source)


def read_bytes(path: str) -> bytes:
    """Return the content of a file, decompressed if it is gzipped, without a byte order mark."""
    if path != STREAM and Path(path).is_dir():
        raise InputError(f"{path}: this is a folder, perhaps a ROS 2 bag. {ACCEPTED}")
    with open_input(path) as stream:
        data = stream.read()
    return _decompress(data, source_of(path)).removeprefix(BYTE_ORDER_MARK)


def source_of(path: str) -> str:
    """Return the name of an input for messages."""
    return "standard input" if path == STREAM else path


def _decompress(data: bytes, source: str) -> bytes:
    if not data.startswith(GZIP_MAGIC):
        return data
    try:
        return gzip.decompress(data)
    except EOFError:
        raise InputError(f"{source}: the gzip file is cut off at its end. Copy or download it again.") from None
    except (OSError, zlib.error):
        raise InputError(f"{source}: the gzip file is damaged. Copy or download it again.") from None
