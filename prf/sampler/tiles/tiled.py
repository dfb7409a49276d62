"""One chain in rounds of tiles."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from typing import Protocol

import numpy as np

from prf.sampler.chain import ChainSampler
from prf.sampler.record import burn_in, functionals
from prf.sampler.tiles import schedule
from prf.sampler.tiles.data import TileData, make_tile_data
from prf.sampler.tiles.merge import draw_at, finish_round
from prf.sampler.tiles.rounds import Round, make_round
from prf.sampler.tiles.schedule import PLAIN_SHARE, looks_of, narrowest, round_length
from prf.sampler.tiles.work import TileResult, work_tile


class TiledChain:
    """How a chain steps in tiles: who drives it begins a round, has the tiles worked, and ends the round."""

    def __init__(self, sampler: ChainSampler, data: TileData) -> None:
        self.sampler = sampler
        self.data = data
        self.length = round_length(data.settings)
        self.first = schedule.ROUND_LENGTHS[0]

    @property
    def is_due(self) -> bool:
        """Whether the next steps are a round."""
        return self.sampler.step >= self.first

    @property
    def next_length(self) -> int:
        """Steps of the next round."""
        return min(self.length, max(self.first, burn_in(self.sampler.step)))

    def compile(self) -> None:
        """Have the kernels of tiles compiled, or read from their cache, without making a step."""
        work_tile(self.data, self._round(0, np.random.default_rng(0)), 0)

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
        """Put the tiles together, and go on with the whole window up to the end of the round.

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
        sampler.finish_block(end, length)

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


class Crew(Protocol):
    """Whoever works tiles elsewhere."""

    def work_tiles(self, chains: Sequence[TiledChain], begun: Sequence[Round]) -> list[list[TileResult]]:
        """Return the results of all tiles of the rounds that `chains` have begun."""


def advance_in_tiles(chains: Sequence[TiledChain], pool: Executor, crew: Crew | None = None) -> None:
    """Do one round in every chain, the tiles of all side by side, in `pool` or by a `crew`."""
    begun = list(pool.map(TiledChain.begin, chains))
    if crew is not None:
        results = crew.work_tiles(chains, begun)
    else:
        futures = [
            [pool.submit(work_tile, chain.data, each, number) for number in range(len(each.tiles))]
            for chain, each in zip(chains, begun, strict=True)
        ]
        results = [[future.result() for future in row] for row in futures]
    list(pool.map(TiledChain.end, chains, begun, results))
