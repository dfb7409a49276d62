"""Seconds from the empty map to a converged image of the demo's office: the sampler as it is, and as it was.

Run it from the repository's root::

    python -m benchmarks.office_time [--before REVISION] [--longest S] [--reference-seconds S] [-o FOLDER]

Each run has four chains in two threads. Its image at any time is compared with that of one run a hundred times as long
as the tenth second, from another seed: the mean absolute difference of the probability of being occupied over the cells
of the image within half a metre of a beam. Times are CPU seconds of the process halved, what two quiet cores take. An
earlier revision is checked out beside the project and runs the same script. A picture holds the curves.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from benchmarks import commands, worlds
from prf.model.layout import image_grid, pixel_centres
from prf.sampler.target import LaserData
from prf.shell.cli import pictures

NEAR = 0.5
"""Metres from a beam within which cells are compared."""
BETWEEN = 0.1
"""Metres between the points that stand for a beam."""
GOAL = 0.01
TIMES = (0.5, 1.0, 2.0, 3.0, 5.0, 7.0, 10.0, 15.0, 20.0, 30.0, 45.0, 60.0, 100.0)
CHAINS = 4
Floats = NDArray[np.float64]


def beam_points(laser: LaserData) -> Floats:
    """Return points (n, 2) along every beam, from its sensor to its return or its maximum range, metres."""
    reach = np.minimum(laser.readings.range, laser.model.limit)
    along = np.concatenate([np.arange(0.0, length, BETWEEN) for length in reach])
    beam = np.repeat(np.arange(len(reach)), [len(np.arange(0.0, length, BETWEEN)) for length in reach])
    direction = np.stack([np.cos(laser.readings.angle), np.sin(laser.readings.angle)], axis=1)
    points: Floats = laser.readings.origin[beam] + along[:, None] * direction[beam]
    return points


def near_beams() -> NDArray[np.bool_]:
    """Return which pixels (ny * nx,) of the office's image lie within half a metre of a beam."""
    target = worlds.target_of(worlds.OFFICE, image=True)
    assert target.laser is not None
    assert target.execution.resolution is not None
    centres = pixel_centres(image_grid(target.window, target.execution.resolution))
    distance, _ = cKDTree(beam_points(target.laser)).query(centres, distance_upper_bound=2.0 * NEAR)
    near: NDArray[np.bool_] = (distance <= NEAR) & target.window.contains(centres)
    return near


def run(root: Path, output: Path, times: list[float], seed: int) -> dict[str, Floats]:
    """Run the sampler of the project at `root`; return images, steps and seconds."""
    environment = {**os.environ, "PYTHONPATH": str(root)}
    script = Path(__file__).with_name("image_curve.py")
    goals = ",".join(map(str, times))
    words = [sys.executable, str(script), str(worlds.OFFICE), str(output), goals, str(seed), str(CHAINS)]
    subprocess.run(words, cwd=root, env=environment, check=True)
    with np.load(output) as stored:
        return dict(stored)


def checked_out(revision: str, folder: Path) -> Path:
    """Return a folder with the project as it was at `revision`."""
    if folder.exists():
        shutil.rmtree(folder)
    folder.mkdir(parents=True)
    archive = subprocess.run(["git", "archive", revision], cwd=worlds.ROOT, stdout=subprocess.PIPE, check=True)
    subprocess.run(["tar", "-x", "-C", str(folder)], input=archive.stdout, check=True)
    return folder


def differences(images: Floats, reference: Floats, near: NDArray[np.bool_]) -> list[float]:
    """Return the mean absolute difference of each image to the reference over the cells near beams."""
    return [float(np.nanmean(np.abs(image.ravel()[near] - reference.ravel()[near]))) for image in images]


def draw(curves: dict[str, tuple[Floats, list[float]]], path: Path) -> None:
    """Draw the difference of every run over time."""
    page = pictures.new_page(7.0, 4.5)
    axes = pictures.add_axes(page, 0.8, 0.6, 6.0, 3.7)
    for name, (seconds, values) in curves.items():
        axes.plot(seconds, values, marker="o", markersize=3, label=name)
    axes.axhline(GOAL, color="grey", linewidth=0.8)
    axes.set(xscale="log", yscale="log", xlabel="seconds on two cores", ylabel="mean absolute difference")
    axes.legend()
    pictures.save(page, path)


def main() -> None:
    """Run all, print, draw."""
    asked = commands.parser(__doc__)
    asked.add_argument("--before", help="a revision to compare with")
    asked.add_argument("--longest", type=float, default=60.0, help="seconds of the runs")
    asked.add_argument("--reference-seconds", type=float, default=1000.0)
    asked.add_argument("--reference", type=Path, help="an image stored by an earlier call, instead of a new long run")
    asked.add_argument("--seeds", type=int, default=3, help="runs of each sampler")
    arguments = commands.parse(asked)
    folder = arguments.output / "office-time"
    folder.mkdir(parents=True, exist_ok=True)
    near = near_beams()
    stored = arguments.reference or folder / "reference.npz"
    if arguments.reference is None:
        commands.say("the long run")
        run(worlds.ROOT, stored, [arguments.reference_seconds], arguments.seed + 1000)
    with np.load(stored) as long:
        reference = long["images"][-1]
    roots = {"now": worlds.ROOT}
    if arguments.before:
        roots["before"] = checked_out(arguments.before, folder / "before")
    times = [t for t in TIMES if t <= arguments.longest]
    curves, table = {}, {}
    for name, root in roots.items():
        for seed in range(arguments.seed, arguments.seed + arguments.seeds):
            found = run(root, folder / f"{name}-{seed}.npz", times, seed)
            values = differences(found["images"], reference, near)
            curves[f"{name}, seed {seed}"] = (found["seconds"], values)
            table[f"{name}, seed {seed}"] = {
                "seconds": found["seconds"].tolist(),
                "steps": found["steps"].tolist(),
                "difference": values,
            }
            commands.say(f"{name}, seed {seed}: " + " ".join(f"{v:.4f}" for v in values))
    draw(curves, folder / "curves.png")
    commands.write_table(folder / "office-time.json", {"cells": int(near.sum()), "runs": table})


if __name__ == "__main__":
    main()
