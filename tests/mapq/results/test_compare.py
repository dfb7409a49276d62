from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from mapq.io.results import write_result
from mapq.labels import UNLABELLED
from mapq.results.causes import CAUSES
from mapq.results.compare import compare as compare_maps
from mapq.results.compare import comparison_content
from mapq.results.evaluate import area_under_curve, calibration_error, reliability, score_labels
from mapq.results.judged import judge, read_judged
from mapq.results.reasons import find_regions
from mapq.results.result import assess
from prf.shell.cli.storage import dump_object
from prf.shell.errors import InputError, UsageError
from tests.mapq.factories import Rectangle, make_patches, sample_patches, wall
from tests.mapq.results.test_result import make_model
from tests.mapq.town import town

STREET = [wall((14.0 * k + 1, 2), (14.0 * k + 9, 2)) for k in range(4)]


def judged(walls: list[Rectangle], name: str = "map"):
    return judge(assess(sample_patches(walls, density=20.0), make_model()), name)


@pytest.fixture(scope="module")
def maps():
    """The same street, doubled at its first wall, and doubled at its last."""
    first = judged([*STREET, wall((1, 2.4), (9, 2.4))], "first")
    return first, judged([*STREET, wall((43, 2.4), (51, 2.4))], "second")


def test_it_reports_where_each_map_is_better(maps):
    found = compare_maps(*maps, 5.0)
    assert found.better == "same"
    by_kind = {place.worse: place for place in found.places}
    assert len(found.places) == 2
    assert by_kind[False].low[0] == 0.0
    assert by_kind[False].high[0] == 10.0
    assert by_kind[True].low[0] == 40.0
    assert by_kind[True].change > 0.0 > by_kind[False].change
    assert by_kind[True].after > 0.5 > by_kind[True].before


def test_swapping_the_maps_swaps_the_answer(maps):
    clean = judged(STREET, "clean")
    forth, back = compare_maps(maps[0], clean, 5.0), compare_maps(clean, maps[0], 5.0)
    assert (forth.better, back.better) == ("second", "first")
    np.testing.assert_allclose(forth.expected, back.expected[::-1])
    assert [place.change for place in forth.places] == pytest.approx([-place.change for place in back.places])
    assert forth.suspicious[1] == 0.0 < forth.suspicious[0]


def test_only_common_ground_counts(maps):
    longer = judged([*STREET, wall((100, 2), (110, 2)), wall((100, 2.4), (110, 2.4))])
    found = compare_maps(judged(STREET), longer, 5.0)
    assert found.better == "same"
    assert found.covered[0] == 1.0 > found.covered[1]


def test_maps_of_different_places_are_refused(maps):
    far = maps[0]._replace(xyz=maps[0].xyz + 1000.0)
    with pytest.raises(InputError, match="share no cell of 5 m"):
        compare_maps(maps[0], far, 5.0)
    with pytest.raises(UsageError, match="must be a length in metres above 0"):
        compare_maps(*maps, 0.0)


def test_a_result_file_repeats_the_patches(tmp_path, maps):
    patches = sample_patches([*STREET, wall((1, 2.4), (9, 2.4))], density=20.0)
    patches = replace(patches, cloud=replace(patches.cloud, coordinate_type=np.float64))
    result = assess(patches, make_model())
    path = str(tmp_path / "r.ply")
    write_result(path, result.cloud(), result.head(), result.patch_rows())
    found, expected = read_judged(path, None), judge(result, path)
    assert len(found.xyz) < len(expected.xyz)
    one, other = compare_maps(found, maps[1], 5.0), compare_maps(expected, maps[1], 5.0)
    for name in ("area", "suspicious", "expected", "covered"):
        np.testing.assert_allclose(getattr(one, name), getattr(other, name), rtol=1e-6)
    with pytest.raises(UsageError, match="Leave out --model"):
        read_judged(path, make_model())
    other = assess(sample_patches(STREET[:2], density=20.0), make_model())
    (tmp_path / "r.json").write_text(dump_object("mapq.result/1", {"patches": list(other.patch_rows())}))
    with pytest.raises(InputError, match="not the JSON of"):
        read_judged(path, None)
    (tmp_path / "r.json").write_text(dump_object("mapq.result/1", {"patches": [{"patch": 1}]}))
    with pytest.raises(InputError, match="without area_m2, n_points"):
        read_judged(path, None)


def test_the_content_is_that_of_the_json(maps):
    content = comparison_content(compare_maps(*maps, 5.0))
    assert set(content) == {
        "cell_m",
        "tolerance_m",
        "n_cells",
        "first",
        "second",
        "better",
        "by",
        "difference",
        "places",
    }
    assert {place["change"] for place in content["places"]} == {"better", "worse"}
    assert set(content["first"]) == {"area_m2", "share_of_area", "expected_share_of_area", "share_in_common"} | {
        "disagreement_m",
        "coverage",
    }


