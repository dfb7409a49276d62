"""A log that can be read in two ways: what plain chains say of it, and what tempered ones do.

Run it from the repository's root::

    python -m benchmarks.multimodal [--seeds N] [--steps N] [--temperatures K] [-o PICTURE] [--json FILE] [--log CSV]

A corridor leads through a lobby with a fire door at either end, which the robot never enters. While it is on the left,
the left door stands open and the right one is shut; when it comes back, on the right, it is the other way round. A
static map can have one of the doors shut, not both, for then no beam would reach either: each reading explains the
beams of one pass that end at a door and takes those of the other for outliers, and with both doors open, or both shut,
fifty nats are lost. The sides of the lobby are glass and give no reading.

What the robot reads on the right is the mirror image of what it reads on the left, noise included; so are window and
prior. Each reading has therefore exactly the same weight, whatever else is on the maps.

Plain chains and tempered ones make the same number of steps in all, hot chains included.
"""

from __future__ import annotations

import argparse
import json
import math
import time
from collections import deque
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from benchmarks import panels
from prf.configuration import LaserPhysics
from prf.model.coloring import Draws, black_at_draws
from prf.model.layout import image_grid, pixel_centres
from prf.model.sensors import LaserModel
from prf.model.window import Window
from prf.output.pictures.posterior import draw_beams, draw_impacts
from prf.readings import Readings
from prf.results import PosteriorImage
from prf.results.convergence import Diagnosis, verdict
from prf.sampler import Ensemble, StopRule, drive
from prf.sampler.ensemble import Sample
from prf.sampler.schedules import LadderPlan
from prf.sampler.target import Execution, LaserData, Target, laser_data
from prf.shell.cli import pictures as style
from prf.shell.cli.storage import spawn_generators
from prf.simulate.sensors import bearings_of, cast, measure
from prf.simulate.world import World

Floats = NDArray[np.float64]
Bits = NDArray[np.bool_]

WINDOW = Window(-4.0, -2.0, 4.0, 2.0)
SCALE = 0.15
"""p of the prior in 1/m."""
HALF_WIDTH = 1.0
"""Of the corridor, whose middle is the x axis; metres, as everything."""
FACE, THICKNESS = 0.85, 0.2
"""Distance of the doors from the middle of the lobby, and how far they reach from there."""
PLACES = np.array([[-3.6, -0.4, 0.0], [-3.0, 0.5, 0.0]])
"""Poses on the left; those on the right are their mirror images."""
SCANNER = LaserPhysics(beams=30, max_range=10.0, outlier_probability=0.0, miss_probability=0.0)
NOISE_SEED = 1
LEFT, NEITHER, RIGHT = -1, 0, 1
"""Which door is shut and stands in the way of the beams of one pass."""
STEPS, TEMPERATURES, CHAINS, SEEDS = 9_000_000, 6, 6, 3


class Result(NamedTuple):
    """What came of one run.

    Attributes
    ----------
    sample : Sample
    summary : dict
        Figures: steps of the cold chain, CPU seconds, verdict and worst R-hat of what `prf sample` watches, share of
        the left reading by chain, how often the draws of each chain change from reading to reading, round trips.
    """

    sample: Sample
    summary: dict[str, Any]


def corridor(left_shut: bool, right_shut: bool) -> World:
    """Return corridor and lobby with each door open or shut."""
    free = shapely.box(WINDOW.x_min + 0.05, -HALF_WIDTH, WINDOW.x_max - 0.05, HALF_WIDTH)
    for is_shut, sign in ((left_shut, -1.0), (right_shut, 1.0)):
        if is_shut:
            near, far = sorted((sign * FACE, sign * (FACE + THICKNESS)))
            free -= shapely.box(near, -HALF_WIDTH - 1.0, far, HALF_WIDTH + 1.0)
    return World.from_polygons(shapely.box(*WINDOW) - free, WINDOW)


