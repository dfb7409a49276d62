"""The weights of `p_return` (:data:`prf.results.score.returns.WEIGHTS`), fitted on the three logs that scores tune on.

Run it from the repository's root, on the runs that `python -m benchmarks.scores` left in FOLDER::

    python -m benchmarks.returns [-o FOLDER]

Weights have the least nats at the points of held-out scans, each weighing as it does for the scores, each run alike.
The first lines give the nats of each run at the weights that the two other logs give.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from benchmarks import commands
from benchmarks.commands import say
from benchmarks.regression import labelled
from benchmarks.scores import HELD_OUT, MAX_RANGE, SECONDS, SETS, TUNED
from prf.configuration import Configuration
from prf.readings import read_readings
from prf.results.read import read_run_data
from prf.results.score.heldout import CLIP, SQUARE, hold_out
from prf.results.score.returns import WEIGHTS, evidence, returns_of_run
from prf.shell.cli.storage import spawn_generators

Floats = NDArray[np.float64]


class Points(NamedTuple):
    """What is known of the points of held-out beams, and their states."""

    evidence: Floats  # (n, 5)
    clutter: Floats  # (n,)
    occupied: Floats  # (n,)
    weight: Floats  # (n,)

    def nats(self, weights: Floats) -> float:
        """Return the mean negative log probability of the states."""
        p = 1.0 - (1.0 - self.clutter) / (1.0 + np.exp(weights[0] + self.evidence @ weights[1:]))
        p = np.clip(p, CLIP, 1.0 - CLIP)
        return float(-np.average(np.where(self.occupied > 0.5, np.log(p), np.log1p(-p)), weights=self.weight))


def points_of(log: Path, folder: Path, max_range: float | None, seed: int) -> Points:
    """Return the points that `prf score` asks for, in the window of a run."""
    run = read_run_data(folder)
    returns = returns_of_run(run)
    beams = hold_out(read_readings(str(log)), Configuration().replace(max_range=max_range, scans=HELD_OUT))
    points = labelled(beams, run.draws.window, spawn_generators(seed, 1)[0])
    assert returns is not None
    assert points.weight is not None
    known = evidence(run.draws, returns, points.xy, SQUARE)
    inside = np.isfinite(known).all(axis=1)
    columns = known, returns.clutter(points.xy, SQUARE), points.occupied.astype(np.float64), points.weight
    return Points(*(column[inside] for column in columns))


def fitted(several: list[Points]) -> Floats:
    """Return the weights of the least nats, those of 1 first."""
    found = minimize(lambda weights: sum(each.nats(weights) for each in several), np.array(WEIGHTS))
    return np.asarray(found.x)


def main() -> int:
    """Print the weights, and what they are worth on a log that they are not from."""
    options = commands.parse(commands.parser(__doc__, SECONDS))
    found: dict[tuple[str, str], Points] = {}
    for name in TUNED:
        log = commands.log_path(options.data, name)
        for scans in SETS:
            folder = options.output / "scores" / f"{name}-{scans}" / "posterior"
            if log is None or not folder.exists():
                say(f"{folder}: no such run; python -m benchmarks.scores makes it")
                return 1
            found[name, scans] = points_of(log, folder, MAX_RANGE[name], options.seed)
    for (name, scans), points in found.items():
        weights = fitted([other for (log_name, _), other in found.items() if log_name != name])
        print(f"{name}, {scans}: {points.nats(weights):.4f} nats, weights {weights.round(2).tolist()}")
    print(f"all three: weights {fitted(list(found.values())).round(2).tolist()}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