def known(judged, metres, error=0.02):
    """Return a map in which scans disagree by so much everywhere."""
    every = np.ones(len(judged.xyz))
    return judged._replace(disagreement=metres * every, error=error * every)


@pytest.mark.parametrize(("metres", "better"), [(0.25, "first"), (0.15, "second"), (0.21, "same"), (0.2, "same")])
def test_the_map_whose_scans_disagree_by_less_is_better_whatever_is_called_suspicious(maps, metres, better):
    clean = judged(STREET, "clean")
    found = compare_maps(known(maps[0], 0.2), known(clean, metres), 5.0)
    assert (found.by, found.better) == ("disagreement", better)
    np.testing.assert_allclose(found.disagreement, [0.2, metres])
    low, value, high = found.difference
    assert low < value < high
    assert value == pytest.approx(metres - 0.2)


def test_disagreement_does_not_decide_where_it_is_known_of_little(maps):
    clean = judged(STREET, "clean")
    some = known(clean, 0.5)
    few = np.where(clean.xyz[:, 0] < 6.0, 0.5, np.nan)
    found = compare_maps(known(maps[0], 0.2), some._replace(disagreement=few), 5.0)
    assert (found.by, found.better) == ("expected share", "second")
    assert np.isnan(found.disagreement).all()


def test_a_result_file_knows_disagreement_and_coverage(tmp_path, maps):
    patches = sample_patches(STREET, density=20.0)
    report = {"not_judged": {"level": {"patches": 1, "points": int(patches.counts.sum()), "area": 1.0}}}
    cloud = patches.cloud.with_fields(scan=np.arange(len(patches.cloud)) % 2)
    result = assess(replace(patches, cloud=cloud, report=report), make_model())
    path = str(tmp_path / "r.ply")
    write_result(path, result.cloud(), result.head(), result.patch_rows())
    found, expected = read_judged(path, None), judge(result, path)
    assert found.coverage == expected.coverage == 0.5
    assert np.isfinite(found.disagreement).any()
    for name in ("disagreement", "error"):
        np.testing.assert_allclose(np.unique(getattr(found, name)), np.unique(getattr(expected, name)), atol=1e-6)


def of_counts(pp: int, ps: int, sp: int, ss: int):
    label = np.repeat([0, 0, 1, 1], [pp, ps, sp, ss]).astype(np.uint8)
    truth = np.repeat([0, 1, 0, 1], [pp, ps, sp, ss]).astype(np.uint8)
    return score_labels(label, truth, np.where(label, 0.75, 0.25))


def test_table_2_of_the_paper():
    """Its percentages have one solution in whole numbers; accuracy 80.42 % as printed, rows inferred."""
    scores = of_counts(648, 40, 219, 416)
    assert scores.n == 1323
    assert scores.confusion == ((648, 40), (219, 416))
    assert math.floor(scores.accuracy * 1e4) == 8042
    assert math.floor(scores.precision * 1e4) == 6551
    assert scores.recall == pytest.approx(0.912, abs=5e-4)
    assert scores.specificity == pytest.approx(0.747, abs=5e-4)
    assert scores.balanced_accuracy == pytest.approx(0.830, abs=5e-4)
    assert scores.f1 == pytest.approx(0.763, abs=5e-4)
    assert scores.mcc == pytest.approx(0.628, abs=5e-4)
    assert scores.base_rate == pytest.approx(456 / 1323)


def test_scores_by_their_definitions():
    rng = np.random.default_rng(0)
    truth, label = rng.integers(0, 2, 60).astype(np.uint8), rng.integers(0, 2, 60).astype(np.uint8)
    p = np.round(rng.random(60), 1)
    scores = score_labels(label, truth, p)
    wins = [(a > b) + 0.5 * (a == b) for a in p[truth == 1] for b in p[truth == 0]]
    assert scores.auc == pytest.approx(np.mean(wins))
    assert scores.brier == pytest.approx(np.mean((p - truth) ** 2))
    assert scores.mcc == pytest.approx(np.corrcoef(label, truth)[0, 1])
    precision, recall = truth[label == 1].mean(), label[truth == 1].mean()
    assert scores.f1 == pytest.approx(2 / (1 / precision + 1 / recall))
    cut = np.clip(p, 1e-6, 1 - 1e-6)
    assert scores.log_loss == pytest.approx(-np.mean(np.log(np.where(truth == 1, cut, 1 - cut))))


