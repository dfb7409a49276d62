"""What the experiments on logs compute themselves: contours, bytes of a map, a scan turned upright, R-hat, tables."""

from __future__ import annotations

import dataclasses
import gzip
import itertools
import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

from benchmarks import (
    bitmap,
    commands,
    figure3,
    figure4,
    figure5,
    scores,
    unseen,
    unseen_numbers,
    unseen_rivals,
    unseen_sets,
)
from benchmarks.contours import contour_polygons, write_contours
from benchmarks.regression import regression_scores
from benchmarks.unseen_sets import Map
from mapq.crf import Labelling
from mapq.labels import PLAUSIBLE, SUSPICIOUS, UNLABELLED
from mapq.results.judged import Judged
from prf.model.sensors import SonarModel
from prf.results import write_run
from prf.results.occupancy import OccupancyGrid
from prf.results.score import read_occupied_area
from tests.factories import make_run
from tests.mapq.factories import make_patches, wall


def grid_of(rows: list[str]) -> OccupancyGrid:
    """Return a grid of cells of 0.1 m from its rows, the highest first: # wall, . free, space unseen."""
    cells = np.array([list(row) for row in rows[::-1]])
    hits = np.where(cells == "#", 2, 0).astype(np.int32)
    misses = np.where(cells == ".", 2, 0).astype(np.int32)
    occupancy = ((hits + 0.5) / (hits + misses + 1.0)).astype(np.float32)
    return OccupancyGrid(occupancy, hits, misses, np.array([1.0, 2.0]), 0.1)


def test_contours_join_the_cells_of_a_wall_and_leave_out_what_is_unseen() -> None:
    wall = contour_polygons(grid_of(["      ", " #### ", "......"]))
    assert shapely.hausdorff_distance(wall, shapely.box(1.1, 2.1, 1.5, 2.2)) < 0.02


def test_written_contours_are_read_as_a_map(tmp_path: Path) -> None:
    grid = grid_of([".....", ".###.", "....."])
    corners = write_contours(grid, tmp_path / "map.geojson")
    area = read_occupied_area(tmp_path / "map.geojson")
    assert corners == 4
    assert area.window == grid.window
    assert area.region.area == pytest.approx(0.03, rel=0.3)


def test_bytes_count_every_corner_once(tmp_path: Path) -> None:
    holed = [[[0, 0], [9, 0], [9, 9], [0, 9], [0, 0]], [[1, 1], [1, 2], [2, 2], [1, 1]]]
    feature = {"type": "Feature", "properties": {}, "geometry": {"type": "MultiPolygon", "coordinates": [holed]}}
    path = tmp_path / "map.geojson"
    path.write_text(json.dumps(feature))
    sizes = figure4.map_bytes(path)
    assert (sizes["rings"], sizes["corners"]) == (2, 7)
    assert [sizes[f"{form}_bytes"] for form in ("int16_cm", "float32", "float64")] == [32, 60, 116]
    assert sizes["geojson_bytes"] == path.stat().st_size


@pytest.mark.parametrize("seen", [False, True])
def test_the_worst_r_hat_is_that_of_what_was_seen(tmp_path: Path, seen: bool) -> None:
    run = make_run(n_draws=80)
    assert run.image is not None
    stuck = run.chain < 2
    image = run.image._replace(seen=np.full_like(run.image.seen, seen))
    steady = np.random.default_rng(1).normal(size=80)
    functionals = {**run.functionals, "n_edges": stuck.astype(np.float64), "log_posterior": steady}
    run = dataclasses.replace(run, image=image, functionals=functionals, probe_black=np.repeat(stuck[:, None], 3, 1))
    write_run(tmp_path / "run", run)
    found = commands.worst_rhat(tmp_path / "run")
    assert math.isinf(found) if seen else found < 1.5


def test_the_summary_has_the_best_rival_score_by_score() -> None:
    names = (*scores.SUMMARY, "rhat")
    rows = [{"map": scores.POSTERIOR, **dict.fromkeys(names, 0.5)}]
    rows += [{"map": f"grid {k}", **dict.fromkeys(names, value)} for k, value in enumerate((0.25, 0.75))]
    cells = scores.summary({"intel": rows}).splitlines()[-1].split(" | ")
    assert cells[:3] == ["| intel", "0.50", "0.50, 0.25 (grid 0)"]
    assert cells[5:7] == ["0.500, 0.750 (grid 1)"] * 2, "of AUC and of the share within 0.2 m the most is the best"


# The scene of figure 3: sums that are 1, and features of both kinds.


def test_the_scene_has_a_bit_of_everything_and_its_sums_are_one() -> None:
    sight = figure3.look(SonarModel())
    rows = figure3.rows_of(sight)
    assert {row["kind"] for row in rows} == {"surface", "corner"}
    assert sum(row["share"] for row in rows) + sight.none == pytest.approx(1.0, abs=1e-12)
    assert figure3.sums(sight)["density"] == pytest.approx(1.0, abs=1e-9)
    surfaces = [row for row in rows if row["kind"] == "surface"]
    assert len(figure3.visible_parts(sight)) == len(surfaces)


