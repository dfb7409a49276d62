"""One run of the sampler on the demo's office, its image at given times; for :mod:`benchmarks.office_time`.

Run as a file, it measures whatever `prf` stands first on the path: an earlier revision has this script too, or is
given it. It uses nothing of the other benchmarks.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np

from prf.configuration import Configuration
from prf.readings import read_readings
from prf.sampler.chains import Sampler
from prf.sampler.prepare import prepare
from prf.shell.cli.provenance import spawn_generators

THREADS = 2


def seconds_now() -> float:
    """Return the time that two quiet cores would have needed so far: the process's, spread over both."""
    return time.process_time() / THREADS


def main(log: Path, output: Path, times: list[float], seed: int, chains: int) -> None:
    """Sample for as long as the last of `times` (seconds on two cores) and store the image of each."""
    prepared = prepare(Configuration.of(), read_readings(str(log)))
    with Sampler(prepared.settings, spawn_generators(seed, chains), THREADS) as sampler:
        sampler.compile()
        start = seconds_now()
        sampler.find_starts(lambda: False)
        images, steps, taken = [], [], []
        for goal in times:
            while seconds_now() - start < goal:
                sampler.advance()
            images.append(sampler.occupancy()[0])
            steps.append(sampler.step)
            taken.append(seconds_now() - start)
    np.savez(output, images=np.array(images), steps=steps, seconds=taken)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]), [float(t) for t in sys.argv[3].split(",")], *map(int, sys.argv[4:6]))
