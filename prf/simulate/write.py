"""A simulation as a directory: the truth, logs that every verb reads, a picture, and how they came to be."""

from __future__ import annotations

import dataclasses
import gzip
import math
import os
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from prf.configuration import LaserPhysics
from prf.model.sensors import CONE
from prf.output.pictures.posterior import fill_map
from prf.readings.describe import MAX_RANGE_SHARE
from prf.readings.readings import PIONEER, mounted
from prf.readings.table import OPTIONAL, REQUIRED
from prf.results.geojson import map_text
from prf.shell.cli import pictures as style
from prf.shell.cli.files import Group, atomic_write, made_folder, together
from prf.shell.cli.outputs import remove_leftovers
from prf.shell.cli.pictures import Target
from prf.shell.cli.storage import describe_input, dump_object, versions
from prf.simulate.path import DIGITS, Scans, rms_errors
from prf.simulate.sensors import bearings_of, is_half_circle, step_of
from prf.simulate.simulation import ARAK, OFFICE, Simulation
from prf.simulate.world import Floats

TRUTH, PLAN, MANIFEST = "truth.geojson", "plan.png", "manifest.json"
LASER, SONAR, PATH = "laser.log.gz", "sonar.csv.gz", "path.csv"
TRUE_POSES, TRUE_TUM = "true_poses.csv", "true_poses.tum"
FILES = (MANIFEST, TRUTH, PLAN, LASER, SONAR, PATH, TRUE_POSES, TRUE_TUM)
SCHEMA = "prf.simulation/2"
LEVEL = 6  # of compression: 9 takes thrice the time for a hundredth less
MIN_RANGE = 0.001  # metres, the resolution of a log: a range of 0 is an error code
HOST = "simulated"
EXACT, WITH_ERRORS = "are exact", f"have errors ({TRUE_POSES} has none)"
NEW = ("pose_noise", "odometry_noise")  # keys of the configuration that are written only where they are set


def write_simulation(folder: str | os.PathLike[str], simulation: Simulation) -> dict[str, Any]:
    """Write a simulation into a directory, which is made if need be; the same simulation gives the same bytes.

    All files take their places together, the manifest last, so that a directory that has one is complete. A log of an
    earlier simulation is removed; files of other names are left alone.

    Returns: the manifest.
    """
    place = Path(folder)
    config = simulation.config
    sources = [path for path in (config.world, config.path) if path not in (OFFICE, ARAK, None)]
    inputs = [describe_input(path) for path in sources if path is not None]  # one may be a file that is replaced now
    for name in FILES:
        remove_leftovers(place / name)
    with made_folder(place), together() as group:
        _write_files(place, simulation, group)
        manifest = _manifest(place, simulation, inputs, group)
        with atomic_write(place / MANIFEST) as stream:
            stream.write(dump_object(SCHEMA, manifest, indent=2) + "\n")
    return manifest


def _write_files(place: Path, simulation: Simulation, group: Group) -> None:
    """Write all but the manifest."""
    scans, given = simulation.scans, simulation.given
    poses = EXACT if simulation.is_exact else WITH_ERRORS
    with atomic_write(place / TRUTH) as stream:
        stream.write(map_text(simulation.world.coloring(), {"made_by": "prf simulate", "seed": simulation.seed}))
    draw_plan(simulation, place / PLAN)
    laser, physics, sonar = simulation.laser, simulation.config.laser, simulation.sonar
    texts = (
        (PATH, path_lines(scans)),
        (TRUE_POSES, None if simulation.is_exact else pose_lines(scans)),
        (TRUE_TUM, None if simulation.is_exact else tum_lines(scans)),
        (LASER, None if laser is None or physics is None else carmen_lines(given, laser, physics, poses)),
        (SONAR, None if sonar is None else sonar_lines(given, sonar)),
    )
    for name, lines in texts:
        if lines is None:
            group.drop(place / name)
        else:
            _write_lines(place / name, lines)