def test_calibration_error_by_its_definition():
    p = np.array([0.05, 0.05, 0.95, 1.0])
    assert calibration_error(p, np.array([False, True, True, True])) == pytest.approx((2 * 0.45 + 2 * 0.025) / 4)
    rng = np.random.default_rng(1)
    many = rng.random(100_000)
    assert calibration_error(many, rng.random(100_000) < many) < 0.01
    assert calibration_error(many, rng.random(100_000) < many**3) > 0.1


def test_patches_without_truth_are_left_out():
    label = np.array([0, 1, 1, UNLABELLED], np.uint8)
    scores = score_labels(label, np.array([0, 1, UNLABELLED, 1], np.uint8), np.array([0.1, 0.9, 0.9, np.nan]))
    assert (scores.n, scores.n_without_truth, scores.accuracy, scores.auc) == (2, 1, 1.0, 1.0)


def test_ratios_of_nothing_are_not_numbers():
    scores = of_counts(3, 0, 0, 0)
    assert (scores.accuracy, scores.specificity) == (1.0, 1.0)
    for name in ("precision", "recall", "f1", "mcc", "auc", "balanced_accuracy"):
        assert math.isnan(getattr(scores, name)), name
    assert score_labels(*[np.empty(0, np.uint8)] * 2, np.empty(0)).n == 0
    assert math.isnan(area_under_curve(np.ones(3), np.ones(3, bool)))


def test_reliability_by_its_definition():
    p, truth = np.array([0.05, 0.15, 0.12, 0.95, 1.0, np.nan, 0.5]), np.array([0, 1, 0, 1, 1, 1, UNLABELLED], np.uint8)
    bins = reliability(truth, p)
    assert [each.n for each in bins] == [1, 2, 0, 0, 0, 0, 0, 0, 0, 2]
    assert (bins[1].p_suspicious, bins[1].suspicious) == (pytest.approx(0.135), 0.5)
    assert (bins[9].low, bins[9].high, bins[9].suspicious) == (pytest.approx(0.9), 1.0, 1.0)
    assert math.isnan(bins[4].suspicious)


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


def test_surfaces_of_a_region_are_as_far_apart_as_its_patches_say(result):
    """Not as far as a pair that lie over one another by chance, as the reveals of two windows do."""
    features, names = result.features, result.features.node_names
    edge, node = features.edge.copy(), features.node.copy()
    edge[:, features.edge_names.index("offset")] = 1.41
    told = features._replace(edge=edge, node=node)
    node[:, names.index("shift_support")], node[:, names.index("shift_along")] = 0.25, 0.36
    assert [region.displacement for region in replace(result, features=told).regions] == [0.36, 0.36]
    node[:, names.index("disagreement")] = 0.12
    assert [region.displacement for region in replace(result, features=told).regions] == [0.12, 0.12]
    node[:, [names.index("shift_support"), names.index("disagreement")]] = 0.0, np.nan
    assert [region.displacement for region in replace(result, features=told).regions] == [1.41, 1.41]


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
    area |= dict.fromkeys(CAUSES[1:], 0.0)
    assert verdict == {
        "share_of_area": pytest.approx(share),
        "share_of_area_by_surface": {"upright": pytest.approx(share)},
        "coverage": pytest.approx(float("nan"), nan_ok=True),
        "flat_share": pytest.approx(float("nan"), nan_ok=True),
        "fail_over": fail_over,
        "min_coverage": 0.2,
        "fail_apart": None,
        "passed": passed,
        "tolerance_m": 0.3,
        "resolution_m": pytest.approx(float("nan"), nan_ok=True),
        "unresolved_share_of_area": pytest.approx(float("nan"), nan_ok=True),
        "cause": "unknown",
        "area_by_cause_m2": area,
        "disagreement_m": pytest.approx(float("nan"), nan_ok=True),
        "scans_apart_m": pytest.approx(float("nan"), nan_ok=True),
        "scans_apart_surface": None,
    }


@pytest.mark.parametrize(("dropped", "passed"), [(3, True), (4, True), (5, False)])
def test_a_map_passes_only_where_enough_of_it_was_judged(result, dropped, passed):
    judged = int(result.patches.counts.sum())
    report = {"not_judged": {"level": {"patches": 1, "points": dropped * judged, "area": 1.0}}}
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
    # Pairs are asked where patches themselves say nothing.
    silent = result.features._replace(node=np.full_like(result.features.node, np.nan))
    looked = Looked(silent)
    again = find_regions(result.patches, looked, result.is_suspicious, result.labelling.probability, result.area)
    quiet = replace(result, features=silent)
    assert [region.displacement for region in again] == [region.displacement for region in quiet.regions]
    assert looked.times <= 5
    assert 0 < looked.taken <= 3 * len(result.features.pairs)
