"""R-hat, ESS and the verdict of convergence."""

from __future__ import annotations

import math
import subprocess
import sys

import numpy as np
import pytest

from prf.diagnostics import acceptance, converged, describe, diagnose, document


def chains(seed: int = 1, n_chains: int = 4, n_draws: int = 400) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=(n_chains, n_draws))


def one(values: np.ndarray) -> tuple[float, float, str]:
    found = diagnose({"f": values})["f"]
    return found.rhat, found.ess, found.state


def test_independent_draws_agree() -> None:
    rhat, ess, state = one(chains())
    assert state == "varies"
    assert rhat == pytest.approx(1.0, abs=0.01)
    assert 1200 < ess < 2200
    assert converged({"f": diagnose({"f": chains()})["f"]})


def test_a_shifted_chain_is_found() -> None:
    values = chains()
    values[2] += 1.0
    verdict = converged(diagnose({"good": chains(2), "shifted": values}))
    assert not verdict
    assert verdict.worst == "shifted"
    assert "R-hat" in verdict.reason


def test_a_chain_of_another_spread_is_found() -> None:
    values = chains()
    values[2] *= 10.0
    assert one(values)[0] > 1.05


def test_too_few_effective_draws_are_named() -> None:
    slow = np.cumsum(chains(3, 4, 400), axis=1)
    verdict = converged(diagnose({"fast": chains(), "slow": slow}))
    assert (verdict.converged, verdict.worst) == (False, "slow")


def test_a_constant_agrees_and_is_called_so() -> None:
    found = diagnose({"probe": np.ones((4, 100), dtype=bool)})
    assert math.isnan(found["probe"].rhat)
    assert describe(found["probe"]) == "constant"
    assert converged(found)


def test_chains_stuck_at_different_values_never_agree() -> None:
    stuck = np.repeat([[1.0], [1.0], [0.0], [1.0]], 100, axis=1)
    assert one(stuck) == (math.inf, 0.0, "stuck")
    verdict = converged(diagnose({"probe": stuck, "good": chains()}))
    assert (verdict.converged, verdict.worst) == (False, "probe")
    assert "different values" in verdict.reason


def test_a_step_in_the_middle_of_every_chain_is_stuck_too() -> None:
    assert one(np.repeat([[0.0, 1.0]], 50, axis=1).repeat(4, axis=0))[2] == "stuck"


def test_a_fair_coin_agrees_although_its_folded_half_is_constant() -> None:
    coin = np.random.default_rng(5).permuted(np.tile([0.0, 1.0], (4, 200)), axis=1)
    rhat, _, state = one(coin)
    assert state == "varies"
    assert rhat < 1.05


def test_one_chain_is_compared_with_itself() -> None:
    assert one(chains(1, 1))[0] < 1.05
    assert one(np.linspace(0.0, 1.0, 400)[None, :])[0] > 1.5


@pytest.mark.parametrize("n_draws", [0, 1, 7])
def test_short_chains_do_not_agree(n_draws: int) -> None:
    found = diagnose({"f": chains(1, 4, n_draws)})
    assert found["f"].state == "short"
    assert not converged(found)


@pytest.mark.parametrize("bad", [math.nan, -math.inf])
def test_values_that_are_not_finite_do_not_agree(bad: float) -> None:
    values = chains()
    values[1, 7] = bad
    assert one(values) == (math.inf, 0.0, "not finite")


def test_long_chains_are_thinned_so_that_the_cost_is_bounded() -> None:
    assert one(chains(1, 4, 100_000))[1] < 2400  # of 2,000 draws that are looked at


def test_no_functional_is_not_converged() -> None:
    assert not converged({})


def test_wrong_shape_is_named() -> None:
    with pytest.raises(ValueError, match=r"functional f.*\(3,\)"):
        diagnose({"f": np.zeros(3)})


def test_agrees_with_arviz_on_plain_arrays() -> None:
    from arviz_stats.base import array_stats

    values = chains(4)
    found = diagnose({"f": values})["f"]
    assert found.rhat == array_stats.rhat(values)
    assert found.ess == array_stats.ess(values)


def test_document_and_acceptance() -> None:
    moves = acceptance(["split", "slide"], np.array([[3, 4], [1, 1]]), np.array([[1, 0], [1, 1]]))
    assert moves == {"split": {"proposed": 4, "accepted": 2}, "slide": {"proposed": 5, "accepted": 1}}
    content = document(diagnose({"f": chains()}), acceptance=moves, steps_per_second=1.5)
    assert content["schema"] == "prf.diagnostics/1"
    assert content["converged"] is True
    assert content["worst"] == "f"
    assert set(content["functionals"]["f"]) == {"rhat", "ess", "state", "seen"}
    assert content["steps_per_second"] == 1.5


def test_import_is_light() -> None:
    code = "import sys, prf.diagnostics; sys.exit(any(m in sys.modules for m in ('arviz_stats', 'scipy', 'numba')))"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_unseen_functionals_have_a_looser_rule_and_are_last() -> None:
    slow = chains() + np.array([[0.0], [0.5], [1.0], [0.0]])
    assert 1.05 < one(slow)[0] < 1.2
    found = diagnose({"far": slow, "near": chains(2)}, unseen=["far"])
    assert [each.seen for each in found.values()] == [False, True]
    assert converged(found)
    assert not converged(diagnose({"far": slow, "near": chains(2)}))
    apart = chains() + 10.0 * np.arange(4)[:, None]
    verdict = converged(diagnose({"far": apart, "near": chains(2)}, unseen=["far"]))
    assert (verdict.converged, verdict.seen, verdict.worst) == (False, True, "far")
    assert verdict.reason.endswith("of what no reading saw")
    verdict = converged(diagnose({"far": apart, "near": slow}, unseen=["far"]))
    assert (verdict.converged, verdict.seen, verdict.worst) == (False, False, "near")
