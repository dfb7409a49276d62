"""The likelihood of one beam: a density, and the one that is written down."""

from __future__ import annotations

import dataclasses
import itertools
import math

import numpy as np
import pytest
from scipy import integrate

from prf.kernels.step import run
from prf.model.coloring import Coloring
from prf.model.layout import grow
from prf.model.ranges import laser_array
from prf.model.sensors import LaserModel
from prf.model.window import Window
from prf.sampler.target import Execution, Target, make_chain
from tests.kernels.entries import decide_early, log_likelihoods
from tests.reference.beams import Sensor, density, draw_readings, log_likelihood, mass_from, mass_of_no_return
from tests.reference.worlds import draw_world

SENSORS = [
    pytest.param(Sensor(8.0), id="defaults"),
    pytest.param(Sensor(30.0, 0.02, 0.05, 0.1, 0.0), id="relative noise"),
    pytest.param(Sensor(1.0, 0.5, 0.0, 0.01, 0.3), id="noise half the range"),
    pytest.param(Sensor(80.0, 1e-3, 0.0, 1e-6, 0.02), id="sharp"),
]
SHARES = [0.0, 1e-12, 1e-6, 1e-3, 0.02, 0.3, 0.5, 0.97, 0.999, 1.0 - 1e-9, 1.0, 1.2, math.inf]


def model_of(sensor: Sensor) -> LaserModel:
    return LaserModel(sensor.max, sensor.noise, sensor.relative, sensor.outlier, sensor.miss)


def kernel(sensor: Sensor, readings: np.ndarray, d: float) -> np.ndarray:
    readings = np.atleast_1d(np.asarray(readings, float))
    found = np.empty(len(readings))
    log_likelihoods(laser_array(model_of(sensor)), readings, np.full(len(readings), d), found)
    return found


def integral(sensor: Sensor, d: float) -> float:
    """Integral of the density over the returns, in pieces round the peak."""
    s = sensor.spread(min(d, sensor.max))
    near = [d + k * s for k in (-40, -8, -4, -2, -1, 0, 1, 2, 4, 8, 40)] if d < sensor.max else []
    cuts = [0.0, *(x for x in near if 0.0 < x < sensor.max), sensor.max]
    return sum(
        integrate.quad(lambda r: float(np.exp(kernel(sensor, r, d)[0])), a, np.nextafter(b, 0.0), epsabs=1e-13)[0]
        for a, b in itertools.pairwise(cuts)
    )


@pytest.mark.parametrize("share", SHARES)
@pytest.mark.parametrize("sensor", SENSORS)
def test_the_total_is_one_for_every_distance(sensor: Sensor, share: float) -> None:
    d = share * sensor.max
    assert integral(sensor, d) + math.exp(kernel(sensor, math.inf, d)[0]) == pytest.approx(1.0, abs=1e-9)


@pytest.mark.parametrize("share", SHARES)
@pytest.mark.parametrize("sensor", SENSORS)
def test_it_is_the_written_one(sensor: Sensor, share: float) -> None:
    d = share * sensor.max
    s = sensor.spread(min(d, sensor.max))
    rng = np.random.default_rng(1)
    near = [] if math.isinf(d) else d + s * np.concatenate([rng.normal(size=40), [-39.0, -38.6, 38.6, 39.0]])
    readings = np.concatenate([rng.uniform(0.0, sensor.max, 40), near, [0.0, np.nextafter(sensor.max, 0.0)]])
    readings = readings[(readings >= 0.0) & (readings < sensor.max)]
    assert kernel(sensor, readings, d) == pytest.approx(np.log(density(sensor, readings, d)), rel=1e-10, abs=1e-10)
    silent = np.array([sensor.max, 2.0 * sensor.max, math.inf])
    with np.errstate(divide="ignore"):
        expected = np.log(mass_of_no_return(sensor, d))
    assert kernel(sensor, silent, d) == pytest.approx(expected, rel=1e-10, abs=1e-12)


@pytest.mark.parametrize("share", SHARES)
@pytest.mark.parametrize("sensor", SENSORS)
def test_a_censored_reading_has_the_mass_from_its_bound_on(sensor: Sensor, share: float) -> None:
    bounds = sensor.max * np.array([1e-3, 0.3, 0.5, 0.97, 1.0])
    found = kernel(sensor, -bounds, share * sensor.max)
    with np.errstate(divide="ignore"):
        expected = np.log([mass_from(sensor, bound, share * sensor.max) for bound in bounds.tolist()])
    assert found == pytest.approx(expected, rel=1e-10, abs=1e-12)


@pytest.mark.parametrize("sensor", SENSORS)
def test_a_reading_is_never_impossible(sensor: Sensor) -> None:
    """Even far from every obstacle, at the very start and the very end of the range."""
    rng = np.random.default_rng(2)
    for d in [*rng.uniform(0.0, sensor.max, 50), math.inf, 0.0, 1e-300]:
        found = kernel(sensor, np.concatenate([rng.uniform(0.0, sensor.max, 50), [0.0, math.inf]]), d)
        returns, silence = found[:-1], found[-1]
        assert np.isfinite(returns).all()
        assert returns.min() >= math.log(sensor.outlier / sensor.max) - 1e-12
        assert silence >= math.log(sensor.miss) if sensor.miss > 0 else silence < 0.0


def test_the_reference_draws_what_its_density_says() -> None:
    """The simulated readings of the calibration test come from the density that this file integrates."""
    sensor, d, n = Sensor(4.0, 0.3, 0.01, 0.1, 0.05), 0.4, 200_000
    readings = draw_readings(sensor, np.full(n, d), np.random.default_rng(3))
    cuts = np.array([0.0, 0.1, 0.3, 0.5, 0.8, 1.5, 4.0])
    counts = np.histogram(readings[np.isfinite(readings)], cuts)[0]
    expected = [
        integrate.quad(lambda r: float(density(sensor, np.array(r), d)), a, b)[0] for a, b in itertools.pairwise(cuts)
    ]
    expected.append(mass_of_no_return(sensor, d))
    observed = np.append(counts, np.isinf(readings).sum()) / n
    assert sum(expected) == pytest.approx(1.0)
    z = (observed - expected) / np.sqrt(np.array(expected) * (1.0 - np.array(expected)) / n)
    assert np.abs(z).max() < 4.5, z
    assert log_likelihood(sensor, math.inf, d) == pytest.approx(math.log(expected[-1]))


# Early rejection decides as the sum over all touched beams does.


ROOM = Window(0.0, 0.0, 10.0, 10.0)
MODELS = [LaserModel(6.0), LaserModel(6.0, noise=0.1, noise_relative=0.05), LaserModel(6.0, noise=1.0)]


@pytest.mark.slow  # its entry takes a minute to compile
@pytest.mark.parametrize("model", MODELS)
def test_early_decisions_are_the_same(model: LaserModel) -> None:
    rng = np.random.default_rng(4)
    data = dataclasses.replace(draw_world(0.3, ROOM, Sensor(6.0), 4, 60, rng).data, model=model)
    chain = make_chain(Target(ROOM, 0.3, data, execution=Execution(cell=0.7)), Coloring.empty(ROOM))
    counts = np.zeros(4, np.int64)
    for steps in range(2_000, 40_001, 2_000):
        while not run(chain, rng, steps):
            chain = grow(chain)
        decide_early(chain, rng, 500, counts)
    assert counts[0] == 0
    assert counts[1] > 100
    assert counts[2] > 100
    assert counts[3] > 1000
