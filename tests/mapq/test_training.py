from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mapq.crf import TrainSettings
from mapq.features import FeatureSettings
from mapq.features.settings import feature_settings
from mapq.io import write_patches
from mapq.io.models import read_model, write_model
from mapq.labels import UNLABELLED
from mapq.results.result import assess
from mapq.training import train_maps
from prf.shell.errors import InputError
from tests.mapq.labelled import draw_patches


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("maps")
    paths = []
    for seed in (1, 2):
        path = folder / f"{seed}.patches"
        write_patches(path, draw_patches(seed))
        paths.append(str(path))
    return paths


def test_double_walls_are_learnt_and_found_on_another_map(files, tmp_path):
    model = train_maps(files)
    assert model.training["held_out"]["accuracy"] > 0.9
    write_model(tmp_path / "m.json", model)
    other = draw_patches(3)
    label = assess(other, read_model(tmp_path / "m.json")).labelling.label
    assert (label == other.label).mean() > 0.95
    assert model.training["held_out"]["n_folds"] == 5


def test_the_summary_lists_the_training_maps(files):
    features = FeatureSettings(radius=2.5)
    model = train_maps(files, TrainSettings("linear", regularisation=1.0), features)
    summary = model.training
    assert summary["n_patches"] == 64
    assert summary["n_suspicious"] == 32
    assert [row["name"] for row in summary["maps"]] == ["1.patches", "2.patches"]
    assert all(len(row["sha256"]) == 64 for row in summary["maps"])
    assert summary["regularisation"] == 1.0
    assert summary["class_weight"] == "balanced"
    assert summary["pseudo_log_likelihood"] < 0.0
    assert feature_settings(model) == features


def test_training_repeats(files):
    first, again = (train_maps(files) for _ in range(2))
    np.testing.assert_array_equal(first.weights, again.weights)
    assert first.calibration.slope == again.calibration.slope
    np.testing.assert_array_equal(first.operating, again.operating)


def test_maps_without_labels_are_refused(tmp_path):
    path = str(tmp_path / "bare.patches")
    write_patches(path, draw_patches(1, labelled=False))
    with pytest.raises(InputError, match="mapq label"):
        train_maps([path])


def test_settings_of_features_that_are_strange_are_refused(files):
    model = train_maps(files, TrainSettings("linear", regularisation=1.0))
    for change, message in (
        ({"colour": 1}, "colour is not known"),
        ({"radius": "wide"}, "cannot be used"),
        ({"radius": -1.0}, "cannot be used"),
        ({"up": 3}, "cannot be used"),
    ):
        with pytest.raises(InputError, match=message):
            feature_settings(replace(model, features={**model.features, **change}))
    short = {name: value for name, value in model.features.items() if name != "tau"}
    with pytest.raises(InputError, match="tau is missing"):
        feature_settings(replace(model, features=short))


def test_conservative_training_counts_what_has_no_label_as_suspicious(tmp_path):
    patches = draw_patches(1)
    label = patches.label.copy()
    label[np.flatnonzero(label == 1)[:6]] = UNLABELLED
    paths = [str(tmp_path / "a.patches"), str(tmp_path / "bare.patches")]
    write_patches(paths[0], replace(patches, label=label))
    write_patches(paths[1], draw_patches(2, labelled=False))
    plain, careful = (train_maps(paths, conservative=each).training for each in (False, True))
    assert careful["n_suspicious"] == plain["n_suspicious"] + 6 == 16
    assert careful["n_patches"] == 32
    assert (plain["labels"], careful["labels"]) == ("given", "conservative")
