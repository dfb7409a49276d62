from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from mapq.cloud import PointCloud
from mapq.commands._summary import summary_lines
from mapq.configuration import FeatureSettings
from mapq.features import patch_features
from mapq.io.results import result_cloud
from mapq.labels import NO_PATCH
from mapq.posed.check_poses import CheckedPoses
from mapq.posed.check_scans import ScanMotion
from mapq.posed.edges import EdgeError
from mapq.report.findings import read_findings
from mapq.report.page import facts, pose_tables, poses_line
from mapq.results.causes import (
    DRIFT,
    LOCAL,
    MISSED_LOOP,
    MOVED,
    UNKNOWN,
    WRONG_EDGE,
    WRONG_SCAN,
    Cause,
    Spread,
    cause_of,
    find_causes,
    moved_by,
    nested_spread,
)
from mapq.results.reasons import largest_median, medians_by_kind, weighted_median
from mapq.results.result import Seen, assess
from mapq.results.visits import Clock, Visits, join_stays, stays_of, visits_of
from tests.mapq.factories import make_patches, shuffled, wall
from tests.mapq.results.test_result import make_model
from tests.mapq.results.test_verdict import scanned

N_SCANS = 20
"""Of each of two laps; they see the wall in the first ten, and something else in all."""
NOISE = 0.01


def way_of(scan: int) -> np.ndarray:
    """Return where the sensor is: forth along a wall, and round a block 40 m deep."""
    share = (scan % N_SCANS) / N_SCANS
    corners = np.array([[0.0, -5.0], [20.0, -5.0], [20.0, -45.0], [0.0, -45.0], [0.0, -5.0]])
    way = np.array([0.0, 0.25, 0.5, 0.75, 1.0])
    return np.array([np.interp(share, way, corners[:, 0]), np.interp(share, way, corners[:, 1]), 1.0])


def wall_of_two_laps(lap: float, jitter: float, noise: float = NOISE, seed: int = 0, gap: float = 0.15):
    """Return the patches of a wall: points apart from its middle by more than `gap` are other patches.

    The second lap puts the wall `lap` metres off, and every scan puts it anywhere within `jitter` of that.
    """
    rng = np.random.default_rng(seed)
    points, scans = [], []
    for scan in [*range(10), *range(N_SCANS, N_SCANS + 10)]:
        seen = wall((0, 0), (10, 0)).sample(rng, 6.0, noise)
        seen[:, 1] += lap * (scan >= N_SCANS) + rng.choice([-0.5, 0.5]) * jitter
        points.append(seen)
        scans.append(np.full(len(seen), scan))
    xyz, scan = np.concatenate(points), np.concatenate(scans)
    layer = (xyz[:, 1] > np.mean([xyz[:, 1].min(), xyz[:, 1].max()])) & (lap + jitter > gap)
    order = np.argsort(layer, kind="stable")
    parts = [xyz[~layer], xyz[layer]] if layer.any() else [xyz]
    patches = make_patches(parts, [(0, 1, 0)] * len(parts), loose=2 * N_SCANS)
    scan = np.concatenate([scan[order], np.arange(2 * N_SCANS)])
    ray = np.array([way_of(each) for each in range(2 * N_SCANS)])[scan] - patches.cloud.xyz
    fields = {"scan": scan, **{f"to_sensor_{axis}": ray[:, k] for k, axis in enumerate("xyz")}}
    return replace(patches, cloud=replace(patches.cloud, fields=fields))


def causes_of(patches):
    every = np.ones(len(patches), bool)
    return list(find_causes(patches, patch_features(patches), every, visits_of(patches.cloud)).values())


@pytest.mark.parametrize("lap", [0.1, 0.4, 0.8])
def test_laps_that_disagree_are_a_missed_loop(lap):
    for cause in causes_of(wall_of_two_laps(lap, 0.02)):
        assert cause.kind == MISSED_LOOP
        assert cause.measures["between_visits_m"] == pytest.approx(lap, rel=0.1)
        assert cause.measures["within_visits_m"] < 0.04
        assert cause.measures["away_m"] == pytest.approx(68.0, abs=1e-6)
        metres, low, high = (float(x) for x in re.search(r"lies (.*) m \((.*) to (.*)\) off", cause.text).groups())
        assert metres == pytest.approx(lap, abs=0.03)
        assert low <= lap <= high


