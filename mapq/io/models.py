"""The model file: readable JSON of schema ``mapq.model/4``, docs/results.md lists its keys."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import replace
from importlib import resources
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapq.io.content import damage_in_one_line
from mapq.kernels.boosted_trees import LEAF, Trees
from mapq.model import CALIBRATIONS, EDGE_MODELS, ISOTONIC, PLATT, Calibration, Model, Potential, Scaling
from prf.shell.cli.files import open_output
from prf.shell.cli.storage import damaged, dump_object, load_object
from prf.shell.errors import InputError

SCHEMA = "mapq.model/4"
DEFAULT = ("models", "default.json")
"""Place in the package of the model that is used where none is named."""

OPERATING = ("false_alarms", "threshold", "recall")
"""Columns of the operating points."""

SIDES = ("left", "right")
"""Where a node of a tree sends unknown values."""


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
        "potential": None if model.potential is None else _potential_content(model.potential),
        "parameters": parameters,
        "calibration": _calibration_content(model.calibration),
        "threshold": model.threshold,
        "tolerances": list(model.tolerances),
        "operating": {name: column.tolist() for name, column in zip(OPERATING, model.operating.T, strict=True)},
        "x_min": model.x_range[0],
        "x_max": model.x_range[1],
        "node_scaling": _scaling_content(model.node),
        "features": dict(model.features),
        "training": dict(model.training),
    }


def _calibration_content(calibration: Calibration) -> dict[str, Any]:
    if calibration.kind == ISOTONIC:
        at, value = calibration.knots.T.tolist()
        return {"kind": calibration.kind, "difference": at, "log_odds": value}
    shift = {"intercept": calibration.intercept} if calibration.kind == PLATT else {}
    return {"kind": calibration.kind, "slope": calibration.slope, **shift}


def _scaling_content(scaling: Scaling) -> dict[str, Any]:
    rows = zip(scaling.names, scaling.median.tolist(), scaling.scale.tolist(), strict=True)
    columns = {name: {"median": median, "scale": scale} for name, median, scale in rows}
    return {"clip": scaling.clip, "columns": columns}


def _potential_content(potential: Potential) -> dict[str, Any]:
    """Return trees as JSON: a node is ``column threshold left right side mean``, a leaf ``leaf value``.

    Values up to the threshold go to the node of the tree numbered `left`, and unknown ones to the side named.
    """
    trees, rows = potential.trees, []
    roots = [*trees.root.tolist(), len(trees.column)]
    for begin, end in pairwise(roots):
        rows.append([_node_text(potential, node, begin) for node in range(begin, end)])
    return {"base": potential.base, "columns": list(potential.names), "trees": rows}


def _node_text(potential: Potential, node: int, begin: int) -> str:
    trees = potential.trees
    value = float(trees.value[node])
    if trees.column[node] == LEAF:
        return f"leaf {value!r}"
    name, side = potential.names[int(trees.column[node])], SIDES[0 if trees.nan_left[node] else 1]
    left, right = int(trees.left[node]) - begin, int(trees.right[node]) - begin
    return f"{name} {float(trees.threshold[node])!r} {left} {right} {side} {value!r}"


def read_model(path: str | os.PathLike[str]) -> Model:
    """Read a model file.

    Raises
    ------
    InputError
        If it is missing, damaged, of another version, lacks a key, or has a weight that is not finite or a negative
        coupling.
    """
    file = Path(path)
    content = load_object(file, SCHEMA)
    with damage_in_one_line(str(path)):
        return _parse(file, content)


def read_default_model() -> Model:
    """Read the model that ships with the package; InputError if there is none."""
    with resources.as_file(resources.files("mapq").joinpath(*DEFAULT)) as path:
        if not path.is_file():
            raise InputError("no model ships with this installation. Train one with mapq train, name it with --model.")
        return read_model(path)


def _parse(path: Path, content: Mapping[str, Any]) -> Model:
    x_range = float(content["x_min"]), float(content["x_max"])
    potential = content.get("potential")
    model = Model(
        content["edge_model"],
        dict(content["features"]),
        _parse_scaling(path, content["node_scaling"]),
        x_range,
        np.zeros(0),
        _parse_calibration(path, content["calibration"]),
        float(content["threshold"]),
        np.column_stack([_finite(path, content["operating"][name], f"operating.{name}") for name in OPERATING]),
        dict(content["training"]),
        tuple(_finite(path, content["tolerances"], "tolerances").tolist()),
        None if potential is None else _parse_potential(path, potential),
    )
    if not model.tolerances or min(model.tolerances) <= 0.0:
        raise damaged(path, "tolerances must be metres above 0")
    if model.edge_model not in EDGE_MODELS:
        raise damaged(path, f"edge_model is not one of {', '.join(EDGE_MODELS)}")
    return replace(model, weights=_parse_weights(path, content["parameters"], model))


def _parse_weights(path: Path, parameters: Mapping[str, Any], model: Model) -> NDArray[np.float64]:
    names = [name.partition(".") for name in model.parameter_names]
    weights = _finite(path, [parameters[group][key] for group, _, key in names], "parameters")
    if any(group == "coupling" and weight < 0.0 for (group, _, _), weight in zip(names, weights, strict=True)):
        raise damaged(path, "parameters.coupling must not be negative")
    return weights


def _parse_calibration(path: Path, content: Mapping[str, Any]) -> Calibration:
    kind = content["kind"]
    if kind == ISOTONIC:
        knots = np.column_stack([_finite(path, content[name], "calibration") for name in ("difference", "log_odds")])
        return Calibration(kind, knots=knots)
    if kind not in CALIBRATIONS:
        raise damaged(path, f"calibration.kind is {kind!r}, not {', '.join(CALIBRATIONS)}")
    return Calibration(kind, float(content["slope"]), float(content["intercept"]) if kind == PLATT else 0.0)


def _parse_scaling(path: Path, scaling: Mapping[str, Any]) -> Scaling:
    columns = scaling["columns"]
    median, scale = (
        _finite(path, [column[key] for column in columns.values()], "node_scaling") for key in ("median", "scale")
    )
    return Scaling(tuple(columns), median, scale, float(scaling["clip"]))


def _finite(path: Path, values: list[float], what: str) -> NDArray[np.float64]:
    numbers = np.array(values, np.float64)
    if not np.isfinite(numbers).all():
        raise damaged(path, f"{what}: {repr(values)[:40]}: must be finite numbers")
    return numbers


def _parse_potential(path: Path, content: Mapping[str, Any]) -> Potential:
    """Return the trees of a model file; nodes lead to later ones of their tree only, so that every walk ends."""
    names = [str(name) for name in content["columns"]]
    roots: list[int] = []
    rows: list[tuple[float, ...]] = []
    for number, tree in enumerate(content["trees"]):
        begin = len(rows)
        roots.append(begin)
        if not tree:
            raise damaged(path, f"potential.trees.{number} has no node")
        for at, text in enumerate(tree):
            row = _parse_node(text, names, begin)
            if row[0] != LEAF and not all(begin + at < end < begin + len(tree) for end in row[2:4]):
                raise damaged(path, f"potential.trees.{number}.{at}: expected a node, got {text[:60]!r}")
            rows.append(row)
    table = np.array(rows, np.float64).reshape(-1, 6).T
    column, left, right = (table[place].astype(np.int64) for place in (0, 2, 3))
    trees = Trees(np.array(roots, np.int64), column, table[1].copy(), left, right, table[4] > 0.0, table[5].copy())
    return Potential(tuple(names), trees, float(content["base"]))


def _parse_node(text: str, names: list[str], begin: int) -> tuple[float, ...]:
    """Return column, threshold, left, right, whether unknown values go left, and value."""
    words = text.split()
    if len(words) == 2 and words[0] == "leaf":
        return LEAF, 0.0, 0, 0, 0.0, float(words[1])
    name, threshold, left, right, side, value = words
    is_left = float(SIDES.index(side) == 0)
    return names.index(name), float(threshold), begin + int(left), begin + int(right), is_left, float(value)
