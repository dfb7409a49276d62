"""Exact draws obey every exact law; a naive second simulator agrees; spoilt simulators are caught."""

from __future__ import annotations

import numpy as np
import pytest

from prf.model.arak import exact_draws
from prf.model.coloring import Draws, violations
from prf.model.window import Window
from tests.reference.naive_particles import naive_draws
from tests.statistical.laws import LawScores, law_scores, residuals

SEED = 20050726
UNIT = Window(0.0, 0.0, 1.0, 1.0)
OBLONG = Window(3.0, -1.5, 5.0, -0.5)
ROOM = Window(-5.0, -5.0, 5.0, 5.0)
CASES = [pytest.param(1.0, UNIT, id="unit"), pytest.param(0.5, OBLONG, id="oblong"), pytest.param(0.4, ROOM, id="room")]
FAST = {1.0: 4000, 0.5: 4000, 0.4: 500}
FULL = {1.0: 100_000, 0.5: 100_000, 0.4: 10_000}


def report(scores: LawScores, limit: float) -> str:
    false_alarms = len(scores.z) * {4.0: 6.3e-5, 4.5: 6.8e-6}[limit]
    return f"seed {SEED}, {len(scores.z)} laws, |z| < {limit} fails by chance once in {1 / false_alarms:.0f}: " + str(
        scores.worst()
    )


@pytest.mark.parametrize(("scale", "window"), CASES)
def test_exact_draws_obey_the_laws(scale: float, window: Window) -> None:
    draws = exact_draws(scale, window, FAST[scale], np.random.default_rng(SEED))
    scores = law_scores(draws, scale, window)
    assert not scores.beyond(4.5), report(scores, 4.5)


@pytest.mark.slow
@pytest.mark.parametrize(("scale", "window"), CASES)
def test_many_exact_draws_obey_the_laws(scale: float, window: Window) -> None:
    draws = exact_draws(scale, window, FULL[scale], np.random.default_rng(SEED))
    scores = law_scores(draws, scale, window)
    assert scores.relative_error_edges < 0.004
    assert not scores.beyond(4.0), report(scores, 4.0)


@pytest.mark.slow
def test_a_naive_simulator_obeys_the_laws_too() -> None:
    draws = naive_draws(1.0, UNIT, 20_000, np.random.default_rng(SEED))
    assert not any(violations(draws[i]) for i in range(500))
    scores = law_scores(draws, 1.0, UNIT)
    assert not scores.beyond(4.0), report(scores, 4.0)


@pytest.mark.slow
@pytest.mark.parametrize("wrong", [{"turns": 1.9}, {"sine_border": True}], ids=["turn rate", "border law"])
def test_a_wrong_simulator_is_caught(wrong: dict[str, float]) -> None:
    scores = law_scores(naive_draws(1.0, UNIT, 20_000, np.random.default_rng(SEED), **wrong), 1.0, UNIT)
    assert scores.beyond(6.0), scores.worst()


@pytest.mark.slow
def test_a_wrong_border_law_is_caught_by_few_draws() -> None:
    draws = naive_draws(1.0, UNIT, 3000, np.random.default_rng(SEED), sine_border=True)
    scores = law_scores(draws, 1.0, UNIT)
    assert abs(scores.z["angle to the left side: variance"]) > 6.0


def test_a_wrong_scale_is_caught_by_few_draws() -> None:
    draws = exact_draws(1.1, UNIT, 4000, np.random.default_rng(SEED))
    assert len(law_scores(draws, 1.0, UNIT).beyond(6.0)) >= 5


def test_an_odd_border_is_caught_at_once() -> None:
    draws = exact_draws(1.0, UNIT, 200, np.random.default_rng(SEED))
    side = draws.side.copy()
    side[np.flatnonzero(side >= 0)[0]] = -1
    assert np.all(residuals(draws, 1.0, UNIT)["border vertices: even"] == 0.0)
    spoilt = Draws(UNIT, draws.vertex_offsets, draws.xy, side, draws.edge_offsets, draws.edges, draws.anchor_black)
    assert law_scores(spoilt, 1.0, UNIT).z["border vertices: even"] == np.inf


def test_batches_undo_repeated_draws() -> None:
    draws = exact_draws(1.0, UNIT, 1000, np.random.default_rng(SEED))
    plain = law_scores(draws, 1.0, UNIT)
    chains = np.arange(1000) % 4
    repeated = Draws.from_colorings([draw for draw in draws for _ in range(5)])
    batched = law_scores(repeated, 1.0, UNIT, chain_ids=np.repeat(chains, 5), batch=5)
    fooled = law_scores(repeated, 1.0, UNIT)
    assert batched.relative_error_edges == pytest.approx(plain.relative_error_edges)
    for name, z in plain.z.items():
        if "without edge" not in name:
            assert batched.z[name] == pytest.approx(z, abs=1e-9)
            assert fooled.z[name] == pytest.approx(z * np.sqrt(4999 / 999), rel=1e-6, abs=1e-9)


def test_a_sub_window_of_a_field_is_a_field() -> None:
    """Consistency: colours in a part of a large window follow the same laws (the same line of points, far inside)."""
    from prf.model.coloring import black_at_draws
    from tests.reference.arak_laws import same_colour_probability

    draws = exact_draws(0.5, ROOM, 2000, np.random.default_rng(SEED))
    colours = black_at_draws(draws, [(1.0, 1.0), (1.3, 1.4)])
    same = colours[:, 0] == colours[:, 1]
    expected = same_colour_probability(0.5, 0.5)
    assert abs(same.mean() - expected) < 4.5 * np.sqrt(expected * (1 - expected) / 2000)
