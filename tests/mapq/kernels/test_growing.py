from __future__ import annotations

import numpy as np
import pytest

from mapq.kernels.growing import pair_rms
from mapq.segmentation.regions import fit, merge
from tests.reference.mapq_segment import plane_of, wall

RNG = np.random.default_rng(8)


def joined(*parts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return np.concatenate(parts), np.repeat(np.arange(len(parts), dtype=np.int32), [len(part) for part in parts])


def all_pairs(n: int) -> np.ndarray:
    return np.array([(i, j) for i in range(n) for j in range(i + 1, n)], np.int32)


def test_planes_of_regions_are_those_of_their_points() -> None:
    xyz, region = joined(wall(RNG, degrees=20), wall(RNG, offset=3, degrees=-50) + 1000.0)
    fits = fit(xyz, region)
    for r in range(2):
        normal, variances = plane_of(xyz[region == r])
        assert abs(fits.planes[r, :3] @ normal) == pytest.approx(1.0, abs=1e-9)
        np.testing.assert_allclose(fits.planes[r, 3:], xyz[region == r].mean(axis=0), rtol=1e-9)
        np.testing.assert_allclose(fits.spread[r], variances, rtol=1e-6)


def test_joint_residuals_are_those_of_the_joint_plane() -> None:
    xyz, region = joined(wall(RNG), wall(RNG, 3, 2, offset=0.1, start=4, degrees=3))
    fits = fit(xyz, region)
    rms = pair_rms(all_pairs(2), np.arange(2, dtype=np.int32), fits.origin, fits.sums)
    normal, _ = plane_of(xyz)
    distance = (xyz - xyz.mean(axis=0)) @ normal
    expected = max(np.sqrt((distance[region == r] ** 2).mean()) for r in range(2))
    assert rms[0] == pytest.approx(expected, rel=1e-6)


def test_pieces_of_one_wall_are_united_and_copies_are_not() -> None:
    left, right = wall(RNG, 4, start=-4), wall(RNG, 4, start=4)
    copy, crumb = wall(RNG, 4, offset=0.15), wall(RNG, 1, 0.5, offset=0.15)
    xyz, region = joined(left, right, copy, crumb, wall(RNG, 4, degrees=90))
    parent = merge(fit(xyz, region), all_pairs(5), 0.036)
    assert parent.tolist() == [0, 0, 2, 2, 4]


def test_merging_again_changes_nothing() -> None:
    parts = [wall(RNG, 2, start=3 * i, degrees=2 * i, noise=0.03) for i in range(6)]
    xyz, region = joined(*parts)
    parent = merge(fit(xyz, region), all_pairs(6), 0.1)
    kept = np.unique(parent)
    again = np.searchsorted(kept, parent[region]).astype(np.int32)
    assert merge(fit(xyz, again), all_pairs(len(kept)), 0.1).tolist() == list(range(len(kept)))
