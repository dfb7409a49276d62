"""What a result is, how it was made, and whether its files are sound: RUN, GRID, MAP or DRAWS."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any, Literal, NamedTuple

import shapely

from prf.coloring import read_geojsonl
from prf.occupancy import SCHEMA as GRID_SCHEMA
from prf.occupancy import is_grid, read_grid
from prf.run import FileState, inspect_files, names, read_manifest, read_map_feature
from prf.score import read_occupied_area
from prf.shell.errors import InputError
from prf.shell.files import open_input

Kind = Literal["run", "grid", "map", "draws"]


class Inspection(NamedTuple):
    """What was found."""

    kind: Kind
    manifest: dict[str, Any]  # how it was made, as far as it says so
    files: list[FileState]  # one for everything but a run


def inspect(path: str | os.PathLike[str]) -> Inspection:
    """Return what the directory or file `path` is and holds; the kind is told by the content."""
    place = Path(path)
    if place.is_dir():
        return Inspection("run", read_manifest(place), inspect_files(place))
    if not place.exists():
        raise InputError(f"{path}: no such file or directory.")
    if is_grid(place):
        return _inspect_grid(place)
    content = _read_json(place)
    if content is None or _is_draw(content):
        return _inspect_draws(place)
    return _inspect_map(place) if content.get("schema") == names.SCHEMAS[names.MAP] else _inspect_polygons(place)


def _read_json(file: Path) -> dict[str, Any] | None:
    """Return the one JSON object that a file is, or None if it is several, one a line."""
    with open_input(file) as stream:
        data = stream.read()
    for text in (data, data.lstrip().partition(b"\n")[0]):
        content = _object(text)
        if content is not None:
            return content if text is data else None
    raise InputError(f"{file}: neither a RUN, a GRID, a MAP nor DRAWS. prf info says what is in a log.")


def _object(text: bytes) -> dict[str, Any] | None:
    try:
        content = json.loads(text)
    except (ValueError, RecursionError):
        return None
    return content if isinstance(content, dict) else None


def _is_draw(content: dict[str, Any]) -> bool:
    """Return whether an object is a single line of DRAWS."""
    geometry = content.get("geometry")
    return isinstance(geometry, dict) and geometry.get("type") == "MultiLineString"


def _inspect_grid(file: Path) -> Inspection:
    grid = read_grid(file)
    n_rows, n_columns = grid.occupancy.shape
    summary = f"{n_columns} x {n_rows} cells of {grid.resolution:g} m, {grid.share_seen:.1%} seen"
    manifest = {"schema": GRID_SCHEMA, **grid.process, "configuration": grid.settings}
    return Inspection("grid", manifest, [_sound(file, GRID_SCHEMA, summary)])


def _inspect_map(file: Path) -> Inspection:
    coloring, properties = read_map_feature(file)
    schema = names.SCHEMAS[names.MAP]
    summary = f"{coloring.n_edges} edges, {coloring.n_vertices} vertices"
    return Inspection("map", {"schema": schema, **properties}, [_sound(file, schema, summary)])


def _inspect_polygons(file: Path) -> Inspection:
    """Take polygons of another program, which says nothing of how they were made."""
    area = read_occupied_area(file)
    n_polygons = sum(part.geom_type == "Polygon" for part in shapely.get_parts(area.region))
    manifest = {"schema": None, "window": None if area.window is None else list(area.window)}
    summary = f"polygons of another program: {n_polygons}, together {area.region.area:.1f} m2"
    return Inspection("map", manifest, [_sound(file, None, summary)])


def _inspect_draws(file: Path) -> Inspection:
    draws = read_geojsonl(file)
    summary = f"{len(draws)} draws, on average {draws.n_edges.mean():.1f} edges, {draws.total_length().mean():.1f} m"
    return Inspection("draws", {"schema": None, "window": list(draws.window)}, [_sound(file, None, summary)])


def _sound(file: Path, schema: str | None, summary: str) -> FileState:
    return FileState(file.name, "ok", file.stat().st_size, schema, summary)
