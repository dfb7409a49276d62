"""The parts of the benchmark on maps never seen that decide what its figures mean."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks import unseen, unseen_rivals, unseen_sets
from benchmarks.unseen_sets import Map
from mapq.labels import PLAUSIBLE, SUSPICIOUS, UNLABELLED
from mapq.results.judged import Judged
from tests.mapq.factories import make_patches, wall

POSES = np.tile(np.eye(4), (7, 1, 1))


@pytest.mark.parametrize(("error", "n_moved"), [("halves", 3), ("drift", 6), ("scans", 2)])
def test_wrong_poses_are_off_by_the_given_size(error: str, n_moved: int):
    off = np.linalg.norm(unseen_sets.wrong_poses(POSES, error, 0.6, 1)[:, :3, 3], axis=1)
    assert np.count_nonzero(off) == n_moved
    assert off.max() == pytest.approx(0.6)
    assert off[0] == 0.0


def test_thinning_keeps_one_point_of_so_many_with_its_fields():
    cloud = make_patches([np.random.default_rng(1).random((3000, 3))], np.eye(3)[:1]).cloud
    thinned = unseen_sets.thin(cloud.with_fields(number=np.arange(3000)), 3)
    assert len(thinned) == pytest.approx(1000, abs=100)
    np.testing.assert_array_equal(thinned.xyz, cloud.xyz[thinned.fields["number"]])


def test_scans_spread_by_what_they_are_displaced():
    rng = np.random.default_rng(1)
    seen = [wall((0, 0), (8, 0)).sample(rng, 60.0, 0.02) + np.array([0.0, off, 0.0]) for off in (0.0, 0.1, 0.4)]
    patches = make_patches([np.concatenate(seen)], np.eye(3)[1:2])
    scan = np.repeat(np.arange(3), [len(each) for each in seen])
    patches = replace(patches, cloud=patches.cloud.with_fields(scan=scan))
    assert unseen_rivals.spread_of(patches) == pytest.approx([0.4], abs=0.02)


def said(row: Map, label: list[int], score: list[float], metres: list[float]) -> unseen.Said:
    """Return what is said of a map whose patches have 1 m² each."""
    n, values = len(label), np.array(score)
    called = values > 0.5
    xyz = np.arange(3.0 * n).reshape(n, 3) / n
    points = Judged(xyz, np.ones(n), called, values, *(np.full(n, np.nan),) * 2, 1.0, row.name)
    plain = unseen_rivals.Plain(np.array(metres), np.full(n, np.nan), np.zeros(n), values.mean())
    known = np.column_stack([values - 0.1, values, values + 0.1])
    scores = {unseen.MODEL: values}
    return unseen.Said(
        row, np.array(label), plain, np.ones(n), called, values, scores, float(called.mean()), 1.0, points, known
    )


def test_a_set_is_summed_up_by_density():
    good, bad, none = PLAUSIBLE, SUSPICIOUS, UNLABELLED
    right = said(Map("a-right-1", "a", "right"), [good] * 10, [0.0] * 9 + [0.6], [0.0] * 10)
    wrong = said(
        Map("a-halves", "a", "wrong", "halves", 1.0, 1), [bad] * 6 + [none] * 4, [0.9] * 5 + [0.3] * 5, [0.9] * 10
    )
    sparse = said(Map("a-halves-6", "a", "wrong", "halves", 1.0, 1, 6), [bad] * 6, [0.9] * 3 + [0.3] * 3, [np.nan] * 6)
    found = unseen.summary([right, wrong, sparse])
    assert found["role"] == "judging"
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
    text = "\n".join(unseen.lines({"a": {unseen.POINTS: found, unseen.SCANS: found}}))
    assert "10.0 / 10.0" in text
    assert "0.983 0.83" in text
