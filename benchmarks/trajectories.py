"""Sampled trajectories beside the truth: drives with errors of known size, odometry round a loop, and public logs.

Run it from the repository's root::

    python -m benchmarks.trajectories [--cases CASE ...] [--judge] [--worlds N ...] [--seconds S]

`small` and `large` are office floors whose poses err independently, by .05 m and .01 rad, and by .15 m and .03 rad;
`loop` is a ring of corridors whose poses are odometry, `long` a larger one; in `carried` the robot is carried 11 m,
`repeating` looks the same every 4 m, `ambiguous` too, at poorer odometry. `real` are public logs with corrected poses,
to which errors as of `large` are added: what their own poses err by counts as an error of all that is judged there.
`beside` are public logs too, with larger errors and odometry in a file beside the poses; of Intel its own.

Tuned was on the worlds of seeds 1 to 3 and on Intel, never on what --judge takes: seeds 11 to 15, and other
buildings. Judged are the poses as given; those at which a scan matcher with a pose graph has the scans agree
(`prf.poses.start.find_trajectory`); and the posterior means of `prf sample`, with the share of intervals of 95 % that
hold the truth; and how many squares of 5 cm hold returns, the fewer the sharper the map. ATE and RPE (scan to scan) are
those of evo, of places after alignment, where it is installed (extra `bench`). Each drive is kept in
build/benchmarks/trajectories with its figures; what is there is not made again.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks import commands
from benchmarks.commands import made, say
from benchmarks.drives import CASES, JUDGING, REAL, TUNING, Case, Drive, Floats, disturbed, recorded, simulated
from prf.configuration import Configuration
from prf.model.ranges import unit_vectors
from prf.poses.model import PoseModel, pose_model
from prf.poses.plane import wrapped
from prf.poses.start import find_trajectory
from prf.readings import Readings, thin
from prf.readings.describe import default_max_range
from prf.sampler.prepare import read_configured

WITHIN = 1.96  # standard deviations that hold 95 %
HAS_EVO = importlib.util.find_spec("evo") is not None
CELL = 0.05  # metres
HEADS = ("metres", "radians", "ate", "rpe", "cells", "seconds", "steps")


def matched(drive: Drive, case: Case) -> tuple[PoseModel, Readings, Floats, float]:
    """Return poses as given, all readings, poses at which these agree, and the seconds that it took to find them."""
    poses = None if drive.poses is None else str(drive.poses)
    file = None if drive.odometry is None else str(drive.odometry)
    config = Configuration.of(**case._asdict(), poses=poses, every_scan=drive.every_scan, odometry_file=file)
    whole = read_configured(config, [str(drive.log)])[0]
    assert whole is not None
    laser = thin(whole, **config.readings.selection()).within(default_max_range(whole))
    model = pose_model(laser, None, case.pose_noise, config.trajectory.step_noise)
    begun = time.perf_counter()
    found = find_trajectory(model, laser, config.laser.noise)
    return model, laser, found, time.perf_counter() - begun


def sampled(drive: Drive, case: Case, folder: Path, options: argparse.Namespace) -> tuple[dict[str, Any], Floats]:
    """Run `prf sample`; return what it prints, and trajectory.csv: scan, t, means and standard deviations of poses."""
    given = {"pose_noise": case.pose_noise, "odometry": case.odometry, "poses": drive.poses}
    result = made(
        "sample",
        folder / "run",
        laser=drive.log,
        every_scan=drive.every_scan,
        time_budget=options.seconds,
        seed=options.seed,
        threads=options.threads,
        **given,
        **({} if drive.odometry is None else {"trajectory.file": drive.odometry}),
    )
    return result, np.loadtxt(folder / "run" / "trajectory.csv", delimiter=",", skiprows=1)


def errors(poses: Floats, truth: Floats) -> dict[str, float]:
    """Return root mean square errors of poses (n, 3) beside the true ones: metres, radians, and those of evo."""
    off = poses - truth
    found = {
        "metres": float(np.sqrt((off[:, :2] ** 2).sum(axis=1).mean())),
        "radians": float(np.sqrt((wrapped(off[:, 2]) ** 2).mean())),
    }
    return found | (evo_errors(poses, truth) if HAS_EVO else {})


def evo_errors(poses: Floats, truth: Floats) -> dict[str, float]:
    """Return evo's absolute and relative errors of places, rms in metres; poses are aligned first, without a scale."""
    from evo.core import metrics
    from evo.core.trajectory import PoseTrajectory3D

    def trajectory(pose: Floats) -> Any:
        n, half = len(pose), 0.5 * pose[:, 2]
        turn = np.column_stack([np.cos(half), np.zeros((n, 2)), np.sin(half)])
        return PoseTrajectory3D(np.column_stack([pose[:, :2], np.zeros(n)]), turn, np.arange(n, dtype=np.float64))

    true, found = trajectory(truth), trajectory(poses)
    found.align(true)
    place = metrics.PoseRelation.translation_part
    values = {}
    for name, metric in (("ate", metrics.APE(place)), ("rpe", metrics.RPE(place, 1.0, metrics.Unit.frames))):
        metric.process_data((true, found))
        values[name] = float(metric.get_statistic(metrics.StatisticsType.rmse))
    return values


