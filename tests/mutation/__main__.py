"""``python -m tests.mutation``: make small mistakes in the sources whose numbers matter most, and see that tests fail.

Prints each mistake that no test noticed, and a line a source. A mistake that changes no number is listed in
``equivalent.toml`` with the reason. ``--share 0.1 --seed 1`` tries a tenth of them. What was noticed is kept in
``build/mutants.jsonl`` and not tried again while its source stands; ``--anew`` forgets it.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import resource
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from tests.mutation.equivalent import read_equivalent
from tests.mutation.guards import GROUPS, Guard
from tests.mutation.host import ELSEWHERE, KILLED, SURVIVED, Verdict, run_host
from tests.mutation.ledger import DEFAULT, Ledger
from tests.mutation.mistakes import Mistake, altered, mistakes
from tests.mutation.run import in_fork, path_of, run_guard, warm

LIMIT = 300.0
"""CPU seconds that all checks of a guard may take in a process of their own."""


class Tally(NamedTuple):
    """What came of the mistakes in one source.

    Attributes
    ----------
    possible, chosen : int
        All that can be made, and those that fell in the share.
    killed, equivalent : int
        Noticed by a test; known to change nothing.
    survivors : list of str
    seconds : float
        CPU time.
    """

    possible: int
    chosen: int
    killed: int
    equivalent: int
    survivors: list[str]
    seconds: float


def main() -> int:
    """Return 1 if a mistake survived that is not known to change nothing."""
    asked = parse()
    guards = [guard for name in asked.group or GROUPS for guard in GROUPS[name]]
    guards = [guard for guard in guards if not asked.module or guard.module in asked.module]
    warm()
    ledger = Ledger(asked.ledger, anew=asked.anew)
    tallies = []
    with tempfile.TemporaryDirectory() as folder:
        states = Path(folder) / "states"
        if any(guard.moves for guard in guards):
            make_states(states)
        for guard in guards:
            tally = try_guard(guard, asked.share, asked.seed, states, ledger)
            tallies.append(tally)
            print(f"{guard.module}: {told(tally)}", flush=True)
    whole = Tally(*(sum(column, type(column[0])()) for column in zip(*tallies, strict=True)))
    print(f"all: {told(whole)}")
    return int(bool(whole.survivors))


def parse() -> argparse.Namespace:
    """Return what the command line asks for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--group", choices=list(GROUPS), action="append", help="only these sources, repeatable")
    parser.add_argument("--module", action="append", help="only this source, repeatable")
    parser.add_argument("--share", type=float, default=1.0, help="of the mistakes to try")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--ledger", type=Path, default=DEFAULT, help="file of what came of mistakes so far")
    parser.add_argument("--anew", action="store_true", help="forget what the ledger holds")
    asked = parser.parse_args()
    if os.environ.get("NUMBA_DISABLE_JIT") != "1":
        parser.error("kernels must not be compiled. Set NUMBA_DISABLE_JIT=1 (make mutants does).")
    return asked


def told(tally: Tally) -> str:
    return (
        f"{tally.chosen} of {tally.possible} mistakes, {tally.killed} noticed, {tally.equivalent} known to change "
        f"nothing, {len(tally.survivors)} survived; {tally.seconds:.0f} CPU s"
    )


def make_states(path: Path) -> None:
    """Write the chains that ratios are checked on, in a process of their own: this one must not import the project."""

    def write() -> int:
        from tests.mutation.ratios import write_states

        write_states(path)
        return 0

    outcome = in_fork(write, 600.0)
    assert outcome.survived, outcome.said


def try_guard(guard: Guard, share: float, seed: int, states: Path, ledger: Ledger) -> Tally:
    """Try mistakes in one source.

    A mistake in the code of a function is made in a fork of a process that has imported everything; of one elsewhere a
    process of its own imports the altered source.
    """
    source, begin = path_of(guard.module).read_text(), _seconds()
    possible = mistakes(source, borders=guard.borders)
    rng = random.Random(f"{seed} {guard.module}")
    chosen = {str(one): one for one in possible if rng.random() < share}
    known = read_equivalent(guard.module)
    n_equivalent = sum(name in known for name in chosen)
    killed = ledger.killed(guard.module, source) & chosen.keys()
    open_ones = [one for name, one in chosen.items() if name not in known and name not in killed]
    survivors = []
    for verdict in hosted(guard, source, open_ones, states):
        if verdict.outcome == ELSEWHERE:
            alone = run_guard(guard, altered(source, chosen[verdict.mistake]), LIMIT, states)
            verdict = Verdict(verdict.mistake, SURVIVED if alone.survived else KILLED, "alone")
        ledger.note(guard.module, source, *verdict)
        if verdict.outcome == SURVIVED:
            print(f"survived {guard.module} {verdict.mistake}", flush=True)
            survivors.append(verdict.mistake)
    n_killed = len(chosen) - n_equivalent - len(survivors)
    return Tally(len(possible), len(chosen), n_killed, n_equivalent, survivors, _seconds() - begin)


def hosted(guard: Guard, source: str, chosen: list[Mistake], states: Path) -> Iterator[Verdict]:
    """Yield what comes of each mistake in a fork of a process that has imported the project, itself a fork of this one.

    Raises
    ------
    AssertionError
        If a check fails on the intact source.
    """
    if not chosen:
        return
    reader, writer = os.pipe()
    sys.stdout.flush()
    child = os.fork()
    if child == 0:
        os.close(reader)
        stream = os.fdopen(writer, "w", buffering=1)
        failed = run_host(guard, source, chosen, states, lambda verdict: print(json.dumps(verdict), file=stream))
        print(json.dumps(failed), file=stream)
        stream.flush()
        os._exit(0)
    os.close(writer)
    with os.fdopen(reader) as stream:
        for line in stream:
            told = json.loads(line)
            if isinstance(told, list):
                yield Verdict(*told)
            else:
                assert not told, f"{guard.module}: {told} fails on the intact source"
    os.waitpid(child, 0)


def _seconds() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


if __name__ == "__main__":
    sys.exit(main())
