"""The model file: readable JSON of schema ``mapq.model/3``, docs/results.md lists its keys."""

from __future__ import annotations

import os
from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapq.io.trees import LARGEST, parse_potential, potential_content
from mapq.model import CALIBRATIONS, EDGE_MODELS, EVIDENCE, ISOTONIC, PLATT, Calibration, Model, Scaling
from prf.shell.errors import InputError
from prf.shell.files import open_output
from prf.shell.jsonout import dump_object
from prf.shell.storage import damaged, load_object

SCHEMA = "mapq.model/3"
DEFAULT = ("models", "default.json")
"""Place in the package of the model that is used where none is named."""

OPERATING = ("false_alarms", "threshold", "recall")
"""Columns of the operating points."""

SMALLEST = 1e-30
"""Of scales: products and sums of what lies between it and `LARGEST` are finite."""

_KINDS: dict[type, str] = {str: "text", dict: "an object", list: "a list"}


def write_model(path: str | os.PathLike[str], model: Model) -> None:
    """Write a model, whole or not at all; ``-`` is standard output.

    Numbers are written in full: reading gives the same model to the last bit. The coupling is written as its values at
    both ends of the range of x, so no rounding can make it negative between them.
    """
    with open_output(path) as stream:
        stream.write(dump_object(SCHEMA, model_content(model), indent=2) + "\n")


def model_content(model: Model) -> dict[str, Any]:
    """Return a model as the JSON object of its file, without the schema."""
    parameters: dict[str, dict[str, float]] = {}
    for name, weight in zip(model.parameter_names, model.weights.tolist(), strict=True):
        group, _, key = name.partition(".")
        parameters.setdefault(group, {})[key] = weight
    return {
        "edge_model": model.edge_model,
        "potential": None if model.potential is None else potential_content(model.potential),
        "parameters": parameters,
        "calibration": _calibration_content(model.calibration),
        "threshold": model.threshold,
        "operating": {name: column.tolist() for name, column in zip(OPERATING, model.operating.T, strict=True)},
        "x_min": model.x_range[0],
        "x_max": model.x_range[1],
        "node_scaling": _scaling_content(model.node),
        "features": dict(model.features),
        "training": dict(model.training),
    }


def read_model(path: str | os.PathLike[str]) -> Model:
    """Read a model file.

    Raises
    ------
    InputError
        If it is missing, damaged, of another version, lacks a key, holds a number that is not finite, or breaks a
        constraint: a negative coupling, a scale or slope that is not positive, a calibration that falls.
    """
    return _parse(Path(path), load_object(Path(path), SCHEMA))


def read_default_model() -> Model:
    """Read the model that ships with the package.

    Raises
    ------
    InputError
        If it does not.
    """
    with resources.as_file(resources.files("mapq").joinpath(*DEFAULT)) as path:
        if not path.is_file():
            raise InputError("no model ships with this installation. Train one with mapq train, name it with --model.")
        return read_model(path)


def _calibration_content(calibration: Calibration) -> dict[str, Any]:
    if calibration.kind == ISOTONIC:
        at, value = calibration.knots.T.tolist()
        return {"kind": calibration.kind, "difference": at, "log_odds": value}
    shift = {"intercept": calibration.intercept} if calibration.kind == PLATT else {}
    return {"kind": calibration.kind, "slope": calibration.slope, **shift}


def _scaling_content(scaling: Scaling) -> dict[str, Any]:
    rows = zip(scaling.names, scaling.median.tolist(), scaling.scale.tolist(), strict=True)
    return {
        "clip": scaling.clip,
        "columns": {name: {"median": median, "scale": scale} for name, median, scale in rows},
    }


def _parse(path: Path, content: Mapping[str, Any]) -> Model:
    edge_model = _take(path, content, "edge_model", str)
    if edge_model not in EDGE_MODELS:
        raise damaged(path, f"edge_model is {edge_model!r}, not {', '.join(EDGE_MODELS)}")
    node = _parse_scaling(path, content, "node_scaling")
    x_range = _number(path, content, "x_min"), _number(path, content, "x_max")
    if x_range[0] > x_range[1]:
        raise damaged(path, f"x_min {x_range[0]} is above x_max {x_range[1]}")
    calibration = _parse_calibration(path, _take(path, content, "calibration", dict))
    threshold = _number(path, content, "threshold")
    blank = Model(edge_model, {}, node, x_range, np.zeros(0))
    weights = _parse_weights(path, _take(path, content, "parameters", dict), blank)
    features, training = _take(path, content, "features", dict), _take(path, content, "training", dict)
    potential = None
    if content.get("potential") is not None:
        potential = parse_potential(path, _take(path, content, "potential", dict))
        if node.names != (EVIDENCE,):
            raise damaged(path, f"node_scaling has not {EVIDENCE} alone, but the model has trees")
    operating = _parse_operating(path, _take(path, content, "operating", dict))
    return Model(edge_model, features, node, x_range, weights, calibration, threshold, operating, training, potential)


