"""A simulation as a directory: the truth, logs that every verb reads, and how they came to be."""

from __future__ import annotations

import dataclasses
import gzip
import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from prf.run.mapfile import map_text
from prf.shell.files import atomic_write, remove_leftovers
from prf.shell.jsonout import dump_object
from prf.shell.manifest import describe_input, versions
from prf.shell.together import Group, together
from prf.shell.work import made_folder
from prf.simulate.log_text import carmen_lines, no_return_number, path_lines, sonar_lines
from prf.simulate.picture import draw_plan
from prf.simulate.simulation import ARAK, OFFICE, Simulation

TRUTH, PLAN, LASER, SONAR, PATH, MANIFEST = (
    "truth.geojson",
    "plan.png",
    "laser.log.gz",
    "sonar.csv.gz",
    "path.csv",
    "manifest.json",
)
FILES = (MANIFEST, TRUTH, PLAN, LASER, SONAR, PATH)
SCHEMA = "prf.simulation/1"
LEVEL = 6
"""Of compression: 9 takes thrice the time for a hundredth less."""


def write_simulation(folder: str | os.PathLike[str], simulation: Simulation) -> dict[str, Any]:
    """Write a simulation into a directory, which is made if need be; the same simulation gives the same bytes.

    All files take their places together, the manifest last, so that a directory that has one is complete. A log of an
    earlier simulation goes; files of other names are left alone.

    Parameters
    ----------
    folder : path
    simulation : Simulation

    Returns
    -------
    dict
        The manifest.

    Raises
    ------
    OutputError
        If the directory or a file cannot be written.
    """
    place = Path(folder)
    inputs = [describe_input(path) for path in _inputs(simulation)]  # one may be a file that is replaced now
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
    scans = simulation.scans
    with atomic_write(place / TRUTH) as stream:
        stream.write(map_text(simulation.world.coloring(), {"made_by": "prf simulate", "seed": simulation.seed}))
    with atomic_write(place / PATH) as stream:
        stream.writelines(f"{line}\n" for line in path_lines(scans))
    draw_plan(simulation, place / PLAN)
    laser, physics, sonar = simulation.laser, simulation.config.laser, simulation.sonar
    logs = (
        (LASER, None if laser is None or physics is None else carmen_lines(scans, laser, physics)),
        (SONAR, None if sonar is None else sonar_lines(scans, sonar)),
    )
    for name, lines in logs:
        if lines is None:
            group.drop(place / name)
        else:
            _write_packed(place / name, lines)


def summary(simulation: Simulation) -> dict[str, Any]:
    """Return the figures of a simulation, for `--json` and the manifest."""
    world, scans, config = simulation.world, simulation.scans, simulation.config
    laser, sonar = simulation.laser, simulation.sonar
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
    }


def _inputs(simulation: Simulation) -> list[str]:
    """Return the files that a simulation was made from."""
    config = simulation.config
    return [
        *([] if config.world in (OFFICE, ARAK) else [config.world]),
        *([] if config.path is None else [config.path]),
    ]


def _manifest(place: Path, simulation: Simulation, inputs: list[dict[str, Any]], group: Group) -> dict[str, Any]:
    """Return all that the simulation follows from, and nothing that differs from one day to the next."""
    made = {name: group.where(place / name) for name in FILES if name != MANIFEST}
    written = {name: describe_input(path) for name, path in made.items() if path is not None}
    return {
        **summary(simulation),
        "dark_walls": simulation.world.walls[simulation.is_dark],
        "configuration": dataclasses.asdict(simulation.config),
        "versions": versions(),
        "inputs": inputs,
        "files": [{**entry, "path": name} for name, entry in written.items()],
    }


def _write_packed(path: Path, lines: Iterable[str]) -> None:
    """Write lines as gzip without a date, so that the bytes depend on the content alone."""
    text = "".join(f"{line}\n" for line in lines)
    with atomic_write(path, binary=True) as stream:
        stream.write(gzip.compress(text.encode("ascii"), compresslevel=LEVEL, mtime=0))
