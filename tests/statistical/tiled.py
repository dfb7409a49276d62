"""Rounds of tiles in one thread: a chain of more tiles than its window needs, and single rounds in worlds of the prior.

``python -m tests.statistical.tiled N_DRAWS SEED`` prints the z-scores of the exact laws of the prior as JSON.
"""

from __future__ import annotations

import dataclasses
import json
import sys
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

import prf
from prf.kernels import constants as c
from prf.kernels.state.build import recompute_sums
from prf.kernels.state.chain import Chain
from prf.kernels.step import run
from prf.model.coloring import Coloring, Draws, black_at
from prf.model.layout import grow, read_coloring
from prf.model.window import INTERIOR, Window
from prf.sampler.target import Target, laser_data, make_chain
from prf.sampler.tiles.rounds import Round, TileData, make_round, make_tile_data
from prf.sampler.tiles.schedule import finish_round, work_tile
from tests.reference.beams import Sensor, draw_readings
from tests.reference.slow_points import Flips, observe
from tests.reference.slow_sonar import Ring
from tests.reference.sonar_worlds import draw_data, ring_all_round
from tests.reference.worlds import draw_white, model_of
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


def tiled_draws(target: Target, n_draws: int, seed: int, cost: float = np.inf) -> Draws:
    """Return the map after every round but the first ones; `cost` is that of an occupied sensor."""
    rng = np.random.default_rng(seed)
    chain, data = make_chain(target, Coloring.empty(target.window)), make_tile_data(target)
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
    return Draws.from_colorings(maps, target.window)


LARGE = Window(0.0, 0.0, 12.0, 10.0)
DENSE = 0.3
FIVE_TILES, ROUND_STEPS = 5, 30_000
SENSOR = Sensor(9.0)
N_SENSORS, N_BEAMS, N_POINTS = 4, 30, 16
NAMES = ("edges", "length", "interior vertices", "log prior", "log likelihood", "triangles")
"""What a round must not change in the mean, besides the colours of some points."""
Begin = Callable[[TileData, Chain, np.random.Generator], Round]


def begin(data: TileData, chain: Chain, rng: np.random.Generator) -> Round:
    return make_round(data, chain, FIVE_TILES, LEAST, ROUND_STEPS, rng)


def world(rng: np.random.Generator, with_sonar: bool) -> tuple[Target, Coloring]:
    """A laser in a world of the prior, or laser, sonar and points."""
    places = rng.uniform(LARGE[:2], LARGE[2:], (N_SENSORS, 2))
    coloring = draw_white(DENSE, LARGE, places, rng)
    origin, angle = np.repeat(places, N_BEAMS, axis=0), rng.uniform(-np.pi, np.pi, N_SENSORS * N_BEAMS)
    unread = laser_data(origin, angle, np.full(len(angle), np.inf), model_of(SENSOR))
    # Where beams end: held against shapely elsewhere, and a hundred times quicker.
    distance = make_chain(Target(LARGE, DENSE, unread), coloring).beams.ray[:, c.DISTANCE]
    read = dataclasses.replace(unread.readings, range=draw_readings(SENSOR, distance, rng))
    laser = dataclasses.replace(unread, readings=read)
    if not with_sonar:
        return Target(LARGE, DENSE, laser), coloring
    sonar = draw_data(coloring, Ring(max=2.0), ring_all_round(places, 8, 0.4, rng), rng)
    points = observe(coloring, Flips(), rng.uniform(LARGE[:2], LARGE[2:], (20, 2)), rng)
    return Target(LARGE, DENSE, laser, sonar=sonar, points=points), coloring


def values(chain: Chain, coloring: Coloring) -> NDArray[np.float64]:
    """What is compared; the colours are those of points at random places that are the same for all trials."""
    places = np.random.default_rng(0).uniform(LARGE[:2], LARGE[2:], (N_POINTS, 2))
    graph = chain.graph
    named = [
        graph.counts[c.EDGES],
        graph.sums[c.TOTAL_LENGTH],
        (coloring.side == INTERIOR).sum(),
        graph.sums[c.LOG_PRIOR],
        graph.sums[c.LOG_LIKELIHOOD],
        graph.counts[c.TRIANGLE_VERTICES] // 3,
    ]
    return np.array([*named, *black_at(coloring, places)], np.float64)


def round_change(rng: np.random.Generator, with_sonar: bool = False, start: Begin = begin) -> NDArray[np.float64]:
    """Change of every value by a round."""
    target, coloring = world(rng, with_sonar)
    data, chain = make_tile_data(target), make_chain(target, coloring)
    before = values(chain, coloring)
    begun = start(data, chain, rng)
    chain = finish_round(data, chain, begun, [work_tile(data, begun, k) for k in range(len(begun.tiles))])
    return values(chain, read_coloring(chain.graph)) - before


if __name__ == "__main__":
    n_draws, seed = int(sys.argv[1]), int(sys.argv[2])
    draws = tiled_draws(Target(ROOM, SCALE), n_draws, seed)
    scores = law_scores(draws, SCALE, ROOM, batch=n_draws // N_BATCHES)
    found = {"package": prf.__file__, "z": scores.z, "relative_error_edges": scores.relative_error_edges}
    print(json.dumps(found))