@pytest.mark.parametrize("jitter", [0.1, 0.4])
def test_neighbouring_scans_that_disagree_are_a_local_error(jitter):
    for cause in causes_of(wall_of_two_laps(0.0, jitter)):
        assert cause.kind == LOCAL
        assert cause.measures["within_visits_m"] == pytest.approx(np.sqrt(0.5) * jitter, rel=0.15)
        assert cause.measures["n_visits"] == 2


def test_the_larger_of_two_errors_is_the_cause():
    assert {cause.kind for cause in causes_of(wall_of_two_laps(0.6, 0.2))} == {MISSED_LOOP}
    assert {cause.kind for cause in causes_of(wall_of_two_laps(0.1, 0.6))} == {LOCAL}


def test_scans_that_agree_name_no_cause():
    (cause,) = causes_of(wall_of_two_laps(0.0, 0.0))
    assert (cause.kind, cause.text) == (UNKNOWN, "scans that see it agree within 0.05 m")


def test_what_single_scans_see_twice_is_no_error_of_theirs():
    (cause,) = causes_of(wall_of_two_laps(0.1, 0.0, noise=0.15, gap=9.0))
    assert cause.kind == UNKNOWN
    assert "within each scan" in cause.text


def test_one_scan_alone_blames_nobody():
    patches = wall_of_two_laps(0.4, 0.0)
    once = replace(patches, cloud=patches.cloud.with_fields(scan=(patches.patch == NO_PATCH).astype(int)))
    assert {(cause.kind, cause.text) for cause in causes_of(once)} == {(UNKNOWN, "one scan alone saw it")}


def test_passes_are_named_where_nothing_else_is_known():
    patches = wall_of_two_laps(0.4, 0.0)
    fields = {"pass_id": (patches.cloud.fields["scan"] >= N_SCANS).astype(np.int16)}
    found = causes_of(replace(patches, cloud=replace(patches.cloud, fields=fields)))
    assert {cause.kind for cause in found} == {MISSED_LOOP}
    assert all(re.fullmatch(r"passes put it 0\.[34]\d m \(.* to .*\) apart", cause.text) for cause in found)


def test_metres_are_those_of_the_spread_where_no_disagreement_is_known():
    patches = wall_of_two_laps(0.4, 0.0)
    features = patch_features(patches, FeatureSettings(context=()))
    found = find_causes(patches, features, np.ones(len(patches), bool), visits_of(patches.cloud))
    assert {cause.text for cause in found.values()} == {"seen again after 68 m, it lies 0.40 m off"}


@pytest.mark.parametrize(
    ("apart", "kind", "words"),
    [
        ((0.2, 0.3, 0.4), MISSED_LOOP, "it lies 0.30 m (0.20 to 0.40) off"),
        ((0.0, 0.3, 0.6), MISSED_LOOP, "it lies 0.30 m (0.00 to 0.60) off"),
        ((0.0, 0.02, 0.07), UNKNOWN, "agree within 0.07 m"),
    ],
)
def test_a_cause_is_named_where_scans_disagree_with_bounds_of_the_metres(apart, kind, words):
    visits = visits_of(wall_of_two_laps(0.4, 0.0).cloud)
    cause = cause_of(Spread(1.9, 0.01, 0.01, 2, 4, (9, N_SCANS)), visits, np.array(apart))
    assert cause.kind == kind
    assert words in cause.text
    alone = cause_of(Spread(1.9, np.nan, 0.01, 2, 2, (9, N_SCANS)), visits, np.array([0.2, 0.3, 0.4]))
    assert (alone.kind, alone.text) == (UNKNOWN, "no two scans of one visit saw it, which could show the cause")


