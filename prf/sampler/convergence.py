"""Whether more steps will bring agreement, from what R-hat did since half of the steps.

R-hat - 1 of chains that mix halves, or better, when a run doubles, and ESS doubles, so the ratio by which a run
misses its bounds is the ratio by which it is too short. For chains that are caught in different readings of the data
R-hat stays: more time alone is no help. ``sampler.temperatures`` "auto" looks at 640,000 steps and at every doubling,
and tempers chains that disagree. Nothing of this looks at a clock or outlives a look: it follows from the draws.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Literal, NamedTuple

from prf.diagnostics import MAX_RHAT, MAX_RHAT_UNSEEN, Diagnosis, shortfall

FIRST_LOOK = 640_000
"""Steps before the first look; a multiple of every length of a block."""
STALLED = 0.75
"""Of R-hat - 1: more than this share of it left after twice the steps, and the chains do not come nearer."""


def is_look(step: int) -> bool:
    """Return whether it is looked at this step: the first look, or a doubling of it."""
    doublings, rest = divmod(step, FIRST_LOOK)
    return rest == 0 and doublings.bit_count() == 1


def worst_rhat(diagnoses: Iterable[Diagnosis]) -> float:
    """Return the largest R-hat of what was seen, inf if chains are stuck at different values; 1 if there is none.

    Where no reading saw the ground a power of the likelihood changes nothing.
    """
    return max((found.rhat for found in diagnoses if found.seen and not math.isnan(found.rhat)), default=1.0)


def disagree(before: Iterable[Diagnosis], now: Iterable[Diagnosis]) -> bool:
    """Return whether chains disagree and do not come nearer."""
    was, found = worst_rhat(before), worst_rhat(now)
    return found > MAX_RHAT and (math.isinf(found) or found - 1.0 > STALLED * (was - 1.0))


Trend = Literal["agree", "nearing", "flat", "unknown"]

NICE = (1, 2, 3, 4, 5, 6, 8, 10, 15, 20, 30, 45)
"""Seconds in tens, minutes and hours that people give."""


class Outlook(NamedTuple):
    """Whether more time will bring agreement."""

    trend: Trend  # "agree", or the chains come nearer ("nearing") or do not ("flat"), or that is unknown ("unknown")
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
