"""The one best map: chains cooled from the posterior to its mode, the best map that any of them saw is kept.

The mode is that of the density over the lines that carry the edges, |E| log p - 2 p length + log likelihood. Over
vertices the same distribution has the factors 1/|e| and sin(phi), and no mode: ever shorter edges are ever denser. At
temperature T the chain samples exp(that / T) times these factors, at T = 1 the posterior itself.
"""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np

from prf.coloring import Coloring
from prf.kernels import constants as c
from prf.layout import read_coloring
from prf.posterior import Settings
from prf.sampler.chain import ChainSampler
from prf.sampler.driver import START_SHARE
from prf.sampler.targets import aim, is_due
from prf.shell.errors import ConfigError

ROUND = 2000
"""Steps between two looks at the map and at the temperature."""
FROZEN = 1e12
"""Inverse temperature at which no step that loses anything is taken, whatever its proposal ratio."""


@dataclasses.dataclass(frozen=True)
class Schedule:
    """How the temperature falls with the share of the work that is done."""

    warm: float = 0.3  # share at temperature 1: the chain samples the posterior and finds its way
    polish: float = 0.15  # share at temperature 0, at the end: only what is better is taken
    coldest: float = 0.003  # temperature before that; between, the logarithm falls evenly

    def __post_init__(self) -> None:
        """Refuse a schedule that does not cool."""
        if min(self.warm, self.polish) < 0.0 or self.warm + self.polish >= 1.0:
            raise ConfigError("annealing: the shares of warm and polish must not be negative, and leave time to cool")
        if not 0.0 < self.coldest < 1.0:
            raise ConfigError(f"anneal.coldest {self.coldest}: must lie between 0 and 1")

    def inverse_temperature(self, share: float) -> float:
        """Return 1 / T when `share` of the work is done."""
        if share >= 1.0 - self.polish:
            return FROZEN
        cooled = max(0.0, share - self.warm) / (1.0 - self.warm - self.polish)
        return float(self.coldest**-cooled)


class Annealed(NamedTuple):
    """The best map found."""

    best: Coloring
    score: float  # of the best map: |E| log p - 2 p length + log likelihood, in nats
    by_chain: tuple[float, ...]  # the best of each chain: their spread shows how certain the best one is
    steps: int  # of each chain
    is_complete: bool  # whether the schedule was completed


class Moment(NamedTuple):
    """The chains on their way down, after a round."""

    share: float  # of the work that is done
    temperature: float
    step: int  # of each chain
    seconds: float
    best: Coloring  # the best map that any chain saw
    by_chain: tuple[float, ...]  # the best score of each chain


class Goal(NamedTuple):
    """When the schedule ends: after `steps` a chain, or after `seconds`."""

    steps: int | None = None
    seconds: float | None = None

    def share(self, step: int, seconds: float) -> float:
        """Return the share that is done."""
        done = step / self.steps if self.steps is not None else seconds / max(self.seconds or 0.0, 1e-9)
        return min(1.0, done)


class _Cooling:
    """One chain on its way down, with the best map that it saw."""

    def __init__(self, settings: Settings, rng: np.random.Generator) -> None:
        self.sampler = ChainSampler(settings, rng, np.zeros(0, np.int64), refreshes=False)
        self.best = self._map()
        self.score = self._score()

    def find_start(self, stop_requested: Callable[[], bool]) -> None:
        """Begin where a chain on a share of the readings leads."""
        self.sampler.find_start(stop_requested)
        self.best, self.score = self._map(), self._score()

    def advance(self, beta: float) -> None:
        """Run some rounds at one temperature."""
        self.sampler.chain.density[c.INVERSE_TEMPERATURE] = beta
        end = self.sampler.step + self.sampler.block
        while self.sampler.step < end:
            self.sampler.run_to(min(end, self.sampler.step + ROUND))
            now = self._score()
            if now > self.score:
                self.best, self.score = self._map(), now
        self.sampler.settle()

    def _map(self) -> Coloring:
        return read_coloring(self.sampler.chain.graph)

    def _score(self) -> float:
        graph, scale = self.sampler.chain.graph, self.sampler.settings.scale
        prior = graph.counts[c.EDGES] * np.log(scale) - 2.0 * scale * graph.sums[c.TOTAL_LENGTH]
        return float(prior + graph.sums[c.LOG_LIKELIHOOD])


def anneal(
    settings: Settings,
    generators: list[np.random.Generator],
    goal: Goal,
    schedule: Schedule | None = None,
    threads: int = 1,
    on_progress: Callable[[Moment], None] | None = None,
    stop_requested: Callable[[], bool] | None = None,
) -> Annealed:
    """Cool one chain a generator and return the best map."""
    schedule = schedule or Schedule()
    plain = dataclasses.replace(settings, resolution=None)
    chains = [_Cooling(plain, rng) for rng in generators]
    start, share, rounds = time.monotonic(), 0.0, 0

    def is_late() -> bool:
        late = goal.steps is None and time.monotonic() - start > START_SHARE * (goal.seconds or 0.0)
        return late or (stop_requested is not None and stop_requested())

    with ThreadPoolExecutor(max(1, min(threads, len(chains)))) as pool:
        for future in [pool.submit(chain.find_start, is_late) for chain in chains]:
            future.result()
        while share < 1.0 and not (stop_requested is not None and stop_requested()):
            beta = schedule.inverse_temperature(share)
            for future in [pool.submit(chain.advance, beta) for chain in chains]:
                future.result()
            rounds += 1
            if is_due(rounds - 1, rounds):
                aim([chain.sampler.chain for chain in chains], [chain.sampler.doubts for chain in chains])
            seconds = time.monotonic() - start
            share = goal.share(chains[0].sampler.step, seconds)
            if on_progress is not None:
                best = max(chains, key=lambda chain: chain.score).best
                scores = tuple(chain.score for chain in chains)
                on_progress(Moment(share, 1.0 / beta, chains[0].sampler.step, seconds, best, scores))
    winner = max(chains, key=lambda chain: chain.score)
    by_chain = tuple(chain.score for chain in chains)
    return Annealed(winner.best, winner.score, by_chain, chains[0].sampler.step, share >= 1.0)
