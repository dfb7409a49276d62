"""Readings in another order, place, direction or unit: the same posterior, where arithmetic allows the same draws."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from prf.sampler.posterior import LaserData
from tests.sampler.frames import first, maps_of, means_of, mirrored, reordered, scaled, shifted, turned

FALSE_ALARM = 1e-3
"""Of the whole family of comparisons below."""
N_CHAINS, N_STEPS = 16, 600_000
"""Half of the steps are left out: after a hundred thousand maps still have too many edges."""


@pytest.mark.parametrize("seed", [0, 1])
def test_beams_in_another_order_give_the_same_maps_to_the_last_bit(seed):
    case = first()
    for (one, sums), (other, others) in zip(maps_of(case, 3), maps_of(reordered(case, seed), 3), strict=True):
        np.testing.assert_array_equal(one.xy, other.xy)
        np.testing.assert_array_equal(one.edges, other.edges)
        np.testing.assert_allclose(sums, others, rtol=1e-12, atol=1e-9)


@pytest.mark.parametrize(
    ("shift", "metres"), [((1024.0, 2048.0), 1e-9), ((100.3, -77.7), 1e-9), ((500_000.0, 5_000_000.0), 1e-6)]
)
def test_a_log_at_another_place_gives_the_same_maps_there(shift, metres):
    case = first()
    for (one, sums), (other, others) in zip(maps_of(case, 3), maps_of(shifted(case, *shift), 3), strict=True):
        np.testing.assert_array_equal(one.edges, other.edges)
        np.testing.assert_allclose(other.xy - np.array(shift), one.xy, rtol=0, atol=metres)
        np.testing.assert_allclose(sums, others, rtol=0, atol=1e-3)


def test_a_log_that_differs_gives_other_maps():
    case = first()
    data = case.settings.laser
    other = replace(
        case.settings,
        laser=LaserData.from_arrays(data.readings.origin, data.readings.angle, data.readings.range + 1e-3, data.model),
    )
    assert not np.array_equal(maps_of(case, 1)[0][0].xy, maps_of(case._replace(settings=other), 1)[0][0].xy)


@pytest.fixture(scope="module")
def known():
    return means_of(first(), N_CHAINS, N_STEPS)


def longer(case):
    """Return a case whose readings are all 2 per cent longer: not the same posterior."""
    data = case.settings.laser
    laser = LaserData.from_arrays(data.readings.origin, data.readings.angle, 1.02 * data.readings.range, data.model)
    return case._replace(settings=replace(case.settings, laser=laser))


def staged(case):
    """Return a case whose beams are asked in three stages, in another order."""
    return reordered(case._replace(settings=replace(case.settings, levels=3)))


WAYS = {
    "turned": turned,
    "mirrored": mirrored,
    "twice as long": lambda case: scaled(case, 2.0),
    "in feet": lambda case: scaled(case, 1.0 / 0.3048),
    "in stages": staged,
}


def least_p(one, other):
    """Return the least p-value of Welch's tests of all means, times how many are made in the family."""
    spread = np.maximum(one.std(axis=0), other.std(axis=0)) > 1e-9
    p = stats.ttest_ind(one[:, spread], other[:, spread], equal_var=False).pvalue
    constant = np.abs(one - other)[:, ~spread].max(initial=0.0)
    return float(p.min()) * one.shape[1] * len(WAYS) if constant < 1e-9 else 0.0


@pytest.mark.slow
@pytest.mark.parametrize("way", list(WAYS))
def test_the_posterior_is_the_same_in_another_frame_or_unit(way, known):
    p = least_p(known, means_of(WAYS[way](first()), N_CHAINS, N_STEPS))
    assert p > FALSE_ALARM, f"{way}: p {p:.2g}, false alarms {FALSE_ALARM}"


@pytest.mark.slow
def test_another_posterior_is_seen(known):
    assert least_p(known, means_of(longer(first()), N_CHAINS, N_STEPS)) < FALSE_ALARM
