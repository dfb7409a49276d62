from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from mapq.cloud import PointCloud
from mapq.commands._summary import summary_lines
from mapq.configuration import FeatureSettings
from mapq.crf.trees import OVER
from mapq.io.results import result_cloud
from mapq.kernels.boosted_trees import LEAF, Trees
from mapq.model import EDGE_MODELS, EVIDENCE, Calibration, Model, Potential, Scaling, parameter_names
from mapq.report.findings import read_findings
from mapq.report.page import number, region_table
from mapq.results.reasons import pair_words
from mapq.results.result import assess
from tests.mapq.factories import make_patches, sample_patches, shuffled, wall
from tests.mapq.labelled import draw_patches
from tests.reference.mapq_crf import local_log_odds


def make_model(edge_model: str = "symmetric") -> Model:
    """Return a model in which a patch that another covers by a third is suspicious, and a thin one less so."""
    column, left, right = np.array([[0, LEAF, LEAF, 1, LEAF, LEAF], [1, 0, 0, 4, 0, 0], [2, 0, 0, 5, 0, 0]])
    threshold, value = np.array([0.3, 0.0, 0.0, -9.0, 0.0, 0.0]), np.array([0.0, -1.0, 1.0, 0.0, 0.1, -0.1])
    trees = Trees(np.array([0, 3]), column, threshold, left, right, np.zeros(6, np.bool_), value)
    node = Scaling((EVIDENCE,), np.zeros(1), np.ones(1), 12.0)
    weights = {"node.evidence": 0.5, "coupling.at_x_min": 0.4}
    values = np.array([weights.get(name, 0.0) for name in parameter_names(edge_model, node.names)])
    features, calibration = FeatureSettings().stored(), Calibration(slope=0.8)
    potential = Potential((OVER, "thickness"), trees, 0.0)
    return Model(edge_model, features, node, (-1.0, 1.0), values, calibration, potential=potential)


@pytest.fixture(scope="module")
def result():
    return assess(draw_patches(1), make_model())


def test_double_walls_are_suspicious_with_reasons(result):
    np.testing.assert_array_equal(result.labelling.label, draw_patches(1).label)
    worst = result.worst(5)
    assert len(worst) == 5
    assert all(result.labelling.label[patch] == 1 for patch in worst)
    severity = result.area * result.probability
    assert severity[worst].tolist() == sorted(severity[result.is_suspicious], reverse=True)[:5]
    reasons = result.reasons(worst[0], 3)
    assert any(reason.text.startswith("parallel to patch") for reason in reasons)


def test_counts_are_shares_of_patches_points_and_area(result):
    counts = result.counts
    bad = result.labelling.label == 1
    assert (counts["n_patches"], counts["n_suspicious"]) == (32, 16)
    assert counts["share_of_points"] == result.patches.counts[bad].sum() / counts["n_points_in_patches"]
    assert counts["area_suspicious_m2"] == pytest.approx(counts["share_of_area"] * counts["area_m2"])
    assert counts["area_m2"] == pytest.approx(32 * 40.0, rel=0.3)


def test_rows_have_terms_that_sum_to_the_log_odds(result):
    rows = list(result.patch_rows())
    odds = local_log_odds(result.features, result.model, result.labelling.label)
    for row, expected in zip(rows, odds, strict=True):
        sizes = [abs(term["contribution"]) for term in row["terms"]]
        assert sizes == sorted(sizes, reverse=True)
        assert sum(term["contribution"] for term in row["terms"]) == pytest.approx(expected, abs=1e-7)
        assert row["log_odds"] == pytest.approx(expected, abs=1e-7)
        paired = [
            term["name"] == "neighbour label" or (term["name"] == OVER and term["value"] > 0) for term in row["terms"]
        ]
        assert paired == ["other" in term for term in row["terms"]]
    assert set(rows[0]) >= {"patch", "label", "p_suspicious", "n_points", "centroid", "normal", "area_m2", "rms_m"}


