"""``python -m tests.killed --moments 100 --seed 1``: kill every verb at random moments, and print what came of it."""

from __future__ import annotations

import argparse
import signal
import sys
import tempfile
from collections import Counter
from pathlib import Path

import numpy as np

from tests.killed.child import ROOT
from tests.killed.moments import Moment, kill_once, run_whole, stop_once
from tests.killed.verbs import VERBS, Verb, make_inputs

STOPPING = (signal.SIGINT, signal.SIGTERM)
STATES = ("absent", "whole", "best so far", "resumable", "wrong")


def main() -> int:
    """Print a table; return 1 if anything was wrong."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--moments", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--signals", action="store_true", help="SIGINT and SIGTERM in turn instead of SIGKILL")
    parser.add_argument("--verb", action="append", help="only this one, repeatable")
    asked = parser.parse_args()
    verbs = [verb for verb in VERBS if not asked.verb or verb.name in asked.verb]
    with tempfile.TemporaryDirectory() as folder:
        moments = kill(verbs, asked.moments, asked.seed, Path(folder), asked.signals)
    for line in table(moments):
        print(line)
    return int(any(moment.faults or moment.state == "wrong" for moment in moments))


def kill(verbs: list[Verb], n_moments: int, seed: int, folder: Path, signals: bool = False) -> list[Moment]:
    """Kill verbs at so many moments in all, shared out by their weights."""
    inputs = folder / "inputs"
    make_inputs(ROOT, inputs)
    turns = [verb for verb in verbs for _ in range(verb.moments)]
    found = []
    for place, verb in enumerate(verbs):
        known = run_whole(verb, inputs, folder / "whole")
        numbers = [number for number in range(n_moments) if turns[number % len(turns)] is verb]
        for number in numbers:
            rng = np.random.default_rng([seed, place, number])
            where = (known, inputs, folder / "killed")
            found.append(stop_once(*where, STOPPING[number % 2], rng) if signals else kill_once(*where, rng))
            moment = found[-1]
            if moment.faults or moment.state == "wrong":
                print(f"{moment.verb} at {moment.share:.3f}: {moment.state}: {'; '.join(moment.faults)}", flush=True)
        print(f"{verb.name}: {known.seconds:.1f} s, {len(numbers)} moments", file=sys.stderr, flush=True)
    return found


def table(moments: list[Moment]) -> list[str]:
    """Return the table: a row a verb, and the sums."""
    lines = [f"{'verb':<28}{'moments':>9}" + "".join(f"{state:>13}" for state in STATES)]
    for name in [*dict.fromkeys(moment.verb for moment in moments), "all"]:
        mine = [moment for moment in moments if name in (moment.verb, "all")]
        counts = Counter(moment.state for moment in mine)
        lines.append(f"{name:<28}{len(mine):>9}" + "".join(f"{counts[state]:>13}" for state in STATES))
    return lines


if __name__ == "__main__":
    sys.exit(main())
