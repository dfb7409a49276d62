"""Whether chains agree: rank-normalised split R-hat and bulk effective sample size of every functional.

Source of both: Vehtari, Gelman, Simpson, Carpenter, Buerkner (2021), Rank-normalization, folding and localization;
computed by arviz-stats.
"""

from __future__ import annotations

import importlib
import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

SCHEMA = "prf.diagnostics/1"
MAX_RHAT = 1.05
MIN_ESS = 100.0
MAX_RHAT_UNSEEN = 1.2
"""Of what no reading saw: only the prior informs it, and no ESS is required."""
DRAWS_PER_CHAIN = 500
"""Draws a chain that the estimates look at: all functionals of four chains then cost a few milliseconds each."""
FEWEST_DRAWS = 8
"""A half chain of four draws is the least that a split R-hat is defined for."""

State = Literal["varies", "constant", "stuck", "short", "not finite"]


class Diagnosis(NamedTuple):
    """Convergence of one functional."""

    # rank-normalised split R-hat, the larger of bulk and tail; nan where constant or too short, inf where stuck
    rhat: float
    ess: float  # bulk effective sample size over all chains, in draws; nan where constant or too short, 0 where stuck
    # "varies"; "constant" (one value in all chains); "stuck" (each half chain constant, at different values); "short"
    # (fewer than 8 draws a chain); "not finite" (nan or inf among the draws)
    state: State
    seen: bool = True  # whether it is of what readings saw; False for what they leave to the prior, all or in part

    def agrees(self, rhat: float = MAX_RHAT, ess: float = MIN_ESS) -> bool:
        """Return whether the functional passes: constant, or R-hat below `rhat` and ESS above `ess`.

        Of what no reading saw only R-hat below `MAX_RHAT_UNSEEN` is required.
        """
        rhat, ess = (rhat, ess) if self.seen else (MAX_RHAT_UNSEEN, 0.0)
        return self.state == "constant" or (self.state == "varies" and self.rhat < rhat and self.ess > ess)


@dataclass(frozen=True)
class Verdict:
    """Whether all functionals agree, and the one that is furthest from agreeing; true or false as a bool."""

    converged: bool
    worst: str  # the functional, and what there is to say about it. One of what was seen comes before all others
    reason: str  # the functional, and what there is to say about it. One of what was seen comes before all others
    seen: bool  # whether all functionals of what was seen agree

    def __bool__(self) -> bool:
        """Return whether the chains agree."""
        return self.converged


def diagnose(
    functionals: Mapping[str, NDArray[Any]],
    draws_per_chain: int = DRAWS_PER_CHAIN,
    unseen: Collection[str] = (),
) -> dict[str, Diagnosis]:
    """Return R-hat and ESS of every functional; `functionals` (n_chains, n_draws)."""
    return {
        name: _diagnose_one(name, values, draws_per_chain)._replace(seen=name not in unseen)
        for name, values in functionals.items()
    }


def converged(diagnoses: Mapping[str, Diagnosis], rhat: float = MAX_RHAT, ess: float = MIN_ESS) -> Verdict:
    """Return whether every functional has R-hat < `rhat` and ESS > `ess`, naming the worst one.

    Functionals of what no reading saw have a rule of their own (:meth:`Diagnosis.agrees`), and rank last.
    A functional with one value in all chains agrees. Without any functional nothing is known: not converged.
    """
    if not diagnoses:
        return Verdict(False, "", "no functional was recorded", False)
    worst = max(diagnoses, key=lambda name: _badness(diagnoses[name], rhat, ess))
    found = diagnoses[worst]
    agrees, where = found.agrees(rhat, ess), "" if found.seen else ", of what no reading saw"
    return Verdict(agrees, worst, f"{worst}: {describe(found)}{where}", agrees or not found.seen)


def describe(diagnosis: Diagnosis) -> str:
    """Return one diagnosis in words, such as ``R-hat 1.013, ESS 412`` or ``constant``."""
    words = {
        "constant": "constant",
        "stuck": "stuck at different values",
        "short": f"fewer than {FEWEST_DRAWS} draws a chain",
        "not finite": "nan or inf among the draws",
    }
    return words.get(diagnosis.state, f"R-hat {diagnosis.rhat:.3f}, ESS {diagnosis.ess:.0f}")


