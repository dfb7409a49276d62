"""The tolerance of a map, what it resolves, and limits in metres."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mapq.commands._summary import summary_lines
from mapq.features.context import DISAGREEMENT
from mapq.posed.check_poses import CheckedPoses
from mapq.posed.check_scans import ScanMotion
from mapq.results.result import assess
from mapq.results.verdict import resolution_of, tolerance_of
from prf.shell.errors import ArgumentError
from tests.mapq.labelled import draw_patches
from tests.mapq.results.test_result import make_model

ALL = (0.05, 0.1, 0.2, 0.3, 0.5, 0.8)


@pytest.fixture(scope="module")
def result():
    return assess(draw_patches(1), make_model())


def scanned(result, low, metres, high):
    """Return the result with what scans disagree by on every patch."""
    features = result.features
    places = [features.node_names.index(name) for name in DISAGREEMENT]
    node = features.node.copy()
    node[:, places] = np.column_stack([metres, low, high])
    return replace(result, features=features._replace(node=node))


def bounds(result, width):
    n = len(result.patches)
    metres = np.linspace(0.06, 0.4, n)
    return metres - 0.5 * width, metres, metres + 0.5 * width


def test_a_tolerance_is_chosen_by_what_is_known(result):
    model = replace(result.model, tolerances=ALL)
    assert np.isnan(resolution_of(result.features))
    assert tolerance_of(result.features, model, None) == 0.3
    for width, expected in ((0.04, 0.1), (0.1, 0.1), (0.16, 0.16), (2.0, 0.8)):
        features = scanned(result, *bounds(result, width)).features
        assert resolution_of(features) == pytest.approx(0.5 * width)
        assert tolerance_of(features, model, None) == pytest.approx(expected)


def test_a_smaller_tolerance_is_advised_where_points_alone_leave_much_in_doubt(result):
    def line(model, p):
        labelling = result.labelling._replace(probability=np.where(result.is_suspicious, 0.9, p).astype(np.float32))
        (found,) = (
            line
            for line in summary_lines(replace(result, model=model, labelling=labelling), "r.ply", {})
            if line.startswith("tolerance")
        )
        return found

    model = replace(result.model, tolerances=ALL)
    share = result.area[~result.is_suspicious].sum() / result.area.sum()
    assert line(model, 0.2).endswith(f"; {share:.0%} of the area is in doubt (p above 0.1), try --tolerance 0.1")
    assert line(model, 0.05).endswith("found by points alone")
    assert line(result.model, 0.2).endswith("found by points alone"), "it learnt no smaller one"


def test_scans_that_see_nothing_in_common_are_not_said_to_be_unknown(result):
    rows = tuple(ScanMotion(scan, f"{scan}.ply", 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.05) for scan in range(4))
    lines = list(summary_lines(replace(result, poses=CheckedPoses(rows)), "r.ply", {}))
    words = "; no two of the 4 scans see the same surface, so nothing was compared"
    assert any(line.startswith("tolerance") and words in line for line in lines)


def test_a_tolerance_that_the_model_did_not_learn_is_refused(result):
    model = replace(result.model, tolerances=ALL)
    assert tolerance_of(result.features, model, 0.07) == 0.07
    with pytest.raises(ArgumentError, match=r"tolerance 0\.04: the model learnt 0\.05 to 0\.8 m"):
        tolerance_of(result.features, model, 0.04)
    with pytest.raises(ArgumentError, match=r"learnt 0\.3 m alone"):
        tolerance_of(result.features, result.model, 0.1)
    assert tolerance_of(scanned(result, *bounds(result, 0.02)).features, result.model, None) == 0.3


def test_the_verdict_says_what_scans_do_not_decide(result):
    known = scanned(result, *bounds(result, 0.1))
    assert known.verdict()["tolerance_m"] == known.tolerance == 0.3
    assert known.verdict()["resolution_m"] == pytest.approx(0.05)
    assert known.verdict()["unresolved_share_of_area"] == 0.0
    low, metres, high = bounds(result, 0.1)
    some = np.arange(len(metres)) % 3 == 0
    partly = scanned(result, low, np.where(some, np.nan, metres), high)
    assert partly.verdict()["unresolved_share_of_area"] == pytest.approx(result.area[some].sum() / result.area.sum())
    assert scanned(result, *bounds(result, 0.7)).verdict()["unresolved_share_of_area"] == 1.0
    assert np.isnan(result.verdict()["unresolved_share_of_area"])


def test_the_verdict_has_the_share_of_neighbourhoods_that_are_flat(result):
    cut = replace(result, patches=replace(result.patches, parameters={"flat_share": 0.34}))
    assert cut.verdict()["flat_share"] == 0.34
    assert np.isnan(result.verdict()["flat_share"])


@pytest.mark.parametrize(("fail_apart", "passed"), [(0.01, False), (0.39, True)])
def test_a_map_fails_by_the_median_of_what_scans_disagree_by(result, fail_apart, passed):
    known = scanned(result, *bounds(result, 0.1))
    verdict = known.verdict(fail_apart=fail_apart)
    assert verdict["passed"] is passed
    assert (verdict["scans_apart_m"] <= fail_apart) is passed
    assert known.verdict(fail_over=0.0, fail_apart=fail_apart)["passed"] is False
    assert result.verdict(fail_apart=fail_apart)["passed"] is False, "nobody knows how far its scans disagree"


@pytest.mark.parametrize("fail_apart", [0.0, -1.0, np.nan, np.inf])
def test_a_limit_that_is_no_length_is_refused(result, fail_apart):
    with pytest.raises(ArgumentError, match="must be metres above 0"):
        result.verdict(fail_apart=fail_apart)


def test_that_nobody_knows_the_scans_is_no_reason():
    alone = assess(draw_patches(1))
    assert alone.model.potential is not None
    texts = [reason.text for patch in range(len(alone.patches)) for reason in alone.reasons(patch, 20)]
    assert texts
    assert not any("scan" in text for text in texts)
