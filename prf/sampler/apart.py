"""Whether chains stay apart: what `--set sampler.rungs=auto` waits for before it puts rungs below them.

Chains that disagree may be on their way, slow, or caught in different readings of the data. What separates these is
what more steps do: R-hat - 1 of chains that mix halves, or better, when a run doubles, and chains on their way come
nearer too; for chains that are caught it stays. So it is looked at 640,000 steps and at every doubling, and compared
with what it was at half of the steps. Nothing of this looks at a clock or outlives a look: it follows from the draws.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

from prf.diagnostics import MAX_RHAT, Diagnosis

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


def stay_apart(before: Iterable[Diagnosis], now: Iterable[Diagnosis]) -> bool:
    """Return whether chains disagree and do not come nearer."""
    was, found = worst_rhat(before), worst_rhat(now)
    return found > MAX_RHAT and (math.isinf(found) or found - 1.0 > STALLED * (was - 1.0))
