"""The law of maps of walls: the chain without readings against rejection, and with a laser by ranks of the truth."""

from __future__ import annotations

import pytest

from tests.statistical.wall_laws import by_chain, by_rejection, other_law, z_scores

pytestmark = pytest.mark.slow

WORST = 4.0
"""Standard errors: of nine numbers one is beyond it by chance once in 1,750 runs."""


def test_the_prior_has_the_law_of_rejection_and_another_law_is_told() -> None:
    chain = by_chain(30_000, 5)
    found = z_scores(chain, by_rejection(10_000, 6))
    assert max(map(abs, found.values())) < WORST, found
    control = z_scores(chain, by_rejection(10_000, 7, other_law()))
    assert max(map(abs, control.values())) > WORST, control
