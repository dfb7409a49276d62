"""The one loop: rounds of all chains until a stop rule holds, with checks of agreement on the way."""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Callable, Iterator
from itertools import repeat

from prf.results import Progress, Status
from prf.results.convergence import Diagnosis, verdict
from prf.sampler.chain import ChainRun
from prf.sampler.ensemble import Ensemble
from prf.shell.scheduler import Workers

LONGEST = 1800.0
"""Seconds after which a run without a goal of its own gives up on agreement."""
CHECK_GROWTH = 1.1
"""Agreement is checked at steps that grow by this factor: the cost stays a small share, and the steps at which a run
can stop do not depend on the clock or on the number of threads."""
START_SHARE = 0.3
"""Share of the time that the search for starts may take at most."""


@dataclasses.dataclass(frozen=True)
class StopRule:
    """The goal of a run: `steps` a chain, or `seconds` of sampling, or agreement if both are None."""

    steps: int | None = None
    seconds: float | None = None
    limit: float = LONGEST

    @property
    def longest(self) -> float:
        """Seconds that a run may take; inf where steps are the goal."""
        return math.inf if self.steps is not None else self.limit if self.seconds is None else self.seconds

    def share(self, step: int, seconds: float, checked: dict[str, Diagnosis] | None = None) -> float:
        """Return the share of the goal that is reached; of agreement, by what the worst diagnosis falls short."""
        done = step / max(self.steps, 1) if self.steps is not None else seconds / max(self.longest, 1e-9)
        if checked and self.steps is None and self.seconds is None:
            done = max(done, min(0.99, 1.0 / max(1.0, *(found.shortfall() for found in checked.values()))))
        return min(1.0, done)

    def status(self, step: int, seconds: float, checked: dict[str, Diagnosis] | None) -> Status:
        """Return "running", or how the run ends here, given the diagnoses if agreement is checked here."""
        if self.steps is not None:
            return "finished" if step >= self.steps else "running"
        if self.seconds is not None:
            return "finished" if seconds >= self.seconds else "running"
        if checked is not None and verdict(checked).converged:
            return "converged"
        return "not converged" if seconds >= self.limit else "running"


def drive(
    ensemble: Ensemble,
    rule: StopRule,
    workers: Workers = map,
    stop_requested: Callable[[], bool] = lambda: False,
    reserve: Callable[[], float] = lambda: 0.0,
) -> Iterator[Progress]:
    """Advance the chains round by round until the goal is reached; yield after every round.

    Each round of a chain is a task of `workers`, in threads or on a Dask scheduler; :func:`map` does one by one.

    Chains that have made no step find their starts first; `stop_requested` cuts that short, and so does the clock where
    time is the goal. A run of a number of steps does not look at the clock. Where the clock decides, `reserve` seconds
    are left at the end, and the last round is the one whose end is nearest to that. Steps are rounded up to whole
    rounds. The caller may leave at any time: after a round the chains are in a state that a checkpoint can hold.
    """
    ensemble.compile()
    start, first_step = time.monotonic(), ensemble.step
    if first_step == 0:
        seconds = START_SHARE * rule.longest
        starts = workers(ChainRun.find_start, ensemble.chains, repeat(seconds), repeat(stop_requested))
        ensemble.chains = list(starts)
    diagnoses: dict[str, Diagnosis] | None = None
    status = rule.status(first_step, 0.0, None)
    while status == "running":
        begun, steps = time.monotonic(), ensemble.next_steps
        ensemble.begin_round()
        ensemble.end_round(list(workers(ChainRun.advance, ensemble.chains)))
        is_checked = is_check(ensemble)
        diagnoses = ensemble.diagnose() if is_checked else diagnoses
        now = time.monotonic()
        seconds = now - start
        planned = seconds + 0.5 * (now - begun) * ensemble.next_steps / steps + reserve()
        status = rule.status(ensemble.step, planned, diagnoses if is_checked else None)
        speed = (ensemble.step - first_step) * len(ensemble.chains) / max(seconds, 1e-9)
        yield Progress(ensemble.step, seconds, speed, rule.share(ensemble.step, planned, diagnoses), diagnoses, status)


def is_check(ensemble: Ensemble) -> bool:
    """Return whether agreement is checked after the present round."""
    block, check = ensemble.step // ensemble.block, 1
    while check < block:
        check = max(check + 1, int(check * CHECK_GROWTH))
    return check == block
