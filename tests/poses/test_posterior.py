"""What draws of a trajectory say of its poses."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from prf.poses.plane import wrapped
from prf.poses.posterior import Trajectory, pose_functionals

SD = np.array([0.03, 0.01, 0.02])
SHIFT = np.array([0.0, 0.04, 0.1])


@pytest.fixture(scope="module")
def drawn() -> Trajectory:
    """Poses 4 cm above and 0.1 rad beyond the given ones, spread 3 cm along a diagonal and 1 cm across it."""
    rng = np.random.default_rng(2)
    given = np.column_stack([np.arange(4.0), np.zeros(4), [0.0, 1.0, np.pi - 0.05, -3.0]])
    noise = rng.standard_normal((4000, 4, 3)) * SD
    along = np.sqrt(0.5) * np.array([[1.0, 1.0], [-1.0, 1.0]])
    draws = np.concatenate([noise[..., :2] @ along, noise[..., 2:]], axis=2) + SHIFT
    return Trajectory(np.arange(4), np.full(4, np.nan), given, draws.astype(np.float32))


def test_means_and_deviations_are_those_of_the_draws(drawn: Trajectory) -> None:
    wanted = drawn.given + SHIFT
    np.testing.assert_allclose(drawn.mean[:, :2], wanted[:, :2], atol=0.002)
    np.testing.assert_allclose(drawn.mean[:, 2], wrapped(wanted[:, 2]), atol=0.002)
    across = np.sqrt(0.5 * (SD[0] ** 2 + SD[1] ** 2))
    np.testing.assert_allclose(drawn.sd, np.broadcast_to([across, across, SD[2]], (4, 3)), rtol=0.05)
    figures = drawn.figures()
    np.testing.assert_allclose(list(figures.values()), [4, 0.04, 0.1, np.hypot(*SD[:2]), SD[2]], rtol=0.05)


def test_headings_are_circular(drawn: Trajectory) -> None:
    """Offsets round half a turn have a mean there, not at 0, and no wide spread."""
    turned = drawn.draws + np.array([0.0, 0.0, np.pi - 0.1], np.float32)
    turned[..., 2] = wrapped(turned[..., 2])
    found = dataclasses.replace(drawn, draws=turned)
    np.testing.assert_allclose(np.abs(found.correction[:, 2]), np.pi, atol=0.002)
    np.testing.assert_allclose(found.sd[:, 2], SD[2], rtol=0.05)


def test_ellipses_hold_nineteen_draws_of_twenty(drawn: Trajectory) -> None:
    axes = drawn.ellipses()
    np.testing.assert_allclose(np.linalg.norm(axes, axis=2), np.broadcast_to(2.448 * SD[[1, 0]], (4, 2)), rtol=0.05)
    error = (drawn.draws - drawn.correction)[..., :2]
    share = np.einsum("dnj,nij->dni", error, axes) / (axes**2).sum(axis=2)
    np.testing.assert_allclose(((share**2).sum(axis=2) <= 1.0).mean(axis=0), 0.95, atol=0.015)


def test_words_tell_corrections_from_knowledge(drawn: Trajectory) -> None:
    shifted = dataclasses.replace(drawn, draws=np.tile(np.float32([0.0, 1.5, 0.0]), (3, 4, 1)))
    assert shifted.words() == "4 poses corrected by 150 cm and 0 degrees (rms), known to 0 cm and 0 degrees"
    assert dataclasses.replace(drawn, draws=drawn.draws[:0]).words().endswith("by 0 cm and 0 degrees (rms)")


def test_functionals_name_first_middle_and_last_pose(drawn: Trajectory) -> None:
    found = pose_functionals(drawn.given + drawn.draws, drawn.given)
    places = [name for i in (0, 2, 3) for name in (f"pose_{i}_x", f"pose_{i}_y", f"pose_{i}_heading")]
    assert list(found) == ["pose_correction", *places]
    np.testing.assert_allclose(found["pose_2_heading"], drawn.draws[:, 2, 2], atol=1e-6)
    np.testing.assert_allclose(found["pose_correction"].mean(), np.hypot(0.04, np.hypot(*SD[:2])), rtol=0.02)
    one = pose_functionals(drawn.given[:1] + np.array([3.0, 4.0, -0.5]), drawn.given[:1])
    np.testing.assert_allclose(list(one.values()), [5.0, 3.0, 4.0, -0.5])
