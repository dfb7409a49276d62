"""Readings drawn with known parameters give these back, within their standard errors."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from prf.calibrate import Calibrated, calibrate_laser, calibrate_sonar
from prf.calibrate.fit import LIMIT, held_out_loss, penalised
from prf.calibrate.laser import LaserProblem
from prf.calibrate.sonar import model_at
from prf.configuration import Configuration
from prf.score import PolygonMap, ScoreConfig, hold_out_sonar, score
from prf.sensors.sonar import SonarModel
from tests.calibrate.worlds import TRUE_LASER, TRUE_RING, Known, laser_log, sonar_log
from tests.reference.slow_sonar import Ring
from tests.reference.sonar_worlds import model_of

SONAR_TRUTH = np.array(
    [
        TRUE_RING.noise,
        TRUE_RING.relative,
        *TRUE_RING.corner,
        *TRUE_RING.surface,
        TRUE_RING.uniform,
        TRUE_RING.short,
        TRUE_RING.short_length,
    ]
)
LASER_TRUTH = np.array([TRUE_LASER.noise, TRUE_LASER.relative, TRUE_LASER.outlier, TRUE_LASER.miss])


def sonar_fit(known: Known, seed: int = 1) -> Calibrated:
    return calibrate_sonar(known.readings, known.area, Configuration.of(), np.random.default_rng(seed))


def laser_fit(known: Known, seed: int = 1) -> Calibrated:
    return calibrate_laser(known.readings, known.area, Configuration.of(max_range=8.0), np.random.default_rng(seed))


def z_scores(found: Calibrated, truth: np.ndarray) -> np.ndarray:
    z: np.ndarray = (found.fit.value - truth) / found.fit.error
    return z


def scored_loss(known: Known, model: SonarModel) -> float:
    """-log likelihood of all readings in the true map, by the way that scores go."""
    cones = hold_out_sonar(known.readings, ScoreConfig(sonar=model))
    found: dict[str, float] = score(PolygonMap(known.area), None, sonar=cones)
    return found["sonar_nll"] * known.readings.n_beams


def test_a_sonar() -> None:
    """The truth is about as probable as the fit: twice the loss of log likelihood is chi-squared of 11 degrees."""
    known = sonar_log(1, 80)
    found = sonar_fit(known)
    best = scored_loss(known, model_at(found.fit.theta, 3.5))
    assert found.fit.loss == pytest.approx(best, rel=1e-9)
    # False-alarm rate 1e-3. The defaults are far beyond.
    most = 0.5 * stats.chi2.ppf(1.0 - 1e-3, 11)
    assert scored_loss(known, model_of(TRUE_RING)) - best < most
    assert found.fit.loss_before - best > 10.0 * most
    assert found.fit.converged
    assert found.held_out[1] < found.held_out[0]
    assert found.fit.loss < found.no_map
    assert (found.n_readings, found.n_scans, found.folds) == (80 * 16, 80, 5)


def test_a_laser() -> None:
    found = laser_fit(laser_log(2, 40))
    z = z_scores(found, LASER_TRUTH)
    assert np.abs(z).max() < 4.0, dict(zip(found.family.names, z, strict=True))
    assert found.fit.told.all()
    assert found.held_out[1] < found.held_out[0]


def test_readings_of_the_defaults_leave_the_defaults() -> None:
    """The negative control of the recovery: where nothing is to be gained, held-out readings say so."""
    found = sonar_fit(sonar_log(3, 40, Ring()))
    default = found.family.natural(found.family.default)
    assert np.abs(z_scores(found, default)).max() < 4.0
    assert found.held_out[1] == pytest.approx(found.held_out[0], abs=0.02)


def test_errors_shrink_as_readings_grow() -> None:
    few, many = laser_fit(laser_log(4, 8)), laser_fit(laser_log(4, 50))
    ratio = few.fit.error / many.fit.error
    assert (ratio > 1.3).all()
    assert (ratio < 6.0).all()


def test_few_readings_keep_what_they_do_not_tell_at_its_default() -> None:
    """Three scans see hardly a corner: no parameter runs away, and the report says which are the prior's."""
    found = sonar_fit(sonar_log(5, 3))
    assert np.isfinite(found.fit.error).all()
    assert not found.fit.told.all()
    off = (found.fit.theta - found.family.default) / found.family.width
    assert np.abs(off).max() < 3.0 < LIMIT
    model = SonarModel(3.5, **dict(zip(found.family.names, found.fit.value.tolist(), strict=True)))
    assert model.uniform_probability > 0.0


def test_the_fit_is_a_minimum() -> None:
    rng = np.random.default_rng(6)
    distance = np.where(rng.random(500) < 0.2, np.inf, rng.uniform(0.5, 7.0, 500))
    reading = np.where(np.isfinite(distance), np.abs(distance + 0.05 * rng.normal(size=500)), np.inf)
    problem = LaserProblem(np.where(rng.random(500) < 0.1, 8.0 * rng.random(500), reading), distance, 8.0)
    from prf.calibrate import fit

    best = fit(problem)
    least = penalised(problem, best.theta)[0]
    for _ in range(50):
        assert penalised(problem, best.theta + 0.03 * rng.normal(size=4))[0] > least - 1e-6


def test_groups_stay_together_in_a_fold() -> None:
    """Readings of a group with a noise of its own: held out, no fit knows it, so it costs more than in the fit."""
    rng = np.random.default_rng(7)
    group = np.repeat(np.arange(2), 200)
    noise = np.where(group == 0, 0.01, 0.3)
    distance = rng.uniform(1.0, 6.0, 400)
    problem = LaserProblem(distance + noise * rng.normal(size=400), distance, 8.0)
    start = problem.family.default
    apart = held_out_loss(problem, start, group, 2, np.random.default_rng(1))
    mixed = held_out_loss(problem, start, np.arange(400), 2, np.random.default_rng(1))
    assert apart[1] > mixed[1] + 0.3
    assert apart[0] == pytest.approx(mixed[0])


@pytest.mark.slow
def test_scores_over_many_worlds_are_standard_normal() -> None:
    """Mean and spread of z over 25 worlds: errors are neither too small nor too large, and nothing is biased."""
    n = 25
    scores = np.array([z_scores(sonar_fit(sonar_log(100 + seed, 150)), SONAR_TRUTH) for seed in range(n)])
    # Priors pull: each adds a bias of up to error / width in units of the error, so a wider band for the mean.
    assert np.abs(scores.mean(axis=0)).max() < 4.0 / np.sqrt(n) + 0.3, scores.mean(axis=0)
    low, high = stats.chi2.ppf([1e-4, 1.0 - 1e-4], n) / n
    squares = (scores**2).mean(axis=0)
    assert squares.max() < high + 0.3**2, squares
    assert squares.min() > 0.8 * low, squares


@pytest.mark.slow
def test_laser_scores_over_many_worlds_are_standard_normal() -> None:
    n = 40
    scores = np.array([z_scores(laser_fit(laser_log(200 + seed, 40)), LASER_TRUTH) for seed in range(n)])
    assert np.abs(scores.mean(axis=0)).max() < 4.0 / np.sqrt(n) + 0.2, scores.mean(axis=0)
    low, high = stats.chi2.ppf([1e-4, 1.0 - 1e-4], n) / n
    assert (scores**2).mean(axis=0).max() < high + 0.2**2
    assert (scores**2).mean(axis=0).min() > 0.8 * low
