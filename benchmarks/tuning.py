"""What the tuning of the proposals buys: acceptance, and effective sample size per CPU second, setting by setting.

Run it from the repository's root (a few minutes; more steps make steadier figures)::

    python -m benchmarks.tuning [--steps N] [--only WORD ...]

All chains start from one burnt-in map of the demo office and take turns on the core. Settings are given as multiples
of the defaults. The effective sample size of a chain of a few million steps is uncertain by a quarter or so; the
jump rate is a steadier witness of how fast a functional forgets: its mean squared change over `LAG` steps, in units
of twice its variance over all settings, per CPU second.
"""

from __future__ import annotations

import argparse
import dataclasses
from typing import Any

import numpy as np

from benchmarks import measure, worlds
from prf.diagnostics import diagnose
from prf.kernels import constants as c
from prf.kernels.build import resum
from prf.layout import read_coloring
from prf.posterior import Settings

BURN_IN = 2_000_000
TURN = 20_000
EVERY = 2_000
LAG = 10_000
FUNCTIONALS = ("n_edges", "total_length", "log_posterior")
CHANGES: dict[str, dict[str, float]] = {
    "default": {},
    "cell 0.6 m": {"cell": 0.6},
    "move reach x 0.1": {"move_reach": 0.1},
    "move reach x 0.3": {"move_reach": 0.3},
    "move reach x 3": {"move_reach": 3.0},
    "split reach x 0.1": {"split_reach": 0.1},
    "split reach x 0.3": {"split_reach": 0.3},
    "split reach x 3": {"split_reach": 3.0},
    "birth reach x 0.3": {"birth_reach": 0.3},
    "birth reach x 3": {"birth_reach": 3.0},
    "cut reach x 0.3": {"cut_reach": 0.3},
    "cut reach x 3": {"cut_reach": 3.0},
    "local share 0.95": {"local_share": 0.95},
}


def changed(settings: Settings, change: dict[str, float]) -> Settings:
    """Return settings whose reaches are multiples of the defaults, other fields as given."""
    tuning = settings.tuning()
    defaults = {
        "move_reach": c.MOVE_REACH,
        "split_reach": c.SPLIT_REACH,
        "birth_reach": c.BIRTH_REACH,
        "cut_reach": c.CUT_REACH,
    }
    values = {
        name: float(tuning[defaults[name]]) * value if name in defaults else value for name, value in change.items()
    }
    return dataclasses.replace(settings, **values)


class Contender:
    """A chain with its own tuning, its CPU seconds and the trace of its functionals."""

    def __init__(self, settings: Settings, coloring: Any) -> None:
        self.chain = worlds.start(settings, coloring)
        self.rng = np.random.default_rng(5)
        self.seconds = 0.0
        self.trace: list[list[float]] = []

    def turn(self) -> None:
        """Run a few thousand steps, noting the functionals on the way."""
        for _ in range(TURN // EVERY):
            spent, self.chain = worlds.cpu(lambda: worlds.advance(self.chain, self.rng, EVERY))
            self.seconds += spent
            sums = self.chain.graph.sums
            self.trace.append(
                [self.chain.graph.counts[c.EDGES], sums[c.TOTAL_LENGTH], sums[c.LOG_PRIOR] + sums[c.LOG_LIKELIHOOD]]
            )
        resum(self.chain)


def run_all(names: list[str], n_steps: int) -> dict[str, Contender]:
    """Run every contender, by turns."""
    settings = worlds.settings_of(worlds.OFFICE)
    chain, _ = measure.burnt_in(settings, BURN_IN, seed=1)
    coloring = read_coloring(chain.graph)
    contenders = {name: Contender(changed(settings, CHANGES[name]), coloring) for name in names}
    for _ in range(n_steps // TURN):
        for contender in contenders.values():
            contender.turn()
    return contenders


def rows(contenders: dict[str, Contender]) -> list[dict[str, Any]]:
    """Return the figures of every contender."""
    variance = np.var(np.concatenate([np.array(one.trace) for one in contenders.values()]), axis=0)
    found = []
    for name, one in contenders.items():
        trace = np.array(one.trace)
        jumps = trace[LAG // EVERY :] - trace[: -(LAG // EVERY)]
        rate = len(trace) * EVERY / one.seconds
        named = {label: trace[None, :, i] for i, label in enumerate(FUNCTIONALS)}
        sizes = diagnose(named, draws_per_chain=len(trace))
        found.append(
            {
                "name": name,
                "steps_per_second": rate,
                "accepted_per_second": rate * one.chain.outcomes[:, c.ACCEPTED].sum() / len(trace) / EVERY,
                "ess_per_second": [sizes[label].ess / one.seconds for label in FUNCTIONALS],
                "jump_rate": (np.mean(jumps**2, axis=0) / (2.0 * variance) * rate / LAG).tolist(),
                "mean": trace.mean(axis=0).tolist(),
                "acceptance": (one.chain.outcomes[:, c.ACCEPTED] / one.chain.outcomes[:, c.PROPOSED]).tolist(),
            }
        )
    return found


def label(name: str) -> str:
    """Return a move's name in six letters."""
    return "".join(word[:3] for word in name.split()[:2])


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--steps", type=int, default=2_000_000, help="steps of each chain")
    parser.add_argument("--only", nargs="+", choices=list(CHANGES), default=list(CHANGES))
    arguments = parser.parse_args()
    print("                    steps/s  accepted/s | ESS/s: edges length log post | jump rate: edges length log post")
    found = rows(run_all(arguments.only, arguments.steps))
    for row in found:
        ess, jump = row["ess_per_second"], row["jump_rate"]
        print(
            f"{row['name']:18} {row['steps_per_second']:8,.0f} {row['accepted_per_second']:11,.0f} |"
            f" {ess[0]:12.2f} {ess[1]:6.2f} {ess[2]:8.2f} | {jump[0]:16.2f} {jump[1]:6.2f} {jump[2]:8.2f}"
        )
    print("\nacceptance            " + " ".join(f"{label(name):>6}" for name in worlds.MOVES.values()))
    for row in found:
        print(f"{row['name']:20} " + " ".join(f"{share:6.2%}" for share in row["acceptance"]))


if __name__ == "__main__":
    main()
