"""Trees in the model file: read to the last bit, refused when damaged."""

from __future__ import annotations

import json

import numpy as np
import pytest

from mapq.io.models import read_model, write_model
from prf.shell.errors import InputError
from tests.reference.mapq_crf import draw_model
from tests.reference.mapq_trees import draw_potential

NAMES = ("fit", "disagreement", "over_angle_deg")
NODE = "fit 0.1 1 2 left 0.2"


def saved(tmp_path, seed=1):
    rng = np.random.default_rng(seed)
    model = draw_model(rng, "symmetric", potential=draw_potential(rng, NAMES))
    path = tmp_path / "m.json"
    write_model(path, model)
    return path, model


@pytest.mark.parametrize("seed", range(3))
def test_trees_are_read_to_the_last_bit(seed, tmp_path):
    path, model = saved(tmp_path, seed)
    found = read_model(path).potential
    assert (found.names, found.base) == (model.potential.names, model.potential.base)
    for name, one, other in zip(found.trees._fields, found.trees, model.potential.trees, strict=True):
        assert one.dtype == other.dtype
        leaf = model.potential.trees.column < 0
        kept = ~leaf if name in ("threshold", "left", "right", "nan_left") else slice(None)
        np.testing.assert_array_equal(one[kept], other[kept], err_msg=name)


def test_a_threshold_of_known_against_unknown_is_kept(tmp_path):
    path, model = saved(tmp_path)
    threshold = np.where(model.potential.trees.column < 0, 0.0, np.inf)
    trees = model.potential.trees._replace(threshold=threshold)
    model = model.__class__(**{**model.__dict__, "potential": model.potential._replace(trees=trees)})
    write_model(path, model)
    np.testing.assert_array_equal(read_model(path).potential.trees.threshold, threshold)


@pytest.mark.parametrize(
    ("place", "value", "message"),
    [
        ("base", None, "no finite base"),
        ("base", float("nan"), "no finite base"),
        ("base", "0", "no finite base"),
        ("base", 10**400, "no finite base"),
        ("base", True, "no finite base"),
        ("columns", "fit", "no lists"),
        ("columns", [1], "no lists"),
        ("trees", {}, "no lists"),
        ("trees", [[]], "trees.0 is no list of nodes"),
        ("trees", ["leaf 1"], "trees.0 is no list of nodes"),
        ("trees", [["leaf 1"], [NODE, "leaf 1"]], "trees.1.0 is no node"),
        *(
            ("trees", [[text, "leaf 1", "leaf 2"]], "trees.0.0 is no node")
            for text in (
                7,
                "",
                "leaf",
                "leaf nan",
                "leaf inf",
                "leaf one",
                "leaf 1e300",
                "leaf 1 2",
                "colour 0.1 1 2 left 0.2",
                "fit nan 1 2 left 0.2",
                "fit 0.1 0 2 left 0.2",
                "fit 0.1 1 3 left 0.2",
                "fit 0.1 -1 2 left 0.2",
                "fit 0.1 1.5 2 left 0.2",
                "fit 0.1 1 2 up 0.2",
                "fit 0.1 1 2 left inf",
                "fit 0.1 1 2 left",
                "fit 0.1 1 2 left 0.2 0.3",
            )
        ),
        ("trees", [[NODE, "leaf 1", "fit 0.1 1 2 left 0.2"]], "trees.0.2 is no node"),
    ],
)
def test_damaged_trees_are_one_line_that_names_the_file(place, value, message, tmp_path):
    path, _ = saved(tmp_path)
    content = json.loads(path.read_text())
    content["potential"][place] = value
    path.write_text(json.dumps(content))
    with pytest.raises(InputError) as error:
        read_model(path)
    assert message in str(error.value)
    assert str(path) in str(error.value)
    assert "\n" not in str(error.value)


def test_trees_are_the_only_node_feature(tmp_path):
    path, _ = saved(tmp_path)
    content = json.loads(path.read_text())
    content["node_scaling"]["columns"]["more"] = {"median": 0.0, "scale": 1.0}
    content["parameters"]["node"]["more"] = 1.0
    path.write_text(json.dumps(content))
    with pytest.raises(InputError, match="node_scaling has not evidence alone"):
        read_model(path)
