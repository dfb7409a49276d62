"""``python -m tests.mutation``: make small mistakes in the sources whose numbers matter most, and see that tests fail.

Prints each mistake that no test noticed, and a line a source. A mistake that changes no number is listed in
``equivalent.toml`` with the reason. ``--share 0.1 --seed 1`` tries a tenth of them.
"""

from __future__ import annotations

import argparse
import os
import random
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

from tests.mutation.equivalent import read_equivalent
from tests.mutation.guards import GROUPS, Guard
from tests.mutation.mistakes import Mistake, altered, mistakes
from tests.mutation.run import FACTOR, FIXED, in_fork, path_of, run_guard, warm


class Tally(NamedTuple):
    """What came of the mistakes in one source."""

    tried: int
    equivalent: int
    survivors: list[Mistake]
    seconds: float


def main() -> int:
    """Return 1 if a mistake survived that is not known to change nothing."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--group", choices=list(GROUPS), action="append", help="only these sources, repeatable")
    parser.add_argument("--module", action="append", help="only this source, repeatable")
    parser.add_argument("--share", type=float, default=1.0, help="of the mistakes to try")
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    if os.environ.get("NUMBA_DISABLE_JIT") != "1":
        parser.error("kernels must not be compiled. Set NUMBA_DISABLE_JIT=1 (make mutants does).")
    guards = [guard for name in asked.group or GROUPS for guard in GROUPS[name]]
    guards = [guard for guard in guards if not asked.module or guard.module in asked.module]
    warm()
    n_survivors = 0
    with tempfile.TemporaryDirectory() as folder:
        states = Path(folder) / "states"
        if any(guard.moves for guard in guards):
            make_states(states)
        for guard in guards:
            tally = try_guard(guard, asked.share, random.Random(f"{asked.seed} {guard.module}"), states)
            n_survivors += len(tally.survivors)
            print(
                f"{guard.module}: {tally.tried} mistakes tried, {len(tally.survivors)} survived; "
                f"{tally.equivalent} known to change nothing; {tally.seconds:.0f} CPU s",
                flush=True,
            )
    return int(n_survivors > 0)


def make_states(path: Path) -> None:
    """Write the chains that ratios are checked on, in a process of their own: this one must not import the project."""

    def write() -> int:
        from tests.mutation.ratios import write_states

        write_states(path)
        return 0

    outcome = in_fork(write, 600.0)
    assert outcome.survived, outcome.said


def try_guard(guard: Guard, share: float, rng: random.Random, states: Path) -> Tally:
    """Try mistakes in one source.

    Raises
    ------
    AssertionError
        If the guard fails on the intact source.
    """
    source = path_of(guard.module).read_text()
    intact = run_guard(guard, source, 600.0, states)
    assert intact.survived, f"{guard.module}: the guard fails on the intact source\n{intact.said}"
    known = read_equivalent(guard.module)
    chosen = [one for one in mistakes(source, borders=guard.borders) if rng.random() < share]
    survivors, seconds = [], intact.seconds
    tried = [one for one in chosen if str(one) not in known]
    for mistake in tried:
        outcome = run_guard(guard, altered(source, mistake), FIXED + FACTOR * intact.seconds, states)
        seconds += outcome.seconds
        if outcome.survived:
            print(f"survived {guard.module} {mistake}", flush=True)
            survivors.append(mistake)
    return Tally(len(tried), len(chosen) - len(tried), survivors, seconds)


if __name__ == "__main__":
    sys.exit(main())
