"""The end of a round: the map with the new insides of its tiles, and the chain on it."""

from __future__ import annotations

import numpy as np

from prf.coloring import Coloring, black_at
from prf.kernels import constants as c
from prf.kernels.build import resum, trace_all
from prf.kernels.chain import Chain
from prf.kernels.image import count_all_edges, settle_all
from prf.layout import make_graph, make_index, painted_sites
from prf.posterior import FIRST_CELL_ROOM, painted_points
from prf.sampler.tiles.data import TileData
from prf.sampler.tiles.rounds import Round
from prf.sampler.tiles.work import TileResult
from prf.sensors.laser import empty_lists
from prf.sensors.sonar import make_sight
from prf.window import INTERIOR


def merged(done: Round, results: list[TileResult]) -> Coloring:
    """Put what stayed and the new insides of all tiles together, in the order of the tiles."""
    old = done.coloring
    is_drawn = np.zeros(old.n_edges, np.bool_)
    for result in results:
        is_drawn[result.drawn] = True
    kept = np.unique(old.edges[~is_drawn])
    number = np.full(len(old.xy), -1, np.int64)
    number[kept] = np.arange(len(kept))
    places, sides, edges = [old.xy[kept]], [old.side[kept]], [number[old.edges[~is_drawn]]]
    n = len(kept)
    for result in results:
        ends = n - 1 - result.edges
        stays = result.edges >= 0
        ends[stays] = number[result.edges[stays]]
        edges.append(ends)
        places.append(result.xy)
        sides.append(np.full(len(result.xy), INTERIOR, np.int8))
        n += len(result.xy)
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
    return replace_map(chain, data, merged(done, results))


def replace_map(chain: Chain, data: TileData, coloring: Coloring) -> Chain:
    """Return the chain on another map, its step, image colours and outcomes kept; all else follows from the map."""
    capacity = len(chain.graph.edge_length)
    while capacity < 2 * (len(coloring.xy) + c.MOST_CHANGES):
        capacity *= 2
    graph = make_graph(coloring, capacity)
    graph.counts[c.STEP] = chain.graph.counts[c.STEP]
    grid = chain.edge_index.grid
    replaced = chain._replace(
        graph=graph,
        edge_index=make_index(graph, grid, FIRST_CELL_ROOM),
        beams=empty_lists(chain.beams, capacity),
        cones=chain.cones._replace(sight=make_sight(capacity + c.MOST_CHANGES)),
        points=painted_points(data.settings.points, coloring),
        sensors=painted_sites(chain.sensors, coloring),
    )
    if chain.image.black.size > 0:
        chain.image.black_since[:] = graph.counts[c.STEP]
        chain.image.mixed_since[:] = graph.counts[c.STEP]
        count_all_edges(graph, chain.image)
    trace_all(replaced)
    resum(replaced)
    return replaced
