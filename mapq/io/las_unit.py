"""Units of LAS coordinates, from the reference system in the file's records."""

from __future__ import annotations

import logging
import re
import struct
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from prf.shell.errors import InputError

logger = logging.getLogger(__name__)

SYSTEM_USER = "LASF_Projection"
WKT, GEO_KEYS = 2112, 34735
"""Records of that user which are read here."""
MODEL_TYPE, LINEAR_UNITS, VERTICAL_UNITS = 1024, 3076, 4099
GEOGRAPHIC = 2
"""Model type of degrees."""
EPSG_UNITS = {9001: 1.0, 9002: 0.3048, 9003: 1200.0 / 3937.0}
"""Metres in the units that point clouds come in, by their EPSG codes."""

_SYSTEM = re.compile(r"\b(PROJCS|PROJCRS|VERT_CS|VERTCRS|GEOGCS|GEOGCRS|GEODCRS)\s*\[")
_UNIT = re.compile(r'\b(?:LENGTH)?UNIT\s*\[\s*"[^"]*"\s*,\s*([-+.\deE]+)')


def unit_of(records: Iterable[Any], source: str) -> NDArray[np.float64]:
    """Return the metres (3,) in a unit of x, y and z; 1 where the records do not say.

    Parameters
    ----------
    records : iterable of VLR
        As laspy makes them. A WKT counts before GeoTIFF keys.
    source : str
        Name of the file, for messages.

    Raises
    ------
    InputError
        If x and y are degrees.
    """
    bodies = {
        int(record.record_id): bytes(record.record_data_bytes())
        for record in records
        if record.user_id == SYSTEM_USER and record.record_id in (WKT, GEO_KEYS)
    }
    if WKT in bodies:
        level, upright, is_geographic = _of_wkt(bodies[WKT].decode("utf-8", "replace"))
    else:
        level, upright, is_geographic = _of_keys(_geo_keys(bodies.get(GEO_KEYS, b"")))
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
    """Return metres in a unit of x and y and in one of z, None where it is not said, and whether x and y are degrees.

    The unit of a system is the last one in it: those of the systems that it is built on stand before.
    """
    found: dict[str, float | None] = {}
    for match in _SYSTEM.finditer(text):
        factors = [_number(unit) for unit in _UNIT.findall(_bracketed(text, match.end() - 1))]
        found.setdefault(match[1][:4], factors[-1] if factors else None)
    is_geographic = bool({"GEOG", "GEOD"} & set(found)) and "PROJ" not in found and "Cartesian" not in text
    return found.get("PROJ"), found.get("VERT"), is_geographic


def _bracketed(text: str, start: int) -> str:
    """Return what stands in the bracket that opens at `start`."""
    depth = 0
    for place in range(start, len(text)):
        depth += {"[": 1, "]": -1}.get(text[place], 0)
        if depth == 0:
            return text[start:place]
    return text[start:]


def _number(text: str) -> float | None:
    try:
        value = float(text)
    except ValueError:
        return None
    return value if 1e-6 < value < 1e6 else None


def _geo_keys(body: bytes) -> dict[int, int]:
    """Return the keys whose value stands in the directory itself."""
    values = struct.unpack(f"<{len(body) // 2}H", body[: len(body) // 2 * 2])
    rows = zip(*[iter(values[4:])] * 4, strict=False)
    return {key: value for key, location, _, value in rows if location == 0}


def _of_keys(keys: Mapping[int, int]) -> tuple[float | None, float | None, bool]:
    """Return what :func:`_of_wkt` does, of GeoTIFF keys."""
    upright = EPSG_UNITS.get(keys.get(VERTICAL_UNITS, 0))
    return EPSG_UNITS.get(keys.get(LINEAR_UNITS, 0)), upright, keys.get(MODEL_TYPE) == GEOGRAPHIC
