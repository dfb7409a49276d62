"""The one best map: chains cooled from the posterior to its mode, the best map that any of them saw is kept.

The mode is that of the density over the lines that carry the edges, |E| log p - 2 p length + log likelihood. Over
vertices the same distribution has the factors 1/|e| and sin(phi), and no mode: ever shorter edges are ever denser. At
temperature T the chain samples exp(that / T) times these factors, at T = 1 the posterior itself.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from prf.configuration import Cooling, Start
from prf.kernels import constants as c
from prf.kernels.state.chain import Chain
from prf.model.coloring import Coloring
from prf.model.layout import read_coloring
from prf.sampler.chain import ChainSampler
from prf.sampler.chains import Sampler
from prf.sampler.driver import StopRule, rounds
from prf.sampler.poses import PoseTurns
from prf.sampler.posterior import Settings
from prf.sampler.record import Record

COOLING = Cooling()
FROZEN = 1e12
"""Inverse temperature at which no step that loses anything is taken, whatever its proposal ratio."""


def inverse_temperature(cooling: Cooling, share: float) -> float:
    """Return 1 / T when `share` of the work is done; between warm and polish the logarithm of T falls evenly."""
    if share >= 1.0 - cooling.polish:
        return FROZEN
    cooled = max(0.0, share - cooling.warm) / (1.0 - cooling.warm - cooling.polish)
    return float(cooling.coldest**-cooled)


class Annealed(NamedTuple):
    """The best map that any chain saw so far."""

    best: Coloring
    by_chain: tuple[float, ...]  # the best score of each chain: their spread shows how certain the best one is
    steps: int  # of each chain
    share: float  # of the schedule that is done
    temperature: float

    @property
    def score(self) -> float:
        """|E| log p - 2 p length + log likelihood of the best map, in nats."""
        return max(self.by_chain)


class BestMap(Record):
    """The map of highest score among the states of a chain at times to record; no draws are kept."""

    def __init__(self, scale: float) -> None:
        super().__init__(np.zeros(0, np.int64))
        self.scale = scale
        self.score = -np.inf

    def take(self, chain: Chain, poses: PoseTurns | None = None) -> None:
        """Keep the present map if it is the best."""
        graph, scale = chain.graph, self.scale
        prior = graph.counts[c.EDGES] * np.log(scale) - 2.0 * scale * graph.sums[c.TOTAL_LENGTH]
        score = float(prior + graph.sums[c.LOG_LIKELIHOOD])
        if score > self.score:
            self.map, self.score = read_coloring(graph), score


class CoolingChain(ChainSampler):
    """A chain on its way down, whose temperature the driver's rounds set."""

    REFRESHES = False
    record: BestMap

    def make_record(self, probes: NDArray[np.int64]) -> BestMap:
        """Return a record of the best map alone."""
        return BestMap(self.settings.scale)

    def find_start(self, stop_requested: Callable[[], bool]) -> None:
        """Before the first step: take the map that the chain starts from, the first to keep."""
        super().find_start(stop_requested)
        self.record.take(self.chain)


def anneal(
    settings: Settings,
    generators: list[np.random.Generator],
    rule: StopRule,
    cooling: Cooling = COOLING,
    threads: int = 1,
    starts_from: Start = "empty",
    on_progress: Callable[[Annealed], None] = lambda _: None,
    stop_requested: Callable[[], bool] = lambda: False,
) -> Annealed:
    """Cool one chain a generator for the steps or the time of `rule`, and return the best map."""
    plain = dataclasses.replace(settings, resolution=None, seen=None, tiles=0)
    with Sampler(plain, generators, threads, starts_from=starts_from, kind=CoolingChain) as sampler:
        share, beta = 0.0, inverse_temperature(cooling, 0.0)
        for progress in rounds(sampler, rule, stop_requested):
            share = progress.share
            on_progress(_best_so_far(sampler, share, beta))
            if stop_requested():
                break
            beta = inverse_temperature(cooling, share)
            for chain in sampler.chains:
                chain.chain.density[c.INVERSE_TEMPERATURE] = beta
    return _best_so_far(sampler, share, beta)


def _best_so_far(sampler: Sampler, share: float, beta: float) -> Annealed:
    records = [chain.record for chain in sampler.chains if isinstance(chain, CoolingChain)]
    best = max(records, key=lambda record: record.score)
    return Annealed(best.map, tuple(record.score for record in records), sampler.step, share, 1.0 / beta)
