from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mapq.results.regions import find_regions
from mapq.results.result import assess
from tests.mapq.factories import make_patches, sample_patches, wall
from tests.mapq.results.test_result import make_model
from tests.mapq.town import town

SMALL = [wall((0, 0), (5, 0)), wall((0, 0.3), (5, 0.3))]
LARGE = [wall((100, 0), (110, 0)), wall((100, 0.5), (110, 0.5)), wall((111, 0), (121, 0)), wall((111, 0.5), (121, 0.5))]
ALONE = [wall((0, 60), (10, 60))]


@pytest.fixture(scope="module")
def result():
    return assess(sample_patches(SMALL + LARGE + ALONE, density=20.0), make_model())


def test_connected_suspicious_patches_are_a_region_the_most_severe_first(result):
    large, small = result.regions
    assert large.patches.tolist() == [2, 3, 4, 5]
    assert small.patches.tolist() == [0, 1]
    assert large.severity > small.severity
    assert not result.is_suspicious[6]


def test_a_region_has_extent_area_and_displacement(result):
    large, small = result.regions
    np.testing.assert_allclose(large.low, (100, 0, 0), atol=0.3)
    np.testing.assert_allclose(large.high, (121, 0.5, 4), atol=0.3)
    np.testing.assert_allclose(small.centre, (2.5, 0.15, 2), atol=0.1)
    assert large.displacement == pytest.approx(0.5, abs=0.02)
    assert small.displacement == pytest.approx(0.3, abs=0.02)
    assert large.area == pytest.approx(result.area[large.patches].sum())
    p = result.labelling.probability
    assert large.severity == pytest.approx((result.area * p)[large.patches].sum())
    assert large.p_suspicious == pytest.approx(large.severity / large.area)


def test_no_suspicious_patch_is_no_region():
    empty = assess(make_patches([], np.empty((0, 3)), loose=3), make_model())
    assert empty.regions == []
    assert empty.verdict(0.5)["passed"] is False
    assert empty.verdict(None)["passed"] is None


@pytest.mark.parametrize(("fail_over", "passed"), [(0.5, False), (0.99, True), (1.0, True)])
def test_the_verdict_is_that_of_the_area(result, fail_over, passed):
    share = result.area[result.is_suspicious].sum() / result.area.sum()
    verdict = result.verdict(fail_over)
    area = {"unknown": pytest.approx(result.area[result.is_suspicious].sum())}
    area |= {"missed loop closure": 0.0, "local mapping error": 0.0}
    assert verdict == {
        "share_of_area": pytest.approx(share),
        "coverage": pytest.approx(float("nan"), nan_ok=True),
        "fail_over": fail_over,
        "min_coverage": 0.2,
        "passed": passed,
        "cause": "unknown",
        "area_by_cause_m2": area,
        "disagreement_m": pytest.approx(float("nan"), nan_ok=True),
        "scans_apart_m": pytest.approx(float("nan"), nan_ok=True),
    }


@pytest.mark.parametrize(("dropped", "passed"), [(3, True), (4, True), (5, False)])
def test_a_map_passes_only_where_enough_of_it_was_judged(result, dropped, passed):
    judged = int(result.patches.counts.sum())
    report = {"dropped_for_tilt": {"patches": 1, "points": dropped * judged, "area": 1.0}}
    some = replace(result, patches=replace(result.patches, report=report))
    assert some.coverage == some.counts["coverage"] == 1.0 / (1 + dropped)
    assert some.verdict(1.0)["passed"] is passed
    assert some.verdict(1.0, 0.1)["passed"] is True
    assert some.verdict(None)["passed"] is None


class Looked:
    """Features that count how often all pairs were looked through, and how many numbers of pairs were taken."""

    def __init__(self, features):
        self.features, self.times, self.taken = features, 0, 0

    def __getattr__(self, name):
        return getattr(self.features, name)

    @property
    def pairs(self):
        self.times += 1
        return self.features.pairs

    @property
    def edge(self):
        return self

    def __getitem__(self, key):
        found = self.features.edge[key]
        self.taken += found.size
        return found


@pytest.mark.parametrize("n_patches", [800, 3200])
def test_the_pairs_of_a_map_are_looked_through_once_however_many_regions_there_are(n_patches):
    result = assess(town(n_patches), make_model())
    assert len(result.regions) > n_patches // 10
    looked = Looked(result.features)
    again = find_regions(result.patches, looked, result.is_suspicious, result.labelling.probability, result.area)
    assert [region.displacement for region in again] == [region.displacement for region in result.regions]
    assert looked.times <= 5
    assert 0 < looked.taken <= 3 * len(result.features.pairs)
