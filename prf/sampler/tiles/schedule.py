"""The schedule of a chain in tiles: the work in each tile, the merged map, and what is recorded on the way.

The work in a tile is a pure function of the round and the readings.
"""

from __future__ import annotations

from concurrent.futures import Executor
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from prf.kernels import constants as c
from prf.kernels.state.chain import Chain
from prf.kernels.state.image import count_edges, settle_all
from prf.model.coloring import Coloring, black_at
from prf.model.window import INTERIOR, Window
from prf.sampler.chain import Draw, Record, burn_in, functionals
from prf.sampler.schedules import Plain, Steps
from prf.sampler.target import Execution, Target, make_chain, run_chain, with_map
from prf.sampler.tiles.part import Part, make_part
from prf.sampler.tiles.rounds import (
    PLAIN_SHARE,
    Round,
    TileData,
    first_round,
    looks_of,
    make_round,
    make_tile_data,
    narrowest,
    round_length,
)


class TileState(NamedTuple):
    """Inside of a tile at one of the looks of a round."""

    xy: NDArray[np.float64]  # (m, 2): new vertices
    # (k, 2): new edges: numbers of vertices of the round's map that stay, or -1 - i for the new vertex i
    edges: NDArray[np.int64]
    gain: NDArray[np.float64]  # by how much what is watched has changed since the round began
    probe_black: NDArray[np.bool_]  # (n_probes,): colours of the probes in the tile, False elsewhere


class TileResult(NamedTuple):
    """Result of a round in a tile."""

    drawn: NDArray[np.int64]  # (n,): edges of the round's map that the new ones replace
    states: tuple[TileState, ...]  # one a look; the last is that of the end
    outcomes: NDArray[np.int64]  # (n_moves, 3)
    pixels: NDArray[np.int64]  # (p,): pixels of the image that belong to the tile
    black: NDArray[np.uint8]  # (p,)
    black_time: NDArray[np.int64]  # (p,): in steps of the tile
    mixed_time: NDArray[np.int64]  # (p,): in steps of the tile


def work_tile(data: TileData, begun: Round, number: int) -> TileResult:
    """Run the chain of one tile from the map of the round; the same on any machine."""
    part = make_part(data, begun, number)
    chain, rng = part.chain, np.random.default_rng(int(begun.seeds[number]))
    at_first, states = functionals(chain), []
    for look in begun.looks.tolist():
        chain = run_chain(chain, rng, look)
        states.append(_state(part, chain, at_first, begun.probes))
    settle_all(chain.image, begun.steps)
    return TileResult(
        part.drawn,
        tuple(states),
        chain.outcomes,
        part.pixels,
        chain.image.black,
        chain.image.black_time,
        chain.image.mixed_time,
    )


def _state(part: Part, chain: Chain, at_first: NDArray[np.float64], probes: NDArray[np.int64]) -> TileState:
    """Return the present inside of a tile."""
    graph = chain.graph
    ends = graph.edge_vertices[graph.members[c.EDGES, : graph.counts[c.EDGES]]]
    is_new = np.ones(len(graph.edge_length), np.bool_)
    is_new[part.pinned] = False
    fresh = np.unique(ends[is_new[ends]])
    code = np.zeros(len(graph.edge_length), np.int64)
    code[: len(part.vertices)] = part.vertices
    code[fresh] = -1 - np.arange(len(fresh))
    black = np.zeros(len(probes), np.bool_)
    inside = np.isin(probes, part.pixels)
    black[inside] = chain.image.black[np.searchsorted(part.pixels, probes[inside])]
    return TileState(graph.vertex_xy[fresh], code[ends].reshape(-1, 2), functionals(chain) - at_first, black)


def draw_at(done: Round, results: list[TileResult], look: int, step: int, at_first: NDArray[np.float64]) -> Draw:
    """Return the state of all tiles at a look, as a draw of the step `step`.

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

    While all tiles step at once, time advances by the steps of all: each step of a tile counts as many as there are
    tiles.
    """
    settle_all(chain.image, int(chain.graph.counts[c.STEP]))
    chain.graph.counts[c.STEP] += done.steps * len(done.tiles)
    for result in results:
        chain.outcomes[:] += result.outcomes
        chain.image.black[result.pixels] = result.black
        chain.image.black_time[result.pixels] += len(done.tiles) * result.black_time
        chain.image.mixed_time[result.pixels] += len(done.tiles) * result.mixed_time
    merged_map = merged(done, results)
    found = with_map(chain, data.target, merged_map)
    if found.image.black.size > 0:
        found.image.black_since[:] = found.graph.counts[c.STEP]
        found.image.mixed_since[:] = found.graph.counts[c.STEP]
        count_edges(found.image, merged_map.segments(), int(found.graph.counts[c.STEP]))
    return found


class Tiles(Plain):
    """Rounds of tiles, after the first steps on the whole window. It records by itself what the tiles were on the way.

    Tiles are worked in the threads of `pool`; without one, and in another process, one after the other.
    """

    def __init__(self, data: TileData, record: Record, pool: Executor | None = None) -> None:
        self.data, self.record, self.pool = data, record, pool
        self.first = first_round()
        self.longest = round_length(data.target)

    def turn(self, step: int, stop: int, end: int) -> tuple[Steps, int]:
        """Return the steps on the whole window, or all of a round."""
        return (run_chain, stop) if step < self.first else (self.make_round, end)

    def round_length(self, step: int, block: int) -> int:
        """Return the steps of the next round."""
        if step < self.first:
            return min(block, self.first - step)
        return min(self.longest, max(self.first, burn_in(step)))

    def make_round(self, chain: Chain, rng: np.random.Generator, end: int) -> Chain:
        """Make a round up to the step `end`: the tiles at once, then on the whole window; return the chain."""
        target, begun_at, at_first = self.data.target, int(chain.graph.counts[c.STEP]), functionals(chain)
        length = end - begun_at
        steps = length - round(PLAIN_SHARE * length)
        least, n_looks = narrowest(target.window, target.execution.tiles), looks_of(length)
        begun = make_round(self.data, chain, target.execution.tiles, least, steps, rng, n_looks, self.record.probes)
        results = self.work(begun)
        at_looks = np.linspace(begun_at, end, n_looks + 1, dtype=np.int64)[1:-1]
        for look, step in enumerate(at_looks.tolist()):
            if self.record.is_due(step):
                self.record.add(draw_at(begun, results, look, step, at_first))
        return run_chain(finish_round(self.data, chain, begun, results), rng, end)

    def work(self, begun: Round) -> list[TileResult]:
        """Return what all tiles of a round came to."""
        n = len(begun.tiles)
        workers = map if self.pool is None else self.pool.map
        return list(workers(work_tile, [self.data] * n, [begun] * n, range(n)))

    def __getstate__(self) -> dict[str, Any]:
        """Leave the threads behind."""
        return {**self.__dict__, "pool": None}


def small_round() -> None:
    """Do one round of a few steps without readings: it calls the kernels of tiles, as a run does after many."""
    target = Target(Window(0.0, 0.0, 1.0, 1.0), 1.0, execution=Execution(resolution=0.2))
    data, chain = make_tile_data(target), make_chain(target, Coloring.empty(target.window))
    begun = make_round(data, chain, 2, 0.2, 20, np.random.default_rng(1))
    finish_round(data, chain, begun, [work_tile(data, begun, number) for number in range(len(begun.tiles))])