def both_passes() -> LaserData:
    """Return the readings of the pass on the left and their mirror images; a range of 0 where the glass is met."""
    distance = cast(corridor(False, True).walls, PLACES, SCANNER)
    reading = measure(distance, SCANNER, np.random.default_rng(NOISE_SEED)).ravel()
    angle = (PLACES[:, 2:] + bearings_of(SCANNER)).ravel()
    origin = np.repeat(PLACES[:, :2], SCANNER.beams, axis=0)
    impact = origin + distance.reshape(-1, 1) * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    reading[(np.abs(impact[:, 0]) < FACE - 1e-6) & (np.abs(impact[:, 1]) > HALF_WIDTH - 1e-6)] = 0.0
    return laser_data(
        np.concatenate([origin, origin * [-1.0, 1.0]]),
        np.concatenate([angle, np.pi - angle]),
        np.concatenate([reading, reading]),
        LaserModel(max_range=SCANNER.max_range),
    )


def posterior() -> Target:
    """Return the posterior of the log; error codes are no readings."""
    data = both_passes()
    kept = data.readings.range > 0.0
    laser = laser_data(data.readings.origin[kept], data.readings.angle[kept], data.readings.range[kept], data.model)
    return Target(WINDOW, SCALE, laser, execution=Execution(resolution=0.05))


def write_log(path: str) -> None:
    """Write the log as a table that `prf sample --laser` reads."""
    data = both_passes()
    rows = np.column_stack([data.readings.origin, data.readings.angle, data.readings.range])
    np.savetxt(path, rows, fmt="%.6f", delimiter=",", header="x,y,theta,range", comments="")


def door_places(side: int) -> Floats:
    """Return places (n, 2) that are black if the door on this side is shut: just behind the face that was seen."""
    y = np.array([-0.4, 0.0, 0.4])
    return np.column_stack([np.full_like(y, side * (FACE + 0.04)), y])


def readings_of(draws: Draws) -> NDArray[np.int64]:
    """Return which reading each draw is: LEFT if the left door is shut and the right one open, RIGHT, or NEITHER."""
    left, right = (black_at_draws(draws, door_places(side)) for side in (LEFT, RIGHT))
    is_left = left.all(axis=1) & ~right.any(axis=1)
    is_right = right.all(axis=1) & ~left.any(axis=1)
    return np.where(is_left, LEFT, np.where(is_right, RIGHT, NEITHER))


def changes(reading: NDArray[np.int64]) -> int:
    """Return how often draws in their order go from one reading to the other; those that are neither do not count."""
    reported = reading[reading != NEITHER]
    return int((np.diff(reported) != 0).sum())


def sampled(temperatures: int, steps: int, seed: int, chains: int = CHAINS) -> Result:
    """Return what chains say after so many steps each, shared out to their temperatures, from draws of the prior."""
    generators = spawn_generators(seed, chains)
    ensemble = Ensemble(posterior(), generators, LadderPlan(temperatures), starts_from="prior")
    ensemble.compile()
    start = time.process_time()
    deque(drive(ensemble, StopRule(math.ceil(steps / temperatures))), maxlen=0)
    ran = {
        "temperatures": temperatures,
        "seed": seed,
        "steps": ensemble.step,
        "cpu_seconds": time.process_time() - start,
    }
    sample = ensemble.sample()
    trips = [report["round_trips"] for report in ensemble.swaps()]
    return Result(sample, ran | agreement(ensemble.diagnose()) | shares(sample) | {"round_trips": trips})


def agreement(diagnoses: dict[str, Diagnosis]) -> dict[str, Any]:
    """Return the verdict of `prf sample`, and the largest R-hat of what it watches."""
    found = verdict(diagnoses)
    worst = max(each.rhat for each in diagnoses.values() if not np.isnan(each.rhat))
    return {"converged": found.converged, "reason": found.reason, "rhat": worst}


def shares(sample: Sample) -> dict[str, Any]:
    """Return the share of either reading, and how often it changes, chain by chain."""
    reading = readings_of(sample.draws)
    by_chain = [reading[sample.chain == chain] for chain in np.unique(sample.chain)]
    return {
        "left": [float((found == LEFT).mean()) for found in by_chain],
        "neither": float((reading == NEITHER).mean()),
        "changes": [changes(found) for found in by_chain],
    }


