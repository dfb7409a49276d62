"""When to stop: after steps, after seconds, or when the chains agree."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Literal, NamedTuple

from prf.diagnostics import MAX_RHAT, MIN_ESS, Diagnosis, converged
from prf.sampler.several import Sampler

LONGEST = 1800.0
"""Seconds after which a run without a goal of its own gives up on agreement."""
CHECK_GROWTH = 1.1
"""Agreement is checked at steps that grow by this factor: the cost stays a small share, and the steps at which a run
can stop do not depend on the clock or on the number of threads."""

START_SHARE = 0.3
"""Share of the time that the search for starts may take at most."""

Status = Literal["running", "converged", "not converged", "finished", "interrupted"]


@dataclass(frozen=True)
class StopRule:
    """The goal of a run: `steps` a chain, or `seconds` of sampling, or agreement if both are None."""

    steps: int | None = None
    seconds: float | None = None
    limit: float = LONGEST


class Progress(NamedTuple):
    """State of a run after a round."""

    step: int  # steps that each chain has made
    seconds: float  # since the start of sampling, in this process
    steps_per_second: float  # over all chains
    share: float  # of the goal that is reached, in [0, 1]; of the time limit when agreement is the goal
    diagnoses: dict[str, Diagnosis] | None  # the latest check of agreement
    status: Status  # "running" until the last round


def drive(
    sampler: Sampler,
    rule: StopRule,
    stop_requested: Callable[[], bool] = lambda: False,
    reserve: Callable[[], float] = lambda: 0.0,
) -> Iterator[Progress]:
    """Advance the chains round by round until the goal is reached; yield after every round.

    Chains that have made no step find their starts first; `stop_requested` cuts that short, and so does the clock where
    time is the goal. A run of a number of steps does not look at the clock. Where the clock decides, `reserve` seconds
    are left at the end, and the last round is the one whose end comes nearest to that.
    Steps are rounded up to whole rounds. Whoever iterates may leave at any time: after a round the chains are in a
    state that a checkpoint can hold.
    """
    sampler.compile()
    start = time.monotonic()
    first_step = sampler.step
    if first_step == 0:
        latest = start + START_SHARE * (math.inf if rule.steps is not None else rule.seconds or rule.limit)
        sampler.find_starts(lambda: stop_requested() or time.monotonic() > latest)
    diagnoses: dict[str, Diagnosis] | None = None
    status = goal_status(sampler, rule, 0.0, None)
    while status == "running":
        begun, steps = time.monotonic(), sampler.next_steps
        sampler.advance(blocks_ahead(sampler, rule))
        if is_check(sampler):
            diagnoses = sampler.diagnose()
        now = time.monotonic()
        seconds = now - start
        planned = seconds + 0.5 * (now - begun) * sampler.next_steps / steps + reserve()
        status = goal_status(sampler, rule, planned, diagnoses if is_check(sampler) else None)
        speed = (sampler.step - first_step) * len(sampler.chains) / max(seconds, 1e-9)
        yield Progress(sampler.step, seconds, speed, share_done(sampler, rule, planned), diagnoses, status)


def next_check(block: int) -> int:
    """Return the first block from `block` on after which agreement is checked."""
    check = 1
    while check < block:
        check = max(check + 1, int(check * CHECK_GROWTH))
    return check


def is_check(sampler: Sampler) -> bool:
    """Whether agreement is checked after the present round."""
    block = sampler.step // sampler.block
    return next_check(block) == block


def blocks_ahead(sampler: Sampler, rule: StopRule) -> int:
    """Return the blocks to the next step at which something may be decided."""
    block = sampler.step // sampler.block
    ahead = next_check(block + 1) - block
    if rule.steps is not None:
        ahead = min(ahead, math.ceil((rule.steps - sampler.step) / sampler.block))
    return max(1, ahead)


def share_done(sampler: Sampler, rule: StopRule, seconds: float) -> float:
    """Return the share of the goal that is reached; `seconds` as for :func:`goal_status`."""
    if rule.steps is not None:
        return min(1.0, sampler.step / max(rule.steps, 1))
    return min(1.0, seconds / max(rule.seconds if rule.seconds is not None else rule.limit, 1e-9))


def goal_status(sampler: Sampler, rule: StopRule, seconds: float, checked: dict[str, Diagnosis] | None) -> Status:
    """Return "running", or how the run ends here; `seconds`: those spent, half of the next round and the reserve."""
    if rule.steps is not None:
        return "finished" if sampler.step >= rule.steps else "running"
    if rule.seconds is not None:
        return "finished" if seconds >= rule.seconds else "running"
    if checked is not None and converged(checked, MAX_RHAT, MIN_ESS):
        return "converged"
    return "not converged" if seconds >= rule.limit else "running"
