from __future__ import annotations

import numpy as np
import pytest

from mapq.results.reasons import pair_words
from mapq.results.result import assess
from tests.mapq.factories import sample_patches, wall
from tests.mapq.results.test_result import make_model
from tests.reference.mapq_crf import local_log_odds

PAIR = {"angle_deg": 1.0, "overlap": 0.0, "crossing": 0.0, "offset": 0.32, "separation": 0.3, "weight": 0.5}


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"overlap": 0.78}, "parallel to patch 41 at 0.32 m, overlap 78 %"),
        ({"overlap": 0.78, "angle_deg": 12.0}, "at 12 degrees over patch 41 at 0.32 m, overlap 78 %"),
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
            "parallel to patch 41 at 0.32 m, overlap 80 %, seen from opposite sides: two faces of one wall",
        ),
        ({"overlap": 0.8, "facing_away": 0.1}, "parallel to patch 41 at 0.32 m, overlap 80 %"),
        ({"angle_deg": 88.0}, "0.30 m from patch 41, at 88 degrees, neither over it nor across"),
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