def _parse_weights(path: Path, parameters: Mapping[str, Any], model: Model) -> NDArray[np.float64]:
    weights = []
    for name in model.parameter_names:
        group, _, key = name.partition(".")
        weights.append(_number(path, _take(path, parameters, group, dict, "parameters."), key, f"parameters.{group}."))
        if group == "coupling" and weights[-1] < 0.0:
            raise damaged(path, f"parameters.{name} is {weights[-1]}, but the coupling must not be negative")
    n_found = sum(len(group) if isinstance(group, dict) else 1 for group in parameters.values())
    if n_found != len(weights):
        raise damaged(path, f"parameters are {n_found}, but edge_model {model.edge_model} has {len(weights)}")
    return np.array(weights)


def _parse_calibration(path: Path, content: Mapping[str, Any]) -> Calibration:
    kind = _take(path, content, "kind", str, "calibration.")
    if kind not in CALIBRATIONS:
        raise damaged(path, f"calibration.kind is {kind!r}, not {', '.join(CALIBRATIONS)}")
    if kind == ISOTONIC:
        columns = [_numbers(path, content, name, "calibration.") for name in ("difference", "log_odds")]
        if len(columns[0]) != len(columns[1]) or len(columns[0]) == 0:
            raise damaged(path, "calibration.difference and calibration.log_odds are not alike long, or empty")
        if (np.diff(columns[0]) <= 0.0).any() or (np.diff(columns[1]) < 0.0).any():
            raise damaged(path, "calibration: the curve does not rise")
        return Calibration(kind, knots=np.column_stack(columns))
    slope = _number(path, content, "slope", "calibration.")
    if slope <= 0.0:
        raise damaged(path, f"calibration.slope is {slope}, not above 0")
    intercept = _number(path, content, "intercept", "calibration.") if kind == PLATT else 0.0
    return Calibration(kind, slope, intercept)


def _parse_operating(path: Path, content: Mapping[str, Any]) -> NDArray[np.float64]:
    columns = [_numbers(path, content, name, "operating.") for name in OPERATING]
    if len({len(column) for column in columns}) > 1:
        raise damaged(path, "operating: the lists are not alike long")
    points = np.column_stack(columns)
    if len(points) and (points[0, 0] != 0.0 or (np.diff(points[:, 0]) <= 0.0).any()):
        raise damaged(path, "operating.false_alarms do not ascend from 0")
    return points


def _parse_scaling(path: Path, content: Mapping[str, Any], key: str) -> Scaling:
    scaling = _take(path, content, key, dict)
    columns = _take(path, scaling, "columns", dict, f"{key}.")
    median, scale = [], []
    for name in columns:
        where = f"{key}.columns.{name}."
        column = _take(path, columns, name, dict, f"{key}.columns.")
        median.append(_number(path, column, "median", where))
        scale.append(_number(path, column, "scale", where))
    clip = _number(path, scaling, "clip", f"{key}.")
    if min([clip, *scale]) < SMALLEST:
        raise damaged(path, f"{key}: clip and scales must be above 0")
    return Scaling(tuple(columns), np.array(median), np.array(scale), clip)


def _take(path: Path, content: Mapping[str, Any], key: str, kind: type, where: str = "") -> Any:
    if key not in content:
        raise damaged(path, f"{where}{key} is missing")
    if not isinstance(content[key], kind):
        raise damaged(path, f"{where}{key} is not {_KINDS[kind]}")
    return content[key]


def _numbers(path: Path, content: Mapping[str, Any], key: str, where: str) -> NDArray[np.float64]:
    values = _take(path, content, key, list, where)
    named = {str(place): value for place, value in enumerate(values)}
    return np.array([_number(path, named, place, f"{where}{key}.") for place in named], np.float64)


def _number(path: Path, content: Mapping[str, Any], key: str, where: str = "") -> float:
    if key not in content:
        raise damaged(path, f"{where}{key} is missing")
    value = content[key]
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) < LARGEST:
        raise damaged(path, f"{where}{key} is {repr(value)[:24]}, not a finite number")
    return float(value)
