"""The sampler on 29,120 simulated sonar readings: steps per second beside a likelihood from scratch, time to agreement.

Run it from the repository's root::

    python -m benchmarks.sonar [--quick] [--minutes M] [-o FOLDER]

An office of 60 x 40 m and the drive through it come from `prf simulate`; `prf sample` then runs until its stop rule is
met, or for the minutes given. How far the image is from settled is also shown by the chains' own images.
"""

from __future__ import annotations

import math
import os
import statistics
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import commands, worlds
from benchmarks.loops import bench
from prf.configuration import Configuration
from prf.kernels import constants as c
from prf.kernels.accept import log_proposal_ratio
from prf.kernels.readings.cones import CONE_LOG_LIKELIHOOD, sense
from prf.kernels.readings.sonar_change import sonar_change, touch_cones
from prf.kernels.state.chain import Chain
from prf.kernels.state.crossing import is_valid
from prf.kernels.state.prior import log_prior_change
from prf.kernels.state.proposal import N_LOOP
from prf.kernels.state.sites import any_inside
from prf.kernels.step import choose_move, propose
from prf.model.coloring import Draws
from prf.output.run import read_run
from prf.readings import read_readings
from prf.results.estimate import occupied_probability
from prf.sampler.prepare import prepare, read_prepared
from prf.sampler.session import Session, StopRule, drive
from prf.sampler.target import Target

READINGS = 29_120
QUICK_READINGS = 4_800
SHORT: dict[str, commands.Option] = {"size": [20.0, 14.0]}
BURN_IN = 300_000
PROPOSALS = 20_000
PROPOSALS_FROM_SCRATCH = 200
DRAWS = 50
"""Of a chain, for its image."""
SPACING = 0.25
"""Metres between the points at which the chains' images are compared."""


@bench
def decide(chain: Chain, rng: np.random.Generator, n: int, from_scratch: bool, changes: np.ndarray) -> int:
    """Weigh `n` proposals to the map as it stands; fill `changes` of the log likelihood, return how many are valid."""
    graph, proposal, cones = chain.graph, chain.proposal, chain.cones
    valid = 0
    for _ in range(n):
        move = choose_move(chain.move_probabilities, rng)
        legal, log_forward, log_reverse = propose(chain, move, rng)
        if not legal or not is_valid(graph, chain.edge_index, proposal):
            continue
        ratio = log_proposal_ratio(chain.move_probabilities, move, log_forward, log_reverse)
        if ratio == -math.inf or any_inside(chain.sensors, proposal.loop, proposal.counts[N_LOOP]):
            continue
        ratio += log_prior_change(graph, proposal, chain.density[c.SCALE], chain.lines)
        if from_scratch:
            change = 0.0
            for cone in range(cones.pose.shape[0]):
                change += sense(graph, chain.edge_index, cones, cone, proposal, True)[1]
                change -= cones.pose[cone, CONE_LOG_LIKELIHOOD]
        else:
            touch_cones(graph, chain.edge_index, cones, proposal)
            change = sonar_change(graph, chain.edge_index, cones, proposal)
        changes[valid] = change
        valid += 1
    return valid


def target_of(log: Path) -> Target:
    """Return what `prf sample --sonar LOG` samples from, without its image."""
    prepared = prepare(Configuration.of(), None, read_readings(str(log), kind="sonar"))
    return prepared.target.with_execution(resolution=None)


