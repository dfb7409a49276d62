"""Reading a cloud of any format: one entry for every command."""

from __future__ import annotations

import numpy as np

from mapq.cloud import PointCloud
from mapq.io.content import Content
from mapq.io.fields import make_cloud
from mapq.io.formats import CLOUD_READERS, COLUMN_READERS
from mapq.io.kitti import read_kitti
from mapq.io.npy import read_npy
from mapq.io.options import AS_IT_IS, ReadOptions
from mapq.io.recognise import recognise
from mapq.io.result_json import unit_beside
from mapq.io.results import RESULT_FIELDS
from prf.shell.files import STREAM


def read_cloud(path: str, options: ReadOptions = AS_IT_IS) -> PointCloud:
    """Read a cloud of points; the format is recognised from the content.

    Parameters
    ----------
    path : str
        PLY, PCD, LAS, LAZ, E57, PTX, XYZ/TXT/CSV, VTK, .npy, .npz, 3DTK .3d, KITTI .bin or a ROS bag, gzipped or not;
        ``-`` is standard input (not for .bin and .3d, which only their names tell).
    options : ReadOptions
        What the file does not say itself.

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


@np.errstate(over="ignore", invalid="ignore")  # numpy would warn of coordinates beyond reason, which no reader trusts
def parse_cloud(content: Content, options: ReadOptions = AS_IT_IS) -> tuple[str, PointCloud]:
    """Return format and cloud of an input; parameters and errors as :func:`read_cloud`.

    A result is in the unit in which it was classified, as the JSON beside it says, for PLY cannot.
    """
    kind, cloud = _parse(content, options)
    if options.unit is not None or content.path == STREAM or not set(RESULT_FIELDS) <= set(cloud.fields):
        return kind, cloud
    unit = unit_beside(content.path)
    return kind, cloud if unit is None else cloud.in_unit(unit)


def _parse(content: Content, options: ReadOptions) -> tuple[str, PointCloud]:
    kind = recognise(content)
    if kind in CLOUD_READERS:
        return kind, CLOUD_READERS[kind](content, options)
    if kind == "kitti":
        fields = read_kitti(content.data(), content.source, options.bin_columns)
    elif kind == "npy":
        fields = read_npy(content.data(), content.source, scale_known=options.unit is not None)
    else:
        fields = COLUMN_READERS[kind](content.data(), content.source)
    return kind, make_cloud(fields, content.source, options.unit or 1.0)
