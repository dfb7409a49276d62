"""The log with two readings: what makes it so, and what plain and tempered chains say of it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks import multimodal
from prf.kernels import constants as c
from prf.model.coloring import Draws, black_at
from prf.readings import read_readings
from prf.sampler.target import make_chain

SEED = 1


def log_likelihood(left_shut: bool, right_shut: bool) -> float:
    chain = make_chain(multimodal.posterior(), multimodal.corridor(left_shut, right_shut).coloring())
    return float(chain.graph.sums[c.LOG_LIKELIHOOD])


def test_either_reading_explains_as_much_and_nothing_between_does() -> None:
    left, right = log_likelihood(True, False), log_likelihood(False, True)
    assert left == pytest.approx(right, abs=1e-6)
    assert log_likelihood(False, False) < left - 45.0
    assert log_likelihood(True, True) < left - 45.0


def test_the_log_is_its_own_mirror_image() -> None:
    data = multimodal.both_passes()
    half = len(data.readings.range) // 2
    along = np.stack([np.cos(data.readings.angle), np.sin(data.readings.angle)], axis=1)
    for places in (data.readings.origin, along):
        np.testing.assert_allclose(places[half:], places[:half] * [-1.0, 1.0], atol=1e-12)
    assert np.array_equal(data.readings.range[half:], data.readings.range[:half])
    assert multimodal.WINDOW.x_min == -multimodal.WINDOW.x_max


def test_draws_are_classified_by_the_doors() -> None:
    states = [(True, False), (False, True), (False, False), (True, True)]
    maps = [multimodal.corridor(*doors).coloring() for doors in states]
    draws = Draws.from_colorings(maps, multimodal.WINDOW)
    assert multimodal.readings_of(draws).tolist() == [multimodal.LEFT, multimodal.RIGHT, 0, 0]
    assert not any(black_at(found, multimodal.both_passes().readings.origin).any() for found in maps)
    assert multimodal.changes(np.array([-1, 0, -1, 1, 0, 1, -1])) == 2


def test_the_log_that_is_written_is_the_one_that_is_sampled(tmp_path: Path) -> None:
    path = tmp_path / "doors.csv"
    multimodal.write_log(str(path))
    laser = multimodal.posterior().laser
    assert laser is not None
    found = read_readings(path)
    np.testing.assert_allclose(found.range, laser.readings.range, atol=1e-6)
    np.testing.assert_allclose(found.origin, laser.readings.origin, atol=1e-6)
    assert 100 < len(found.range) < len(multimodal.both_passes().readings.range)


@pytest.mark.slow
def test_plain_chains_are_reported_and_tempered_ones_agree_on_what_is_exact() -> None:
    """After as many steps in all. By the mirror, either reading has the same weight."""
    plain, tempered = (
        multimodal.sampled(temperatures, multimodal.STEPS, SEED).summary
        for temperatures in (1, multimodal.TEMPERATURES)
    )
    print(plain, tempered)
    assert not plain["converged"]
    assert plain["rhat"] > 1.1
    assert sum(plain["changes"]) == 0
    assert tempered["rhat"] < 1.1
    assert min(tempered["round_trips"]) > 10
    assert min(tempered["changes"]) > 10
    left = np.array(tempered["left"])
    assert left.mean() == pytest.approx(0.5 * (1.0 - tempered["neither"]), abs=0.1)
    assert left.min() > 0.2
    assert left.max() < 0.8
