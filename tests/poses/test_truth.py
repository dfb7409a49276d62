"""Sampled trajectories beside the truth."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from prf.output.report.truth import truth_section
from prf.poses.plane import compose
from prf.poses.posterior import Trajectory
from prf.poses.truth import TrueErrors
from prf.readings.poses import true_poses
from prf.shell.errors import InputError

N = 40
SD = np.array([0.05, 0.03, 0.01])
TRUE = np.column_stack([np.linspace(0.0, 8.0, N), np.sin(np.linspace(0.0, 3.0, N)), np.linspace(0.2, 1.5, N)])


@pytest.fixture
def drawn() -> Trajectory:
    """Draws round means that err as they say, which are turned and moved as a whole."""
    rng = np.random.default_rng(3)
    mean = TRUE + SD * rng.standard_normal(TRUE.shape)
    mean = compose(np.tile([3.0, -2.0, 0.7], (N, 1)), mean)
    draws = SD[[0, 0, 2]] * rng.standard_normal((400, N, 3))
    chain = (np.arange(400) % 4).astype(np.int32)
    return Trajectory(np.arange(N), np.arange(N, dtype=float), mean, draws.astype(np.float32), chain=chain)


def test_errors_are_those_of_the_shape_and_as_large_as_stated(drawn: Trajectory) -> None:
    found = TrueErrors.of(drawn, TRUE, "true.csv").figures()
    assert found["ate_m"] == pytest.approx(np.hypot(*SD[:2]), rel=0.25)
    assert found["rpe_m"] == pytest.approx(np.sqrt(2.0) * np.hypot(*SD[:2]), rel=0.25)
    assert found["rpe_rad"] == pytest.approx(np.sqrt(2.0) * SD[2], rel=0.25)
    assert found["nees"] == pytest.approx(0.8, abs=0.3)


def test_poses_without_a_true_one_are_left_out(drawn: Trajectory) -> None:
    some = np.where(np.isin(np.arange(N), [4, 5, 20])[:, None], np.nan, TRUE)
    found = TrueErrors.of(drawn, some, "true.csv")
    assert (len(found.place), len(found.step), len(found.nees)) == (N - 3, N - 4, N - 6)
    assert not np.isin([4, 5, 20], found.scan).any()
    assert np.isfinite(found.nees).all()


def test_true_poses_are_found_by_time_or_by_order(tmp_path: Path) -> None:
    scan, time, none = np.array([2, 5, 7]), np.array([2.0, 5.0, 7.5]), np.full(3, np.nan)
    timed, plain, few = (tmp_path / name for name in ("timed.csv", "plain.csv", "few.csv"))
    rows = np.column_stack([np.arange(10.0), TRUE[:10]])
    np.savetxt(timed, rows, delimiter=",", header="t,x,y,theta", comments="")
    np.savetxt(plain, rows[:, 1:], delimiter=",", header="x,y,theta", comments="")
    np.savetxt(few, rows[:3, 1:], delimiter=",", header="x,y,theta", comments="")
    np.testing.assert_allclose(true_poses(str(timed), scan, time, 2.0)[:2], TRUE[[2, 5]], atol=1e-9)
    np.testing.assert_allclose(true_poses(str(plain), scan, none, 2.0), TRUE[[2, 5, 7]], atol=1e-9)
    np.testing.assert_allclose(true_poses(str(few), scan, none, 2.0), TRUE[:3], atol=1e-9)
    with pytest.raises(InputError, match="Give one pose a scan"):
        true_poses(str(few), np.arange(4), np.full(4, np.nan), 2.0)


def test_the_report_draws_both_errors_and_escapes_the_name(drawn: Trajectory) -> None:
    section = truth_section(TrueErrors.of(drawn, TRUE, "a<b.csv"))
    assert section.count("<svg") == 2
    assert "a&lt;b.csv" in section
    assert "nan" not in section
    assert truth_section(None) == ""
