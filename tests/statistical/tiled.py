"""A chain in rounds of tiles, in one thread, with more tiles than its window needs.

``python -m tests.statistical.tiled N_DRAWS SEED`` prints the z-scores of the exact laws of the prior as JSON.
"""

from __future__ import annotations

import json
import sys

import numpy as np

import prf
from prf.kernels import constants as c
from prf.kernels.state.build import recompute_sums
from prf.kernels.step import run
from prf.model.coloring import Coloring, Draws
from prf.model.layout import grow, read_coloring
from prf.model.window import Window
from prf.sampler.posterior import Settings, make_chain
from prf.sampler.tiles.rounds import make_round, make_tile_data
from prf.sampler.tiles.tiled import finish_round, work_tile
from tests.statistical.laws import law_scores

ROOM = Window(-5.0, -5.0, 5.0, 5.0)
SCALE = 0.4
TILES = 6
LEAST = 1.5
STEPS = 24_000
"""In the tiles of a round."""
PLAIN = 4000
"""On the whole window between two."""
BURN_IN = 20
N_BATCHES = 100


def tiled_draws(settings: Settings, n_draws: int, seed: int, cost: float = np.inf) -> Draws:
    """Return the map after every round but the first ones; `cost` is that of an occupied sensor."""
    rng = np.random.default_rng(seed)
    chain, data = make_chain(settings, Coloring.empty(settings.window)), make_tile_data(settings)
    chain.density[c.OCCUPIED_COST] = cost
    maps = []
    for number in range(BURN_IN + n_draws):
        begun = make_round(data, chain, TILES, LEAST, STEPS, rng)
        chain = finish_round(data, chain, begun, [work_tile(data, begun, k) for k in range(len(begun.tiles))])
        until = int(chain.graph.counts[c.STEP]) + PLAIN
        while not run(chain, rng, until):
            chain = grow(chain)
        recompute_sums(chain)
        if number >= BURN_IN:
            maps.append(read_coloring(chain.graph))
    return Draws.from_colorings(maps, settings.window)


if __name__ == "__main__":
    n_draws, seed = int(sys.argv[1]), int(sys.argv[2])
    draws = tiled_draws(Settings(ROOM, SCALE), n_draws, seed)
    scores = law_scores(draws, SCALE, ROOM, batch=n_draws // N_BATCHES)
    found = {"package": prf.__file__, "z": scores.z, "relative_error_edges": scores.relative_error_edges}
    print(json.dumps(found))
