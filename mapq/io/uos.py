"""3DTK's .3d files, which it calls `uos`: centimetres, left-handed, y upwards.

The axes of 3DTK are x to the right, y upwards, z ahead. Here they become x ahead, y to the left, z upwards, in metres.
"""

from __future__ import annotations

import numpy as np

from mapq.cloud import PointCloud
from mapq.io.content import Content
from mapq.io.fields import cloud_of_world
from mapq.io.options import ReadOptions
from mapq.io.rows import Layout, as_count, parse_rows
from prf.shell.errors import InputError

AXES = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
"""Takes x right, y up, z ahead to x ahead, y left, z up; it mirrors, since one is left-handed and the other not."""
CENTIMETRE = 0.01


def read_uos(content: Content, options: ReadOptions) -> PointCloud:
    """Read the points of a .3d file: x y z and perhaps further columns, with or without a count in the first line.

    Raises
    ------
    InputError
        If a row cannot be read, or there are not as many as the first line says.
    """
    data, source = content.data(), content.source
    first, _, rest = data.partition(b"\n")
    has_count = len(first.split()) == 1
    body, line = (rest, 2) if has_count else (data, 1)
    width = len(body.partition(b"\n")[0].split())
    if width < 3:
        raise InputError(f"{source}:{line}: {width} columns; a .3d file of 3DTK has x y z.")
    names = ["x", "y", "z", *(f"column_{number}" for number in range(4, width + 1))]
    layout = Layout(np.dtype([(name, np.float64) for name in names]), width, tuple(range(width)))
    rows = parse_rows(body, layout, source, line)
    promised = as_count(first.decode("latin-1").strip()) if has_count else len(rows)
    if promised != len(rows):
        raise InputError(
            f"{source}: its first line promises {promised} points, {len(rows)} follow. Copy the file again, or remove "
            f"that line."
        )
    unit = CENTIMETRE if options.unit is None else options.unit
    points = np.column_stack([rows[name] for name in "xyz"]) @ AXES.T * unit
    return cloud_of_world(points, {name: rows[name] for name in names[3:]}, source)
