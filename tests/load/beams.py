"""A log of a million beams: described, thinned or not, sampled, cooled, made a grid of, scored."""

from __future__ import annotations

import contextlib
import math
from pathlib import Path

import numpy as np

from prf.arak import exact_draws
from prf.coloring import Coloring
from prf.simulate.laser import LaserPhysics
from prf.window import Window
from tests.load.edges import EDGES_A_METRE, SCALE, call, write_log
from tests.load.meter import Meter

N_EDGES = 400


def world() -> Coloring:
    """Return the map that the laser reads."""
    side = math.sqrt(N_EDGES / EDGES_A_METRE)
    return exact_draws(SCALE, Window(0.0, 0.0, side, side), 1, np.random.default_rng(1))[0]


def run(n_beams: int, steps: int, folder: Path, meter: Meter) -> None:
    """Carry a log of about so many beams through every verb that reads one."""
    coloring = world()
    side = coloring.window.x_max
    with meter.stage("simulate and write the log") as note:
        note.append(f"{write_log(folder / 'log.csv', coloring, n_beams // LaserPhysics().beams):,} beams")
        note.append(f"{(folder / 'log.csv').stat().st_size / 1e6:.0f} MB")
    place = f"--laser log.csv --window 0 0 {side} {side}"
    with contextlib.chdir(folder):
        call(meter, "info log.csv")
        budget = f"--chains 2 --steps {steps} --seed 1"
        call(meter, f"sample --no-thinning {budget} {place} -o whole")
        call(meter, f"sample {budget} {place} -o thinned")
        call(meter, f"anneal {budget} {place} -o best.geojson")
        call(meter, f"grid {place} -o grid.npz")
        call(meter, "score thinned --laser log.csv --seed 1")
        call(meter, "score grid.npz --laser log.csv --seed 1")
