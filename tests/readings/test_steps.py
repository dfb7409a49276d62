"""Jumps, and poses that jitter."""

from __future__ import annotations

import re

import numpy as np
import pytest

from prf.readings.describe import find_spoiling
from prf.readings.readings import ScanTable
from prf.readings.steps import jitter_of, jumps
from prf.readings.table import read_table

N = 200
TURN = np.linspace(0.0, 2.0 * np.pi, N)
WAY = np.column_stack([20.0 * np.cos(TURN), 10.0 * np.sin(TURN), TURN + np.pi / 2])


def jittered(sigma: float) -> np.ndarray:
    return WAY + np.random.default_rng(1).normal(size=WAY.shape) * [sigma, sigma, 0.3 * sigma]


def scans_at(pose: np.ndarray) -> ScanTable:
    n = np.arange(len(pose))
    return ScanTable(n, n, np.ones_like(n), np.zeros_like(n), pose, n.astype(float))


@pytest.mark.parametrize("sigma", [0.2, 0.5, 1.0])
def test_independent_errors_of_poses_show_in_how_far_they_lie_from_the_middle_of_their_neighbours(sigma: float) -> None:
    found = jitter_of(jittered(sigma))
    assert found.is_jitter
    assert found[:2] == pytest.approx((sigma, 0.3 * sigma), rel=0.2)


@pytest.mark.parametrize("pose", [WAY, jittered(0.02), jittered(0.5)[:20], WAY[::10], np.zeros((N, 3))])
def test_smooth_few_sparse_or_resting_poses_do_not_jitter(pose: np.ndarray) -> None:
    assert not jitter_of(pose).is_jitter


def test_a_jump_beyond_the_jitter_is_one_and_steps_of_the_jitter_are_none() -> None:
    pose = jittered(1.0)
    assert list(jumps(scans_at(pose))) == []
    pose[120:, 0] += 30.0
    assert [(code, numbers) for code, _, numbers in jumps(scans_at(pose))] == [("pose-jump", (120,))]


@pytest.mark.parametrize("seconds", [0.2, 0.4])
def test_steps_of_a_thinned_log_are_no_jumps_but_one_far_beyond_them_is(seconds: float) -> None:
    pose = 2.0 * WAY[::4]
    pose[:, 2] = 1.3 * np.arange(len(pose))
    scans = scans_at(pose)._replace(time=seconds * np.arange(len(pose)))
    [(code, words, numbers)] = jumps(scans)
    assert (code, numbers) == ("scans-apart", ())
    assert words.startswith("scans are far apart: half of the steps are above 4.")
    pose[20:, 0] += 30.0
    found = [(code, numbers) for code, _, numbers in jumps(scans._replace(pose=pose))]
    assert found == [("scans-apart", ()), ("pose-jump", (20,))]


def test_what_odometry_drove_too_is_no_jump() -> None:
    pose = WAY.copy()
    pose[60:, 2] += 2.0  # on the spot
    pose[120:, 0] += 30.0
    odometry = WAY + np.cumsum(np.random.default_rng(4).normal(0.0, 0.01, WAY.shape), axis=0) + [3.0, 1.0, 0.0]
    turned = odometry.copy()
    turned[60:, 2] += 2.1
    scans = scans_at(pose)._replace(time=np.full(N, np.nan))
    jumping = [(None, (60, 120)), (pose, (60, 120)), (odometry, (60, 120)), (turned, (120,))]
    for driven, numbers in jumping:
        [found] = jumps(scans._replace(odometry=driven))
        assert (found[0], found[2]) == ("pose-jump", numbers)


def test_poses_of_a_sonar_that_jitter_are_reported_with_the_flag() -> None:
    pose = jittered(0.5)
    rows = "".join(f"{x},{y},{h},2.0,0.3\n" for x, y, h in pose)
    found = find_spoiling(read_table(b"x,y,theta,range,cone\n" + rows.encode(), "a"))
    assert [each.code for each in found] == ["pose-jitter"]
    assert re.search(r"prf sample --pose-noise 0\.[45]\d? 0\.1\d?$", found[0].message)


def test_the_heading_of_a_scan_of_a_table_is_that_of_its_middle_beam() -> None:
    rows = "".join(f"{k},0,{k + a},1.0,{k}\n" for k in range(3) for a in (-0.5, 0.0, 0.5))
    table = read_table(b"x,y,theta,range,scan\n" + rows.encode(), "a").notes.scans
    np.testing.assert_array_equal(table.pose, [[0, 0, 0], [1, 0, 1], [2, 0, 2]])
