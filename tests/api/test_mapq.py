"""`mapq.segment`, `mapq.train`, `mapq.classify`: numpy in and out, the same as the verbs write."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import mapq
from mapq.cli import app
from mapq.segmentation import segment as cut
from prf.shell.cli.run import run_app
from prf.shell.errors import ArgumentError, InputError, OutputExists, UsageError


@pytest.fixture(scope="module")
def cloud(data_dir: Path) -> mapq.PointCloud:
    town = mapq.read_cloud(data_dir / "demo-town.ply.gz")
    return town.take(np.linalg.norm(town.xyz[:, :2] - [126.0, 10.0], axis=1) < 17.0)


@pytest.fixture(scope="module")
def patches(cloud: mapq.PointCloud) -> mapq.Patches:
    return mapq.segment(cloud, progress=False)


@pytest.fixture(scope="module")
def result(patches: mapq.Patches) -> mapq.Result:
    return mapq.classify(patches, progress=False)


def test_arrays_and_clouds_give_the_same_patches(cloud: mapq.PointCloud, patches: mapq.Patches) -> None:
    np.testing.assert_array_equal(mapq.segment(cloud.world(), progress=False).patch, patches.patch)
    np.testing.assert_array_equal(cut(cloud).patch, patches.patch)
    assert repr(patches) == f"<mapq.Patches: {len(patches)} patches of {patches.counts.sum():,} points>"


def test_lengths_follow_the_unit(cloud: mapq.PointCloud, patches: mapq.Patches) -> None:
    in_feet = mapq.point_cloud(cloud.world() / 0.3048, {"time": np.arange(len(cloud)) * 1e-4}, unit=0.3048)
    found = mapq.segment(in_feet, progress=False)
    np.testing.assert_allclose(
        *(mapq.patch_features(each).nodes["area_m2"].sum() for each in (found, patches)), rtol=0.1
    )
    assert list(in_feet.fields) == ["time"]


def test_features_are_named_columns(patches: mapq.Patches) -> None:
    plain = mapq.patch_features(patches)
    nodes, edges = plain.nodes, plain.edges
    np.testing.assert_array_equal(nodes["thickness"], plain.node[:, plain.node_names.index("thickness")])
    np.testing.assert_array_equal(edges["plausibility"], plain.plausibility)
    np.testing.assert_array_equal(np.column_stack([edges["i"], edges["j"]]), plain.pairs)
    assert plain.units["area_m2"] == "m2"
    assert plain.parameters["radius"] == 3.0
    assert mapq.patch_features(patches, mapq.FeatureSettings(radius=1.0)).parameters["radius"] == 1.0


def test_a_result_speaks_of_points_as_the_written_one_does(result: mapq.Result, tmp_path: Path) -> None:
    result.save(tmp_path / "map.ply", fail_over=0.05)
    written = mapq.read_cloud(tmp_path / "map.ply").fields
    np.testing.assert_array_equal(result.patch, written["patch"])
    np.testing.assert_array_equal(result.suspicious, written["suspicious"])
    np.testing.assert_array_equal(result.p_suspicious, written["p_suspicious"])
    np.testing.assert_array_equal(result.suspicious == 255, result.patch == -1)
    np.testing.assert_array_equal(result.label[result.patch[result.patch >= 0]], result.suspicious[result.patch >= 0])
    told = json.loads((tmp_path / "map.json").read_text())
    assert told["verdict"]["passed"] == result.verdict(0.05)["passed"]
    assert [row["p_suspicious"] for row in told["patches"]] == result.probability.tolist()
    assert len(told["regions"]) == len(result.regions)
    with pytest.raises(OutputExists):
        result.save(tmp_path / "map.ply")


def test_a_result_is_that_of_the_verb(result: mapq.Result, patches: mapq.Patches, tmp_path: Path) -> None:
    mapq.write_patches(tmp_path / "map.patches", patches)
    assert (
        run_app(app, "mapq", ["classify", str(tmp_path / "map.patches"), "-o", str(tmp_path / "verb.ply"), "-q"]) == 0
    )
    result.save(tmp_path / "call.ply")
    assert (tmp_path / "call.ply").read_bytes() == (tmp_path / "verb.ply").read_bytes()
    verb, call = (json.loads((tmp_path / f"{name}.json").read_text()) for name in ("verb", "call"))
    made = ("command", "created", "inputs")
    assert {key: value for key, value in verb.items() if key not in made} == {
        key: value for key, value in call.items() if key not in made
    }
    assert len(verb["inputs"]) == 1
    again = mapq.classify(mapq.read_patches(tmp_path / "map.patches"), progress=False)
    np.testing.assert_array_equal(again.probability, result.probability)


def test_a_result_gives_reasons(result: mapq.Result) -> None:
    worst = int(result.regions[0].patches[0])
    reasons = result.reasons(worst, n_most=2)
    assert 0 < len(reasons) <= 2
    assert reasons[0].log_odds > 0.0
    assert result.verdict()["passed"] is None
    assert result.counts["n_patches"] == len(result.patches)
    with pytest.raises(ArgumentError, match="patch 5000"):
        result.reasons(5000)
    with pytest.raises(ArgumentError, match="fail_over 5"):
        result.verdict(5.0)
    with pytest.raises(ArgumentError, match="min_coverage 2"):
        result.verdict(0.05, min_coverage=2.0)


def test_a_table_has_a_row_a_patch(result: mapq.Result) -> None:
    table = result.table()
    assert all(table.dtype[name].shape == () for name in table.dtype.names), "columns of a data frame"
    np.testing.assert_array_equal(table["p_suspicious"], result.probability)
    np.testing.assert_array_equal(table["area_m2"], result.features.nodes["area_m2"])
    np.testing.assert_array_equal(np.flatnonzero(table["region"] == 0), np.sort(result.regions[0].patches))


def test_a_result_is_compared_with_the_truth(result: mapq.Result) -> None:
    truth = result.patches.labelled("truth").label
    assert result.evaluate("truth").accuracy == np.mean(result.label == truth)
    assert result.evaluate(result.label).accuracy == 1.0


def test_notebooks_show_cards_with_pictures(result: mapq.Result, patches: mapq.Patches) -> None:
    assert "Point cloud" in patches.cloud._repr_html_()
    for shown in (result, patches):
        card = shown._repr_html_()
        assert "data:image/png;base64,iVBOR" in card
        assert len(card) < 100_000
        assert len(shown.plot(("plan", "3d")).axes) == 2
    assert "suspicious" in repr(result)


def test_a_report_is_that_of_the_verb(result: mapq.Result, tmp_path: Path) -> None:
    result.report(tmp_path / "call.html", title="corner")
    result.save(tmp_path / "map.ply")
    words = ["report", str(tmp_path / "map.ply"), "--title", "corner", "-o", str(tmp_path / "verb.html"), "-q"]
    assert run_app(app, "mapq", words) == 0
    call, verb = ((tmp_path / f"{name}.html").read_text().splitlines() for name in ("call", "verb"))
    differing = [pair for pair in zip(call, verb, strict=True) if pair[0] != pair[1]]
    assert len(differing) <= 2, "the name of the map, and how it was made"


def test_labels_are_taught(patches: mapq.Patches, tmp_path: Path) -> None:
    labelled = patches.labelled("truth")
    assert set(labelled.label) == {0, 1}
    told: list[float] = []

    def listen(share: float, _: Mapping[str, object]) -> None:
        told.append(share)

    settings = mapq.TrainSettings(regularisation=1.0, coupling_regularisation=1.0)
    model = mapq.train(labelled, settings=settings, progress=listen)
    assert told[-1] == 1.0
    same = mapq.train([patches.labelled(labelled.label)], settings, progress=False)
    np.testing.assert_array_equal(model.weights, same.weights)
    mapq.write_model(tmp_path / "model.json", model)
    by_file = mapq.classify(patches, tmp_path / "model.json", progress=False)
    np.testing.assert_array_equal(by_file.probability, mapq.classify(patches, model, progress=False).probability)
    with pytest.raises(OutputExists):
        mapq.write_model(tmp_path / "model.json", model)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda p: mapq.segment(np.zeros((4, 2))), r"xyz: has shape \(4, 2\)"),
        (lambda p: mapq.segment(np.full((4, 3), np.nan)), "xyz: no point is finite"),
        (lambda p: mapq.segment([["a", "b", "c"]]), "xyz: must be an array of numbers"),
        (lambda p: mapq.point_cloud(np.zeros((4, 3)), {"time": np.zeros(3)}), r"fields\['time'\]: has shape \(3,\)"),
        (lambda p: mapq.point_cloud(np.zeros((4, 3)), unit=0.0), "unit 0.0"),
        (lambda p: mapq.classify(p, max_false_alarms=2.0), "max_false_alarms 2.0: must be a share"),
        (lambda p: mapq.classify(p, max_false_alarms=np.nan), "max_false_alarms nan: must be a share"),
        (lambda p: p.labelled([0, 1]), r"labels: has shape \(2,\)"),
        (lambda p: p.labelled(np.full(len(p), 2)), "labels: must be 0"),
        (lambda p: mapq.train([]), "maps: give at least one"),
    ],
)
def test_what_cannot_be_used_is_named(call: Any, words: str, patches: mapq.Patches) -> None:
    with pytest.raises(ArgumentError, match=words):
        call(patches)


def test_errors_of_the_verbs_are_those_of_the_calls(patches: mapq.Patches, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"):
        mapq.classify(tmp_path / "none.ply")
    with pytest.raises(InputError, match="plane needs"):
        mapq.segment(np.zeros((5, 3)))
    with pytest.raises(InputError, match="no point field"):
        patches.labelled("nonsense")
    with pytest.raises(UsageError, match="segmented already"):
        mapq.classify(patches, segmentation=mapq.SegmentSettings(), progress=False)
    with pytest.raises(InputError):
        mapq.train(patches, progress=False)
