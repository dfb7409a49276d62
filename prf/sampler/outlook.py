"""How much longer a run needs until its chains agree, from how it went since half of its steps.

For chains that mix, ESS grows in proportion to the steps and R-hat - 1 falls in inverse proportion, so the ratio by
which a run misses its bounds is the ratio by which it is too short. Where R-hat does not fall, more time alone is no
help.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Literal, NamedTuple

from prf.diagnostics import MAX_RHAT, MAX_RHAT_UNSEEN, Diagnosis, shortfall
from prf.sampler.apart import STALLED

Trend = Literal["agree", "nearing", "flat", "unknown"]

NICE = (1, 2, 3, 4, 5, 6, 8, 10, 15, 20, 30, 45)
"""Seconds in tens, minutes and hours that people give."""


class Outlook(NamedTuple):
    """Whether more time will bring agreement."""

    trend: Trend  # "agree", or the chains come nearer ("nearing") or do not ("flat"), or it cannot be said ("unknown")
    seconds: float | None  # more of them that it needs, if they come nearer


def outlook(half: Mapping[str, Diagnosis], now: Mapping[str, Diagnosis], seconds: float, climbs: bool) -> Outlook:
    """Return whether more time will bring agreement."""
    failing = {name: found for name, found in now.items() if not found.agrees()}
    if not failing:
        return Outlook("agree", None)
    if any(found.state in ("short", "not finite") for found in (*half.values(), *now.values())):
        return Outlook("unknown", None)
    if _stays(half, failing):
        return Outlook("unknown" if climbs else "flat", None)
    factor = max(shortfall(found) for found in failing.values())
    return Outlook("nearing", rounded((factor - 1.0) * seconds)) if math.isfinite(factor) else Outlook("unknown", None)


def _stays(half: Mapping[str, Diagnosis], failing: Mapping[str, Diagnosis]) -> bool:
    """Return whether the worst R-hat of those that fail by it is about what it was after half of the steps."""
    bounds = {name: MAX_RHAT if found.seen else MAX_RHAT_UNSEEN for name, found in failing.items()}
    by_rhat = [name for name, found in failing.items() if not found.rhat < bounds[name]]
    now = max((failing[name].rhat for name in by_rhat), default=1.0)
    was = max((half[name].rhat for name in by_rhat if not math.isnan(half[name].rhat)), default=1.0)
    return math.isinf(now) or now - 1.0 > STALLED * (was - 1.0)


def rounded(seconds: float) -> float:
    """Return a time of few digits that is not shorter, or hardly."""
    for unit in (10.0, 60.0, 3600.0):
        for number in NICE:
            if number * unit >= 0.99 * seconds:
                return number * unit
    return 86400.0 * math.ceil(seconds / 86400.0)
