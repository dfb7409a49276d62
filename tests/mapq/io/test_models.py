from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from mapq.configuration import FeatureSettings
from mapq.features.compute import feature_settings
from mapq.io.models import SCHEMA, read_default_model, read_model, write_model
from mapq.model import EDGE_MODELS, Calibration
from prf.shell.errors import InputError
from tests.reference.mapq_crf import draw_model
from tests.reference.mapq_trees import draw_potential


def saved(tmp_path, edge_model="symmetric"):
    path = tmp_path / "m.json"
    write_model(path, draw_model(np.random.default_rng(1), edge_model))
    return path


@pytest.mark.parametrize("edge_model", EDGE_MODELS)
def test_what_is_written_is_read(edge_model, tmp_path):
    model = draw_model(np.random.default_rng(1), edge_model)
    found = read_model(saved(tmp_path, edge_model))
    assert found.parameter_names == model.parameter_names
    for name in ("edge_model", "x_range", "threshold", "features", "training"):
        assert getattr(found, name) == getattr(model, name)
    np.testing.assert_array_equal(found.weights, model.weights)
    assert (found.node.names, found.node.clip) == (model.node.names, model.node.clip)
    np.testing.assert_array_equal(found.node.median, model.node.median)
    np.testing.assert_array_equal(found.node.scale, model.node.scale)


@pytest.mark.parametrize(
    "calibration",
    [
        Calibration("temperature", 1.0 / 3.0),
        Calibration("platt", 1.0 / 3.0, -0.1),
        Calibration("isotonic", knots=np.array([[-1.0 / 3.0, -2.0], [0.1, 0.0], [2.0, 0.0]])),
    ],
)
def test_calibrations_and_operating_points_are_read_to_the_last_bit(calibration, tmp_path):
    points = np.array([[0.0, 1.0 / 3.0, 0.5], [0.1, -0.7, 1.0]])
    model = replace(draw_model(np.random.default_rng(1)), calibration=calibration, operating=points, threshold=0.1)
    write_model(tmp_path / "m.json", model)
    found = read_model(tmp_path / "m.json")
    one, other = found.calibration, calibration
    assert (one.kind, one.slope, one.intercept) == (other.kind, other.slope, other.intercept)
    np.testing.assert_array_equal(one.knots, other.knots)
    np.testing.assert_array_equal(found.operating, points)
    assert found.threshold == 0.1


def test_the_file_is_readable(tmp_path):
    content = json.loads(saved(tmp_path).read_text())
    assert content["schema"] == SCHEMA == "mapq.model/4"
    assert set(content["parameters"]) == {"node", "coupling"}
    assert set(content["parameters"]["node"]) == {"bias", "fit", "tilt", "thickness"}
    assert set(content["parameters"]["coupling"]) == {"at_x_min", "at_x_max"}
    assert set(content["node_scaling"]["columns"]["fit"]) == {"median", "scale"}


@pytest.mark.parametrize(
    ("place", "value", "message"),
    [
        ("schema", "mapq.model/1", "version 1 of mapq.model is not known"),
        ("schema", "mapq.result/1", "schema mapq.result/1, expected"),
        ("edge_model", "potts", "edge_model is not one of"),
        ("calibration.kind", "warm", "calibration.kind is 'warm', not temperature, platt, isotonic"),
        ("calibration.slope", "hot", "damaged"),
        ("calibration", {"kind": "platt", "slope": 1.0}, "'intercept' is missing"),
        ("operating.recall", [1.0], "damaged"),
        ("parameters.coupling.at_x_min", -1e-9, "coupling must not be negative"),
        ("parameters", [], "damaged"),
        ("features", "safe", "damaged"),
    ],
)
def test_content_that_is_no_model_is_one_line(place, value, message, tmp_path):
    path = saved(tmp_path)
    content = json.loads(path.read_text())
    at = content
    *way, last = place.split(".")
    for key in way:
        at = at[key]
    at[last] = value
    path.write_text(json.dumps(content))
    with pytest.raises(InputError) as error:
        read_model(path)
    assert message in str(error.value)
    assert str(path) in str(error.value)
    assert "\n" not in str(error.value)


def test_a_file_that_is_cut_off_is_damaged(tmp_path):
    path = saved(tmp_path)
    path.write_text(path.read_text()[:200])
    with pytest.raises(InputError, match="damaged"):
        read_model(path)


def test_the_shipped_model_measures_as_this_release_does_and_holds_nothing_of_one_run():
    model = read_default_model()
    assert feature_settings(model) == FeatureSettings()
    assert "created" not in model.training
    assert all("sha256" not in row for row in model.training["maps"])


def test_a_model_measured_otherwise_is_refused_in_one_line():
    model = read_default_model()
    less = {name: value for name, value in model.features.items() if name != "tau"}
    cases = (
        (less, "tau is missing"),
        ({**model.features, "reading": "safe"}, "reading is not known to this release"),
        ({**model.features, "tau": -1.0}, "cannot be used"),
    )
    for features, words in cases:
        with pytest.raises(InputError, match=words) as error:
            feature_settings(replace(model, features=features))
        assert "Train the model anew" in str(error.value)
        assert "\n" not in str(error.value)


NAMES = ("fit", "disagreement", "over_angle_deg")


def saved_trees(tmp_path, seed=1):
    rng = np.random.default_rng(seed)
    model = draw_model(rng, "symmetric", potential=draw_potential(rng, NAMES))
    path = tmp_path / "m.json"
    write_model(path, model)
    return path, model


@pytest.mark.parametrize("seed", range(3))
def test_trees_are_read_to_the_last_bit(seed, tmp_path):
    path, model = saved_trees(tmp_path, seed)
    found = read_model(path).potential
    assert (found.names, found.base) == (model.potential.names, model.potential.base)
    for name, one, other in zip(found.trees._fields, found.trees, model.potential.trees, strict=True):
        assert one.dtype == other.dtype
        leaf = model.potential.trees.column < 0
        kept = ~leaf if name in ("threshold", "left", "right", "nan_left") else slice(None)
        np.testing.assert_array_equal(one[kept], other[kept], err_msg=name)


def test_a_threshold_of_known_against_unknown_is_kept(tmp_path):
    path, model = saved_trees(tmp_path)
    threshold = np.where(model.potential.trees.column < 0, 0.0, np.inf)
    trees = model.potential.trees._replace(threshold=threshold)
    model = model.__class__(**{**model.__dict__, "potential": model.potential._replace(trees=trees)})
    write_model(path, model)
    np.testing.assert_array_equal(read_model(path).potential.trees.threshold, threshold)
