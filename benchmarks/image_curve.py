"""One run of the sampler on the demo's office, its image at given times; for :mod:`benchmarks.office_time`.

Run as a file, it measures whatever `prf` stands first on the path: an earlier revision has this script too, or is
given it. It uses nothing of the other benchmarks.
"""

from __future__ import annotations

import math
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np

from prf.configuration import Configuration
from prf.readings import read_readings
from prf.sampler.ensemble import Ensemble
from prf.sampler.prepare import prepare
from prf.sampler.session import StopRule, drive
from prf.shell.cli.storage import spawn_generators

THREADS = 2


def seconds_now() -> float:
    """Return the time that two quiet cores would have needed so far: the process's, spread over both."""
    return time.process_time() / THREADS


def main(log: Path, output: Path, times: list[float], seed: int, chains: int) -> None:
    """Sample for as long as the last of `times` (seconds on two cores) and store the image of each."""
    prepared = prepare(Configuration.of(), read_readings(str(log)))
    ensemble = Ensemble(prepared.target, spawn_generators(seed, chains), threads=THREADS)
    ensemble.compile()
    start = seconds_now()
    images, steps = [], []
    taken: list[float] = []
    with ThreadPoolExecutor(THREADS) as pool:
        for _ in drive(ensemble, StopRule(seconds=math.inf), pool.map):
            while len(taken) < len(times) and seconds_now() - start >= times[len(taken)]:
                images.append(ensemble.occupancy()[0])
                steps.append(ensemble.step)
                taken.append(seconds_now() - start)
            if len(taken) == len(times):
                break
    np.savez(output, images=np.array(images), steps=steps, seconds=taken)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]), [float(t) for t in sys.argv[3].split(",")], *map(int, sys.argv[4:6]))