@pytest.mark.parametrize(
    ("shifts", "edge", "kind"),
    [
        (np.where(np.arange(40) == 5, 0.4, 0.0), None, WRONG_SCAN),
        (np.where(np.arange(40) >= 15, 0.4, 0.0), None, MISSED_LOOP),
        (0.02 * np.arange(40), None, DRIFT),
        (0.02 * np.arange(40), (12, 13), WRONG_EDGE),
        (np.where(np.arange(40) == 5, 0.4, 0.0), (12, 13), WRONG_SCAN),
        (np.zeros(40), None, MOVED),
    ],
)
def test_checked_poses_name_the_cause(shifts, edge, kind):
    motion = np.tile(np.eye(4), (40, 1, 1))
    motion[:, 1, 3] = shifts
    places = np.array([way_of(scan) for scan in range(40)])
    edges = () if edge is None else (EdgeError(edge, 0.5, 0.0, 0.99, 0, edge),)
    poses = CheckedPoses(edges=edges, motion=motion, places=places)
    patches = wall_of_two_laps(0.4, 0.0)
    found = find_causes(patches, patch_features(patches), np.ones(2, bool), visits_of(patches.cloud), poses)
    assert {cause.kind for cause in found.values()} == {kind}


def causes_by_motions(shifts, wrong=()):
    """Return the causes of a wall that two laps put 0.4 m apart; scans ask for shifts (40,), some are surely wrong."""
    motion, places = np.tile(np.eye(4), (40, 1, 1)), np.array([way_of(scan) for scan in range(40)])
    motion[:, 1, 3] = shifts
    rows = tuple(ScanMotion(k, f"{k}", 0.0, shifts[k], 0.0, 0.0, 0.0, 1.0, 0.99 * (k in wrong)) for k in range(40))
    patches = wall_of_two_laps(0.4, 0.0)
    poses = CheckedPoses(rows if wrong else (), motion=motion, places=places)
    found = find_causes(patches, patch_features(patches), np.ones(2, bool), visits_of(patches.cloud), poses)
    return list(found.values())


def test_a_scan_that_is_right_is_not_blamed_where_others_are_wrong():
    off = np.where(np.arange(40) == 5, 0.4, 0.0)
    assert {cause.measures.get("scan") for cause in causes_by_motions(off)} == {5}
    assert {cause.measures.get("scan") for cause in causes_by_motions(off, wrong=(5, 35))} == {5}
    for cause in causes_by_motions(off, wrong=(35,)):
        assert cause.kind == MISSED_LOOP
        assert "scan" not in cause.measures


def test_one_scan_is_not_compared_with_itself():
    motion, places = np.tile(np.eye(4), (40, 1, 1)), np.array([way_of(scan) for scan in range(40)])
    patches = wall_of_two_laps(0.0, 0.0)
    poses = CheckedPoses(motion=motion, places=places)
    (cause,) = find_causes(patches, patch_features(patches), np.ones(1, bool), visits_of(patches.cloud), poses).values()
    text = "the scans that see it could not be compared"
    assert cause == Cause(UNKNOWN, text, {"metres": 0.0})


def test_what_explains_less_than_half_of_the_disagreement_is_no_cause():
    for cause in causes_by_motions(np.where(np.arange(40) == 5, 0.15, 0.0)):
        assert cause.kind == UNKNOWN
        assert re.fullmatch(r"the .* put it 0\.15 m apart only, and scans disagree by 0\.3\d m at least", cause.text)


def test_where_poses_agree_points_within_a_scan_do_not_make_a_thing_move():
    motion, places = np.tile(np.eye(4), (40, 1, 1)), np.array([way_of(scan) for scan in range(40)])
    patches = wall_of_two_laps(0.02, 0.0)
    poses = CheckedPoses(edges=(), motion=motion, places=places)
    found = find_causes(patches, patch_features(patches), np.ones(len(patches), bool), visits_of(patches.cloud), poses)
    assert {cause.kind for cause in found.values()} == {UNKNOWN}
    assert moved_by(Spread(0.3, 0.1, 0.25, 2, 4, None)) == 0.0
    assert moved_by(Spread(np.nan, 0.4, np.nan, 1, 4, None)) == 0.4


def test_neither_the_order_of_points_nor_the_sign_of_a_normal_matters():
    patches = wall_of_two_laps(0.4, 0.1)
    turned = shuffled(replace(patches, normal=-patches.normal))
    for one, other in zip(causes_of(patches), causes_of(turned), strict=True):
        assert (one.kind, one.text) == (other.kind, other.text)


