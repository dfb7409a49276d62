from __future__ import annotations

import json

import pytest

from mapq.io.models import read_model
from tests.cli.mapq_samples import call, call_json, save_model, save_patches


def test_weights_and_held_out_scores_are_printed(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    paths = [save_patches(tmp_path, seed) for seed in (1, 2)]
    code, out, _ = call(capsys, "train", "-v", *paths)
    assert code == 0
    rows = {line.split()[0]: line.split()[1:] for line in out.splitlines()}
    model = read_model("model.json")
    printed = dict(each.split() for each in " ".join(rows["weights"]).split(", "))
    for name, weight in zip(model.parameter_names, model.weights, strict=True):
        assert float(printed[name]) == pytest.approx(weight, rel=1e-3)
    assert float(rows["accuracy"][0]) > 0.9
    assert "64 patches in 5 folds, 50.0% suspicious" in out


def test_options_reach_the_model(capsys, tmp_path):
    path, target = save_patches(tmp_path), tmp_path / "m.json"
    features = ("reading=literal", "radius=2.5", "tau=0.7", "neighbours=3", "watched=7", "tolerance=0.2")
    field = ("regularisation=3", "coupling_regularisation=4", "class_weight=none")
    values = [*(f"features.{each}" for each in features), *(f"crf.{each}" for each in field)]
    options = [word for value in values for word in ("--set", value)]
    result = call_json(capsys, "train", path, "-o", target, *options, "--objective", "pl")
    assert result["schema"] == "mapq.model/3"
    assert result["output"] == str(target)
    features = result["features"]
    assert [features[key] for key in ("reading", "radius", "tau", "n_neighbours")] == ["literal", 2.5, 0.7, 3]
    assert [features[key] for key in ("n_watched", "tolerance")] == [7, 0.2]
    training = result["training"]
    kept = [training[key] for key in ("regularisation", "coupling_regularisation", "class_weight", "objective")]
    assert kept == [3.0, 4.0, "none", "pl"]
    stored = json.loads(target.read_text())
    del result["output"]
    assert stored == result


@pytest.mark.parametrize("edge_model", ["symmetric", "none"])
def test_every_edge_model_trains(capsys, tmp_path, edge_model):
    target = tmp_path / "m.json"
    assert call(capsys, "train", save_patches(tmp_path), "-o", target, "--set", f"crf.edge_model={edge_model}")[0] == 0
    assert read_model(target).edge_model == edge_model


def test_the_table_is_short(capsys, tmp_path):
    out = call(capsys, "train", save_patches(tmp_path), "-o", tmp_path / "m.json")[1]
    assert len(out.splitlines()) <= 15
    assert "node.bias" in out
    assert "--max-false-alarms" not in out


def test_labels_of_one_kind_are_refused(capsys, tmp_path):
    path = save_patches(tmp_path)
    from mapq.io import read_patches, write_patches

    patches = read_patches(path)
    patches.label[:] = 0
    write_patches(path, patches)
    code, _, err = call(capsys, "train", path, "-o", tmp_path / "m.json")
    assert (code, err.count("\n")) == (3, 1)
    assert "all 32 labelled patches are plausible" in err


def test_the_operating_point_is_stored_and_can_be_chosen_later(capsys, tmp_path):
    target, careful = tmp_path / "m.json", tmp_path / "careful.json"
    paths = [save_patches(tmp_path, seed) for seed in (1, 2)]
    plain = call_json(capsys, "train", *paths, "-o", target)
    chosen = call_json(capsys, "train", *paths, "--max-false-alarms", "0%", "-o", careful)
    points = plain["operating"]
    assert plain["threshold"] == 0.0
    assert points["false_alarms"][0] == 0.0
    assert chosen["threshold"] == points["threshold"][0]
    assert chosen["parameters"] == plain["parameters"]
    results = []
    for name, options in (("a", ["--model", careful]), ("b", ["--model", target, "--max-false-alarms", "0"])):
        results.append(call_json(capsys, "classify", paths[0], *options, "-o", tmp_path / f"{name}.ply"))
    assert results[0]["threshold"] == results[1]["threshold"]
    assert results[0]["threshold"]["difference"] == chosen["threshold"]
    cut = results[0]["threshold"]["p_suspicious"]
    for row in results[0]["patches"]:
        assert (row["label"] == "suspicious") == (row["difference"] >= chosen["threshold"] - 1e-9)
        assert (row["label"] == "suspicious") == (row["p_suspicious"] > cut - 1e-7)


def test_a_model_without_held_out_regions_has_no_operating_point(capsys, tmp_path):
    path = save_patches(tmp_path)
    options = ["--model", save_model(tmp_path), "--max-false-alarms", "1%"]
    for verb in ("classify", "evaluate"):
        code, out, err = call(capsys, verb, path, *options)
        assert (code, out, err.count("\n")) == (2, "", 1)
        assert "has no operating points" in err


def test_maximum_margin_trains(capsys, tmp_path):
    paths = [save_patches(tmp_path, seed) for seed in (1, 2)]
    found = call_json(capsys, "train", *paths, "--objective", "max-margin", "-o", tmp_path / "m.json")
    assert found["training"]["objective"] == "max-margin"
    assert found["training"]["held_out"]["accuracy"] > 0.9
    assert min(found["parameters"]["coupling"].values()) >= 0.0