# What the sonar experiment computes itself: shares of whole scans, and the comparison with the grids.


def test_shares_are_whole_scans_without_those_held_out() -> None:
    scans = list(range(200))
    everything = figure5.mapping_scans(scans, 100.0)
    assert everything == [scan for scan in scans if scan % 10 != 5]
    for percent in (5.0, 10.0, 25.0, 50.0):
        some = figure5.mapping_scans(scans, percent)
        assert set(some) < set(everything)
        assert len(some) == int(len(everything) * percent / 100)
        gaps = [b - a for a, b in itertools.pairwise(some)]
        assert max(gaps) - min(gaps) <= 2, "spread evenly over the drive, but for the scans held out"


def test_a_share_keeps_the_rows_of_the_log(tmp_path: Path) -> None:
    lines = ["x,y,theta,range,scan", *(f"1.5,2.5,{k}.0,,{scan}" for scan in range(40) for k in range(3))]
    log = tmp_path / "sonar.csv.gz"
    log.write_bytes(gzip.compress("\n".join(lines).encode()))
    n = figure5.write_share(figure5.read_rows(log), 50.0, tmp_path / "half" / "sonar.csv")
    written = (tmp_path / "half" / "sonar.csv").read_text().splitlines()
    assert n == len(written) - 1 == 18 * 3
    assert written[0] == lines[0]
    assert set(written) <= set(lines)


def row(kind: str, iou: float, nll: float, **changes: Any) -> dict[str, Any]:
    """Return scores of a map."""
    return {
        "share": 5.0,
        "settings": "fitted",
        "map": kind,
        "iou_occupied": iou,
        "iou_free": 0.9,
        "sonar_nll": nll,
        **changes,
    }


def test_the_prf_must_be_ahead_of_the_better_grid_of_each_measure() -> None:
    grids = [row("count grid", 0.1, 1.0, iou_free=0.8), row("log-odds grid", 0.3, 2.0, iou_free=0.7)]
    assert figure5.lost([row(figure5.POSTERIOR, 0.4, 0.5), *grids]) == []
    found = figure5.lost([row(figure5.POSTERIOR, 0.2, 1.5), *grids])
    assert found == [
        "PRF posterior, fitted, 5 %, iou_occupied: 0.200 against 0.300",
        "PRF posterior, fitted, 5 %, sonar_nll: 1.500 against 1.000",
    ]
    assert (
        figure5.lost([row(figure5.BEST, 0.1, 9.0, share=10.0), row("count grid", 0.0, 9.1, share=10.0, iou_free=0.0)])
        == []
    )


# The benchmark of the noisy bitmap: its truth, and what its baselines do where that is known.


@pytest.mark.parametrize("diagonal", [False, True], ids=["4 neighbours", "8 neighbours"])
def test_the_graph_cut_trades_pixels_for_borders(diagonal: bool) -> None:
    """One black pixel: kept while its border costs less than the odds of a flip."""
    noisy = np.zeros((9, 9), np.bool_)
    noisy[4, 4] = True
    border = 4.0 + (4.0 / np.sqrt(2.0) if diagonal else 0.0)
    odds = np.log((1.0 - bitmap.FLIPS) / bitmap.FLIPS)
    assert np.array_equal(bitmap.by_ising(noisy, 0.99 * odds / border, diagonal), noisy)
    assert not bitmap.by_ising(noisy, 1.01 * odds / border, diagonal).any()


def test_the_median_is_the_majority() -> None:
    noisy = np.zeros((9, 9), np.bool_)
    noisy[:, :4] = True
    noisy[4, 1] = False
    expected = noisy.copy()
    expected[4, 1] = True
    assert np.array_equal(bitmap.by_median(noisy, 3), expected)


def test_the_maps_find_a_half_plane() -> None:
    """Few steps, and pixels so clear that the posterior mean is the truth but along the border."""
    truth = np.zeros((bitmap.SIZE, bitmap.SIZE), np.bool_)
    truth[:, :48] = True
    noisy = truth ^ (np.random.default_rng(1).random(truth.shape) < bitmap.FLIPS)
    image, best, _ = bitmap.by_maps(noisy, 1, 0.03, 30_000, 1)
    assert image.occupancy.shape == truth.shape
    assert bitmap.wrong(image.occupancy > 0.5, truth) < 0.02
    assert best.n_edges < 60


# The parts of the benchmark on maps never seen that decide what its figures mean.


POSES = np.tile(np.eye(4), (7, 1, 1))


