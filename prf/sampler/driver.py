"""The driver: rounds of all chains until a stop rule holds, with checks of agreement and checkpoints on the way."""

from __future__ import annotations

import dataclasses
import logging
import math
import time
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

from prf.results import Progress, Status
from prf.results.convergence import Diagnosis, verdict
from prf.sampler.chains import Sampler

if TYPE_CHECKING:
    from prf.output.run import Run
    from prf.sampler.session import Session

LONGEST = 1800.0
"""Seconds after which a run without a goal of its own gives up on agreement."""
CHECK_GROWTH = 1.1
"""Agreement is checked at steps that grow by this factor: the cost stays a small share, and the steps at which a run
can stop do not depend on the clock or on the number of threads."""
START_SHARE = 0.3
"""Share of the time that the search for starts may take at most."""
CHECKPOINT_SECONDS = 60.0
"""Sampling between two checkpoints: what a killed run loses at most."""

logger = logging.getLogger(__name__)


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
    session: Session, rule: StopRule, on_progress: Callable[[Session], None], stop_requested: Callable[[], bool]
) -> Run:
    """Advance the chains until `rule` holds or `stop_requested`, writing checkpoints and at last the RUN."""
    sampler, first_step = session.sampler, session.sampler.step
    session.prepare_folder()
    session.progress = session.progress._replace(step=first_step)
    if first_step == 0 and sampler.chains[0].starts_from != "empty":
        logger.info("finding maps to start from ...")
    for progress in rounds(sampler, rule, stop_requested, session.seconds_to_finish):
        session.progress = progress
        on_progress(session)
        if progress.status == "running" and stop_requested():
            session.progress = progress._replace(status="interrupted")
            break
        if progress.status == "running" and session.seconds_since_written() > CHECKPOINT_SECONDS:
            session.write(picture=False)
    finished = session.read_finished() if sampler.step == first_step else None
    return session.write(picture=True) if finished is None else finished


def rounds(
    sampler: Sampler,
    rule: StopRule,
    stop_requested: Callable[[], bool] = lambda: False,
    reserve: Callable[[], float] = lambda: 0.0,
) -> Iterator[Progress]:
    """Advance the chains round by round until the goal is reached; yield after every round.

    Chains that have made no step find their starts first; `stop_requested` cuts that short, and so does the clock where
    time is the goal. A run of a number of steps does not look at the clock. Where the clock decides, `reserve` seconds
    are left at the end, and the last round is the one whose end is nearest to that. Steps are rounded up to whole
    rounds. The caller may leave at any time: after a round the chains are in a state that a checkpoint can hold.
    """
    sampler.compile()
    start, first_step = time.monotonic(), sampler.step
    if first_step == 0:
        latest = start + START_SHARE * rule.longest
        sampler.find_starts(lambda: stop_requested() or time.monotonic() > latest)
    diagnoses: dict[str, Diagnosis] | None = None
    status = rule.status(first_step, 0.0, None)
    while status == "running":
        begun, steps = time.monotonic(), sampler.next_steps
        sampler.advance()
        is_checked = is_check(sampler)
        diagnoses = sampler.diagnose() if is_checked else diagnoses
        now = time.monotonic()
        seconds = now - start
        planned = seconds + 0.5 * (now - begun) * sampler.next_steps / steps + reserve()
        status = rule.status(sampler.step, planned, diagnoses if is_checked else None)
        speed = (sampler.step - first_step) * len(sampler.chains) / max(seconds, 1e-9)
        yield Progress(sampler.step, seconds, speed, rule.share(sampler.step, planned, diagnoses), diagnoses, status)


def is_check(sampler: Sampler) -> bool:
    """Return whether agreement is checked after the present round."""
    block, check = sampler.step // sampler.block, 1
    while check < block:
        check = max(check + 1, int(check * CHECK_GROWTH))
    return check == block
