"""The tables of a settings file of `mapq`: the settings of a step each, and their own checks judge the values."""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

from mapq.crf.train import OBJECTIVES, POTENTIALS
from mapq.features.settings import CONTEXTS, FeatureSettings
from mapq.model import EDGE_MODELS
from mapq.segmentation.settings import SegmentSettings
from prf.shell.configuration import Array, Kind, Number, Schema, Table, Whole, Word, Words
from prf.shell.errors import ConfigError

CLASS_WEIGHTS = ("none", "balanced")

FIELDS: Mapping[str, str] = MappingProxyType({"neighbours": "n_neighbours", "watched": "n_watched"})
"""Keys of [features] whose field of :class:`FeatureSettings` has another name; they are those of the options."""

SEGMENT: Mapping[str, Kind] = MappingProxyType(
    {
        "neighbours": Whole(),
        "resolution": Number(),
        "noise": Number(),
        "max_angle": Number(),
        "max_distance": Number(),
        "max_gap": Number(),
        "max_variation": Number(),
        "min_points": Whole(),
        "min_extent": Number(),
        "max_tilt": Number(),
        "up": Array(3),
    }
)
FEATURES: Mapping[str, Kind] = MappingProxyType(
    {
        "reading": Word(("safe", "literal")),
        "neighbours": Whole(),
        "watched": Whole(),
        "radius": Number(),
        "tau": Number(),
        "eps": Number(),
        "noise": Number(),
        "tolerance": Number(),
        "spacing": Number(),
        "up": Array(3),
        "context": Words(CONTEXTS),
    }
)
CRF: Mapping[str, Kind] = MappingProxyType(
    {
        "objective": Word(OBJECTIVES),
        "potential": Word(POTENTIALS),
        "edge_model": Word(EDGE_MODELS),
        "regularisation": Number(),
        "coupling_regularisation": Number(),
        "class_weight": Word(CLASS_WEIGHTS),
        "folds": Whole(),
        "max_false_alarms": Number(),
    }
)


def in_fields(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return values of [features] under the names of the fields of :class:`FeatureSettings`."""
    return {FIELDS.get(key, key): value for key, value in values.items()}


def _check_segment(values: Mapping[str, Any]) -> None:
    SegmentSettings(**values).check()


def _check_features(values: Mapping[str, Any]) -> None:
    FeatureSettings(**in_fields(values))


def _check_crf(values: Mapping[str, Any]) -> None:
    for name in ("regularisation", "coupling_regularisation"):
        if not 0.0 < values.get(name, 1.0) < math.inf:
            raise ConfigError(f"{name} {values[name]}: must be above 0, or separable labels would have no optimum")
    if values.get("folds", 2) < 2:
        raise ConfigError(f"folds {values['folds']}: must be 2 or more")
    if not 0.0 <= values.get("max_false_alarms", 0.0) <= 1.0:
        raise ConfigError(f"max_false_alarms {values['max_false_alarms']}: must be a share between 0 and 1")


TABLES: Mapping[str, Table] = MappingProxyType(
    {
        "segment": Table(SEGMENT, _check_segment),
        "features": Table(FEATURES, _check_features),
        "crf": Table(CRF, _check_crf),
    }
)
"""The tables that a file may have."""

SCHEMA = Schema(TABLES, presets="mapq.settings")
