"""Write a map for other programs: GeoJSON, ROS map_server, SVG, DXF, netCDF; or its trajectory: TUM, g2o."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from prf.shell.cli.options import Force, Json, Output

if TYPE_CHECKING:
    from prf.output.export import Exported

logger = logging.getLogger(__name__)

EXAMPLES = (
    "prf export office --format ros-map --radius 0.25 --mode scale",
    "prf export office -o office.dxf",
    "prf export office --draw 0 --format geojson -o - | head -c 300",
    "prf export data/demo-office.geojson --format ros-map --resolution 0.1 -o plan.yaml",
)


Format = Literal["geojson", "ros-map", "svg", "dxf", "netcdf", "tum", "g2o"]
"""What to write."""
Mode = Literal["trinary", "scale", "raw"]
"""How map_server reads the pixels."""


Given = Annotated[
    str, typer.Argument(metavar="RUN|GRID|MAP", help="From prf sample or prf grid, or polygons in GeoJSON.")
]
AsFormat = Annotated[Format | None, typer.Option("--format", help="What to write; else by the suffix of the output.")]
DrawNumber = Annotated[
    int | None,
    typer.Option("--draw", metavar="K", help="Draw number K, from 0, instead of the best map or the posterior."),
]
Band = Annotated[
    tuple[float, float] | None,
    typer.Option("--unknown", metavar="LOW HIGH", help="ros-map: unknown between these.  [0.196 0.65]"),
]
Squares = Annotated[
    bool, typer.Option("--squares", help="ros-map: whether any part of a cell is occupied, not its centre.")
]
Returns = Annotated[
    bool, typer.Option("--returns", help="ros-map: how probably a beam that comes there ends there (p_return).")
]
CellSize = Annotated[
    float | None,
    typer.Option("--resolution", metavar="METRES", help="ros-map: cell size.  [0.05; --squares: the run's image's]"),
]
AsMode = Annotated[
    Mode,
    typer.Option("--mode", help="ros-map: trinary is free, occupied, unknown; scale and raw serve the percent."),
]
Radius = Annotated[
    float | None,
    typer.Option(
        "--radius",
        metavar="METRES",
        help="ros-map: how probably a robot of this radius is not free there, over whole maps.",
    ),
]
KeepOut = Annotated[
    float | None,
    typer.Option("--keep-out", metavar="P", help="ros-map: a mask for Nav2's keep-out filter, above this."),
]
Simplify = Annotated[
    float | None,
    typer.Option("--simplify", metavar="METRES", help="dxf, svg: by which outlines may be off.  [dxf 0.05, svg 0]"),
]
AsLayer = Annotated[
    Literal["area", "walls"],
    typer.Option("--layer", help="geojson, dxf: the occupied area; or centre lines and doors of --prior walls."),
]
Extrapolate = Annotated[
    float | None,
    typer.Option(
        "--extrapolate",
        metavar="METRES",
        help="Export the posterior's guess so far beyond what readings saw; else that is unknown.  [0]",
    ),
]


def export(
    source: Given,
    format: AsFormat = None,
    draw: DrawNumber = None,
    unknown: Band = None,
    squares: Squares = False,
    returns: Returns = False,
    resolution: CellSize = None,
    mode: AsMode = "trinary",
    radius: Radius = None,
    keep_out: KeepOut = None,
    simplify: Simplify = None,
    extrapolate: Extrapolate = None,
    layer: AsLayer = "area",
    output: Output = None,
    json: Json = False,
    force: Force = False,
) -> None:
    """Write a map for other programs: GeoJSON, ROS map_server, SVG, DXF, netCDF; or its trajectory: TUM, g2o.

    geojson, svg and dxf take the polygons of the best map, dxf with fewer vertices and on layers by how probable each
    piece of an outline is, ros-map the posterior probability of each cell, netcdf the
    values that were watched in every draw, for ArviZ, tum the means of poses that were sampled, g2o
    the steps between them too, with their information. What no reading saw is unknown in a ros-map, and polygons end
    half a metre beyond what was seen. ros-map writes a yaml file, the image it names, and parameters by which Nav2
    loads them; it is the one format for a GRID. netcdf needs libraries: pip install '.[netcdf]'.
    """
    from prf.output.export import Options, export_source
    from prf.shell.cli import storage
    from prf.shell.cli.console import say_beside
    from prf.shell.cli.outputs import refuse_json_on_stream

    refuse_json_on_stream(output, json)
    options = Options(
        format=format,
        draw=draw,
        unknown=unknown,
        squares=squares,
        mode=mode,
        radius=radius,
        keep_out=keep_out,
        returns=returns,
        resolution=resolution,
        extrapolate=extrapolate,
        simplify=simplify,
        walls=layer == "walls",
    )
    done = export_source(source, output, options, force)
    for note in done.notes:
        logger.warning(note)
    if json:
        content = {"format": done.format, "files": done.files, **done.facts}
        storage.emit_object("prf.export/1", content)
        return
    say = say_beside(output or done.files[0]["path"])
    for line in _lines(done):
        say(line)


def _lines(done: Exported) -> Iterator[str]:
    """Return the table for a person."""
    rows = [(name.removeprefix("n_").replace("_", " "), _words(value)) for name, value in done.facts.items()]
    rows += [("wrote", f"{file['path']}, {file['bytes']:,} B") for file in done.files]
    width = max(len(name) for name, _ in rows) + 2
    return (f"{name:<{width}}{value}" for name, value in rows)


def _words(value: object) -> str:
    if isinstance(value, int):
        return f"{value:,}"
    return f"{value:.6g}" if isinstance(value, float) else str(value)
