from __future__ import annotations

import numpy as np
import pytest

from benchmarks.plane_scores import score_segmentation
from mapq.cloud import PointCloud
from mapq.configuration import SURFACES, SegmentSettings
from mapq.features import measure_shapes
from mapq.patches import Patches
from mapq.results.result import assess
from mapq.segmentation import segment
from prf.shell.errors import InputError
from tests.reference.mapq_segment import cloud_of, ground, plane_of, scan_lines, wall

ALL = SegmentSettings(surfaces=SURFACES)


def rng(seed: int = 0) -> np.random.Generator:
    return np.random.default_rng(seed)


def best_ious(patches: Patches, truth: np.ndarray) -> tuple[list[float], list[int]]:
    score = score_segmentation(patches.patch, truth)
    return score.iou.tolist(), score.best_patch.tolist()


class TestDoubleWalls:
    @pytest.mark.parametrize("offset", [0.15, 0.2, 0.3, 0.5, 1.5])
    def test_two_copies_are_two_patches(self, offset: float) -> None:
        cloud, truth = cloud_of(wall(rng(1)), wall(rng(2), offset=offset))
        patches = segment(cloud)
        ious, best = best_ious(patches, truth)
        assert len(patches) == 2
        assert sorted(best) == [0, 1]
        assert min(ious) > 0.9

    def test_beside_single_walls_and_ground(self) -> None:
        copies = [wall(rng(1), 20), wall(rng(2), 6, offset=0.2, noise=0.03)]
        cloud, truth = cloud_of(*copies, ground(rng(3), 24), wall(rng(4), degrees=90, start=4))
        ious, best = best_ious(segment(cloud, ALL), truth)
        assert len(set(best)) == 4
        assert min(ious) > 0.75

    def test_in_a_sparse_map(self) -> None:
        cloud, truth = cloud_of(wall(rng(1), 20, 8, 0.3), wall(rng(2), 20, 8, 0.3, offset=0.3))
        ious, best = best_ious(segment(cloud), truth)
        assert sorted(best) == [0, 1]
        assert min(ious) > 0.9

    def test_in_a_map_denser_than_its_noise(self) -> None:
        cloud, truth = cloud_of(wall(rng(1), 4, 3, 0.02), wall(rng(2), 4, 3, 0.02, offset=0.2))
        patches = segment(cloud)
        ious, best = best_ious(patches, truth)
        assert patches.parameters["resolution"] > 0.05
        assert sorted(best) == [0, 1]
        assert min(ious) > 0.9

    @pytest.mark.parametrize("degrees", [2.0, 3.0, 5.0])
    def test_copies_that_cross_are_two_patches_that_cross(self, degrees: float) -> None:
        cloud, truth = cloud_of(wall(rng(1), 20, 6), wall(rng(2), 20, 6, degrees=degrees))
        patches = segment(cloud)
        _, best = best_ious(patches, truth)
        assert sorted(best) == [0, 1]
        along = np.sign(cloud.xyz[:, 0])
        for number in (0, 1):
            side = truth == number
            for half in (-1, 1):
                owned = patches.patch[side & (along == half) & (np.abs(cloud.xyz[:, 0]) > 5)]
                assert np.mean(owned == best[number]) > 0.7, "both ends of a copy are in one patch"

    def test_a_rough_wall_stays_one_patch(self) -> None:
        cloud, _ = cloud_of(wall(rng(1), noise=0.08, spacing=0.25), ground(rng(2), noise=0.005))
        patches = segment(cloud)
        assert patches.counts[0] > 0.85 * patches.counts.sum()
        assert patches.counts[0] > 0.85 * (12 * 5 / 0.25**2)


class TestGaps:
    def test_walls_in_line_with_a_gap_are_two(self) -> None:
        cloud, truth = cloud_of(wall(rng(1), 8, start=-4.75), wall(rng(2), 8, start=4.75))
        ious, best = best_ious(segment(cloud), truth)
        assert sorted(best) == [0, 1]
        assert min(ious) > 0.95

    def test_a_wall_goes_round_its_windows(self) -> None:
        xyz = wall(rng(1))
        hole = (np.abs(xyz[:, 0] % 3 - 1.5) < 0.6) & (np.abs(xyz[:, 2] - 2.5) < 0.7)
        assert len(segment(PointCloud.from_world(xyz[~hole]))) == 1

    def test_members_are_connected_and_lie_on_their_plane(self) -> None:
        cloud, _ = cloud_of(wall(rng(1)), wall(rng(2), degrees=40, offset=2), ground(rng(3)))
        patches = segment(cloud, ALL)
        points, start = patches.members
        for number in range(len(patches)):
            xyz = cloud.xyz[points[start[number] : start[number + 1]]]
            distance = (xyz - patches.centroid[number]) @ patches.normal[number]
            assert np.abs(distance).max() <= 1.1 * patches.parameters["max_distance"]
            normal, _ = plane_of(xyz)
            assert abs(normal @ patches.normal[number]) == pytest.approx(1.0, abs=1e-9)
            assert n_pieces(xyz, patches.parameters["max_gap"]) == 1


