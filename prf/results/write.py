"""Writing a RUN directory, each file whole or not at all, so that a run may be written again at any checkpoint."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from prf.poses.posterior import Trajectory
from prf.readings import Readings
from prf.results import names
from prf.results.geojson import map_text
from prf.results.run import PosteriorImage, RunData
from prf.shell.cli.files import atomic_write
from prf.shell.cli.outputs import is_leftover, remove_leftovers
from prf.shell.cli.storage import dump_object, save_arrays
from prf.shell.errors import OutputError, cannot_write, system_reason

FILES = (names.MANIFEST, names.CHECKPOINT, names.PICTURE, names.TRAJECTORY, *names.SCHEMAS)
"""All that a RUN directory may hold, the manifest first: without it the others are not a run."""


def write_run(path: str | os.PathLike[str], run: RunData) -> None:
    """Write all parts of `run` that are not None into the directory `path`, which is made if need be.

    Each file is replaced whole; the manifest is written last, so a directory without one is not yet a run. Files of
    other names (a checkpoint, pictures) are left alone. Whether an existing run may be replaced is the caller's
    decision.
    """
    folder = Path(path)
    make_folder(folder)
    write_draws(folder, run)
    if run.image is not None:
        write_image(folder, run.image)
    if any(part is not None for part in (run.laser, run.sonar, run.points)):
        write_readings(folder, run)
    if run.trajectory is not None:
        write_trajectory(folder, run.trajectory)
    if run.best is not None:
        write_best(folder, run)
    if run.diagnostics is not None:
        write_object(folder / names.DIAGNOSTICS, run.diagnostics)
    write_manifest(folder, run.manifest)


def make_folder(folder: Path) -> None:
    """Make a RUN directory if it is missing."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise cannot_write(folder, error) from error


def remove_stale_outputs(folder: Path) -> None:
    """Remove what an older run left in a directory, so that no file of it can pass for one of the new run."""
    if folder.exists() and not folder.is_dir():
        raise OutputError(f"{folder}: is a file, but a directory is expected. Choose another name.")
    remove_half_written(folder)
    for name in FILES:
        try:
            (folder / name).unlink(missing_ok=True)
        except OSError as error:
            raise OutputError(f"{folder / name}: cannot be removed ({system_reason(error)}).") from error


def remove_half_written(folder: Path) -> None:
    """Remove what a killed process left half written; the caller holds the run (:mod:`prf.shell.cli.outputs`)."""
    for name in FILES:
        remove_leftovers(folder / name)


def remove_unfinished(folder: Path) -> None:
    """Remove files that are not a run without a manifest, and the directory if nothing else is in it."""
    if is_unfinished(folder):
        remove_stale_outputs(folder)
    if folder.is_dir() and not any(folder.iterdir()):
        folder.rmdir()


def is_unfinished(folder: Path) -> bool:
    """Return whether `folder` is what a run leaves that is killed before its first manifest: nothing that is missed."""
    if not os.path.isdir(folder) or (folder / names.MANIFEST).exists():
        return False
    kept = [entry.name for entry in folder.iterdir()]
    return bool(kept) and all(name in FILES or any(is_leftover(name, output) for output in FILES) for name in kept)


def write_manifest(folder: Path, manifest: Mapping[str, Any]) -> None:
    """Write manifest.json; the schema is added."""
    write_object(folder / names.MANIFEST, manifest)


def write_draws(folder: Path, run: RunData) -> None:
    """Write draws.npz: the draws, where each comes from, functionals and probe colours."""
    draws = run.draws
    functionals = {names.FUNCTIONAL_PREFIX + name: values for name, values in run.functionals.items()}
    walls = {} if run.walls is None else {names.WALLS: run.walls.wall, names.WALL_OFFSETS: run.walls.offsets}
    save_arrays(
        folder / names.DRAWS,
        names.SCHEMAS[names.DRAWS],
        {
            "window": draws.window.to_array(),
            "vertex_offsets": draws.vertex_offsets.astype(np.int64),
            "xy": draws.xy.astype(np.float64),
            "side": draws.side.astype(np.int8),
            "edge_offsets": draws.edge_offsets.astype(np.int64),
            "edges": draws.edges.astype(np.int32),
            "anchor_black": draws.anchor_black.astype(np.bool_),
            "chain": run.chain.astype(np.int32),
            "step": run.step.astype(np.int64),
            "probe_xy": run.probe_xy.astype(np.float64),
            "probe_black": run.probe_black.astype(np.bool_).reshape(len(draws), len(run.probe_xy)),
            **{name: np.asarray(values, dtype=np.float64) for name, values in functionals.items()},
            **walls,
        },
    )


