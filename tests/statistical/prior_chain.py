"""A long chain on the prior of the unit square, p = 1, and the z-scores of the exact laws.

``python -m tests.statistical.prior_chain STEPS SEED MOVE=ODDS ...`` prints them as JSON; odds replace the defaults, so
that a doubtful move acts more often. Cells of 0.2 m let the local recolouring find neighbours.
"""

from __future__ import annotations

import json
import sys

import numpy as np

import prf
from prf.coloring import Coloring, Draws
from prf.kernels import constants as c
from prf.kernels.step import run
from prf.layout import grow, read_coloring
from prf.posterior import Settings, make_chain
from prf.window import Window
from tests.statistical.laws import law_scores

UNIT = Window(0.0, 0.0, 1.0, 1.0)
THIN = 1000
BURN_IN = 200_000
N_BATCHES = 100


def prior_draws(steps: int, seed: int, odds: dict[int, float]) -> Draws:
    """Return every `THIN`-th map of one chain from the empty map, after the burn-in."""
    rng = np.random.default_rng(seed)
    chain = make_chain(Settings(UNIT, 1.0, cell=0.2), Coloring.empty(UNIT))
    for move, share in odds.items():
        chain.odds[move] = share
    chain.odds[:] /= chain.odds.sum()
    maps = []
    for until in range(BURN_IN, steps + 1, THIN):
        while not run(chain, rng, until):
            chain = grow(chain)
        maps.append(read_coloring(chain.graph))
    return Draws.from_colorings(maps, UNIT)


if __name__ == "__main__":
    steps, seed = int(sys.argv[1]), int(sys.argv[2])
    odds = {getattr(c, name): float(share) for name, share in (text.split("=") for text in sys.argv[3:])}
    draws = prior_draws(steps, seed, odds)
    scores = law_scores(draws, 1.0, UNIT, batch=len(draws) // N_BATCHES)
    found = {
        "package": prf.__file__,
        "z": scores.z,
        "relative_error_edges": scores.relative_error_edges,
        "mean_edges": float(draws.n_edges.mean()),
    }
    print(json.dumps(found))
