"""The laser's parameters as tables, bounds and aims, and its beams laid out, each on few readings."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import special

from prf.kernels import constants as c
from prf.kernels.readings.beams import Beams
from prf.kernels.readings.laser_change import FADED
from prf.kernels.state.grid import Grid
from prf.model.ranges import (
    MARGIN,
    aims_of,
    best_log_density,
    deal_levels,
    laser_array,
    make_beams,
    make_rays,
    number_of_levels,
)
from prf.model.sensors import LaserModel
from prf.model.window import Window
from tests.kernels.entries import log_likelihoods
from tests.reference.beams import Sensor, log_likelihood, normal

SENSORS = [
    pytest.param(Sensor(8.0), id="defaults"),
    pytest.param(Sensor(30.0, 0.05, 0.02, 0.1, 0.03), id="relative noise"),
    pytest.param(Sensor(80.0, 0.002, 0.0, 1e-6, 0.0), id="sharp"),
    pytest.param(Sensor(6.0, 2.0, 0.0, 0.9, 0.02), id="wide"),
    pytest.param(Sensor(80.0, 0.002, 0.0499, 1e-100, 0.02), id="outliers next to never"),
]
WINDOW = Window(0.0, 0.0, 3.0, 2.0)
GRID = Grid(0.0, 0.0, 1.0, 3, 2)


def model_of(sensor: Sensor) -> LaserModel:
    return LaserModel(sensor.max, sensor.noise, sensor.relative, sensor.outlier, sensor.miss)


def test_defaults_are_those_of_the_contract() -> None:
    assert LaserModel(8.0) == model_of(Sensor(8.0))


@pytest.mark.parametrize("sensor", SENSORS)
def test_the_table_gives_the_density(sensor: Sensor) -> None:
    """At up to 20 deviations: past some nine or ten the kernel takes the outliers alone."""
    rng = np.random.default_rng(3)
    distance = np.concatenate([rng.uniform(0.01, 1.2 * sensor.max, 30), [np.inf, 0.3 * sensor.max]])
    spread = np.maximum(sensor.noise, sensor.relative * np.minimum(distance, sensor.max))
    near = np.where(np.isfinite(distance), distance, 0.0) + np.linspace(-20.0, 20.0, 32) * spread
    reading = np.where(near < sensor.max, np.abs(near), np.inf)
    found = np.zeros(len(reading))
    log_likelihoods(laser_array(model_of(sensor)), reading, distance, found)
    expected = [log_likelihood(sensor, r, d) for r, d in zip(reading.tolist(), distance.tolist(), strict=True)]
    assert found == pytest.approx(expected, rel=1e-10, abs=1e-10)


@pytest.mark.parametrize("share", [FADED, 0.3])
@pytest.mark.parametrize("sensor", SENSORS[:3])
def test_hits_fade_at_their_deviation(sensor: Sensor, share: float) -> None:
    """Doubled, as by what is cut off below 0, the Gaussian is there the share of the uniform density."""
    z = np.array(model_of(sensor).deviation_where_hits_are(share))
    there = 2.0 * sensor.hit * float(normal(z, 0.0, 1.0)) / sensor.noise
    assert there == pytest.approx(share * sensor.outlier / sensor.max)


@pytest.mark.parametrize("sensor", SENSORS)
def test_the_best_of_a_reading_is_just_above_what_any_distance_gives(sensor: Sensor) -> None:
    """But for the doubling near 0, where not the whole of it may be there, and what the noise's growth gives."""
    deviations = np.array([0.1, 0.5, 2.0, 19.0, 21.0, 30.0, 39.0])
    readings = np.concatenate([deviations * sensor.noise, np.array([0.2, 0.5, 0.9]) * sensor.max])
    readings = readings[readings < sensor.max]
    wide = sensor.max < 20.0 * sensor.spread(sensor.max)
    for r, best in zip(readings, best_log_density(model_of(sensor), readings), strict=True):
        around = r + np.linspace(-1.0, 1.0, 801) * sensor.spread(r)
        d = np.concatenate([around[around > 0.0], np.geomspace(1e-3, 1.0, 200) * r, [r]])
        s = np.maximum(sensor.noise, sensor.relative * d)
        highest = float(np.log(sensor.outlier / sensor.max + sensor.hit * normal(r, d, s) / special.ndtr(d / s)).max())
        slack = math.log(2.0) if wide or r < 20.0 * sensor.spread(r) else 0.0
        assert highest < best <= highest + slack + sensor.relative**2 + 1e-6
    (silent,) = best_log_density(model_of(sensor), np.array([np.inf]))
    assert math.log(sensor.miss + sensor.hit) < silent < math.log(sensor.miss + sensor.hit) + 1e-8