def summary(simulation: Simulation) -> dict[str, Any]:
    """Return the figures of a simulation, for `--json` and the manifest."""
    world, scans, config = simulation.world, simulation.scans, simulation.config
    laser, sonar = simulation.laser, simulation.sonar
    errors = {} if simulation.is_exact else {"pose_rmse": rms_errors(scans, simulation.given)}
    return {
        "seed": simulation.seed,
        "world": config.world,
        "window": list(world.window),
        "n_walls": len(world.walls),
        "occupied_area": float(shapely.area(world.occupied)),
        "n_redrawn": simulation.n_redrawn,
        "n_scans": len(scans.time),
        "path_length": float(np.hypot(*np.diff(scans.pose[:, :2], axis=0).T).sum()),
        "duration": float(scans.time[-1]),
        "n_beams": 0 if laser is None else laser.size,
        "n_beams_returned": 0 if laser is None else int(np.count_nonzero(np.isfinite(laser) & (laser > 0.0))),
        "laser_no_return": None if config.laser is None else no_return_number(config.laser.max_range),
        "n_sonar": 0 if sonar is None else sonar.size,
        "n_sonar_returned": 0 if sonar is None else int(np.count_nonzero(np.isfinite(sonar))),
        **errors,
    }


def _manifest(place: Path, simulation: Simulation, inputs: list[dict[str, Any]], group: Group) -> dict[str, Any]:
    """Return all that the simulation follows from, and nothing that differs from one day to the next."""
    made = {name: group.where(place / name) for name in FILES if name != MANIFEST}
    written = {name: describe_input(path) for name, path in made.items() if path is not None}
    config = simulation.config
    laser = None if config.laser is None else config.laser.model_dump()
    configuration = (dataclasses.asdict(config) | {"laser": laser}).items()
    return {
        **summary(simulation),
        "configuration": {name: value for name, value in configuration if name not in NEW or value is not None},
        "versions": versions(),
        "inputs": inputs,
        "files": [{**entry, "path": name} for name, entry in written.items()],
    }


def _write_lines(path: Path, lines: Iterable[str]) -> None:
    """Write lines; as gzip without a date where the name ends on .gz, so that the bytes depend on the content alone."""
    data = "".join(f"{line}\n" for line in lines).encode("ascii")
    with atomic_write(path, binary=True) as stream:
        stream.write(gzip.compress(data, compresslevel=LEVEL, mtime=0) if path.suffix == ".gz" else data)


def no_return_number(max_range: float) -> float:
    """Return the range that a log has for "no return": the default maximum range that readers take is `max_range`."""
    centimetres = math.ceil(100.0 * max_range / MAX_RANGE_SHARE)
    rounds_off = MAX_RANGE_SHARE * (centimetres / 100.0) < max_range
    return (centimetres + rounds_off) / 100.0


def carmen_lines(scans: Scans, readings: Floats, physics: LaserPhysics, poses: str = EXACT) -> Iterator[str]:
    """Yield the lines of a CARMEN log: FLASER for half a circle, ROBOTLASER1, which has angles, for other scanners.

    `scans`: poses of the laser, `poses`: what is said of them. `readings` (n_scans, n_beams): metres, written in
    millimetres; inf: no return.
    """
    silent = no_return_number(physics.max_range)
    kind = "FLASER" if is_half_circle(physics) else "ROBOTLASER1"
    yield f"# A simulated drive, made by prf simulate: poses {poses}, and the laser's"
    yield f"# message formats defined: {kind}"
    yield f"# no return: {silent:g}; dropped: 0"
    for pose, time, row in zip(scans.pose, scans.time.tolist(), readings, strict=True):
        ranges = " ".join(_shown(np.where(np.isinf(row), silent, np.maximum(row, MIN_RANGE))))
        at = " ".join(f"{value:.{DIGITS}f}" for value in pose.tolist())
        stamp = f"{time:.3f} {HOST} {time:.3f}"
        if is_half_circle(physics):
            yield f"FLASER {len(row)} {ranges} {at} {at} {stamp}"
            continue
        begin, step = float(bearings_of(physics)[0]), step_of(physics)
        scanner = f"0 {begin!r} {physics.field_of_view!r} {step!r} {silent:g} {physics.noise:g} 0"
        yield f"ROBOTLASER1 {scanner} {len(row)} {ranges} 0 {at} {at} 0 0 0 0 0 {stamp}"


