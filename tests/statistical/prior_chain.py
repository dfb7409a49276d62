"""A long chain on the prior of the unit square and the z-scores of the exact laws.

``python -m tests.statistical.prior_chain STEPS SEED MOVE=ODDS ... setting=NUMBER ...`` prints them as JSON; odds
replace the defaults, so that a doubtful move acts more often. Settings are p = 1, unless given, and those of the
sampler, but cells of 0.2 m, which let the local recolouring find neighbours; ``targets=N`` aims at so many squares.
With ``exact`` in front, and the number of draws for that of steps, the draws are exact ones.
"""

from __future__ import annotations

import json
import sys

import numpy as np
from numpy.typing import NDArray

import prf
from prf.kernels import constants as c
from prf.kernels.step import run
from prf.model.arak import exact_draws
from prf.model.coloring import Coloring, Draws
from prf.model.layout import grow, make_targets, read_coloring
from prf.model.window import Window
from prf.sampler.target import Execution, Target, Tuning, make_chain
from tests.statistical.laws import law_scores

UNIT = Window(0.0, 0.0, 1.0, 1.0)
THIN = 1000
BURN_IN = 200_000
N_BATCHES = 100
TARGET_SIDE = 0.05


def prior_draws(
    steps: int, seed: int, target: Target, odds: dict[int, float], n_targets: int
) -> tuple[Draws, NDArray[np.int64]]:
    """Return every `THIN`-th map of one chain from the empty map, after the burn-in, and the outcomes of its moves."""
    rng = np.random.default_rng(seed)
    chain = make_chain(target, Coloring.empty(UNIT))
    chain = chain._replace(targets=make_targets(UNIT, TARGET_SIDE, rng.random((n_targets, 2))))
    chain.tuning[c.AIMED_SHARE] = target.tuning.aimed_share if n_targets > 0 else 0.0
    for move, share in odds.items():
        chain.move_probabilities[move] = share
    chain.move_probabilities[:] /= chain.move_probabilities.sum()
    maps = []
    for until in range(BURN_IN, steps + 1, THIN):
        while not run(chain, rng, until):
            chain = grow(chain)
        maps.append(read_coloring(chain.graph))
    return Draws.from_colorings(maps, UNIT), chain.outcomes


def print_exact(n_draws: int, seed: int) -> None:
    """Print the z-scores of exact draws at p = 1."""
    draws = exact_draws(1.0, UNIT, n_draws, np.random.default_rng(seed))
    print(json.dumps({"package": prf.__file__, "z": law_scores(draws, 1.0, UNIT).z}))


if __name__ == "__main__":
    if sys.argv[1] == "exact":
        print_exact(int(sys.argv[2]), int(sys.argv[3]))
        sys.exit()
    steps, seed = int(sys.argv[1]), int(sys.argv[2])
    numbers = {name: float(number) for name, number in (text.split("=") for text in sys.argv[3:])}
    odds = {getattr(c, name): share for name, share in numbers.items() if name.isupper()}
    changes = {name: number for name, number in numbers.items() if name.islower()}
    n_targets = int(changes.pop("targets", 0))
    scale, execution = changes.pop("scale", 1.0), Execution(cell=changes.pop("cell", 0.2))
    target = Target(UNIT, scale, tuning=Tuning(**changes), execution=execution)
    draws, outcomes = prior_draws(steps, seed, target, odds, n_targets)
    scores = law_scores(draws, target.scale, UNIT, batch=len(draws) // N_BATCHES)
    found = {
        "package": prf.__file__,
        "z": scores.z,
        "relative_error_edges": scores.relative_error_edges,
        "mean_edges": float(draws.n_edges.mean()),
        "accepted": outcomes[:, c.ACCEPTED].tolist(),
    }
    print(json.dumps(found))
