"""The parts of the benchmark on causes that decide what its figures mean."""

from __future__ import annotations

import numpy as np

from benchmarks import causes
from mapq.perturb import build
from mapq.results.causes import LOCAL, MISSED_LOOP
from mapq.simulate import Settings, simulate
from tests.mapq.factories import make_patches


def test_a_drive_that_is_cut_and_merged_is_the_map_again():
    cloud = simulate(Settings.of_size("small", {"n_points": 3000, "drift": 0.0}), 1)
    scans = causes.cut(cloud, 20.0)
    again = build(scans, reference=scans.poses).cloud
    np.testing.assert_allclose(again.xyz, cloud.xyz, atol=1e-4)
    assert len(scans) == len(np.unique(np.floor(cloud.fields["time"] / 20.0)))


def test_patches_belong_to_the_scans_that_most_of_their_points_are_of():
    patches = make_patches([np.zeros((10, 3)), np.ones((10, 3)), np.ones((10, 3))], np.eye(3), loose=1)
    cloud = patches.cloud.with_fields(scan=np.repeat([0, 9, 0, 9, 9], [10, 10, 5, 5, 1]))
    chosen = [causes.chosen(causes.Case("", cause, "", cloud, 5), patches).tolist() for cause in (MISSED_LOOP, LOCAL)]
    assert chosen == [[True, False, False], [False, True, False]]
    assert causes.chosen(causes.Case("", LOCAL, "", cloud), patches).all()
