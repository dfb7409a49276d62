"""Exact draws obey every exact law, and spoilt simulators are caught."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from prf.kernels import constants as c
from prf.kernels.state.build import recompute_sums
from prf.kernels.step import run
from prf.model.arak import exact_draws
from prf.model.coloring import Coloring, Draws, violations
from prf.model.layout import grow, make_targets
from prf.model.window import Window
from prf.sampler import mcmc_draws
from prf.sampler.target import Target, Tuning, make_chain
from tests.statistical import mutants
from tests.statistical.laws import LawScores, law_scores, residuals
from tests.statistical.means import largest

SEED = 20050726
UNIT = Window(0.0, 0.0, 1.0, 1.0)
OBLONG = Window(3.0, -1.5, 5.0, -0.5)
ROOM = Window(-5.0, -5.0, 5.0, 5.0)
CASES = [pytest.param(1.0, UNIT, id="unit"), pytest.param(0.5, OBLONG, id="oblong"), pytest.param(0.4, ROOM, id="room")]
EXACT = ("tests.statistical.prior_chain", "exact")
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
@pytest.mark.parametrize("mutant", [mutants.RARE_TURNS, mutants.SINE_BORDER], ids=["turn rate", "border law"])
def test_a_wrong_simulator_is_caught(mutant: mutants.Mutant, tmp_path: Path) -> None:
    found = mutants.run_check(tmp_path, mutant, *EXACT, "20000", str(SEED), compiled=True)
    assert largest(found["z"])[1] > 6.0, largest(found["z"])


@pytest.mark.slow
def test_a_wrong_border_law_is_caught_by_few_draws(tmp_path: Path) -> None:
    found = mutants.run_check(tmp_path, mutants.SINE_BORDER, *EXACT, "3000", str(SEED), compiled=True)
    assert abs(found["z"]["angle to the left side: variance"]) > 6.0


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


# Draws of the Markov chain obey every exact law of the prior, and births balance deaths in every pair of moves.


N_CHAINS = 4
MCMC_FAST = {1.0: (600, 20), 0.5: (600, 20)}
MCMC_FULL = {1.0: (9000, 40), 0.5: (12_000, 40), 0.4: (3000, 100)}
"""Draws of each chain at the spacing that the sampler chooses, and how many make a batch.

