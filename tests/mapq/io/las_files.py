"""Small LAS files, written for a test."""

from __future__ import annotations

import io

import laspy
import numpy as np
from laspy.vlrs import VLR

FOOT_WKT = (
    'PROJCS["a grid",GEOGCS["b",DATUM["c",SPHEROID["d",6378137,298.25]],UNIT["degree",0.0174532925199433]],'
    'PROJECTION["e"],PARAMETER["false_easting",0],UNIT["US survey foot",0.304800609601219]]'
)


def wkt(text: str) -> VLR:
    """A record with a reference system."""
    return VLR("LASF_Projection", 2112, "", text.encode() + b"\0")


def geo_keys(**keys: int) -> VLR:
    """A record with GeoTIFF keys, by `k` and their number."""
    rows = [1, 1, 0, len(keys), *(value for key, number in keys.items() for value in (int(key[1:]), 0, 1, number))]
    return VLR("LASF_Projection", 34735, "", np.array(rows, "<u2").tobytes())


def las_data(n: int = 60, kind: int = 3, version: str = "1.2", extra: bool = True, records: tuple[VLR, ...] = ()):
    """A file with every dimension filled, on a survey grid, with extra dimensions of three sorts."""
    rng = np.random.default_rng(kind)
    header = laspy.LasHeader(version=version, point_format=kind)
    header.scales, header.offsets = np.array([0.001, 0.001, 0.0025]), np.array([437_000.0, 5_428_000.0, 100.0])
    header.vlrs += records
    if extra:
        params = laspy.ExtraBytesParams
        header.add_extra_dims(
            [
                params("reflectance", "f4", "of the surface"),
                params("height", "i2", scales=[0.01], offsets=[50.0]),
                params("normal", "3f8"),
                params("stamp", "u8"),
            ]
        )
    las = laspy.LasData(header)
    las.X, las.Y, las.Z = rng.integers(-40_000, 40_000, (3, n), dtype=np.int32)
    if n:
        las.Z[0] = -(2**31)
    for item in header.point_format.dimensions:
        if item.name in "XYZ":
            continue
        if item.dtype is None:
            las[item.name] = rng.integers(0, item.max, n, endpoint=True).astype(np.uint8)
        elif item.dtype.base.kind == "f":
            las[item.name] = rng.normal(size=(n, item.num_elements)).squeeze()
        else:
            raw = rng.integers(item.min, item.max, n, dtype=item.dtype, endpoint=True)
            las.points.array[item.name] = raw
    return las


def las_bytes(compress: bool = False, **options) -> bytes:
    """The same as a file."""
    stream = io.BytesIO()
    las_data(**options).write(stream, do_compress=compress)
    return stream.getvalue()