def document(diagnoses: Mapping[str, Diagnosis], **extra: Any) -> dict[str, Any]:
    """Return the content of diagnostics.json: schema, verdict, one entry a functional, and `extra` entries as given."""
    verdict = converged(diagnoses)
    return {
        "schema": SCHEMA,
        "converged": verdict.converged,
        "converged_seen": verdict.seen,
        "worst": verdict.worst,
        "reason": verdict.reason,
        "functionals": {name: found._asdict() for name, found in diagnoses.items()},
        **extra,
    }


def acceptance(names: list[str], proposed: NDArray[Any], accepted: NDArray[Any]) -> dict[str, dict[str, int]]:
    """Return ``{move: {"proposed", "accepted"}}`` from counts (n_moves,) or (n_chains, n_moves), summed over chains."""
    proposed = np.atleast_2d(proposed).sum(axis=0)
    accepted = np.atleast_2d(accepted).sum(axis=0)
    return {
        name: {"proposed": int(tried), "accepted": int(taken)}
        for name, tried, taken in zip(names, proposed, accepted, strict=True)
    }


def _diagnose_one(name: str, values: NDArray[Any], draws_per_chain: int) -> Diagnosis:
    chains = np.asarray(values, dtype=np.float64)
    if chains.ndim != 2:
        raise ValueError(f"functional {name}: expected (n_chains, n_draws), got shape {chains.shape}")
    chains = _thin(chains, draws_per_chain)
    if chains.shape[1] < FEWEST_DRAWS or chains.shape[0] == 0:
        return Diagnosis(math.nan, math.nan, "short")
    if not np.isfinite(chains).all():
        return Diagnosis(math.inf, 0.0, "not finite")
    if (chains == chains[0, 0]).all():
        return Diagnosis(math.nan, math.nan, "constant")
    if _halves_constant(chains):
        return Diagnosis(math.inf, 0.0, "stuck")
    return _estimate(chains)


def _thin(chains: NDArray[np.float64], draws_per_chain: int) -> NDArray[np.float64]:
    """Take every k-th draw, counted from the newest."""
    n_draws = chains.shape[1]
    stride = max(1, math.ceil(n_draws / draws_per_chain))
    return chains[:, (n_draws - 1) % stride :: stride] if n_draws else chains


def _halves_constant(chains: NDArray[np.float64]) -> bool:
    """Return whether each half chain has one value: the variance within is 0, and R-hat is infinite."""
    half = chains.shape[1] // 2
    halves = np.vstack((chains[:, :half], chains[:, -half:]))
    return bool((halves == halves[:, :1]).all())


def _estimate(chains: NDArray[np.float64]) -> Diagnosis:
    # Imported here since it brings scipy (one CPU second), by name since it is untyped.
    array_stats: Any = importlib.import_module("arviz_stats.base").array_stats
    several = chains
    if len(chains) == 1:  # arviz-stats wants two chains: one chain is compared with itself in quarters
        half = chains.shape[1] // 2
        several = np.vstack((chains[:, :half], chains[:, -half:]))
    with np.errstate(invalid="ignore", divide="ignore"):  # the folded half of a fair coin is constant
        rhat = float(array_stats.rhat(several, chain_axis=0, draw_axis=1, method="rank"))
        ess = float(array_stats.ess(chains, chain_axis=0, draw_axis=1, method="bulk"))
    return Diagnosis(math.inf if math.isnan(rhat) else rhat, 0.0 if math.isnan(ess) else ess, "varies")


def _badness(found: Diagnosis, rhat: float, ess: float) -> tuple[bool, bool, float]:
    """Order diagnoses: those that fail first, seen before unseen, then by how far they are from their bounds."""
    return not found.agrees(rhat, ess), found.seen, shortfall(found, rhat, ess)


def shortfall(found: Diagnosis, rhat: float = MAX_RHAT, ess: float = MIN_ESS) -> float:
    """Return how far R-hat and ESS are from their bounds, the larger of two ratios: agreement is below 1."""
    if found.state != "varies":
        return 0.0 if found.state == "constant" else math.inf
    if not found.seen:
        return (found.rhat - 1.0) / (MAX_RHAT_UNSEEN - 1.0)
    return max((found.rhat - 1.0) / (rhat - 1.0), ess / max(found.ess, 1e-9))
