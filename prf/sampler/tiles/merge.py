"""The end of a round: the map with the new insides of its tiles, and the chain on it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from prf.coloring import Coloring, black_at
from prf.kernels import constants as c
from prf.kernels.chain import Chain
from prf.kernels.image import count_all_edges, settle_all
from prf.sampler.record import Draw
from prf.sampler.tempering_state import with_map
from prf.sampler.tiles.data import TileData
from prf.sampler.tiles.rounds import Round
from prf.sampler.tiles.work import TileResult
from prf.window import INTERIOR


def draw_at(done: Round, results: list[TileResult], look: int, step: int, at_first: NDArray[np.float64]) -> Draw:
    """Return what all tiles had come to at a look, as a draw of the step `step`.

    Tiles step at once, and what one changes of the density no other does: from `at_first`, the values that are watched
    when the round began, their gains add up.
    """
    states = [result.states[look] for result in results]
    values = at_first + np.sum([state.gain for state in states], axis=0)
    return Draw(step, merged(done, results, look), values, np.any([state.probe_black for state in states], axis=0))


def merged(done: Round, results: list[TileResult], look: int = -1) -> Coloring:
    """Put what stayed and the insides of all tiles at a look together, in the order of the tiles."""
    old = done.coloring
    is_drawn = np.zeros(old.n_edges, np.bool_)
    for result in results:
        is_drawn[result.drawn] = True
    kept = np.unique(old.edges[~is_drawn])
    number = np.full(len(old.xy), -1, np.int64)
    number[kept] = np.arange(len(kept))
    places, sides, edges = [old.xy[kept]], [old.side[kept]], [number[old.edges[~is_drawn]]]
    n = len(kept)
    for state in (result.states[look] for result in results):
        ends = n - 1 - state.edges
        stays = state.edges >= 0
        ends[stays] = number[state.edges[stays]]
        edges.append(ends)
        places.append(state.xy)
        sides.append(np.full(len(state.xy), INTERIOR, np.int8))
        n += len(state.xy)
    found = Coloring(
        old.window, np.concatenate(places), np.concatenate(sides), np.concatenate(edges).astype(np.int32), False
    )
    # No tile turns the colour of the window's border.
    corner = [[old.window.x_min, old.window.y_min]]
    return found._replace(anchor_black=bool(black_at(old, corner)[0] != black_at(found, corner)[0]))


def finish_round(data: TileData, chain: Chain, done: Round, results: list[TileResult]) -> Chain:
    """Return the chain on the merged map, with the steps and the times of the tiles.

    While all tiles step at once, time goes on by the steps of all: each step of a tile counts as many as there are
    tiles.
    """
    settle_all(chain.image, int(chain.graph.counts[c.STEP]))
    chain.graph.counts[c.STEP] += done.steps * len(done.tiles)
    for result in results:
        chain.outcomes[:] += result.outcomes
        chain.image.black[result.pixels] = result.black
        chain.image.black_time[result.pixels] += len(done.tiles) * result.black_time
        chain.image.mixed_time[result.pixels] += len(done.tiles) * result.mixed_time
    found = with_map(chain, data.settings, merged(done, results))
    if found.image.black.size > 0:
        found.image.black_since[:] = found.graph.counts[c.STEP]
        found.image.mixed_since[:] = found.graph.counts[c.STEP]
        count_all_edges(found.graph, found.image)
    return found
