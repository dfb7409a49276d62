"""A day of `prf sample` and of `prf anneal` with everything that recurs made to recur sooner.

What could grow over a day recurs with checkpoints, with draws (which are thinned when they are many), with rounds of
the chains and with checks of agreement. A day has 1,440 checkpoints, and some 14 doublings of the spacing of draws.
Both are reached in minutes when draws lie a few steps apart and every round ends with a checkpoint.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

import prf.anneal
import prf.sampler.chain
import prf.sampler.record
import prf.sampler.session
from prf.anneal import Goal, anneal
from prf.run import names
from prf.sampler import session as sessions
from prf.sampler.config import SampleConfig
from prf.sampler.drive import StopRule
from prf.shell.seeds import spawn_generators
from tests.load.meter import resident

DAY = 86_400.0
LOG = Path(__file__).resolve().parents[2] / "data" / "demo-office.log.gz"
CHAINS = 2
THIN, MOST, BLOCK = 2, 128, 1500
"""Of a shortened run: steps between draws at first, draws kept at most, steps of a round."""
SECONDS_A_CHECKPOINT = prf.sampler.session.CHECKPOINT_SECONDS
FIRST_THIN, MOST_DRAWS = prf.sampler.record.FIRST_THIN, prf.sampler.record.MOST_DRAWS


class Day(NamedTuple):
    """What recurs in a day of a real run, at a speed of so many steps a second and chain."""

    checkpoints: int
    doublings: int
    steps: float


def day(speed: float) -> Day:
    """Return what recurs in a day."""
    steps = DAY * speed
    return Day(int(DAY / SECONDS_A_CHECKPOINT), math.ceil(math.log2(steps / (FIRST_THIN * MOST_DRAWS))), steps)


class Trace(NamedTuple):
    """What was seen at the end of every round.

    Attributes
    ----------
    memory : (n,) float64
        MB.
    draws, bytes, spacing : (n,) int64
        Draws kept by all chains, size of draws.npz, steps between draws; 0 of an annealing.
    """

    memory: NDArray[np.float64]
    draws: NDArray[np.int64]
    bytes: NDArray[np.int64]
    spacing: NDArray[np.int64]


@contextmanager
def shortened(block: int = BLOCK, checkpoints: bool = True) -> Iterator[None]:
    """Let draws, epochs and rounds be short, and end every round with a checkpoint, or none."""
    places: tuple[tuple[Any, str, Any], ...] = (
        (prf.sampler.record, "FIRST_THIN", THIN),
        (prf.sampler.record, "FIRST_EPOCH", THIN),
        (prf.sampler.record, "MOST_DRAWS", MOST),
        (prf.sampler.chain, "SHORTEST_BLOCK", block),
        (prf.sampler.chain, "LONGEST_BLOCK", block),
        (prf.sampler.session, "CHECKPOINT_SECONDS", -1.0 if checkpoints else math.inf),
        (prf.anneal, "ROUND", block // 2),
    )
    before = [getattr(module, name) for module, name, _ in places]
    try:
        for module, name, value in places:
            setattr(module, name, value)
        yield
    finally:
        for (module, name, _), value in zip(places, before, strict=True):
            setattr(module, name, value)


def sample(
    n_rounds: int,
    folder: Path,
    checkpoints: bool = True,
    block: int = BLOCK,
    memory: Callable[[], float] = resident,
) -> Trace:
    """Sample the demo office in so many rounds, each with a checkpoint or none; return what was seen at each."""
    seen = _Seen(n_rounds)
    with shortened(block, checkpoints):
        config = SampleConfig(chains=CHAINS, every_scan=10, every_beam=10, resolution=0.5, start="empty")
        prepared = sessions.read_prepared(str(LOG), config)
        session = sessions.start([str(LOG)], prepared, folder, 1, 1)

        def look(_: object) -> None:
            records = [chain.record for chain in session.sampler.chains]
            file = folder / names.DRAWS
            size = file.stat().st_size if file.exists() else 0
            seen.note(memory(), sum(len(each.draws) for each in records), size, records[0].thin)

        with session.sampler:
            session.carry_out(StopRule(steps=n_rounds * block), look, lambda: False)
    return seen.trace()


def cool(n_rounds: int, memory: Callable[[], float] = resident, block: int = 200) -> Trace:
    """Cool towards the best map of the demo office in so many rounds; return what was seen at each."""
    seen = _Seen(n_rounds)
    with shortened(block):
        settings = sessions.read_prepared(str(LOG), SampleConfig(every_scan=10, every_beam=10)).settings
        anneal(
            settings,
            spawn_generators(1, CHAINS),
            Goal(steps=n_rounds * block),
            on_progress=lambda *_: seen.note(memory(), 0, 0, 0),
        )
    return seen.trace()


class _Seen:
    """What is seen round by round, in an array that is there from the start: a list would pass for a leak."""

    def __init__(self, n_rounds: int) -> None:
        self.rows = np.full((n_rounds + 1, 4), -1.0)
        self.n = 0

    def note(self, *row: float) -> None:
        self.rows[self.n] = row
        self.n += 1

    def trace(self) -> Trace:
        memory, *counts = self.rows[: self.n].T.copy()
        return Trace(memory, *(column.astype(np.int64) for column in counts))


def growth(memory: NDArray[np.float64]) -> float:
    """Return by how much memory grew, MB: the median of the last third less that of the middle third.

    The first third is left out: there the map grows from nothing, and caches fill.
    """
    third = len(memory) // 3
    return float(np.median(memory[-third:]) - np.median(memory[third : 2 * third]))
