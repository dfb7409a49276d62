"""One chain in rounds of tiles: the work in each tile, the merged map, and what is recorded on the way.

The work in a tile is a pure function of the round and the readings.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from prf.kernels import constants as c
from prf.kernels.state.chain import Chain
from prf.kernels.state.image import count_edges, settle_all
from prf.model.coloring import Coloring, black_at
from prf.model.layout import run_chain
from prf.model.window import INTERIOR, Window
from prf.sampler.chain import ChainSampler
from prf.sampler.chain_map import with_map
from prf.sampler.posterior import Settings, make_chain
from prf.sampler.record import Draw, burn_in, functionals
from prf.sampler.tiles.part import Part, make_part
from prf.sampler.tiles.partition import PLAIN_SHARE, first_round, looks_of, narrowest, round_length
from prf.sampler.tiles.rounds import Round, TileData, make_round, make_tile_data


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
    found = with_map(chain, data.settings, merged_map)
    if found.image.black.size > 0:
        found.image.black_since[:] = found.graph.counts[c.STEP]
        found.image.mixed_since[:] = found.graph.counts[c.STEP]
        count_edges(found.image, merged_map.segments(), int(found.graph.counts[c.STEP]))
    return found


class TiledChain:
    """How a chain steps in tiles: who drives it begins a round, has the tiles worked, and ends the round."""

    def __init__(self, sampler: ChainSampler, data: TileData) -> None:
        self.sampler = sampler
        self.data = data
        self.length = round_length(data.settings)
        self.first = first_round()

    @property
    def is_due(self) -> bool:
        """Whether the next steps are a round."""
        return self.sampler.step >= self.first

    @property
    def next_length(self) -> int:
        """Steps of the next round."""
        return min(self.length, max(self.first, burn_in(self.sampler.step)))

    def begin(self) -> Round:
        """Begin a round."""
        steps = self.next_length - round(PLAIN_SHARE * self.next_length)
        return self._round(steps, self.sampler.rng)

    def _round(self, steps: int, rng: np.random.Generator) -> Round:
        settings = self.data.settings
        least = narrowest(settings.window, settings.tiles)
        looks, probes = looks_of(self.next_length), self.sampler.record.probes
        return make_round(self.data, self.sampler.chain, settings.tiles, least, steps, rng, looks, probes)

    def end(self, begun: Round, results: list[TileResult]) -> None:
        """Merge the tiles, and run on the whole window up to the end of the round.

        What is there is recorded at the end, and on the way as the tiles were at their looks.
        """
        sampler = self.sampler
        length = self.next_length
        end = sampler.step + length
        at_first = functionals(sampler.chain)
        steps = np.linspace(sampler.step, end, len(begun.looks) + 1, dtype=np.int64)[1:-1]
        for look, step in enumerate(steps.tolist()):
            if sampler.record.is_due(step):
                sampler.record.add(draw_at(begun, results, look, step, at_first))
        sampler.chain = finish_round(self.data, sampler.chain, begun, results)
        sampler.record_at(end)
        sampler.finish_block(length)

    def advance(self) -> None:
        """Do one round, the tiles one after the other."""
        begun = self.begin()
        self.end(begun, [work_tile(self.data, begun, number) for number in range(len(begun.tiles))])


def tiled_chains(samplers: Sequence[ChainSampler]) -> list[TiledChain]:
    """Return chains of one posterior in tiles; none if their settings ask for none."""
    if not samplers or samplers[0].settings.tiles == 0:
        return []
    data = make_tile_data(samplers[0].settings)
    return [TiledChain(sampler, data) for sampler in samplers]


def advance_in_tiles(chains: Sequence[TiledChain], pool: Executor) -> None:
    """Do one round in every chain, the tiles of all side by side."""
    begun = list(pool.map(TiledChain.begin, chains))
    futures = [
        [pool.submit(work_tile, chain.data, each, number) for number in range(len(each.tiles))]
        for chain, each in zip(chains, begun, strict=True)
    ]
    results = [[future.result() for future in row] for row in futures]
    list(pool.map(TiledChain.end, chains, begun, results))


def small_round() -> None:
    """Do one round of a few steps without readings: it calls the kernels of tiles, as a run does after many."""
    settings = Settings(Window(0.0, 0.0, 1.0, 1.0), 1.0, resolution=0.2)
    data, chain = make_tile_data(settings), make_chain(settings, Coloring.empty(settings.window))
    begun = make_round(data, chain, 2, 0.2, 20, np.random.default_rng(1))
    finish_round(data, chain, begun, [work_tile(data, begun, number) for number in range(len(begun.tiles))])