def held(mean: Floats, sd: Floats, truth: Floats) -> dict[str, float]:
    """Return the shares of x, y and heading (n, 3) whose intervals of 95 % hold the truth.

    A standard deviation of 0 is that of a pose that is held, and not counted.
    """
    off = mean - truth
    off[:, 2] = wrapped(off[:, 2])
    inside, free = np.abs(off) <= WITHIN * sd, sd > 0.0
    return {name: float(inside[free[:, k], k].mean()) for k, name in enumerate(("x", "y", "heading"))}


def n_cells(model: PoseModel, laser: Readings, rows: NDArray[np.int64], poses: Floats) -> int:
    """Return how many squares hold returns of the states `rows` (k,) at poses (k, 3): the fewer, the sharper the map.

    It needs no truth, which of a public log is only what others made of it.
    """
    assert model.laser is not None
    whole = np.zeros((len(model.scan), 3))
    whole[rows] = poses
    beams = model.placed(laser, None, whole)[0]
    assert beams is not None
    used = np.isin(model.laser.owner, rows) & np.isfinite(beams.range)
    ends = beams.origin[used] + beams.range[used, None] * unit_vectors(beams.angle[used])
    return len(np.unique(np.floor(ends / CELL), axis=0))


def judged(drive: Drive, case: Case, folder: Path, options: argparse.Namespace) -> dict[str, Any]:
    """Return the figures of one drive."""
    model, laser, agreed, seconds = matched(drive, case)
    result, table = sampled(drive, case, folder, options)
    order = np.argsort(model.scan)  # the poses of a log whose clock runs backward are in the order of time
    rows = order[np.searchsorted(model.scan, table[:, 0].astype(np.int64), sorter=order)]
    truth = drive.truth[model.scan[rows]]
    mean, sd = table[:, 2:5], table[:, 5:8]
    run = {name: result[name] for name in ("steps", "seconds", "converged", "reason")}

    def of(poses: Floats) -> dict[str, float]:
        return {**errors(poses, truth), "cells": n_cells(model, laser, rows, poses)}

    return {
        "n_poses": len(table),
        "truth": {"cells": n_cells(model, laser, rows, truth)},
        "given": of(model.prior.given[rows]),
        "scans matched": {**of(agreed[rows]), "seconds": seconds},
        "posterior mean": {
            **of(mean),
            **run,
            "held": held(mean, sd, truth),
            "mean_sd": sd.mean(axis=0),
        },
    }


def lines(name: str, found: dict[str, Any]) -> Iterator[str]:
    """Yield the figures of one drive for a person."""
    yield f"{name + ', ' + str(found['n_poses']) + ' poses':24}" + "".join(f"{head:>11}" for head in HEADS)
    for row in ("truth", "given", "scans matched", "posterior mean"):
        values = [found[row].get(head, "") for head in HEADS]
        words = [f"{value:,.4g}" if isinstance(value, float) else f"{value:,}" if value else "" for value in values]
        yield f"  {row:22}" + "".join(f"{word:>11}" for word in words)
    last = found["posterior mean"]
    shares = ", ".join(f"{key} {share:.1%}" for key, share in last["held"].items())
    yield f"  intervals of 95 % hold {shares}; {last['reason']}"


def drive_of(name: str, kind: str, options: argparse.Namespace) -> Drive | None:
    """Make the drive of a world or a building; None where its log is absent."""
    folder = options.folder / f"{kind}-{name}"
    if kind not in REAL:
        return simulated(folder, kind, int(name))
    log = commands.log_path(options.data, name)
    if log is None:
        return None
    if (kind, name) == ("beside", "intel"):
        return recorded(options.data / "odometry", log)
    return disturbed(folder, log, CASES[kind], options.seed)


def main() -> None:
    """Print the figures of all drives, and write them."""
    parser = commands.parser(__doc__, seconds=300.0)
    parser.add_argument("--cases", nargs="+", choices=list(CASES), default=list(CASES), help="all of them by default")
    parser.add_argument("--judge", action="store_true", help="worlds that nothing was tuned on")
    parser.add_argument("--worlds", nargs="+", help="seeds of worlds, or buildings, instead")
    parser.add_argument("--again", action="store_true", help="make again what is there")
    options = commands.parse(parser)
    options.folder = options.output / "trajectories"
    chosen = JUDGING if options.judge else TUNING
    if not HAS_EVO:
        say("evo is not installed (extra bench): no ATE and no RPE")
    for kind in options.cases:
        for name in options.worlds or map(str, REAL[kind][chosen] if kind in REAL else chosen):
            folder = options.folder / f"{kind}-{name}"
            kept = folder / f"figures-{options.seconds:.0f}s.json"
            if options.again or not kept.exists():
                drive = drive_of(name, kind, options)
                if drive is None:
                    continue
                commands.write_table(kept, judged(drive, CASES[kind], folder, options))
            print("\n".join(lines(f"{kind} {name}", json.loads(kept.read_text()))), flush=True)


if __name__ == "__main__":
    main()
