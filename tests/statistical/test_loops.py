"""The sampler by disagreement loops: it reads maps rightly, and obeys the exact laws of the prior."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from prf.model.arak import exact_draws
from prf.model.coloring import Coloring, Draws, black_at
from prf.model.coloring.polygons import violations
from prf.model.window import Window
from tests.reference import disagreement_loops as loops
from tests.statistical.laws import LawScores, law_scores

SEED = 20261121
WINDOW = Window(0.0, 0.0, 2.0, 1.5)
SCALE = 0.6
PIN = (1.3, 0.4)
N_BATCHES = 60


def some_draws(n: int) -> Draws:
    return exact_draws(SCALE, WINDOW, n, np.random.default_rng(SEED))


def as_sets(coloring: Coloring) -> set[frozenset[tuple[float, float]]]:
    points = [(float(x), float(y)) for x, y in coloring.xy]
    return {frozenset((points[a], points[b])) for a, b in coloring.edges.tolist()}


def relived(coloring: Coloring, births: list[loops.Birth]) -> Coloring:
    drawing = loops.History(coloring.window, SCALE, np.random.default_rng(SEED)).live(births)
    edges = np.array(drawing.edges, np.int32).reshape(-1, 2)
    return Coloring(coloring.window, np.array(drawing.xy).reshape(-1, 2), np.array(drawing.side, np.int8), edges, False)


def test_a_history_that_nothing_disturbs_draws_the_same_map() -> None:
    for draw in some_draws(50):
        assert as_sets(relived(draw, loops.births_of(draw))) == as_sets(draw)


def test_what_a_missing_birth_does_not_reach_stays() -> None:
    for draw in some_draws(30):
        births = loops.births_of(draw)
        if not births:
            continue
        last = max(births, key=lambda birth: birth.at[0])
        births.remove(last)
        found = relived(draw, births)
        assert not violations(found)
        before = {edge for edge in as_sets(draw) if max(x for x, _ in edge) < last.at[0]}
        assert before <= as_sets(found)


def test_numbers_of_births_are_those_of_the_law() -> None:
    """Interior births and those on three sides: Poisson with mean Lambda."""
    counts = np.array([len(loops.births_of(draw)) for draw in some_draws(2000)])
    mean = loops.mean_births(WINDOW, SCALE)
    assert abs(counts.mean() - mean) < 4.0 * math.sqrt(mean / len(counts))
    fresh = [loops.fresh_birth(WINDOW, SCALE, np.random.default_rng([SEED, k])).side for k in range(4000)]
    inside = math.pi * SCALE**2 * WINDOW.area / mean
    assert np.mean(np.array(fresh) == -1) == pytest.approx(inside, abs=0.03)


def test_four_quarters_turn_a_map_back() -> None:
    for draw in some_draws(20):
        for quarters in range(4):
            turned = loops.turned(draw, quarters)
            assert not violations(turned)
            back = loops.turned(turned, 4 - quarters)
            np.testing.assert_allclose(back.xy, draw.xy, atol=1e-12)
            assert back.window == draw.window
            assert np.array_equal(back.side, draw.side)
            assert back.anchor_black == draw.anchor_black


def prior_scores(steps: int, surplus: float = 1.0) -> LawScores:
    rng = np.random.default_rng(SEED)
    chain = loops.sample(Coloring.empty(WINDOW), SCALE, lambda coloring: 0.0, PIN, rng, surplus)
    maps = [coloring for k, coloring in enumerate(itertools.islice(chain, steps)) if k >= 500 and k % 5 == 0]
    assert not any(violations(coloring) for coloring in maps[::50])
    return law_scores(Draws.from_colorings(maps), SCALE, WINDOW, batch=len(maps) // N_BATCHES)


@pytest.mark.slow
def test_loops_obey_the_laws_of_the_prior() -> None:
    # 71 numbers, each beyond 4.5 by chance once in 30,000 (Student, 60 batches).
    scores = prior_scores(8000)
    assert not scores.beyond(4.5), scores.worst()


@pytest.mark.slow
def test_loops_with_too_many_births_do_not() -> None:
    """By a half, in the ratio alone."""
    assert abs(prior_scores(8000, surplus=1.5).worst(1)[0][1]) > 6.0


@pytest.mark.slow
def test_loops_obey_the_laws_of_the_prior_in_a_long_run() -> None:
    scores = prior_scores(200_000)
    print(scores.relative_error_edges, scores.worst())
    assert scores.relative_error_edges < 0.006
    # Once in 75 runs by chance.
    assert not scores.beyond(4.0), scores.worst()


def test_a_pinned_sensor_stays_white() -> None:
    def white(coloring: Coloring) -> float:
        return -math.inf if black_at(coloring, np.array([PIN]))[0] else 0.0

    chain = loops.sample(Coloring.empty(WINDOW), SCALE, white, PIN, np.random.default_rng(SEED))
    maps = list(itertools.islice(chain, 400))
    assert not any(black_at(coloring, np.array([PIN]))[0] for coloring in maps)
    assert len({coloring.n_edges for coloring in maps}) > 5
