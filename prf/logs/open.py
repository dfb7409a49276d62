"""Reading a log of any format: one entry for every command."""

from __future__ import annotations

import gzip
import zlib
from pathlib import Path
from typing import Literal

from prf.logs.carmen import read_carmen
from prf.logs.readings import Readings
from prf.logs.recognise import ACCEPTED, recognise
from prf.logs.table import read_table
from prf.shell.errors import InputError
from prf.shell.files import STREAM, open_input

GZIP_MAGIC = b"\x1f\x8b"
BYTE_ORDER_MARK = b"\xef\xbb\xbf"
"""UTF-8's, which spreadsheets put before a CSV header."""

Kind = Literal["laser", "sonar"]


def read_readings(path: str, kind: Kind = "laser") -> Readings:
    """Read the readings of one kind of sensor from a log; the format is recognised from the content.

    Parameters
    ----------
    path : str
        A CARMEN log or a table, gzipped or not, whatever its name; ``-`` is standard input.
    kind : {"laser", "sonar"}
        Which readings to take. Sonar comes from a table; the CARMEN reader knows lasers.

    Returns
    -------
    Readings
        All beams, in the order of the file.

    Raises
    ------
    InputError
        If the file is missing, damaged, of another format, or has no readings of this kind.
    """
    source = "standard input" if path == STREAM else path
    data = _decompress(_read_bytes(path), source).removeprefix(BYTE_ORDER_MARK)
    if recognise(data, source) == "table":
        return read_table(data, source)
    if kind == "sonar":
        raise InputError(
            f"{source}: a CARMEN log gives laser readings only. Give sonar readings as a table x,y,theta,range,cone."
        )
    return read_carmen(data, source)


def _read_bytes(path: str) -> bytes:
    if path != STREAM and Path(path).is_dir():
        raise InputError(f"{path}: this is a folder, perhaps a ROS 2 bag. {ACCEPTED}")
    with open_input(path) as stream:
        return stream.read()


def _decompress(data: bytes, source: str) -> bytes:
    if not data.startswith(GZIP_MAGIC):
        return data
    try:
        return gzip.decompress(data)
    except EOFError:
        raise InputError(f"{source}: the gzip file is cut off at its end. Copy or download it again.") from None
    except (OSError, zlib.error):
        raise InputError(f"{source}: the gzip file is damaged. Copy or download it again.") from None