@pytest.mark.parametrize(("error", "n_moved"), [("halves", 3), ("drift", 6), ("scans", 2)])
def test_wrong_poses_are_off_by_the_given_size(error: str, n_moved: int):
    off = np.linalg.norm(unseen_sets.wrong_poses(POSES, error, 0.6, 1)[:, :3, 3], axis=1)
    assert np.count_nonzero(off) == n_moved
    assert off.max() == pytest.approx(0.6)
    assert off[0] == 0.0


def test_scans_spread_by_what_they_are_displaced():
    rng = np.random.default_rng(1)
    seen = [wall((0, 0), (8, 0)).sample(rng, 60.0, 0.02) + np.array([0.0, off, 0.0]) for off in (0.0, 0.1, 0.4)]
    patches = make_patches([np.concatenate(seen)], np.eye(3)[1:2])
    scan = np.repeat(np.arange(3), [len(each) for each in seen])
    patches = replace(patches, cloud=patches.cloud.with_fields(scan=scan))
    assert unseen_rivals.spread_of(patches) == pytest.approx([0.4], abs=0.02)


def said(row: Map, label: list[int], score: list[float], metres: list[float]) -> unseen_numbers.Said:
    """Return what is said of a map whose patches have 1 m² each."""
    n, values = len(label), np.array(score)
    called = values > 0.5
    xyz = np.arange(3.0 * n).reshape(n, 3) / n
    points = Judged(xyz, np.ones(n), called, values, *(np.full(n, np.nan),) * 2, 1.0, 0.3, row.name)
    plain = unseen_rivals.Plain(np.array(metres), np.full(n, np.nan), np.zeros(n), values.mean())
    known = np.column_stack([values - 0.1, values, values + 0.1])
    scores = {unseen.MODEL: values}
    at = {t: Labelling(called.astype(np.uint8), values.astype(np.float32), values) for t in unseen_numbers.TOLERANCES}
    of_kind = np.zeros(n, np.uint8), np.full(n, 1.0 / n)
    share = float(called.mean())
    return unseen_numbers.Said(
        row, np.array(label), plain, np.ones(n), called, values, scores, share, 1.0, *of_kind, points, known, at
    )


def test_a_set_is_summed_up_by_density():
    good, bad, none = PLAUSIBLE, SUSPICIOUS, UNLABELLED
    right = said(Map("a-right-1", "a", "right"), [good] * 10, [0.0] * 9 + [0.6], [0.0] * 10)
    wrong = said(
        Map("a-halves", "a", "wrong", "halves", 1.0, 1), [bad] * 6 + [none] * 4, [0.9] * 5 + [0.3] * 5, [0.9] * 10
    )
    sparse = said(Map("a-halves-6", "a", "wrong", "halves", 1.0, 1, 6), [bad] * 6, [0.9] * 3 + [0.3] * 3, [np.nan] * 6)
    found = unseen_numbers.summary([right, wrong, sparse], unseen.SCANS)
    assert found["role"] == "judging"
    upright, level = found["kinds"]["upright"], found["kinds"]["level"]
    assert (upright["n_far"], upright["n_right"], upright["alarms"]) == (10, 10, 0.1)
    assert upright["found"] == upright["recall_at_last"] == 0.5
    assert (upright["auc_at_last"], upright["called_below"]) == (pytest.approx(0.95), 0.1)
    assert found["kinds"]["both"] == pytest.approx(upright, nan_ok=True)
    assert level["n_far"] == level["share_of_points"] == 0
    assert found["false_alarms"] == {1: {"n": 10, "patches": 0.1, "area": 0.1}}
    rank = found["ranks"][1]
    assert (rank["n"], rank["recall_shipped"], rank["alarms_shipped"]) == (16, pytest.approx(5 / 6), 0.1)
    assert rank[unseen.MODEL] == {"auc": pytest.approx(59 / 60), "recall": pytest.approx(5 / 6)}
    assert found["ranks"][6] is None
    assert found["compare"] == [2, 2]
    assert found["compare_entropy"] == [1, 1]
    assert found["thinning"] == pytest.approx(0.0)
    assert found["growth"] == [0, 0]
    assert found["disagreement"]["n"] == 20
    assert found["disagreement"]["coverage"] == pytest.approx(14 / 20)
    assert found["curve"]["n"] == [10, 0, 0, 0, 0, 10, 0]
    at = found["tolerances"]
    assert (at["n_between"], at["alarms"], at["auc"]) == (0, 0.1, pytest.approx(0.95))
    text = "\n".join(unseen.lines({"a": {unseen.POINTS: found, unseen.SCANS: found}}))
    assert "10.0 / 10.0" in text
    assert "0.983 0.83" in text


def test_a_regression_on_counts_of_beams_tells_walls_from_free_ground(data_dir: Path) -> None:
    pytest.importorskip("sklearn")
    found = regression_scores(data_dir / "demo-office.log.gz", "5::10", None, 1, {"skip_scans": "5::10"})
    assert found["auc"] > 0.9
    assert found["nll"] < 0.2
    assert {"nll_unweighted", "brier", "auc_unweighted"} <= set(found)
