from __future__ import annotations

import numpy as np
import pytest

from prf.shell.cli.seeds import resolve_seed, spawn_generators
from prf.shell.errors import UsageError


def test_a_given_seed_stays_and_an_absent_one_is_drawn() -> None:
    assert resolve_seed(7) == 7
    drawn = {resolve_seed(None) for _ in range(20)}
    assert len(drawn) > 1
    assert all(0 <= seed < 2**32 for seed in drawn)


def test_a_negative_seed_is_a_usage_error() -> None:
    with pytest.raises(UsageError, match="--seed -1"):
        resolve_seed(-1)


def test_more_generators_leave_the_first_ones_as_they_were() -> None:
    few = [rng.random(4) for rng in spawn_generators(5, 2)]
    many = [rng.random(4) for rng in spawn_generators(5, 6)]
    np.testing.assert_array_equal(few, many[:2])
    assert len({tuple(draws) for draws in many}) == 6