The autocorrelation time of the number of edges is 2 to 8 draws, that of the black share of the room about 20.
"""
PAIRS = {
    "triangle": (c.TRIANGLE_BIRTH, c.TRIANGLE_DEATH),
    "boundary triangle": (c.BOUNDARY_BIRTH, c.BOUNDARY_DEATH),
    "corner cut": (c.CORNER_BIRTH, c.CORNER_DEATH),
    "split": (c.SPLIT, c.MERGE),
}
"""The others change walls too rarely without readings: they have a test of their own."""
WALLS = {
    "cut": (c.CUT_WALL, c.MEND_WALL),
    "joined": (c.JOIN_WALL, c.PART_WALL),
    "docked": (c.DOCK, c.UNDOCK),
    "notched": (c.NOTCH, c.FILL),
}


def scores_of_chains(scale: float, window: Window, n_draws: int, batch: int) -> tuple[LawScores, Draws]:
    """Chains of different seeds in two threads; the scores do not depend on the threads."""
    with ThreadPoolExecutor(2) as pool:
        chains = list(pool.map(lambda k: mcmc_draws(scale, window, n_draws, seed=SEED + k)[0], range(N_CHAINS)))
    draws = Draws.from_colorings([draw for chain in chains for draw in chain])
    ids = np.repeat(np.arange(N_CHAINS), n_draws)
    return law_scores(draws, scale, window, chain_ids=ids, batch=batch), draws


def chain_report(scores: LawScores, limit: float, n_batches: int) -> str:
    false_alarms = len(scores.z) * 2.0 * stats.t.sf(limit, n_batches - 1)
    return (
        f"seed {SEED}, {len(scores.z)} laws in {n_batches} batches, |z| < {limit} fails by chance once in "
        f"{1 / false_alarms:.0f}; n_edges to {100 * scores.relative_error_edges:.2f} %: {scores.worst()}"
    )


@pytest.mark.parametrize(("scale", "window"), CASES[:2])
def test_the_chain_obeys_the_laws(scale: float, window: Window) -> None:
    n_draws, batch = MCMC_FAST[scale]
    scores, draws = scores_of_chains(scale, window, n_draws, batch)
    assert not any(violations(draws[i]) for i in range(0, len(draws), len(draws) // 50))
    assert not scores.beyond(4.5), chain_report(scores, 4.5, N_CHAINS * n_draws // batch)


@pytest.mark.slow
@pytest.mark.parametrize(("scale", "window"), CASES)
def test_long_chains_obey_the_laws(scale: float, window: Window) -> None:
    n_draws, batch = MCMC_FULL[scale]
    scores, _ = scores_of_chains(scale, window, n_draws, batch)
    summary = chain_report(scores, 4.0, N_CHAINS * n_draws // batch)
    print(summary)
    assert scores.relative_error_edges < 0.004
    assert not scores.beyond(4.0), summary


def surplus_of_births(scale: float, window: Window, n_batches: int, length: int, seed: int) -> np.ndarray:
    """Accepted births less accepted deaths (n_batches, n_pairs) in batches of `length` steps, after a burn-in."""
    chain = make_chain(Target(window, scale), Coloring.empty(window))
    rng = np.random.default_rng(seed)
    accepted = []
    for batch in range(n_batches + 1):
        until = 200_000 + batch * length
        while not run(chain, rng, until):
            chain = grow(chain)
        recompute_sums(chain)
        accepted.append(chain.outcomes[:, c.ACCEPTED].copy())
    births, deaths = (np.array(accepted)[:, [pair[k] for pair in PAIRS.values()]] for k in range(2))
    return np.diff(births - deaths, axis=0)


@pytest.mark.parametrize(("scale", "window"), CASES)
def test_births_are_as_frequent_as_deaths(scale: float, window: Window) -> None:
    """Detailed balance without any law: each pair of moves balances by itself, though others make and break loops."""
    surplus = surplus_of_births(scale, window, 100, 10_000, SEED)
    error = surplus.std(axis=0, ddof=1) / np.sqrt(len(surplus))
    z = surplus.mean(axis=0) / error
    assert (error > 0).all()
    assert np.abs(z).max() < 4.5, f"seed {SEED}, |z| < 4.5 fails by chance once in 36,000: {z}"


@pytest.mark.slow
@pytest.mark.parametrize(("scale", "window"), CASES)
def test_births_are_as_frequent_as_deaths_in_a_long_run(scale: float, window: Window) -> None:
    with ThreadPoolExecutor(2) as pool:
        parts = list(pool.map(lambda k: surplus_of_births(scale, window, 200, 50_000, SEED + k), range(2)))
    surplus = np.concatenate(parts)
    z = surplus.mean(axis=0) / (surplus.std(axis=0, ddof=1) / np.sqrt(len(surplus)))
    print(f"seed {SEED}: {dict(zip(PAIRS, z.round(2).tolist(), strict=True))}")
    assert np.abs(z).max() < 4.0, z


def balance_of_walls(which: str, n_batches: int, length: int, seed: int) -> tuple[float, int]:
    """z-score of what one move does less what the other undoes, each a quarter of all proposals, and their number."""
    chain = make_chain(Target(UNIT, 1.0, tuning=Tuning(cut_reach=0.05, join_reach=0.1)), Coloring.empty(UNIT))
    points = np.random.default_rng(seed).random((60, 2))
    chain = chain._replace(targets=make_targets(UNIT, 0.05, points))
    chain.tuning[c.AIMED_SHARE] = 0.6
    walls = list(WALLS[which])
    chain.move_probabilities[walls] = 0.0
    chain.move_probabilities[:] *= 0.5 / chain.move_probabilities.sum()
    chain.move_probabilities[walls] = 0.25
    rng = np.random.default_rng(seed)
    accepted = []
    for batch in range(n_batches + 1):
        while not run(chain, rng, 200_000 + batch * length):
            chain = grow(chain)
        recompute_sums(chain)
        accepted.append(chain.outcomes[walls, c.ACCEPTED].copy())
    cuts, mends = np.diff(accepted, axis=0).T
    surplus = cuts - mends
    return float(surplus.mean() / (surplus.std(ddof=1) / np.sqrt(n_batches))), int(cuts.sum() + mends.sum())


@pytest.mark.parametrize("which", WALLS)
def test_what_is_done_to_walls_is_undone_as_often(which: str) -> None:
    z, n = balance_of_walls(which, 100, 40_000 if which == "cut" else 10_000, SEED)
    assert n > 300
    assert abs(z) < 4.5, f"seed {SEED}, {n} walls, |z| < 4.5 fails by chance once in 50,000: {z}"


@pytest.mark.slow
@pytest.mark.parametrize("which", WALLS)
def test_what_is_done_to_walls_is_undone_as_often_in_a_long_run(which: str) -> None:
    with ThreadPoolExecutor(2) as pool:
        found = list(pool.map(lambda k: balance_of_walls(which, 200, 200_000, SEED + k), range(2)))
    print(f"seed {SEED}: z and number of walls {which} or the reverse {found}")
    assert all(n > 3000 for _, n in found)
    assert all(abs(z) < 4.0 for z, _ in found), found