def write_image(folder: Path, image: PosteriorImage) -> None:
    """Write posterior.npz."""
    assert image.disagreement is not None
    arrays = {
        "occupancy": image.occupancy.astype(np.float32),
        "square_occupancy": image.square_occupancy.astype(np.float32),
        "origin": np.asarray(image.origin, dtype=np.float64),
        "resolution": np.float64(image.resolution),
        "seen": image.seen.astype(np.bool_),
        "disagreement": image.disagreement.astype(np.float32),
    }
    save_arrays(folder / names.POSTERIOR, names.SCHEMAS[names.POSTERIOR], arrays)


def write_readings(folder: Path, run: RunData) -> None:
    """Write readings.npz; readings at or beyond the max range are written as inf, no laser as no beams."""
    laser = run.laser if run.laser is not None else Readings.from_arrays([0.0, 0.0], [], []).within(np.nan)
    arrays = {**_arrays_of(laser), names.WAY: run.way.astype(np.float64)}
    if run.counts is not None:
        arrays |= {names.COUNT_PREFIX + name: np.asarray(value) for name, value in run.counts._asdict().items()}
    if run.sonar is not None:
        sonar = {**_arrays_of(run.sonar), "cone": run.sonar.cone}
        arrays |= {names.SONAR_PREFIX + name: values for name, values in sonar.items()}
    if run.points is not None:
        arrays[names.POINT_PREFIX + "xy"] = run.points.xy.astype(np.float64)
        arrays[names.POINT_PREFIX + "value"] = run.points.value.astype(np.float64)
    save_arrays(folder / names.READINGS, names.SCHEMAS[names.READINGS], arrays)


def _arrays_of(readings: Readings) -> dict[str, NDArray[Any]]:
    return {
        "origin": readings.origin,
        "angle": readings.angle,
        "range": np.where(readings.returned, readings.range, np.inf),
        "scan": readings.scan,
        "log": readings.log,
        "weight": readings.weight,
        "share": readings.share,
        "max_range": np.array(readings.max_range),
    }


def write_trajectory(folder: Path, found: Trajectory) -> None:
    """Write poses.npz, and trajectory.csv once there are draws."""
    arrays: dict[str, NDArray[Any]] = {
        "scan": found.scan.astype(np.int64),
        "time": found.time.astype(np.float64),
        "given": found.given.astype(np.float64),
        "draws": found.draws.astype(np.float32),
    }
    for kind, owner in (("laser", found.laser), ("sonar", found.sonar)):
        if owner is not None:
            arrays[f"pose_of_{kind}"] = owner.astype(np.int32)
    if found.prior is not None:
        known = found.prior._asdict() | {"noise": found.prior.noise[0]}
        arrays |= {name: np.asarray(value) for name, value in known.items() if name != "given"}
    if (body := found.body) is not None and body.prior is not None:
        own = {"given": body.given[0], "noise": body.prior.noise[0], "draws": body.draws[:, 0]}
        arrays |= {names.BODY_PREFIX + name: value for name, value in own.items()}
    arrays |= {names.LOOP_PREFIX + name: value for name, value in found.disputed._asdict().items()}
    save_arrays(folder / names.POSES, names.SCHEMAS[names.POSES], arrays)
    if len(found.draws):
        with atomic_write(folder / names.TRAJECTORY) as stream:
            stream.writelines(f"{line}\n" for line in trajectory_lines(found))


def trajectory_lines(found: Trajectory) -> Iterator[str]:
    """Yield the lines of trajectory.csv: mean, standard deviation and covariances of each pose, to the last bit."""
    yield names.TRAJECTORY_HEADER
    rows = np.column_stack([found.time, found.mean, found.sd, found.covariance[:, [0, 0, 1], [1, 2, 2]]]).tolist()
    for scan, row in zip(found.scan.tolist(), rows, strict=True):
        yield ",".join([str(scan), *("" if math.isnan(value) else repr(value) for value in row)])


def write_best(folder: Path, run: RunData) -> None:
    """Write map.geojson from the best map of `run`, which must have one."""
    if run.best is None:
        raise ValueError("the run has no best map")
    with atomic_write(folder / names.MAP) as stream:
        stream.write(map_text(run.best, {"log_posterior": run.best_log_posterior}))


def write_object(path: Path, content: Mapping[str, Any]) -> None:
    """Write a JSON object with the schema that files of this name have; nan and infinities become null."""
    without_schema = {key: value for key, value in content.items() if key != "schema"}
    with atomic_write(path) as stream:
        stream.write(dump_object(names.SCHEMAS[path.name], without_schema, indent=2) + "\n")