def words(found: dict[str, Any]) -> str:
    """Return the figures of one run in two lines."""
    left, trips = found["left"], found["round_trips"]
    verdict = "agree" if found["converged"] else "do not agree"
    return (
        f"seed {found['seed']}, {found['temperatures']} temperatures, {found['steps']:,} cold steps: "
        f"R-hat {found['rhat']:.2f}, the chains {verdict} ({found['reason']}), {found['cpu_seconds']:.0f} s of CPU\n"
        f"  left door shut in {min(left):.0%} to {max(left):.0%} of a chain's draws, {np.mean(left):.0%} of all, "
        f"neither reading in {found['neither']:.0%}; "
        f"reading changed {min(found['changes'])} to {max(found['changes'])} times a chain"
        + (f", {min(trips)} to {max(trips)} round trips" if trips else "")
    )


def image_of(sample: Sample, chain: int) -> PosteriorImage:
    """Return the share of draws of one chain in which each pixel is black."""
    grid = image_grid(WINDOW, 0.05)
    draws = [draw for draw, of in zip(sample.draws, sample.chain.tolist(), strict=True) if of == chain]
    chosen = Draws.from_colorings(draws, WINDOW)
    share = black_at_draws(chosen, pixel_centres(grid)).mean(axis=0).astype(np.float32)
    occupancy = share.reshape(grid.ny, grid.nx)
    return PosteriorImage(
        occupancy, np.zeros_like(occupancy), np.array([grid.x0, grid.y0]), grid.cell, np.ones_like(occupancy, np.bool_)
    )


def draw_log(axes: Any, beams: Readings) -> None:
    """Draw beams, impacts and places of the scanner; it went from one side to the other by another way."""
    draw_beams(axes, beams)
    draw_impacts(axes, beams)
    axes.plot(*np.unique(beams.origin, axis=0).T, "o", markersize=4.0, color=style.PATH, zorder=4)


def draw(plain: Result, tempered: Result, target: Path) -> None:
    """Draw the beams, the occupancy of two plain chains, most left and most right, and of a tempered chain."""
    data = posterior().laser
    assert data is not None
    beams = data.readings.within(data.model.limit)
    left, temperatures = plain.summary["left"], tempered.summary["temperatures"]
    shown = (int(np.argmax(left)), int(np.argmin(left)))
    panels.save_page(
        target,
        [
            panels.Panel(lambda axes: draw_log(axes, beams), f"{len(data.readings.range)} beams of two passes"),
            panels.image(image_of(tempered.sample, 0), f"a tempered chain, {temperatures} temperatures"),
            *(panels.image(image_of(plain.sample, chain), f"plain chain {chain + 1}") for chain in shown),
        ],
        WINDOW,
        columns=2,
        height=1.9,
        title="Two fire doors and a lobby that nobody entered",
        subtitle=f"one door open on either pass: R-hat {plain.summary['rhat']:.2f} of plain chains, "
        f"{tempered.summary['rhat']:.2f} of tempered ones",
    )


def main() -> None:
    """Run both kinds of chains for each seed, and print in words what came of each."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=SEEDS, help="runs of either kind")
    parser.add_argument("--steps", type=int, default=STEPS, help="of each chain, over all its temperatures")
    parser.add_argument("--temperatures", type=int, default=TEMPERATURES)
    parser.add_argument("--chains", type=int, default=CHAINS)
    parser.add_argument("-o", "--output", type=Path, help="picture of the first seed")
    parser.add_argument("--json", type=Path)
    parser.add_argument("--log", help="write the log as a table and stop")
    args = parser.parse_args()
    if args.log:
        write_log(args.log)
        return
    summaries = []
    for seed in range(1, args.seeds + 1):
        plain, tempered = (
            sampled(temperatures, args.steps, seed, args.chains) for temperatures in (1, args.temperatures)
        )
        summaries += [plain.summary, tempered.summary]
        print(f"{words(plain.summary)}\n{words(tempered.summary)}", flush=True)
        if seed == 1 and args.output:
            draw(plain, tempered, args.output)
    if args.json:
        args.json.write_text(json.dumps(summaries, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
