"""Pictures of maps: the projection, the colours, and that a page holds what it should."""

from __future__ import annotations

import io

import numpy as np
import pytest

from mapq.labels import NO_PATCH, PLAUSIBLE, SUSPICIOUS, UNLABELLED
from mapq.picture import (
    BACKGROUND_RGB,
    PLAUSIBLE_RGB,
    SUSPICIOUS_RGB,
    Picture,
    axonometric,
    label_colours,
    patch_colours,
    picture_of_cloud,
    probability_colours,
)
from prf.shell.errors import InputError


def walls(n_points: int = 2000) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return points of four walls, the wall of each, and their labels by wall."""
    rng = np.random.default_rng(1)
    wall = rng.integers(0, 4, n_points).astype(np.int32)
    along, height = rng.uniform(0.0, 20.0, n_points), rng.uniform(0.0, 6.0, n_points)
    xyz = np.stack([along, 5.0 * wall, height], axis=1)
    label = np.array([PLAUSIBLE, SUSPICIOUS, PLAUSIBLE, UNLABELLED], np.uint8)[wall]
    return xyz, np.where(wall == 3, NO_PATCH, wall).astype(np.int32), label


class TestAxonometric:
    def test_from_above_it_is_the_plan_view(self) -> None:
        xyz = np.random.default_rng(1).normal(size=(50, 3))
        xy, nearness = axonometric(xyz, azimuth=-90.0, elevation=90.0)
        np.testing.assert_allclose(xy, xyz[:, :2], atol=1e-12)
        np.testing.assert_allclose(nearness, xyz[:, 2], atol=1e-12)

    def test_up_is_up_and_the_viewer_sees_the_near_side(self) -> None:
        xy, nearness = axonometric(np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]), 0.0, 0.0)
        np.testing.assert_allclose(xy, [[0.0, 1.0], [0.0, 0.0], [1.0, 0.0]], atol=1e-12)
        np.testing.assert_allclose(nearness, [0.0, 1.0, 0.0], atol=1e-12)

    def test_it_is_a_rotation(self) -> None:
        xyz = np.random.default_rng(2).normal(size=(20, 3))
        xy, nearness = axonometric(xyz, 25.0, 40.0)
        np.testing.assert_allclose((xy**2).sum(axis=1) + nearness**2, (xyz**2).sum(axis=1))


class TestColours:
    def test_labels(self) -> None:
        scheme = label_colours(
            np.array([PLAUSIBLE, SUSPICIOUS, UNLABELLED], np.uint8), np.array([0, 1, NO_PATCH], np.int32)
        )
        np.testing.assert_allclose(scheme.rgb, [PLAUSIBLE_RGB, SUSPICIOUS_RGB, BACKGROUND_RGB], rtol=1e-6)
        assert list(scheme.layer) == [1, 2, 0]
        assert [name for name, _ in scheme.legend] == ["plausible", "suspicious", "no patch"]

    def test_probabilities_end_in_the_colours_of_the_labels(self) -> None:
        scheme = probability_colours(np.array([0.0, 1.0, np.nan]), np.array([0, 1, NO_PATCH], np.int32))
        np.testing.assert_allclose(scheme.rgb, [PLAUSIBLE_RGB, SUSPICIOUS_RGB, BACKGROUND_RGB], rtol=1e-6)

    def test_neighbouring_patches_differ(self) -> None:
        rgb = patch_colours(np.arange(40, dtype=np.int32)).rgb
        assert np.all(np.abs(np.diff(rgb, axis=0)).sum(axis=1) > 0.2)
        assert np.all((rgb >= 0.0) & (rgb <= 1.0))


class TestPicture:
    def test_suspicious_points_are_drawn_red(self) -> None:
        from matplotlib.image import imread

        xyz, patch, label = walls()
        pixels = imread(io.BytesIO(Picture(xyz, label_colours(label, patch), "t", "s").png()), format="png")[..., :3]
        for rgb in (PLAUSIBLE_RGB, SUSPICIOUS_RGB):
            assert np.count_nonzero(np.abs(pixels - rgb).max(axis=2) < 0.02) > 100

    def test_stray_points_do_not_widen_it(self) -> None:
        xyz, patch, label = walls()
        stray, whole = np.flatnonzero(patch == NO_PATCH)[:5], Picture(xyz, label_colours(label, patch), "t", "s")
        xyz = xyz.copy()
        xyz[stray] = 500.0
        widths = [np.ptp(each.draw(("plan",)).axes[0].get_xlim()) for each in (whole, whole._replace(xyz=xyz))]
        assert widths[1] == pytest.approx(widths[0], rel=0.05)
        bare = picture_of_cloud("a/town.ply", xyz)
        assert (bare.title, bare.subtitle) == ("Point cloud", f"town.ply  ·  {len(xyz):,} points")
        assert np.ptp(bare.draw(("plan",)).axes[0].get_xlim()) > 400.0

    def test_points_that_are_not_finite_are_left_out(self) -> None:
        xyz, patch, label = walls()
        xyz[::3] = np.nan
        picture = Picture(xyz, label_colours(label, patch), "t", "s")
        picture.draw()
        assert picture._replace(xyz=xyz * np.nan).png() is None
        with pytest.raises(InputError, match="no point"):
            picture._replace(xyz=xyz * np.nan).draw()