def sonar_lines(scans: Scans, readings: Floats) -> Iterator[str]:
    """Yield the lines of a table of sonar readings, one row a transducer, an empty range for no return.

    `scans`: poses of the robot. `readings` (n_scans, 16): metres; inf: no return.
    """
    yield ",".join((*REQUIRED, *OPTIONAL))
    for number, (pose, time, row) in enumerate(zip(scans.pose, scans.time.tolist(), readings, strict=True)):
        for (x, y, theta), text in zip(mounted(pose, PIONEER).tolist(), _shown(row), strict=True):
            distance = "" if text == "inf" else text
            yield f"{x:.{DIGITS}f},{y:.{DIGITS}f},{theta:.{DIGITS}f},{distance},{CONE:g},{time:.3f},{number}"


def path_lines(scans: Scans) -> Iterator[str]:
    """Yield the lines of a table of poses, which `prf simulate --path` takes again."""
    yield "x,y,theta,t"
    for pose, time in zip(scans.pose.tolist(), scans.time.tolist(), strict=True):
        yield ",".join(f"{value:.{DIGITS}f}" for value in pose) + f",{time:.3f}"


def pose_lines(scans: Scans) -> Iterator[str]:
    """Yield the lines of a table of poses, which `--poses` of other verbs takes."""
    yield "t,x,y,theta"
    for pose, time in zip(scans.pose.tolist(), scans.time.tolist(), strict=True):
        yield f"{time:.3f}," + ",".join(f"{value:.{DIGITS}f}" for value in pose)


def tum_lines(scans: Scans) -> Iterator[str]:
    """Yield the lines of poses as TUM has them: t x y z qx qy qz qw."""
    for (x, y, theta), time in zip(scans.pose.tolist(), scans.time.tolist(), strict=True):
        half = 0.5 * theta
        yield f"{time:.3f} {x:.{DIGITS}f} {y:.{DIGITS}f} 0 0 0 {math.sin(half):.9f} {math.cos(half):.9f}"


def _shown(values: Floats) -> list[str]:
    """Return numbers in millimetres, without zeros at the end."""
    return [f"{value:.3f}".rstrip("0").rstrip(".") for value in values.tolist()]


def draw_plan(simulation: Simulation, target: Target) -> None:
    """Draw occupied area and the places of the scans, the first one ringed; poses with errors as a thin line."""
    world, path = simulation.world, simulation.scans.pose[:, :2]
    length = float(np.hypot(*np.diff(path, axis=0).T).sum())
    window = world.window
    errors = "" if simulation.is_exact else "  ·  poses of the logs in violet"
    small = f"{style.counted(len(path), 'scan')} on {length:,.0f} m  ·  {style.counted(len(world.walls), 'wall')}"
    page, axes = style.map_page(
        window, style.margins_of(window), "Simulated world", f"{small}  ·  {style.window_words(window)}{errors}"
    )
    fill_map(axes, world.coloring())
    dots = 2.0 if len(path) < 400 else 1.0
    axes.plot(*path.T, color=style.PATH, linewidth=0.6, marker="o", markersize=dots, markeredgewidth=0.0, zorder=4)
    if not simulation.is_exact:
        axes.plot(*simulation.given.pose[:, :2].T, color=style.DIFFERS, linewidth=0.6, zorder=3.9)
    axes.plot(*path[:1].T, marker="o", markersize=6.0, color="white", markeredgecolor=style.PATH, zorder=4.1)
    style.save(page, target)
