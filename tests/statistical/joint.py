"""Worlds of the prior, readings of the sensor models, a round of tiles: maps and readings keep their joint law.

Each trial is independent of the others, and what a round must not change in the mean is compared before and after
it, map by map (Geweke 2004, "Getting it right", without a chain): a thousand trials see a bias of a few thousandths.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from prf.kernels import constants as c
from prf.kernels.state.chain import Chain
from prf.model.arak import exact_draws
from prf.model.coloring import Coloring, black_at
from prf.model.layout import read_coloring
from prf.model.window import INTERIOR, Window
from prf.sampler.posterior import LaserData, Settings, make_chain
from prf.sampler.tiles.rounds import Round, TileData, make_round, make_tile_data
from prf.sampler.tiles.tiled import finish_round, work_tile
from tests.reference.beams import Sensor, draw_readings
from tests.reference.slow_points import Flips, observe
from tests.reference.slow_sonar import Ring
from tests.reference.sonar_worlds import draw_data, ring_all_round
from tests.reference.worlds import model_of

ROOM = Window(0.0, 0.0, 12.0, 10.0)
SCALE = 0.3
TILES = 5
LEAST = 1.5
STEPS = 30_000
SENSOR = Sensor(9.0)
N_SENSORS, N_BEAMS = 4, 30
NAMES = ("edges", "length", "interior vertices", "log prior", "log likelihood", "triangles")
N_POINTS = 16

Begin = Callable[[TileData, Chain, np.random.Generator], Round]


def begin(data: TileData, chain: Chain, rng: np.random.Generator) -> Round:
    return make_round(data, chain, TILES, LEAST, STEPS, rng)


def world(rng: np.random.Generator, with_sonar: bool) -> tuple[Settings, Coloring]:
    """A laser in a world of the prior, or laser, sonar and points."""
    places = rng.uniform(ROOM[:2], ROOM[2:], (N_SENSORS, 2))
    while True:
        coloring = exact_draws(SCALE, ROOM, 1, rng)[0]
        if not black_at(coloring, places).any():
            break
    origin, angle = np.repeat(places, N_BEAMS, axis=0), rng.uniform(-np.pi, np.pi, N_SENSORS * N_BEAMS)
    unread = LaserData.from_arrays(origin, angle, np.full(len(angle), np.inf), model_of(SENSOR))
    # Where beams end: held against shapely elsewhere, and a hundred times quicker.
    distance = make_chain(Settings(ROOM, SCALE, unread), coloring).beams.ray[:, c.DISTANCE]
    read = dataclasses.replace(unread.readings, range=draw_readings(SENSOR, distance, rng))
    laser = dataclasses.replace(unread, readings=read)
    if not with_sonar:
        return Settings(ROOM, SCALE, laser), coloring
    sonar = draw_data(coloring, Ring(max=2.0), ring_all_round(places, 8, 0.4, rng), rng)
    points = observe(coloring, Flips(), rng.uniform(ROOM[:2], ROOM[2:], (20, 2)), rng)
    return Settings(ROOM, SCALE, laser, sonar=sonar, points=points), coloring


def values(chain: Chain, coloring: Coloring) -> NDArray[np.float64]:
    """What is compared; the colours are those of points at random places that are the same for all trials."""
    places = np.random.default_rng(0).uniform(ROOM[:2], ROOM[2:], (N_POINTS, 2))
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


def trials(n: int, seed: int, with_sonar: bool = False, start: Begin = begin) -> NDArray[np.float64]:
    """Change of every value by a round (n, number of values)."""
    changes = []
    for number in range(n):
        rng = np.random.default_rng([seed, number])
        settings, coloring = world(rng, with_sonar)
        data, chain = make_tile_data(settings), make_chain(settings, coloring)
        before = values(chain, coloring)
        begun = start(data, chain, rng)
        results = [work_tile(data, begun, k) for k in range(len(begun.tiles))]
        chain = finish_round(data, chain, begun, results)
        changes.append(values(chain, read_coloring(chain.graph)) - before)
    return np.array(changes)


def z_scores(changes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Mean change over its standard error; 0 for what never changes."""
    error = changes.std(axis=0, ddof=1) / np.sqrt(len(changes))
    return np.divide(changes.mean(axis=0), error, out=np.zeros(changes.shape[1]), where=error > 0.0)