def rates(log: Path, seed: int, burn_in: int) -> dict[str, Any]:
    """Return steps per second of the sampler's loop, and its ratio to deciding from scratch."""
    target = target_of(log)
    rng = np.random.default_rng(seed)
    chain = worlds.start(target)
    chain = worlds.advance(chain, rng, burn_in)
    spent = []
    for _ in range(5):
        seconds, chain = worlds.cpu(lambda: worlds.advance(chain, rng, burn_in // 5))  # noqa: B023
        spent.append(seconds / (burn_in // 5))
    weighing, largest = compared(chain, seed)
    return {
        "readings": len(chain.cones.pose),
        "edges": int(chain.graph.counts[c.EDGES]),
        "steps_per_second": 1.0 / statistics.median(spent),
        "ratio_to_scratch": weighing[1] / weighing[0],
        "largest_difference": largest,
    }


def compared(chain: Chain, seed: int) -> tuple[list[float], float]:
    """Return seconds a proposal of both ways to weigh it, and the largest difference of what they find."""
    found = []
    seconds = []
    for from_scratch, n in ((False, PROPOSALS), (True, PROPOSALS_FROM_SCRATCH)):
        changes = np.zeros(n)
        decide(worlds.copy(chain), np.random.default_rng(seed), 1, from_scratch, changes)
        spent, valid = worlds.cpu(
            lambda: decide(worlds.copy(chain), np.random.default_rng(seed), n, from_scratch, changes)  # noqa: B023
        )
        seconds.append(spent / n)
        found.append(changes[:valid])
    n_both = min(len(changes) for changes in found)
    both = [np.nan_to_num(changes[:n_both], neginf=-1e300) for changes in found]
    return seconds, float(np.abs(both[0] - both[1]).max())


def sampled(log: Path, folder: Path, seconds: float, seed: int, threads: int) -> dict[str, Any]:
    """Sample until the stop rule is met, or for `seconds`; return how it ended."""
    prepared = read_prepared((), Configuration.of(), [str(log)])
    session = Session.start([str(log)], prepared, folder, seed, threads or os.cpu_count() or 1)
    session.open()
    with ThreadPoolExecutor(threads or os.cpu_count()) as pool:
        for found in drive(session.ensemble, StopRule(limit=seconds), pool.map):
            session.progress = found
    run = session.finish()
    end = run.progress
    assert run.diagnostics is not None
    assert end is not None
    return {
        "status": end.status,
        "seconds": end.seconds,
        "steps": end.step,
        "steps_per_second": end.steps_per_second,
        "reason": run.diagnostics["reason"],
        "functionals": run.diagnostics["functionals"],
    }


def settled(folder: Path) -> dict[str, Any]:
    """Return how far the chains' images differ, over the points of which any chain is sure."""
    run = read_run(folder)
    window = run.draws.window
    x, y = (np.arange(low + SPACING, high, SPACING) for low, high in (window[::2], window[1::2]))
    points = np.stack([axis.ravel() for axis in np.meshgrid(x, y)], axis=1)
    images = []
    for number in np.unique(run.chain):
        (mine,) = np.nonzero(run.chain == number)
        taken = mine[np.linspace(0, len(mine) - 1, min(len(mine), DRAWS)).astype(int)]
        images.append(occupied_probability(Draws.from_colorings([run.draws[i] for i in taken], window), points))
    image = np.array(images)
    sure = (np.minimum(image, 1.0 - image) < 0.05).any(axis=0)
    spread = (image.max(axis=0) - image.min(axis=0))[sure]
    return {
        "points": int(sure.sum()),
        "mean_spread": float(spread.mean()),
        "share_over_half": float((spread > 0.5).mean()),
    }


def main() -> None:
    """Simulate, measure, sample."""
    asked = commands.parser(__doc__)
    asked.add_argument("--minutes", type=float, default=5.0, help="of sampling at most")
    arguments = commands.parse(asked)
    folder = arguments.output / "sonar"
    readings = QUICK_READINGS if arguments.quick else READINGS
    world = commands.prf(
        "simulate",
        "--sonar",
        "--no-laser",
        "--force",
        seed=arguments.seed,
        readings=readings,
        output=folder / "world",
        **(SHORT if arguments.quick else {}),
    )
    log = folder / "world" / "sonar.csv.gz"
    commands.say("steps per second")
    result = {"world": world, "rates": rates(log, arguments.seed, BURN_IN // (6 if arguments.quick else 1))}
    commands.say("until the chains agree")
    seconds = 60.0 * (0.3 if arguments.quick else arguments.minutes)
    run = sampled(log, folder / "run", seconds, arguments.seed, arguments.threads)
    result |= {"run": run, "chains_apart": settled(folder / "run")}
    commands.say(f"{result['rates']}")
    commands.say(f"{run['status']} after {run['seconds']:.0f} s, {run['steps']:,} steps a chain ({run['reason']})")
    commands.say(f"{result['chains_apart']}")
    commands.write_table(folder / "sonar.json", result)


if __name__ == "__main__":
    main()
