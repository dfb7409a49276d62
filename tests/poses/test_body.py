"""Poses of runs that were let go of: what is known of their motion as one body, and how it is kept."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from prf.model.window import Window
from prf.poses.body import BODY, apart, body_of, joined
from prf.poses.model import PosePrior
from prf.poses.plane import compose, seen_from
from prf.poses.posterior import Trajectory
from prf.results.read import read_trajectory
from prf.results.write import write_trajectory
from prf.shell.cli.storage import load_arrays
from prf.shell.errors import InputError
from tests.factories import make_beams

N = 6


def trajectory(seed: int = 1) -> Trajectory:
    """Poses that err by more or less each."""
    rng = np.random.default_rng(seed)
    given = rng.uniform([0.0, 0.0, -3.0], [8.0, 5.0, 3.0], (N, 3))
    prior = PosePrior(given, rng.uniform(0.01, 0.1, (N, 2)), np.zeros((0, 3)), np.zeros((0, 3)))
    draws = rng.normal(0.0, 0.02, (40, N, 3)).astype(np.float32)
    owner = np.repeat(np.arange(N, dtype=np.int32), 3)
    return Trajectory(np.arange(N), np.arange(N) * 1.0, given, draws, owner, prior=prior)


def moved(found: Trajectory, motion: np.ndarray) -> np.ndarray:
    """Given poses (n, 3) as they are when the body has moved."""
    body = body_of(found)
    return compose(body.given + motion, seen_from(body.given, found.given))


def test_its_law_is_that_of_the_errors_that_all_poses_have_together() -> None:
    found = trajectory()
    body = body_of(found)
    assert body.prior is not None
    assert found.prior is not None
    step = 1e-3
    for axis, sd in enumerate(body.prior.noise[0, [0, 0, 1]]):
        off = step * np.eye(3)[axis]
        log_density = found.prior.log_density(moved(found, off))
        assert -2.0 * log_density / step**2 == pytest.approx(1.0 / sd**2, rel=1e-4)
        for other in range(axis):
            both = found.prior.log_density(moved(found, off + step * np.eye(3)[other]))
            alone = found.prior.log_density(moved(found, step * np.eye(3)[other]))
            assert both == pytest.approx(log_density + alone, rel=1e-4)


def test_it_moves_as_all_poses_do_together() -> None:
    found = trajectory()
    motion = np.random.default_rng(2).normal(0.0, 1e-3, (40, 3))
    off = np.array([moved(found, each) - found.given for each in motion])
    whole = dataclasses.replace(found, draws=off.astype(np.float32))
    np.testing.assert_allclose(body_of(whole).draws[:, 0], motion, atol=1e-6)


def with_body() -> Trajectory:
    found = trajectory()
    owner = found.laser
    assert owner is not None
    return dataclasses.replace(found, laser=np.append(owner, BODY).astype(np.int32), body=body_of(trajectory(2)))


def test_it_is_one_more_pose_of_a_run_that_goes_on() -> None:
    """A run let go of twice has one body, which errs no more than the poses of both together."""
    found = with_body()
    whole = joined(found)
    assert whole.scan.tolist() == [BODY, *range(N)]
    assert whole.laser is not None
    assert whole.laser.min() == 0
    again = apart(whole)
    assert again.body is not None
    for one, other in ((again, found), (again.body, found.body)):
        for name in ("scan", "given", "draws"):
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
    np.testing.assert_array_equal(again.laser, found.laser)
    twice = body_of(found).prior
    first, second = (body_of(trajectory(seed)).prior for seed in (1, 2))
    assert first is not None
    assert second is not None
    assert twice is not None
    assert twice.noise[0, 0] ** -2 == pytest.approx(first.noise[0, 0] ** -2 + second.noise[0, 0] ** -2)
    assert apart(trajectory()).body is None


def test_readings_of_it_are_placed_at_its_mean() -> None:
    found = with_body()
    assert found.body is not None
    readings = make_beams(Window(0.0, 0.0, 8.0, 6.0))
    own = found.moved(readings, np.full(readings.n_beams, BODY, np.int32))
    given = np.column_stack([readings.origin, readings.angle])
    expected = compose(found.body.mean, seen_from(found.body.given, given))
    np.testing.assert_allclose(own.origin, expected[:, :2])


def test_it_is_read_as_it_was_written(tmp_path: Path) -> None:
    found = with_body()
    alike = dataclasses.replace(found, prior=found.prior._replace(noise=np.full((N, 2), 0.1)))  # type: ignore[union-attr]
    write_trajectory(tmp_path, alike)
    again = read_trajectory(tmp_path / "poses.npz")
    assert again.body is not None
    assert found.body is not None
    np.testing.assert_array_equal(again.laser, found.laser)
    np.testing.assert_array_equal(again.body.given, found.body.given)
    np.testing.assert_array_equal(again.body.prior.noise, found.body.prior.noise)  # type: ignore[union-attr]
    np.testing.assert_array_equal(again.body.draws, found.body.draws)
    arrays = load_arrays(tmp_path / "poses.npz", "prf.poses/1")
    for name, value in (("body_noise", np.zeros(2)), ("body_given", np.full(3, np.nan)), ("pose_of_laser", None)):
        spoiled = {**arrays, name: arrays[name] - 1 if value is None else value}
        np.savez(tmp_path / "poses.npz", schema="prf.poses/1", **{k: v for k, v in spoiled.items() if k != "schema"})
        with pytest.raises(InputError):
            read_trajectory(tmp_path / "poses.npz")