def test_components_are_those_of_a_nested_analysis_of_variance():
    """Two cells, two visits of them, two scans each, two points a scan; expected values by hand."""
    visits = Visits(np.zeros(0, np.int64), np.array([4, 4, 4, 4, 8, 8, 8, 8]), None, None, "scan")
    moment = np.repeat([0, 1, 4, 5], 2)
    point, scan, visit = (np.array(x) for x in ([-1, 1] * 4, [-1, -1, 1, 1] * 2, [-1] * 4 + [1] * 4))
    height = np.tile(0.01 * point + 0.1 * scan + 0.5 * visit, 2)
    spread = nested_spread(height, np.repeat([0, 51], 8), np.tile(moment, 2), visits)
    noise = 2 * 0.01**2  # sums of squares by degrees of freedom: 16 points in 8 scans
    assert spread.points == pytest.approx(np.sqrt(noise))
    # 8 scans in 4 visits: sum of squares 16 x 0.1^2; 16 points less 8 x 2^2 / 4.
    by_scan = (16 * 0.1**2 - noise * 4) / (16 - 8)
    by_visit = (16 * 0.5**2 - noise * 2) / (16 - 8)
    assert spread.scans == pytest.approx(np.sqrt(2 * by_scan))
    assert spread.visits == pytest.approx(np.sqrt(2 * by_visit))
    assert (spread.n_visits, spread.n_scans, spread.gap) == (2, 4, (1, 4))


def test_a_result_carries_causes():
    patches = wall_of_two_laps(0.5, 0.02)
    result = assess(patches, make_model())
    assert result.is_suspicious.all()
    rows = list(result.patch_rows())
    assert {row["cause"]["kind"] for row in rows} == {MISSED_LOOP}
    (region,) = result.head()["regions"]
    assert region["cause"] == MISSED_LOOP
    assert region["area_by_cause_m2"][MISSED_LOOP] == pytest.approx(result.area.sum())
    assert result.verdict(None)["cause"] == MISSED_LOOP
    assert set(result.cloud().fields["cause"].tolist()) == {1, 255}
    again = result_cloud(result.cloud(), patches.patch, result.labelling.label, result.labelling.probability)
    assert not {"cause", "original_cause"} & set(again.fields)


def test_the_scan_that_is_blamed_comes_first_where_none_is_surely_displaced(tmp_path):
    """Its area is named; a shift whose bounds reach 0 is not."""
    result = assess(wall_of_two_laps(0.5, 0.02), make_model())
    causes = {patch: Cause(WRONG_SCAN, "scan 1 puts it off", {"scan": 1}) for patch in result.causes}
    shifts = ((0.05, 0.0, 0.47), (0.2, 0.01, 0.41), (0.15, 0.0, 0.52))
    rows = [
        ScanMotion(scan, f"s{scan}.ply", shift, 0.0, 0.0, 0.0, low, high, p_wrong)
        for p_wrong, (scan, (shift, low, high)) in zip((3e-4, 1e-4, 8e-5), enumerate(shifts), strict=True)
    ]

    def look(rows):
        told = replace(result, seen=Seen(result.visits, causes), poses=CheckedPoses(tuple(rows)))
        told.save(tmp_path / "r.ply", force=True)
        findings = read_findings(str(tmp_path / "r.ply"))
        return told, findings, list(summary_lines(told, "r.ply", {}))

    area = result.area.sum()
    told, findings, found = look(rows)
    assert [row["scan"] for row in told.head()["scans"]] == [1, 0, 2]
    assert [row["blamed_m2"] for row in told.head()["scans"]] == [pytest.approx(area), 0.0, 0.0]
    unsure = "of 3{} is surely displaced (p 0.00 at most)"
    assert f"scans           none {unsure.format('')}; {area:.1f} m2 are put down to scan 1" in found
    unsure = unsure.format(" scans")
    assert poses_line(findings) == f"None {unsure}; {area:.1f} m² are put down to <strong>s1.ply</strong>."
    table = pose_tables(findings)
    assert (
        f"<td>s1.ply</td><td>0.20, 0.00, 0.00</td><td>0.00</td><td>0.01 to 0.41</td><td>0.000</td><td>{area:.1f}<"
        in table
    )
    assert "<td>s0.ply</td><td>–</td><td>–</td><td>0.00 to 0.47</td>" in table
    # Of two neither can be told.
    causes = {patch: Cause(WRONG_SCAN, "which is wrong two do not show", {}) for patch in result.causes}
    _, findings, found = look(rows[:2])
    assert "scans           the two disagree, which is wrong they do not show: scan 0 would lie on scan" in found
    assert "                1 if moved by +0.05 +0.00 +0.00 m and turned by +0.00 deg" in found
    assert poses_line(findings) == (
        "The two scans disagree, and which is wrong they do not show: "
        "<strong>s0.ply</strong> would lie on s1.ply if moved by 0.05, 0.00, 0.00 m."
    )
    # One that is probably displaced is first whatever the area.
    told, findings, found = look([rows[2]._replace(p_wrong=0.9, low=0.1), *rows[:2]])
    assert [row["scan"] for row in told.head()["scans"]] == [2, 0, 1]
    assert "scans           1 of 3 probably displaced" in found
    assert poses_line(findings) == "Probably wrong scans: <strong>s2.ply</strong>, of 3."


