"""The tables of a settings file: one a model, a key a parameter of it.

Which keys there are follows from the models, and their own checks judge the values, so that a file and the options of a
verb can never disagree about what is allowed.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

from prf.arak import checked_scale
from prf.sensors.laser import LaserModel
from prf.sensors.points import KINDS, PointModel
from prf.sensors.sonar import SonarModel
from prf.shell.configuration import Array, Kind, Number, Schema, Table, Word
from prf.shell.errors import ConfigError
from prf.thinning import checked_density
from prf.window import Window

Tables = Mapping[str, Mapping[str, Any]]
"""Table to key to value: a float, a tuple of four for a window, or one of some words. SI units."""

KINDS_OF_KEYS: Mapping[str, Kind] = MappingProxyType({"window": Array(4), "kind": Word(KINDS)})
"""Keys whose value is something else than one number."""


def _check_prior(values: Mapping[str, Any]) -> None:
    checked_scale(values.get("scale", 1.0))
    if "window" in values:
        Window.checked(*values["window"])


def _check_laser(values: Mapping[str, Any]) -> None:
    # Without one in the file the maximum range comes from the log.
    LaserModel(**{"max_range": 1.0, **values})


def _check_sonar(values: Mapping[str, Any]) -> None:
    cone = values.get("cone", 1.0)
    if not 0.0 < cone < math.pi:
        raise ConfigError(f"cone {cone}: must lie between 0 and pi radians")
    SonarModel(**{key: value for key, value in values.items() if key != "cone"})


def _check_points(values: Mapping[str, Any]) -> None:
    PointModel(**values)


def _check_thinning(values: Mapping[str, Any]) -> None:
    checked_density(values.get("beam_density", 0.0))


def _keys(*names: str) -> Mapping[str, Kind]:
    return MappingProxyType({name: KINDS_OF_KEYS.get(name, Number()) for name in names})


def _fields(model: type) -> tuple[str, ...]:
    return tuple(field.name for field in dataclasses.fields(model))


TABLES: Mapping[str, Table] = MappingProxyType(
    {
        "prior": Table(_keys("scale", "window"), _check_prior),
        "laser": Table(_keys(*_fields(LaserModel)), _check_laser),
        "sonar": Table(_keys(*_fields(SonarModel), "cone"), _check_sonar),
        "points": Table(_keys(*_fields(PointModel)), _check_points),
        "thinning": Table(_keys("beam_density"), _check_thinning),
    }
)
"""The tables that a file may have."""

SCHEMA = Schema(TABLES, presets="prf.settings_file")
