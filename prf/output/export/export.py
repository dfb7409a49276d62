"""One export: formats and files, their content, and what a user should know."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import PurePath
from typing import Any, NamedTuple

import shapely
from shapely import MultiPolygon

from prf.model.coloring import oriented_polygons
from prf.output.export.cells import SMALL_ROBOT, cells_of, closed_though_free, cut_to_known, returned
from prf.output.export.drawings import dxf_text, paper_ratio, plan_dxf, svg_text
from prf.output.export.netcdf import netcdf_bytes
from prf.output.export.outlines import SIMPLIFIED, outlines, simplified
from prf.output.export.ros import FREE_THRESHOLD, MODES, OCCUPIED_THRESHOLD, Mode, nav2_parameters, ros_map
from prf.output.export.source import Source, g2o_text, read_source, require_existing, stem_of, trajectory_of, tum_text
from prf.results import map_text
from prf.results.plan import plan_text
from prf.shell.cli.files import STREAM, encoded, open_output, together
from prf.shell.cli.outputs import beside, exclusive, refuse_existing, refuse_inputs
from prf.shell.errors import InputError, UsageError

GEOJSON, ROS_MAP, SVG, DXF, NETCDF, TUM, G2O = FORMATS = ("geojson", "ros-map", "svg", "dxf", "netcdf", "tum", "g2o")
SUFFIXES = {
    GEOJSON: (".geojson", ".json"),
    ROS_MAP: (".yaml", ".yml", ".pgm"),
    SVG: (".svg",),
    DXF: (".dxf",),
    NETCDF: (".nc", ".netcdf"),
    TUM: (".tum",),
    G2O: (".g2o",),
}
"""Suffixes of an output that name its format; the first one is that of an output without a name."""
AGREED = 0.99
"""Share of the seen ground on which chains agree, below which an export warns."""
LEAST_CLOSED = 1.0
"""Square metres of free cells that are closed to a small robot, above which it warns."""


@dataclass(frozen=True)
class Options:
    """How to export; None and False: not given."""

    format: str | None = None  # one of `FORMATS`; None: by the suffix of the output
    # number of the draw of a RUN to export instead of its best map, its posterior image or the mean of its poses, from
    # 0; -1 is the last
    draw: int | None = None
    # of a ROS map: cells of a probability from the first to the second are unknown
    unknown: tuple[float, float] | None = None
    # of a ROS map: whether a cell is not completely white instead of the colour of its centre
    squares: bool = False
    mode: Mode = "trinary"  # of a ROS map: how map_server reads its pixels
    # of a ROS map, metres: the probability that the disc of this radius round a cell's centre is not free
    radius: float | None = None
    # of a ROS map: a mask of cells of a probability above this, where a robot shall not go
    keep_out: float | None = None
    # of a ROS map: the probability that a beam which reaches a cell ends in it, not that its centre is occupied
    returns: bool = False
    resolution: float | None = None  # of a ROS map made from one map: side of a cell in metres
    # metres beyond the cells that readings saw up to which a RUN or a GRID is exported as it has it; None: 0
    extrapolate: float | None = None
    # of a drawing: metres by which outlines may be off, with fewer vertices; None: `SIMPLIFIED` of DXF, 0 of SVG
    simplify: float | None = None
    walls: bool = False  # centre lines and doors of a map of walls, not the occupied area


class Exported(NamedTuple):
    """What was written: format, files, figures about the content, and what its user should know."""

    format: str
    files: list[dict[str, Any]]  # "path" and "bytes" of each
    facts: dict[str, Any]
    notes: list[str]


def export_source(path: str | os.PathLike[str], output: str | None, options: Options, force: bool = False) -> Exported:
    """Write a run, its trajectory, a grid or one map in the form of another program.

    `path`: RUN directory, GRID file or map in GeoJSON. `output`: where to; None: named after the source, beside it.
    ``-`` is standard output. `force`: overwrite an existing output.
    """
    require_existing(path)
    name = resolve_format(options.format, output)
    check_options(name, options)
    files = targets(name, output, beside(path, stem_of(path)), options.mode)
    for file in files:
        refuse_existing(file, force)
    refuse_inputs(files, [os.fspath(path)])
    with exclusive(*files):
        source = read_source(path, with_readings=options.returns)
        parts, facts = _content(name, source, options, files)
        with together():  # the yaml file of a ROS map, which names the image, is written last
            for target, part in reversed(list(zip(files, parts, strict=True))):
                with open_output(target, binary=isinstance(part, bytes)) as stream:
                    stream.write(part)
    sizes = [len(encoded(part) if isinstance(part, str) else part) for part in parts]
    written = [{"path": file, "bytes": size} for file, size in zip(files, sizes, strict=True)]
    return Exported(name, written, facts, notes_on(source, facts))


def resolve_format(wanted: str | None, output: str | None) -> str:
    """Return the format `wanted`, or else the one that the suffix of `output` names."""
    if wanted is not None:
        return wanted
    suffix = "" if output is None else PurePath(output).suffix.lower()
    for name, suffixes in SUFFIXES.items():
        if suffix in suffixes:
            return name
    problem = "no format is given" if output is None else f"{output}: its suffix names no format"
    raise UsageError(f"{problem}. Give --format {'|'.join(FORMATS)}.")


def check_options(name: str, options: Options) -> None:
    """Refuse options that format `name` has no use for, and values outside their domain (UsageError)."""
    only_ros = {
        "--unknown": options.unknown is not None,
        "--squares": options.squares,
        "--returns": options.returns,
        "--resolution": options.resolution is not None,
        "--mode": options.mode != MODES[0],
        "--radius": options.radius is not None,
        "--keep-out": options.keep_out is not None,
    }
    for flag, given in only_ros.items():
        if given and name != ROS_MAP:
            raise UsageError(f"{flag} is for --format {ROS_MAP} only, not {name}.")
    if name == ROS_MAP:
        _check_ros_map(options)
    if options.returns and (options.squares or options.draw is not None):
        raise UsageError("--returns is of all draws and of whole cells: leave --squares and --draw out.")
    if options.walls and name not in (GEOJSON, DXF):
        raise UsageError(f"--layer walls is for --format geojson and dxf, not {name}.")
    if options.walls and options.extrapolate is not None:
        raise UsageError("--extrapolate is for the occupied area: leave it out beside --layer walls.")
    if options.extrapolate is not None and name in (NETCDF, TUM, G2O):
        raise UsageError(f"--extrapolate is for maps, not for --format {name}.")
    if options.extrapolate is not None and not 0.0 <= options.extrapolate < float("inf"):
        raise UsageError(f"--extrapolate {options.extrapolate:g}: must be a number of metres of at least 0.")
    if options.simplify is not None and name not in (SVG, DXF):
        raise UsageError(f"--simplify is for --format {SVG} and {DXF} only, not {name}.")
    if options.simplify is not None and not 0.0 <= options.simplify < float("inf"):
        raise UsageError(f"--simplify {options.simplify:g}: must be a number of metres of at least 0.")
    if options.draw is not None and name in (NETCDF, G2O):
        raise UsageError(f"--draw is for maps; --format {name} is of all draws.")


def _check_ros_map(options: Options) -> None:
    """Refuse options of a ROS map that do not go together, and values outside their domain (UsageError)."""
    if options.unknown is not None and not 0.0 <= options.unknown[0] <= options.unknown[1] <= 1.0:
        low, high = options.unknown
        raise UsageError(f"--unknown {low:g} {high:g}: needs two probabilities, the lower one first.")
    if options.resolution is not None and not 0.0 < options.resolution < float("inf"):
        raise UsageError(f"--resolution {options.resolution:g}: must be a positive number of metres.")
    if options.mode != MODES[0] and (options.unknown is not None or options.keep_out is not None):
        raise UsageError(f"--mode {options.mode} serves the probability itself: leave --unknown and --keep-out out.")
    if options.unknown is not None and options.keep_out is not None:
        raise UsageError("--keep-out P is a mask with one threshold: leave --unknown out.")
    if options.keep_out is not None and not 0.0 <= options.keep_out < 1.0:
        raise UsageError(f"--keep-out {options.keep_out:g}: must be a probability below 1.")
    if options.radius is not None and not 0.0 < options.radius < float("inf"):
        raise UsageError(f"--radius {options.radius:g}: must be a positive number of metres.")
    if options.radius is not None and (options.squares or options.returns):
        raise UsageError("--radius asks for discs: leave --squares and --returns out.")


def targets(name: str, output: str | None, stem: str, mode: Mode = "trinary") -> tuple[str, ...]:
    """Return the files that an export writes: one, or for a ROS map the yaml file, the image and parameters of Nav2.

    `name`: the format. `output`: as the user gave it. Of a ROS map the name of either file, or their common stem.
    `stem`: names the output if the user did not. `mode`: of a ROS map; an image that can be transparent is a PNG.
    """
    if output == STREAM and name in (ROS_MAP, NETCDF):
        what = "is several files" if name == ROS_MAP else "is binary"
        raise UsageError(f"--format {name} {what} and cannot go to standard output. Name a file with -o.")
    if name != ROS_MAP:
        return (output if output is not None else stem + SUFFIXES[name][0],)
    given = PurePath(stem if output is None else output)
    is_yaml = output is not None and given.suffix.lower() in (".yaml", ".yml")
    is_named = is_yaml or (output is not None and given.suffix.lower() == ".pgm")
    base = given.with_suffix("") if is_named else given
    image = f"{base}.png" if mode == "scale" else f"{base}.pgm"
    return str(given) if is_yaml else f"{base}.yaml", image, f"{base}.nav2.yaml"


def notes_on(source: Source, facts: Mapping[str, Any]) -> list[str]:
    """Return a line where draws were left out, and where the chains of a run disagree on what was seen."""
    notes, run = [], source.run
    if run is not None and facts.get("n_draws_left_out"):
        left_out = f"{facts['n_draws_left_out']} of {len(run.chain)} draws left out, beyond the shortest one."
        notes.append(f"chains of uneven length: {left_out}")
    found = None if run is None or run.image is None else run.image.agreement()
    if run is not None and found is not None and (run.is_early or found.seen < AGREED):
        words = "the run is too short to say where chains agree" if run.is_early else found.words()
        notes.append(f"{words}. Sample longer before you rely on it there: prf sample --resume {source.path}")
    area = facts.get("free_but_closed_m2", 0.0)
    if area > LEAST_CLOSED:
        x, y = facts["free_but_closed_at"]
        free = f"{area:.1f} m2 that this map calls free, most of them round ({x:.1f}, {y:.1f}),"
        why = f"are closed to a disc of {SMALL_ROBOT} m: walls there lie elsewhere in every draw"
        notes.append(f"{free} {why}. For a robot of any size: --radius METRES")
    return notes


def _content(
    name: str, source: Source, options: Options, files: tuple[str, ...]
) -> tuple[tuple[str | bytes, ...], dict[str, Any]]:
    """Return the content of each file, and figures about it."""
    if name == NETCDF:
        return _netcdf(source)
    if name in (TUM, G2O):
        figures = trajectory_of(source).figures()
        text = g2o_text(source) if name == G2O else tum_text(source, options.draw)
        return ((text,), {"n_poses": figures.pop("n"), **figures})
    if name == ROS_MAP:
        return _ros_map(source, options, *files[:2])
    if options.walls:
        return _plan(name, source, options.draw)
    chosen = source.choose_map(options.draw)
    if options.draw is None:
        chosen = cut_to_known(chosen, source.image, options.extrapolate or 0.0)
    whole, window = oriented_polygons(chosen.coloring), chosen.coloring.window
    tolerance = SIMPLIFIED if options.simplify is None and name == DXF else options.simplify or 0.0
    area = simplified(whole, tolerance)
    facts, title = {"map": chosen.title, **_counts(area)}, _printable(chosen.title)
    if tolerance > 0.0:
        facts["n_vertices_before"] = _counts(whole)["n_vertices"]
    if name == GEOJSON:
        return ((map_text(chosen.coloring, chosen.properties),), facts)
    if name == DXF:
        draws = None if source.run is None or options.draw is not None else source.run.draws
        lines = outlines(area, draws, tolerance)
        counts = Counter(line.layer for line in lines)
        facts |= {f"n_{layer}": counts[layer] for layer in sorted(counts)}
        return ((dxf_text(lines, window, title),), facts)
    return ((svg_text(area, window, title),), {**facts, "scale": f"1:{paper_ratio(window):g}"})


def _plan(name: str, source: Source, draw: int | None) -> tuple[tuple[str], dict[str, Any]]:
    """Return centre lines and doors of walls, and figures about them."""
    plan, window = source.choose_plan(draw)
    title = _printable(stem_of(source.path))
    text = plan_text(plan, window) if name == GEOJSON else plan_dxf(plan, window, title)
    return (text,), {"n_walls": len(plan.walls), "length": plan.length, "n_doors": len(plan.doors)}


def _counts(area: MultiPolygon) -> dict[str, Any]:
    """Return polygons, holes in them, corners of all rings (the closing one counted once) and square metres."""
    n_rings = sum(1 + len(polygon.interiors) for polygon in area.geoms)
    n_polygons, n_vertices = len(area.geoms), int(shapely.get_num_coordinates(area)) - n_rings
    return {
        "n_polygons": n_polygons,
        "n_holes": n_rings - n_polygons,
        "n_vertices": n_vertices,
        "area": float(area.area),
    }


def _printable(title: str) -> str:
    """Return a title in one line, with escapes for what XML and DXF cannot hold."""
    plain = " ".join(title.split())
    return "".join(letter if letter.isprintable() else repr(letter)[1:-1] for letter in plain)


def _ros_map(
    source: Source, options: Options, yaml_file: str, image_file: str
) -> tuple[tuple[str | bytes, ...], dict[str, Any]]:
    extrapolate, radius, cells = options.extrapolate or 0.0, options.radius or 0.0, None
    if options.returns:
        cells = returned(source.require_run("returns"), options.resolution, extrapolate)
        if cells is None:
            raise InputError(f"{source.path}: it used no laser, so that it has no p_return. Leave --returns out.")
    else:
        asked: dict[str, Any] = {"squares": options.squares, "radius": radius, "resolution": options.resolution}
        cells = cells_of(source, options.draw, extrapolate, **asked)
    is_mask = options.keep_out is not None
    band = (options.keep_out, options.keep_out) if options.keep_out is not None else options.unknown
    yaml, image, counts = ros_map(cells, band, PurePath(image_file).name, options.mode)
    n_rows, n_columns = cells.probability.shape
    what = "p_return" if options.returns else "p_not_free" if radius else "p_occupied"
    facts = {"probability": what, "mode": options.mode, "n_columns": n_columns, "n_rows": n_rows}
    facts |= {"resolution": cells.resolution, **counts}
    if what == "p_occupied" and options.mode == "trinary" and source.run is not None and options.draw is None:
        free, occupied = options.unknown or (FREE_THRESHOLD, OCCUPIED_THRESHOLD)
        area, place = closed_though_free(cells, source.run, free, occupied)
        facts |= {"free_but_closed_m2": area, "free_but_closed_at": place}
    return (yaml, image, nav2_parameters(yaml_file, options.mode, is_mask, radius)), facts


def _netcdf(source: Source) -> tuple[tuple[bytes], dict[str, Any]]:
    run = source.require_run("chains")
    content, (n_chains, n_draws) = netcdf_bytes(run)
    left_out = len(run.chain) - n_chains * n_draws
    return (content,), {"n_chains": n_chains, "n_draws_per_chain": n_draws, "n_draws_left_out": left_out}