@pytest.mark.parametrize("sensor", [*SENSORS[:3], SENSORS[4]])
def test_an_aim_ends_where_hits_fade(sensor: Sensor) -> None:
    model, readings = model_of(sensor), np.array([0.02, 0.5, 7.0])
    z = model.deviation_where_hits_are(FADED)
    near, far = aims_of(model, readings, np.ones(len(readings)))
    assert (readings - near) / np.maximum(sensor.noise, sensor.relative * near) == pytest.approx(np.full(3, z))
    if z * sensor.relative < 1.0:
        assert (far - readings) / np.maximum(sensor.noise, sensor.relative * far) == pytest.approx(np.full(3, z))
    else:
        assert np.isinf(far).all()
    assert np.isinf(aims_of(model, np.array([np.inf]), np.ones(1))).all()


def test_wide_noise_is_aimed_everywhere() -> None:
    near, far = aims_of(LaserModel(6.0, noise=2.0), np.array([1.0, 5.0]), np.ones(2))
    assert (near.tolist(), far.tolist()) == ([-math.inf] * 2, [math.inf] * 2)


@pytest.mark.parametrize(("n", "n_levels"), [(0, 1), (19_999, 1), (20_000, 2), (79_999, 2), (80_000, 3)])
def test_beams_enough_for_further_levels(n: int, n_levels: int) -> None:
    assert number_of_levels(n) == n_levels


def test_a_fourth_of_the_beams_is_tested_before_the_rest() -> None:
    level = deal_levels(1001, 3)
    assert np.bincount(level).tolist() == [63, 251 - 63, 1001 - 251]
    assert np.bincount(level[:500], minlength=3).min() > 10, "at random among all"
    assert deal_levels(7, 1).tolist() == [0] * 7


READINGS = np.array([1.0, 2.5, np.inf, 0.4])


def beams(n_levels: int | None = None, readings: np.ndarray = READINGS) -> Beams:
    """Four beams through two rows of three cells, from the middles of the outer ones."""
    origin = np.array([[0.5, 0.5], [0.5, 0.5], [2.5, 1.5], [2.5, 1.5]])
    ray = make_rays(WINDOW, LaserModel(8.0), origin, np.array([0.0, 0.5, 1.0, 1.5]) * np.pi, readings)
    leaves = np.array([2.5, 1.5, 2.5, 1.5])
    assert ray[:, c.RANGE].tolist() == np.where(readings < leaves, readings, -leaves).tolist()
    assert not ray[:, c.BEAM_LOG_LIKELIHOOD].any()
    return make_beams(GRID, LaserModel(8.0), ray, np.ones(len(ray)), 10, n_levels)


def test_slots_are_the_cells_in_their_order() -> None:
    found = beams()
    assert found.slot_start.tolist() == [0, 3, 5, 8, 10]
    assert found.slot_cell.tolist() == [0, 1, 2, 0, 3, 5, 4, 3, 5, 2]
    assert found.slot_exit == pytest.approx(np.array([0.5, 1.5, 2.5, 0.5, 1.5, 0.5, 1.5, 2.5, 0.5, 1.5]), abs=1e-5)
    assert found.cell_start.tolist() == [0, 2, 3, 5, 7, 8, 10]


@pytest.mark.parametrize("n_levels", [1, 2, 3])
def test_each_level_has_lists_of_its_own(n_levels: int) -> None:
    found, n_lists = beams(n_levels), n_levels * GRID.nx * GRID.ny
    beam = np.repeat(np.arange(4), np.diff(found.slot_start))
    assert (found.slot_cell // 6).tolist() == found.level[beam].tolist()
    assert np.diff(found.cell_start).tolist() == np.bincount(found.slot_cell, minlength=n_lists).tolist()
    assert found.first_beam.shape == found.edge_shortfall.shape == (10, n_levels)
    assert found.cell_count.shape == found.cell_shortfall.shape == (n_lists,)


def test_an_aim_reaches_into_the_cells_within_its_margin() -> None:
    """Readings half a margin farther from a border of cells than the aim reaches, and 1.5 margins."""
    z = LaserModel(8.0).deviation_where_hits_are(FADED)
    reach, hair = z * 0.03, 0.5 * MARGIN
    before = beams(readings=np.array([1.5 + reach + hair, 1.0, np.inf, 0.25]))
    assert before.aim[[0, 3]].tolist() == [[1, 3], [8, 9]]
    assert before.aim[2, 0] == before.aim[2, 1]
    assert beams(readings=np.array([1.5 + reach + 3.0 * hair, 1.0, 1.0, 1.0])).aim[0].tolist() == [2, 3]
    assert beams(readings=np.array([1.5 - reach - hair, 1.0, 1.0, 1.0])).aim[0].tolist() == [1, 3]
    assert beams(readings=np.array([1.5 - reach - 3.0 * hair, 1.0, 1.0, 1.0])).aim[0].tolist() == [1, 2]