def test_scans_apart_is_the_disagreement_of_most_of_the_area(tmp_path):
    walls = wall((0, 0), (8, 0)), wall((0, 20), (8, 20))
    rng = np.random.default_rng(1)
    apart = np.array([[0.0, 0.0, 0.0], [0.0, 0.3, 0.0]])
    points = [np.concatenate([each.sample(rng, 30.0, 0.005) + shift for shift in apart]) for each in walls]
    patches = make_patches(points, [(0, 1, 0)] * 2)
    scan = np.concatenate([np.repeat([0, 1], len(each) // 2) for each in points])
    patches = replace(patches, cloud=patches.cloud.with_fields(scan=scan))
    result = assess(patches, make_model())
    verdict, rows = result.verdict(None), list(result.patch_rows())
    assert verdict["scans_apart_m"] == pytest.approx(0.3, abs=0.03)
    assert verdict["disagreement_m"] == pytest.approx(0.3, abs=0.03)
    assert verdict["scans_apart_m"] in [pytest.approx(row["disagreement_m"]) for row in rows]
    assert all(row["low"] < row["disagreement_m"] < row["high"] for row in rows)
    (line,) = (line for line in summary_lines(result, "r.ply", {}) if line.startswith("scans disagree"))
    assert "less than" not in line
    none = np.zeros(len(patches))
    agreeing = scanned(result, none - 0.02, none, none + 0.02)
    (line,) = (line for line in summary_lines(agreeing, "r.ply", {}) if line.startswith("scans disagree"))
    little = "less than 0.020 m (what scans resolve)"
    assert f"{little} in the median of upright surfaces, the worst kind; {little} in the mean of all" in line
    agreeing.save(tmp_path / "r.ply")
    words = f"{little} in the median of upright surfaces, the worst kind; {little} in the mean of all, where"
    assert f"<dt>scans disagree</dt><dd>{words}" in facts(read_findings(str(tmp_path / "r.ply")))
    silent = assess(replace(patches, cloud=replace(patches.cloud, fields={})), make_model())
    assert np.isnan([silent.verdict(None)[name] for name in ("scans_apart_m", "disagreement_m")]).all()
    assert {tuple(row[name] for name in ("disagreement_m", "low", "high")) for row in silent.patch_rows()} == {
        (None, None, None)
    }


def test_floors_do_not_hide_that_walls_are_apart():
    metres, area = np.array([0.3, 0.3, 0.01, 0.01, 0.01, np.nan]), np.array([2.0, 2.0, 10.0, 10.0, 10.0, 90.0])
    upright, level, tilted = 0, 1, 2
    kinds = np.array([upright, upright, level, level, level, level], np.uint8)
    assert weighted_median(metres, area) == 0.01
    assert largest_median(metres, area, kinds) == 0.3
    assert medians_by_kind(metres, area, kinds) == {upright: 0.3, level: 0.01}
    few = np.array([level, tilted, level, level, level, level], np.uint8)
    assert largest_median(metres, area, few) == 0.01, "too little to say something by itself"
    assert np.isnan(largest_median(metres[-1:], area[-1:], kinds[-1:]))
    assert np.isnan(largest_median(metres[:0], area[:0], kinds[:0]))


def test_the_back_of_a_thin_wall_is_no_second_copy_of_it():
    """Two faces 0.3 m apart: one lap sees the one from its side, the next the other from there."""
    patches = wall_of_two_laps(0.3, 0.0)
    (cause, _) = causes_of(patches)
    assert cause.kind == MISSED_LOOP
    toward = np.where(patches.cloud.fields["scan"] < N_SCANS, -5.0, 5.0)
    faces = replace(patches, cloud=patches.cloud.with_fields(to_sensor_y=toward))
    assert {(each.kind, each.text) for each in causes_of(faces)} == {(UNKNOWN, "scans that see it agree within 0.05 m")}


ROUND = np.array([[0.0, 0.0], [30.0, 0.0], [60.0, 0.0], [60.0, 30.0], [30.0, 30.0], [0.0, 30.0], [0.0, 1.0]])
"""Where the sensor was at each scan of a round."""


def make_cloud(**fields: np.ndarray) -> PointCloud:
    n_points = len(next(iter(fields.values())))
    return PointCloud(np.zeros((n_points, 3)), np.zeros(3), fields)


def driven(places: np.ndarray, sensors: bool = True, **fields: np.ndarray) -> PointCloud:
    """Return three points a scan, seen from above each place; `sensors`: the map tells from where."""
    sensor = np.repeat(np.column_stack([places, np.ones(len(places))]), 3, axis=0)
    points = sensor + np.tile([[5.0, 0.0, 0.0], [-5.0, 0.0, 0.0], [0.0, 2.0, 0.0]], (len(places), 1))
    if sensors:
        fields |= {f"to_sensor_{axis}": (sensor - points)[:, k] for k, axis in enumerate("xyz")}
    if not fields.keys() & {"time", "gps_time"}:
        fields["scan"] = np.repeat(np.arange(len(places)), 3)
    return PointCloud(points, np.zeros(3), fields)


@pytest.mark.parametrize("sensors", [True, False])
def test_a_round_brings_another_visit(sensors):
    visits = visits_of(driven(ROUND, sensors))
    assert visits is not None
    assert visits.unit == "scan"
    assert visits.moment.tolist() == np.repeat(np.arange(7), 3).tolist()
    assert visits.new_visit(np.array([0, 0]), np.array([6, 1])).tolist() == [True, False]
    assert (visits.way is not None) is sensors


def test_neighbouring_scans_are_one_visit_however_far_apart():
    visits = visits_of(driven(10.0 * ROUND))
    assert visits is not None
    assert visits.leaves.tolist() == [2, 3, 4, 5, 6, 7, 7]


def test_seconds_make_moments_where_scans_are_not_known():
    seconds = np.repeat([0.0, 0.4, 1.6, 2.3, 3.1, 4.8, 160.0], 3)
    for name in ("time", "gps_time"):
        visits = visits_of(driven(ROUND, **{name: seconds + 1e9}))
        assert visits is not None
        assert visits.unit == "second"
        assert visits.moment.reshape(-1, 3)[:, 0].tolist() == [0, 0, 1, 2, 3, 4, 5]
        assert visits.seconds is not None
        assert visits.new_visit(np.array([0, 0]), np.array([5, 1])).tolist() == [True, False]


def test_every_pass_is_a_visit_where_nothing_else_is_known():
    for name in ("pass_id", "point_source_id"):
        visits = visits_of(make_cloud(**{name: np.array([3, 3, 7, 9], np.uint16)}))
        assert visits is not None
        assert (visits.unit, visits.leaves.tolist()) == ("pass", [1, 2, 3])


@pytest.mark.parametrize(
    "fields",
    [
        {"intensity": np.arange(4.0)},
        {"scan": np.zeros(4)},
        {"scan": np.array([0.5, 1.0, 2.0, 3.0])},
        {"time": np.array([0.0, 0.1, 0.2, 0.3])},
        {"scan": np.array(["a", "b", "c", "d"])},
        {"pass_id": np.zeros((4, 2))},
    ],
)
def test_fields_that_are_no_clock_are_ignored(fields):
    assert visits_of(make_cloud(**fields)) is None


@pytest.mark.parametrize("turn", [np.tile([0.0, 0.05, 0.1], 7), 1e9 * np.arange(21.0), np.zeros(21)])
def test_what_is_no_clock_does_not_hide_one(turn):
    """Many drivers write the time within a turn of the laser, or nanoseconds, into a field called time."""
    seconds = np.repeat(20.0 * np.arange(7), 3)
    by_scan = visits_of(driven(ROUND, time=turn, gps_time=seconds, scan=np.repeat(np.arange(7), 3)))
    assert by_scan is not None
    assert by_scan.unit == "scan"
    np.testing.assert_array_equal(by_scan.seconds, 20.0 * np.arange(7))
    by_time = visits_of(driven(ROUND, time=turn, gps_time=seconds))
    assert by_time is not None
    assert by_time.unit == "second"
    alone = visits_of(driven(ROUND, time=turn, scan=np.repeat(np.arange(7), 3)))
    assert alone is not None
    assert alone.seconds is None
    by_pass = visits_of(make_cloud(pass_id=np.zeros(4), point_source_id=np.array([3, 3, 7, 9])))
    assert by_pass is not None
    assert by_pass.leaves.tolist() == [1, 2, 3]


def test_a_point_without_sensor_position_hides_no_sensor():
    cloud = driven(ROUND)
    x = cloud.fields["to_sensor_x"].copy()
    x[4] = np.nan
    visits = visits_of(cloud.with_fields(to_sensor_x=x))
    assert visits is not None
    np.testing.assert_allclose(visits.way, [0, 30, 60, 90, 120, 150, 179])
    clock = Clock("scan", "scan", 0.0, None, True)
    whole, parts = stays_of(cloud, clock)[0], []
    for some in (np.arange(21) < 4, np.arange(21) == 4, np.arange(21) > 4):
        parts.append(stays_of(cloud.with_fields(to_sensor_x=x).take(some), clock)[0])
    np.testing.assert_allclose(join_stays(parts).sensor, whole.sensor)
    x[3:6] = np.nan
    unknown = visits_of(cloud.with_fields(to_sensor_x=x))
    assert unknown is not None
    assert unknown.way is None


def test_scans_are_neighbours_by_their_numbers():
    """Of scans 0, 2, 4, 40 and 42 the map has no points of those between 4 and 40."""
    places = np.array([[0.0, 0.0], [0.5, 0.0], [1.0, 0.0], [90.0, 0.0], [90.5, 0.0]])
    cloud = driven(places)
    visits = visits_of(cloud.with_fields(scan=np.array([0, 2, 4, 40, 42])[cloud.fields["scan"]]))
    assert visits is not None
    assert visits.leaves.tolist() == [3, 3, 3, 5, 5]


def test_parts_of_a_map_are_put_together():
    """Halves of each scan, in other orders: means of medians, weighted by points; times where there are some."""
    cloud = driven(ROUND)
    cloud = cloud.with_fields(time=np.where(np.arange(21) % 3 == 0, np.nan, 10.0 * cloud.fields["scan"]))
    clock = Clock("scan", "scan", 0.0, "time", True)
    whole, _ = stays_of(cloud, clock)
    parts = [stays_of(cloud.take(rows), clock)[0] for rows in (np.arange(1, 21, 3), np.arange(21)[::-1])]
    joined = join_stays([parts[0]._replace(seconds=np.full(7, np.nan)), parts[1]])
    np.testing.assert_array_equal(joined.value, whole.value)
    np.testing.assert_array_equal(joined.n_points, whole.n_points + 1)
    np.testing.assert_allclose(joined.sensor, whole.sensor, atol=1e-12)
    np.testing.assert_allclose(joined.place, (3.0 * whole.place + parts[0].place) / 4.0)
    np.testing.assert_allclose(joined.seconds, 10.0 * np.arange(7))
    blind = [part._replace(sensor=np.full((7, 3), np.nan)) for part in parts]
    np.testing.assert_allclose(join_stays([blind[0], parts[1]]).sensor, parts[1].sensor)
    assert np.isnan(join_stays(blind).sensor).all()