def n_pieces(xyz: np.ndarray, gap: float) -> int:
    """Return how many pieces points fall into when those within a gap are connected."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    pairs = cKDTree(xyz).query_pairs(gap, output_type="ndarray")
    graph = coo_matrix((np.ones(len(pairs)), pairs.T), shape=(len(xyz), len(xyz)))
    return int(connected_components(graph, directed=False)[0])


class TestOrder:
    def test_the_order_of_the_points_does_not_matter(self) -> None:
        parts = [wall(rng(1)), wall(rng(2), offset=0.2), wall(rng(3), degrees=4), ground(rng(4)), wall(rng(5), 4)]
        xyz = np.concatenate(parts)
        xyz = np.concatenate([xyz, xyz[::3], xyz[:50], np.full((5, 3), np.nan)])
        first = segment(PointCloud.from_world(xyz), ALL)
        for seed in range(3):
            order = rng(seed).permutation(len(xyz))
            again = segment(PointCloud.from_world(xyz[order]), ALL)
            np.testing.assert_array_equal(again.patch, first.patch[order])
            np.testing.assert_array_equal(again.normal, first.normal)
            np.testing.assert_array_equal(again.centroid, first.centroid)
            assert again.parameters == first.parameters
            assert again.report == first.report

    def test_a_turned_map_has_the_same_patches(self) -> None:
        walls = [wall(rng(seed), 5, 3, degrees=37 * seed, offset=4 * seed) for seed in range(1, 7)]
        xyz = np.concatenate(walls)
        first = segment(PointCloud.from_world(xyz))
        again = segment(PointCloud.from_world(xyz @ np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]])))
        assert again.parameters == first.parameters
        np.testing.assert_array_equal(again.patch, first.patch)


class TestTraps:
    def test_a_perfect_grid_full_of_ties(self) -> None:
        u, z = np.meshgrid(np.arange(0, 8, 0.1), np.arange(0, 4, 0.1))
        patches = segment(PointCloud.from_world(np.column_stack([u.ravel(), 0 * u.ravel(), z.ravel()])))
        assert patches.counts.tolist() == [u.size]

    def test_heavy_duplicates_change_nothing_but_counts(self) -> None:
        xyz = wall(rng(1), 8)
        once = segment(PointCloud.from_world(xyz))
        heavy = segment(PointCloud.from_world(np.concatenate([np.repeat(xyz, 12, axis=0), xyz[:1].repeat(4000, 0)])))
        np.testing.assert_array_equal(heavy.patch[: 12 * len(xyz) : 12], once.patch)
        assert heavy.report["points_repeated"] == 11 * len(xyz) + 4000
        (warning,) = set(heavy.report["warnings"]) - set(once.report["warnings"])
        assert warning.startswith(f"{11 * len(xyz) + 4000} of {12 * len(xyz) + 4000} points repeat the coordinates")
        assert heavy.parameters == once.parameters

    def test_points_that_are_not_finite_belong_to_no_patch(self) -> None:
        xyz = wall(rng(1))
        clean = segment(PointCloud.from_world(xyz))
        xyz = np.insert(xyz, [0, 7, 7, 2000], [[np.nan] * 3, [0, np.inf, 0], [np.nan, 0, 0], [-np.inf] * 3], axis=0)
        patches = segment(PointCloud(xyz, np.zeros(3)))
        bad = ~np.isfinite(xyz).all(axis=1)
        assert (patches.patch[bad] == -1).all()
        np.testing.assert_array_equal(patches.patch[~bad], clean.patch)
        assert patches.report["points_not_finite"] == 4

    @pytest.mark.parametrize("unit", [1e-3, 0.3048, 1e3])
    def test_any_unit_of_length(self, unit: float) -> None:
        cloud, truth = cloud_of(wall(rng(1)), wall(rng(2), offset=0.2))
        patches = segment(PointCloud(cloud.xyz * unit, np.zeros(3)))
        assert min(best_ious(patches, truth)[0]) > 0.9
        assert patches.parameters["noise"] == pytest.approx(0.02 * unit, rel=0.3)

    def test_millimetres_taken_for_metres_are_warned_of_and_not_judged(self) -> None:
        patches = segment(PointCloud(1e3 * wall(rng(1)), np.zeros(3), source="my.xyz"))
        assert any("--unit mm" in warning for warning in patches.report["warnings"])
        with pytest.raises(InputError, match=r"my\.xyz: its points are .* m apart.* --unit mm"):
            assess(patches)

    def test_survey_coordinates(self) -> None:
        xyz = wall(rng(1))
        near, far = (segment(PointCloud.from_world(xyz + shift)) for shift in (np.zeros(3), (4.5e5, 5.4e6, 300.0)))
        assert len(near) == len(far) == 1
        assert np.mean(near.patch == far.patch) > 0.999

    @pytest.mark.parametrize("anisotropy", [5, 10, 20])
    def test_scan_lines_far_apart(self, anisotropy: int) -> None:
        xyz = scan_lines(0.03, 0.03 * anisotropy)
        patches = segment(PointCloud.from_world(xyz))
        assert patches.counts.max(initial=0) > 0.9 * len(xyz)

    def test_what_a_cloud_hides_is_said(self) -> None:
        lines = scan_lines(0.02, 3.0)
        patches = segment(PointCloud.from_world(lines), SegmentSettings(resolution=0.0))
        assert any("scan line" in warning for warning in patches.report["warnings"])

    def test_a_volume_has_no_patches(self) -> None:
        patches = segment(PointCloud.from_world(rng(1).uniform(0, 6, (8000, 3))), ALL)
        assert len(patches) == 0
        assert patches.report["warnings"][0].startswith("no patches")

    @pytest.mark.parametrize("n", [3, 4, 5, 12, 40])
    def test_tiny_clouds(self, n: int) -> None:
        patches = segment(PointCloud.from_world(rng(n).uniform(0, 1, (n, 3)) * (1, 0, 1)))
        assert len(patches) == 0
        assert (patches.patch == -1).all()

    @pytest.mark.parametrize(
        "xyz",
        [
            np.zeros((0, 3)),
            np.ones((30, 3)),
            np.full((9, 3), np.nan),
            np.array([[0.0, 0, 0], [1, 0, 0]]),
        ],
    )
    def test_fewer_than_three_places_are_refused(self, xyz: np.ndarray) -> None:
        with pytest.raises(InputError, match="a plane needs 3"):
            segment(PointCloud(xyz, np.zeros(3), source="x.ply"))


class TestFilters:
    def test_kinds_that_are_not_judged_are_dropped_and_counted(self) -> None:
        cloud, truth = cloud_of(wall(rng(1)), ground(rng(2), 20))
        kept, usual = segment(cloud, SegmentSettings(surfaces=("upright",))), segment(cloud)
        assert (len(kept), len(usual), len(segment(cloud, ALL))) == (1, 2, 2)
        assert [SURFACES[kind] for kind in usual.kinds] == ["level", "upright"]
        assert set(usual.report["not_judged"]) == {"tilted"}
        dropped = kept.report["not_judged"]["level"]
        assert dropped["patches"] == 1
        assert dropped["points"] == pytest.approx(np.count_nonzero(truth == 1), rel=0.05)
        assert dropped["area"] == pytest.approx(400.0, rel=0.1)
        assert measure_shapes(kept).area == pytest.approx([60.0], rel=0.15)

    def test_small_ones_are_dropped(self) -> None:
        cloud, _ = cloud_of(wall(rng(1)), wall(rng(2), 2, 2, offset=4))
        assert len(segment(cloud, SegmentSettings(min_points=100))) == 2
        assert len(segment(cloud, SegmentSettings(min_points=300))) == 1
        assert len(segment(cloud, SegmentSettings(min_extent=3.0))) == 1

    def test_what_is_given_is_used(self) -> None:
        cloud, _ = cloud_of(wall(rng(1)))
        given = {"max_angle": 11.0, "max_distance": 0.1, "max_gap": 1.5, "noise": 0.03, "min_extent": 2.0}
        parameters = segment(cloud, SegmentSettings(max_variation=0.2, **given)).parameters
        assert {name: parameters[name] for name in given} == given


# A scene of a thousand points with most of what a segmentation has to decide; plain Python does it in seconds.


def few_rng(seed: int) -> np.random.Generator:
    return np.random.default_rng(seed)


def test_crossing_copies_a_corner_the_ground_and_outliers() -> None:
    copies = wall(few_rng(1), 4.0, 2.5, 0.2), wall(few_rng(2), 4.0, 2.5, 0.2, degrees=8.0)
    corner = wall(few_rng(3), 3.0, 2.5, 0.2, degrees=90.0, start=3.5)
    strays = few_rng(4).uniform(-3.0, 3.0, (40, 3))
    cloud, truth = cloud_of(*copies, corner, ground(few_rng(5), 5.0, 0.25), strays)
    patches = segment(cloud, SegmentSettings(surfaces=SURFACES))
    score = score_segmentation(patches.patch, truth)
    assert len(patches) == 4
    assert len({*score.best_patch[:4].tolist()}) == 4
    assert score.iou[:2].min() > 0.75, "copies that cross"
    assert score.iou[2:4].min() > 0.95, "corner and ground"
    assert np.mean(patches.patch[truth == 4] == -1) > 0.6, "strays"
