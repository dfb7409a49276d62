"""Kind, origin and state of a result: RUN, GRID, MAP or DRAWS. No damaged file of a run raises anything here."""

from __future__ import annotations

import json
import os
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
import shapely

from prf.kernels.constants import STEP
from prf.model.coloring import read_geojsonl
from prf.results import names, read_manifest, read_map_feature
from prf.results.occupancy import SCHEMA as GRID_SCHEMA
from prf.results.occupancy import is_grid, read_grid
from prf.results.read import read_best, read_draws, read_image, read_readings, read_trajectory
from prf.results.score import read_occupied_area
from prf.shell.cli.files import open_input
from prf.shell.cli.pictures import counted
from prf.shell.cli.storage import OtherVersion, damaged, load_arrays, load_object, take_array
from prf.shell.errors import InputError, PrfError

_OLD_CHECKPOINT = (
    "this release reads the draws, but cannot resume from here. Use the release that wrote it, or sample anew."
)


class FileState(NamedTuple):
    """State of one file: "ok", "missing", "damaged" or "other version"; what it holds, or why it cannot be read."""

    name: str
    state: str
    bytes: int | None
    schema: str | None
    summary: str

    @property
    def is_lost(self) -> bool:
        """Whether it is there and cannot be read, nor the run without it, as without an old checkpoint."""
        spare = self.state == "other version" and self.name == names.CHECKPOINT
        return self.state in ("damaged", "other version") and not spare


def inspect_files(path: str | os.PathLike[str]) -> list[FileState]:
    """Return the state of every file that a RUN directory should hold, in the order of the documentation."""
    folder = Path(path)
    if not (folder / names.MANIFEST).is_file():
        read_manifest(folder)  # raises what is wrong with the folder itself
    kept = {name: how for name, how in _SUMMARIES.items() if name not in _OF_POSES or (folder / name).exists()}
    return [_inspect(folder / name, summarise) for name, summarise in kept.items()]


def _inspect(file: Path, summarise: Callable[[Path], str]) -> FileState:
    schema = {**names.SCHEMAS, names.CHECKPOINT: names.CHECKPOINT_SCHEMA}.get(file.name)
    if not file.is_file():
        return FileState(file.name, "missing", None, schema, "")
    size = file.stat().st_size
    try:
        return FileState(file.name, "ok", size, schema, summarise(file))
    except OtherVersion as error:
        words = f"{error.found}: {_OLD_CHECKPOINT}" if file.name == names.CHECKPOINT else _without_name(error, file)
        return FileState(file.name, "other version", size, error.found, words)
    except PrfError as error:
        return FileState(file.name, "damaged", size, schema, _without_name(error, file))


def _without_name(error: PrfError, file: Path) -> str:
    return str(error).removeprefix(f"{file}: ")


def _summarise_manifest(file: Path) -> str:
    return f"status {load_object(file, names.SCHEMAS[names.MANIFEST]).get('status', 'unknown')}"


def _summarise_draws(file: Path) -> str:
    fields: dict[str, Any] = read_draws(file)
    chains = len(set(fields["chain"].tolist()))
    edges = fields["draws"].n_edges
    middle = f", {edges.mean():.0f} edges on average" if len(edges) else ""
    watched = ", ".join(fields["functionals"]) or "none"
    return f"{counted(len(edges), 'draw')} of {counted(chains, 'chain')}{middle}; functionals {watched}"


def _summarise_image(file: Path) -> str:
    image = read_image(file)
    n_rows, n_columns = image.occupancy.shape
    return f"{n_columns} x {n_rows} cells of {image.resolution:g} m"


def _summarise_readings(file: Path) -> str:
    found = read_readings(file)
    parts = []
    for name, what in (("laser", "beams"), ("sonar", "sonar readings")):
        readings = found[name]
        if readings is not None:
            n_returns, reach = int(np.count_nonzero(readings.returned)), readings.max_range
            parts.append(f"{readings.n_beams} {what}, {n_returns} with a return below {reach:g} m")
    points = found["points"]
    if points is not None:
        parts.append(f"{len(points.value)} points")
    return "; ".join(parts)


def _summarise_poses(file: Path) -> str:
    found = read_trajectory(file)
    return f"{len(found.draws)} draws; {found.words()}"


def _summarise_trajectory(file: Path) -> str:
    header, *rows = file.read_text(errors="replace").splitlines() or [""]
    if header != names.TRAJECTORY_HEADER:
        raise damaged(file, f"its first line is not {names.TRAJECTORY_HEADER}")
    return f"{counted(len(rows), 'pose')}, mean and standard deviation"


