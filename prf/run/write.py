"""Writing a RUN directory, each file whole or not at all, so that a run may be written again at any checkpoint."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from prf.run import names
from prf.run.mapfile import map_text
from prf.run.model import Beams, Cones, Points, PosteriorImage, Run
from prf.shell.errors import cannot_write
from prf.shell.files import atomic_write
from prf.shell.jsonout import dump_object
from prf.shell.storage import save_arrays


def write_run(path: str | os.PathLike[str], run: Run) -> None:
    """Write all parts of `run` that are not None into the directory `path`, which is made if need be.

    Each file is replaced whole; the manifest comes last, so that a directory without one is no run yet. Files of
    other names (a checkpoint, pictures) are left alone. Whether an existing run may be replaced is the caller's to
    ask.
    """
    folder = Path(path)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise cannot_write(folder, error) from error
    write_draws(folder, run)
    if run.image is not None:
        write_image(folder, run.image)
    if any(part is not None for part in (run.beams, run.cones, run.points)):
        write_readings(folder, run.beams, run.cones, run.points, run.way)
    if run.best is not None:
        write_best(folder, run)
    if run.diagnostics is not None:
        write_object(folder / names.DIAGNOSTICS, run.diagnostics)
    write_manifest(folder, run.manifest)


def write_manifest(folder: Path, manifest: Mapping[str, Any]) -> None:
    """Write manifest.json; the schema is added."""
    write_object(folder / names.MANIFEST, manifest)


def write_draws(folder: Path, run: Run) -> None:
    """Write draws.npz: the draws, where each comes from, functionals and probe colours."""
    draws = run.draws
    functionals = {names.FUNCTIONAL_PREFIX + name: values for name, values in run.functionals.items()}
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


def write_readings(
    folder: Path,
    beams: Beams | None,
    cones: Cones | None,
    points: Points | None = None,
    way: NDArray[np.float64] | None = None,
) -> None:
    """Write readings.npz; readings at or beyond the max range are written as inf, no laser as no beams."""
    if beams is None:
        nothing = np.zeros(0)
        beams = Beams(np.zeros((0, 2)), nothing, nothing, np.zeros(0, np.int64), np.nan)
    arrays = {
        "origin": beams.origin.astype(np.float64),
        "angle": beams.angle.astype(np.float64),
        "range": np.where(beams.range < beams.max_range, beams.range, np.inf),
        "scan": beams.scan.astype(np.int64),
        "max_range": np.float64(beams.max_range),
        names.WAY: np.zeros((0, 4)) if way is None else way.astype(np.float64),
    }
    if cones is not None:
        silent = ~(cones.range < cones.max_range)
        arrays |= {
            names.SONAR_PREFIX + name: values
            for name, values in (
                ("origin", cones.origin.astype(np.float64)),
                ("angle", cones.angle.astype(np.float64)),
                ("cone", cones.cone.astype(np.float64)),
                ("range", np.where(silent, np.inf, cones.range)),
                ("scan", cones.scan.astype(np.int64)),
                ("max_range", np.float64(cones.max_range)),
            )
        }
    if points is not None:
        arrays[names.POINT_PREFIX + "xy"] = points.xy.astype(np.float64)
        arrays[names.POINT_PREFIX + "value"] = points.value.astype(np.float64)
    save_arrays(folder / names.READINGS, names.SCHEMAS[names.READINGS], arrays)


def write_best(folder: Path, run: Run) -> None:
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