def test_points_carry_their_patchs_result(result):
    cloud = result.cloud()
    patch, label = cloud.fields["patch"], cloud.fields["suspicious"]
    assert (patch.dtype, label.dtype, cloud.fields["p_suspicious"].dtype) == (np.int32, np.uint8, np.float32)
    np.testing.assert_array_equal(label, result.labelling.label[patch])
    np.testing.assert_array_equal(cloud.fields["p_suspicious"], result.labelling.probability[patch])
    np.testing.assert_array_equal(cloud.fields["intensity"], np.arange(len(cloud)))
    np.testing.assert_array_equal(cloud.fields["red"] > cloud.fields["blue"], label == 1)


def test_the_order_of_points_changes_nothing(result):
    again = assess(shuffled(draw_patches(1)), make_model())
    np.testing.assert_array_equal(result.labelling.label, again.labelling.label)
    np.testing.assert_array_equal(result.labelling.difference, again.labelling.difference)
    assert list(result.patch_rows())[5]["terms"] == list(again.patch_rows())[5]["terms"]


@pytest.mark.parametrize("edge_model", EDGE_MODELS)
def test_no_patches(edge_model):
    found = assess(make_patches([], np.empty((0, 3)), loose=4), make_model(edge_model))
    counts = found.counts
    assert (counts["n_patches"], counts["n_points"], list(found.patch_rows())) == (0, 4, [])
    assert math.isnan(counts["share_of_area"])
    cloud = found.cloud()
    assert cloud.fields["suspicious"].tolist() == [255] * 4
    assert cloud.fields["patch"].tolist() == [-1] * 4
    assert np.isnan(cloud.fields["p_suspicious"]).all()


def test_colours_of_the_cloud_are_kept_once():
    xyz = np.arange(9.0).reshape(3, 3)
    colours = {name: np.arange(3, dtype=np.uint8) + index for index, name in enumerate(("red", "green", "blue"))}
    cloud = PointCloud(xyz, np.zeros(3), {"time": np.arange(3.0), **colours})
    patch, p = np.array([0, -1, 1], np.int32), np.array([0.2, 0.9], np.float32)
    once = result_cloud(cloud, patch, np.array([0, 1], np.uint8), p)
    assert once.fields["suspicious"].tolist() == [0, 255, 1]
    names = ["time", "original_red", "original_green", "original_blue", "patch", "suspicious", "p_suspicious"]
    assert list(once.fields) == [*names, "red", "green", "blue"]
    twice = result_cloud(once, patch[::-1].copy(), np.array([1, 1], np.uint8), p)
    assert set(twice.fields) == set(once.fields)
    np.testing.assert_array_equal(twice.fields["original_red"], colours["red"])
    assert twice.fields["suspicious"].tolist() == [1, 255, 1]


def test_patches_far_from_the_origin_have_world_coordinates():
    patches = draw_patches(1, 6)
    shift = np.array([431000.0, 5411000.0, 0.0])
    far = replace(patches, cloud=replace(patches.cloud, shift=shift))
    near_rows, far_rows = (list(assess(each, make_model()).patch_rows()) for each in (patches, far))
    np.testing.assert_allclose(np.subtract(far_rows[3]["centroid"], near_rows[3]["centroid"]), shift, atol=1e-5)
    assert near_rows[3]["terms"] == far_rows[3]["terms"]


def test_of_a_wide_region_the_place_of_its_worst_patch_is_named(tmp_path, monkeypatch):
    result = assess(draw_patches(1), make_model())
    region = result.regions[0]
    share = result.area * result.probability
    assert region.worst == max(region.patches.tolist(), key=lambda patch: share[patch])
    result.save(tmp_path / "r.ply")
    findings, at = read_findings(str(tmp_path / "r.ply")), result.patches.centroid[region.worst]
    for widest, n_named in ((1e3, 0), (0.0, 1)):
        monkeypatch.setattr("mapq.patches.WIDE_REGION", widest)
        monkeypatch.setattr("mapq.report.page.WIDE_REGION", widest)
        line = next(line for line in summary_lines(result, "r.ply", {}) if "region 0" in line)
        assert line.count(f"worst at {at[0]:.1f} {at[1]:.1f} {at[2]:.1f}") == n_named
        place = ", ".join(number(value) for value in at.tolist())
        assert region_table(findings).count(f"<br><small>worst at {place}") == n_named