def _summarise_best(file: Path) -> str:
    coloring, log_posterior = read_best(file)
    return f"best map: {coloring.n_edges} edges, log posterior {log_posterior:.2f}"


def _summarise_diagnostics(file: Path) -> str:
    content = load_object(file, names.SCHEMAS[names.DIAGNOSTICS])
    return str(content.get("reason", ""))


def _summarise_checkpoint(file: Path) -> str:
    arrays = load_arrays(file, names.CHECKPOINT_SCHEMA)
    chains = [name for name in arrays if name.endswith(".graph.counts") and ".hot" not in name]
    counts = [take_array(file, arrays, name, np.int64, (None,)) for name in chains]
    if not counts or min(map(len, counts)) <= STEP:
        raise damaged(file, "it has no chains")
    return f"{counted(len(counts), 'chain')} at step {int(counts[0][STEP]):,}"


def _summarise_picture(file: Path) -> str:
    from PIL import Image  # noqa: PLC0415 - for this file alone

    try:
        with Image.open(file) as picture:
            picture.verify()
            return f"{picture.width} x {picture.height} pixels"
    except (OSError, SyntaxError, ValueError, struct.error) as error:
        raise damaged(file, "incomplete picture") from error


_SUMMARIES: dict[str, Callable[[Path], str]] = {
    names.MANIFEST: _summarise_manifest,
    names.DRAWS: _summarise_draws,
    names.POSTERIOR: _summarise_image,
    names.READINGS: _summarise_readings,
    names.POSES: _summarise_poses,
    names.TRAJECTORY: _summarise_trajectory,
    names.MAP: _summarise_best,
    names.DIAGNOSTICS: _summarise_diagnostics,
    names.CHECKPOINT: _summarise_checkpoint,
    names.PICTURE: _summarise_picture,
}

_OF_POSES = (names.POSES, names.TRAJECTORY)
"""Files that runs with fixed poses do not have."""

Kind = Literal["run", "grid", "map", "draws"]


def inspect(path: str | os.PathLike[str]) -> tuple[Kind, dict[str, Any], list[FileState]]:
    """Return what the directory or file `path` is and holds; the kind is recognised from the content.

    Beside the kind: how it was made, as far as it is recorded, and its files, of everything but a run one.
    """
    place = Path(path)
    if place.is_dir():
        return "run", read_manifest(place), inspect_files(place)
    if not place.exists():
        raise InputError(f"{path}: no such file or directory.")
    kind, manifest, summary = _look_into(place)
    return kind, manifest, [FileState(place.name, "ok", place.stat().st_size, manifest["schema"], summary)]


def _look_into(file: Path) -> tuple[Kind, dict[str, Any], str]:
    """Return kind, manifest and summary of a file."""
    if is_grid(file):
        grid = read_grid(file)
        n_rows, n_columns = grid.occupancy.shape
        summary = f"{n_columns} x {n_rows} cells of {grid.resolution:g} m, {grid.share_seen:.1%} seen"
        return "grid", {"schema": GRID_SCHEMA, **grid.process, "configuration": grid.settings}, summary
    with open_input(file) as stream:
        data = stream.read()
    content, line = _object(data), _object(data.lstrip().partition(b"\n")[0])
    if content is None and line is None:
        raise InputError(f"{file}: neither a RUN, a GRID, a MAP nor DRAWS. prf info shows what is in a log.")
    geometry = (content or {}).get("geometry")
    if content is None or (isinstance(geometry, dict) and geometry.get("type") == "MultiLineString"):
        draws = read_geojsonl(file)
        mean = f"on average {draws.n_edges.mean():.1f} edges, {draws.total_length().mean():.1f} m"
        return "draws", {"schema": None, "window": list(draws.window)}, f"{len(draws)} draws, {mean}"
    schema = names.SCHEMAS[names.MAP]
    if content.get("schema") == schema:
        coloring, properties = read_map_feature(file)
        return "map", {"schema": schema, **properties}, f"{coloring.n_edges} edges, {coloring.n_vertices} vertices"
    area = read_occupied_area(file)  # of another program, which does not record how it was made
    n_polygons = sum(part.geom_type == "Polygon" for part in shapely.get_parts(area.region))
    summary = f"polygons of another program: {n_polygons}, together {area.region.area:.1f} m2"
    return "map", {"schema": None, "window": None if area.window is None else list(area.window)}, summary


def _object(text: bytes) -> dict[str, Any] | None:
    try:
        content = json.loads(text)
    except (ValueError, RecursionError):
        return None
    return content if isinstance(content, dict) else None
