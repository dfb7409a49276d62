"""Units of LAS coordinates, from the reference system in the file's records."""

from __future__ import annotations

import logging
import re
import struct
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from prf.shell.errors import InputError

logger = logging.getLogger(__name__)

SYSTEM_USER = "LASF_Projection"
WKT, GEO_KEYS = 2112, 34735
"""Records of that user that are read here."""
MODEL_TYPE, LINEAR_UNITS, VERTICAL_UNITS = 1024, 3076, 4099
GEOGRAPHIC = 2
"""Model type of degrees."""
EPSG_UNITS = {
    **{9001: 1.0, 9002: 0.3048, 9003: 1200.0 / 3937.0, 9005: 0.3047972654, 9036: 1000.0, 9096: 0.9144},
    **{1025: 0.001, 1033: 0.01},
}
"""Metres in the units of point clouds, by their EPSG codes."""

LEVEL = ("PROJCS", "PROJCRS", "PROJECTEDCRS", "DERIVEDPROJCRS")
UPRIGHT = ("VERT_CS", "VERTCS", "VERTCRS", "VERTICALCRS")
ANGLES = ("GEOGCS", "GEOGCRS", "GEOGRAPHICCRS", "GEODCRS", "GEODETICCRS")
OTHER = ("LOCAL_CS", "ENGCRS", "ENGINEERINGCRS", "GEOCCS")
"""Kinds of systems of a WKT, in the spellings of both versions and of ESRI."""

_SYSTEM = re.compile(rf"\b({'|'.join((*LEVEL, *UPRIGHT, *ANGLES, *OTHER))})\s*\[", re.IGNORECASE)
_UNIT = re.compile(r'\b(?:LENGTH)?UNIT\s*\[\s*"[^"]*"\s*,\s*(\d[-+.\deE]*)', re.IGNORECASE)


def unit_of(records: Iterable[Any], source: str) -> NDArray[np.float64]:
    """Return the metres (3,) in a unit of x, y and z; 1 where the records do not state it.

    Parameters
    ----------
    records : iterable of VLR
        As laspy makes them. A WKT counts before GeoTIFF keys.
    source : str
        Name of the file, for messages.
    """
    bodies = {
        int(record.record_id): bytes(record.record_data_bytes()) for record in records if record.user_id == SYSTEM_USER
    }
    if WKT in bodies:
        level, upright, is_geographic = _of_wkt(bodies[WKT].decode("utf-8", "replace"))
    else:
        level, upright, is_geographic = _of_keys(bodies.get(GEO_KEYS, b""), source)
    if is_geographic:
        raise InputError(
            f"{source}: x and y are degrees of longitude and latitude. Project the cloud to a grid in metres first."
        )
    level = 1.0 if level is None else level
    unit = np.array([level, level, level if upright is None else upright])
    if (unit != 1.0).any():
        logger.info("%s: x and y are in units of %g m, z of %g m; lengths are in metres", source, unit[0], unit[2])
    return unit


def _of_wkt(text: str) -> tuple[float | None, float | None, bool]:
    """Return metres in a unit of x and y and in one of z, None where not stated, and whether x and y are degrees.

    The unit of a system is the last one in it, behind those of the systems that it is built on.
    """
    found: dict[str, float | None] = {}
    for match in _SYSTEM.finditer(text):
        units = _UNIT.findall(_bracketed(text, match.end() - 1))
        found.setdefault(match[1].upper(), float(units[-1]) if units else None)

    def unit(kinds: tuple[str, ...]) -> float | None:
        return next((found[kind] for kind in kinds if found.get(kind) is not None), None)

    is_level = any(kind in found for kind in (*LEVEL, *OTHER))
    is_geographic = not is_level and any(kind in found for kind in ANGLES) and "cartesian" not in text.lower()
    return unit((*LEVEL, *OTHER)), unit(UPRIGHT), is_geographic


def _bracketed(text: str, start: int) -> str:
    """Return the content of the bracket that opens at `start`."""
    depth = 0
    for place in range(start, len(text)):
        depth += {"[": 1, "]": -1}.get(text[place], 0)
        if depth == 0:
            return text[start:place]
    return text[start:]


def _of_keys(body: bytes, source: str) -> tuple[float | None, float | None, bool]:
    """Return what :func:`_of_wkt` does, of a directory of GeoTIFF keys."""
    rows = struct.iter_unpack("<4H", body[8 : len(body) // 8 * 8])
    keys = {key: value for key, location, _, value in rows if location == 0}
    codes = [keys.get(key, 0) for key in (LINEAR_UNITS, VERTICAL_UNITS)]
    for code in codes:
        if code and code not in EPSG_UNITS:
            logger.warning("%s: the unit of length of code %d is not known; give it with --unit", source, code)
    level, upright = (EPSG_UNITS.get(code) for code in codes)
    return level, upright, keys.get(MODEL_TYPE) == GEOGRAPHIC