def test_fields_named_as_a_result_s_are_kept_under_other_names():
    own = {name: np.arange(3.0) + place for place, name in enumerate(("patch", "red", "original_red"))}
    cloud = PointCloud(np.zeros((3, 3)), np.zeros(3), own)
    fields = result_cloud(cloud, np.zeros(3, np.int32), np.zeros(1, np.uint8), np.zeros(1, np.float32)).fields
    np.testing.assert_array_equal(fields["original_patch"], own["patch"])
    np.testing.assert_array_equal(fields["original_original_red"], own["red"])
    np.testing.assert_array_equal(fields["original_red"], own["original_red"])
    assert (fields["patch"].dtype, fields["red"].dtype) == (np.int32, np.uint8)


PAIR = {"angle_deg": 1.0, "overlap": 0.0, "crossing": 0.0, "offset": 0.32, "separation": 0.3, "weight": 0.5}


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"overlap": 0.78}, "parallel to patch 41 at 0.32 m, overlap 78%"),
        ({"overlap": 0.78, "angle_deg": 12.0}, "at 12 degrees over patch 41 at 0.32 m, overlap 78%"),
        (
            # 2.5 m from one edge and 7.5 m from the other is half of the 5 m to the middle.
            {"crossing": 2.5 / 7.5, "overlap": 0.1},
            "crosses patch 41 at 1 degrees, at least 50% of the way from the edges to the middle",
        ),
        (
            {"crossing": 1.0, "overlap": 0.1},
            "crosses patch 41 at 1 degrees, at least 100% of the way from the edges to the middle",
        ),
        (
            {"overlap": 0.8, "facing_away": 0.4},
            "parallel to patch 41 at 0.32 m, overlap 80%, seen from opposite sides: two faces of one wall",
        ),
        ({"overlap": 0.8, "facing_away": 0.1}, "parallel to patch 41 at 0.32 m, overlap 80%"),
        (
            {"angle_deg": 88.0, "separation": 0.001},
            "touches patch 41 at 88 degrees, neither overlapping nor crossing it",
        ),
        ({"angle_deg": 88.0}, "0.30 m from patch 41, at 88 degrees, neither overlapping nor crossing it"),
    ],
)
def test_a_pair_is_described_in_words_and_metres(changes, expected):
    assert pair_words(PAIR | changes, 41) == expected


@pytest.fixture(scope="module")
def doubled():
    """A wall drawn twice 0.4 m apart, and one alone."""
    walls = [wall((0, 0), (10, 0)), wall((0, 0.4), (10, 0.4)), wall((0, 40), (10, 40))]
    return assess(sample_patches(walls), make_model())


def test_both_copies_name_each_other(doubled):
    for patch, other in ((0, 1), (1, 0)):
        first = doubled.reasons(patch, 5)[0]
        assert first.text.startswith(f"parallel to patch {other} at 0.40 m, overlap ")
        assert first.other == other
        assert first.measures["offset_m"] == pytest.approx(0.4, abs=0.02)
        assert first.log_odds > 0.0


def test_reasons_of_a_plausible_patch_speak_for_plausible(doubled):
    reasons = doubled.reasons(2, 5)
    assert not doubled.is_suspicious[2]
    assert reasons
    assert all(reason.log_odds < 0.0 for reason in reasons)
    assert any("thick" in reason.text for reason in reasons)


def test_reasons_sum_to_the_log_odds_but_for_the_biases(doubled):
    odds = local_log_odds(doubled.features, doubled.model, doubled.labelling.label)
    for patch, row in enumerate(doubled.patch_rows()):
        biases = sum(term["contribution"] for term in row["terms"] if term["name"] == "base")
        reasons = [doubled._reasons.of(patch, sign, 99) for sign in (1.0, -1.0)]
        total = sum(reason.log_odds for side in reasons for reason in side)
        assert total + biases == pytest.approx(odds[patch], abs=1e-9)


def test_the_row_of_a_reason_holds_its_measures(doubled):
    row = next(iter(doubled.patch_rows()))["reasons"][0]
    assert set(row) == {"text", "log_odds", "other", "offset_m", "separation_m", "angle_deg", "overlap", "crossing"}
    assert all(np.isfinite(value) for name, value in row.items() if name != "text")
