"""``python -m tests.load day|edges|beams|patches``: carry a large job through, and print what its stages took.

Seconds are of CPU. Memory is resident, the most during a stage and what was left at its end; figures of the
project are in docs/load.md.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

from tests.load import beams, edges, patches, steady
from tests.load.meter import Meter
from tests.load.plot import draw

COUNTS = {"day": 1440, "edges": 10_000, "beams": 1_000_000, "patches": 1_000_000}
HEAD = "| stage | CPU s | most MB | left MB | |\n|---|---|---|---|---|"


def main() -> None:
    """Run one job."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("job", choices=COUNTS)
    parser.add_argument("--count", type=int, help="checkpoints, edges, beams or patches")
    parser.add_argument("--steps", type=int, default=20_000, help="of each chain, where maps are sampled")
    parser.add_argument("--rounds", type=int, default=50_000, help="of a day, without a checkpoint")
    parser.add_argument("--plot", type=Path, default=Path("load-memory.png"), help="of a day")
    parser.add_argument("--folder", help="where the files of the job go, which are removed")
    asked = parser.parse_args()
    count = asked.count or COUNTS[asked.job]
    with tempfile.TemporaryDirectory(dir=asked.folder) as name:
        folder = Path(name)
        if asked.job == "day":
            run_day(count, asked.rounds, folder, asked.plot)
            return
        print(HEAD)
        meter = Meter()
        if asked.job == "edges":
            print(f"{edges.run(count, asked.steps, folder, meter):,} edges in the best map")
        elif asked.job == "beams":
            beams.run(count, asked.steps, folder, meter)
        else:
            patches.run(count, folder, meter)


def run_day(n_checkpoints: int, n_rounds: int, folder: Path, picture: Path) -> None:
    """Print by how much memory grew, and draw it."""
    sampled = steady.sample(n_checkpoints, folder / "checkpoints")
    rounds = steady.sample(n_rounds, folder / "rounds", checkpoints=False, block=200)
    cooled = steady.cool(n_rounds)
    for name, trace in (("checkpoints", sampled), ("rounds", rounds), ("rounds of anneal", cooled)):
        grown, least = steady.growth(trace.memory), trace.memory[len(trace.memory) // 3]
        print(f"{len(trace.memory):,} {name}: {grown:+.2f} MB of {least:.0f} MB")
    print(
        f"draws at most {sampled.draws.max()} of {steady.CHAINS} chains (cap {steady.CHAINS * steady.MOST}); "
        f"{sampled.bytes.max() / 1e3:.0f} kB at most, {sampled.bytes[-1] / 1e3:.0f} kB at the end; "
        f"spacing {steady.THIN} to {sampled.spacing[-1]} steps"
    )
    for speed in (20_000.0, 200_000.0):
        print(f"a day at {speed:,.0f} steps a second and chain: {steady.day(speed)}")
    draw(sampled, rounds, cooled, picture)


if __name__ == "__main__":
    main()
