"""How much longer a run needs until its chains agree, from how it went since half of its steps.

For chains that mix, ESS grows in proportion to the steps and R-hat - 1 falls in inverse proportion, so the ratio by
which a run misses its bounds is the ratio by which it is too short. Where R-hat does not fall, more time alone is no
help.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Literal, NamedTuple

from prf.diagnostics import Diagnosis, shortfall
from prf.sampler.apart import stay_apart

Trend = Literal["agree", "nearing", "flat", "unknown"]

NICE = (1, 2, 3, 4, 5, 6, 8, 10, 15, 20, 30, 45)
"""Seconds in tens, minutes and hours that people give."""


class Outlook(NamedTuple):
    """Whether more time will bring agreement.

    Attributes
    ----------
    trend : str
        "agree", or the chains come nearer ("nearing") or do not ("flat"), or it cannot be said ("unknown").
    seconds : float or None
        More of them that it needs, if they come nearer.
    """

    trend: Trend
    seconds: float | None


def outlook(half: Mapping[str, Diagnosis], now: Mapping[str, Diagnosis], seconds: float) -> Outlook:
    """Return whether more time will bring agreement.

    Parameters
    ----------
    half, now : mapping of str to Diagnosis
        After half of the steps and after all.
    seconds : float
        That all took.
    """
    failing = {name: found for name, found in now.items() if not found.agrees()}
    if not failing:
        return Outlook("agree", None)
    if any(found.state in ("short", "not finite") for found in (*half.values(), *now.values())):
        return Outlook("unknown", None)
    if stay_apart(half.values(), now.values()):
        return Outlook("flat", None)
    factor = max(shortfall(found) for found in failing.values())
    return Outlook("nearing", rounded((factor - 1.0) * seconds)) if math.isfinite(factor) else Outlook("unknown", None)


def rounded(seconds: float) -> float:
    """Return a time that is not shorter, of few digits."""
    for unit in (10.0, 60.0, 3600.0):
        for number in NICE:
            if number * unit >= seconds:
                return number * unit
    return 86400.0 * math.ceil(seconds / 86400.0)
