"""Find where to look next: places from which one scan is expected to settle most."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from prf.shell.cli.options import Force, Json, Output

if TYPE_CHECKING:
    from prf.results.explore import Exploration

logger = logging.getLogger(__name__)

EXAMPLES = (
    "prf explore rooms",
    "prf explore rooms --from 2.0 4.2 --by gain-per-metre -o places.csv --picture places.png",
    "prf explore rooms --for door.csv --radius 0.3",
)


def explore(
    run: Annotated[str, typer.Argument(metavar="RUN", help="What prf sample wrote.")],
    start: Annotated[
        tuple[float, float] | None,
        typer.Option("--from", metavar="X Y", help="Where the robot is, metres.  [where the sensor was last]"),
    ] = None,
    target: Annotated[
        str | None,
        typer.Option(
            "--for",
            metavar="PATH.csv",
            help="What to settle: corners x,y of a path, or of a region if the last is the first.",
        ),
    ] = None,
    radius: Annotated[
        float, typer.Option("--radius", metavar="METRES", help="Radius of the disc that drives, and follows the path.")
    ] = 0.25,
    by: Annotated[Literal["gain", "gain-per-metre"], typer.Option("--by", help="What places are ranked by.")] = "gain",
    places: Annotated[int, typer.Option("--places", metavar="N", min=1, help="How many rows at most.")] = 20,
    picture: Annotated[
        str | None, typer.Option("--picture", metavar="FILE", help="Draw them over the posterior: png, svg or pdf.")
    ] = None,
    output: Output = None,
    force: Force = False,
    json: Json = False,
) -> None:
    """Find where to look next: places from which one scan is expected to settle most.

    CSV rows x,y,theta,gain_nats,low,high,metres,gain_per_metre,p_free, best first. gain_nats is the expected drop, by
    one scan from there, of the entropies of p_occupied, summed over cells of 0.2 m; with --for that of the entropy of
    "a disc of this radius can follow the path", or of the cells in the region alone. The sensor is that of the log;
    theta, radians, is the heading from which it sees most of it. low and high bound the gain at 95 %. Places are those
    that the disc reaches with p_free of 0.9 or more, by a way of so many metres.
    """
    from prf.output.pictures import render_places
    from prf.output.run import read_run
    from prf.readings.points import read_points
    from prf.results import names
    from prf.shell.cli.files import STREAM
    from prf.shell.cli.outputs import claim_output
    from prf.shell.cli.pictures import picture_format

    if picture is not None:
        picture_format(picture)
        claim_output(picture, force, inputs=[target])
    if output is not None:
        claim_output(output, force, inputs=[target], suffixes=(".csv",), json=json)
    corners = None if target is None else read_points(target)
    source = read_run(run, parts=(names.POSTERIOR, names.READINGS, names.POSES, names.MAP))
    found = source.explore(start, corners, radius=radius, by=by)
    if picture is not None:
        render_places(source, found, picture, corners, radius)
    _write(found, places, output, json)
    for wrote in (output, picture):
        if wrote not in (None, STREAM):
            logger.info("wrote %s", wrote)
    if found.high[0] == float("inf"):
        logger.warning("%s: too few draws a chain to bound the gains. Sample longer: prf sample --resume.", run)
    elif found.low[0] <= 0.0:
        logger.warning("%s: no gain is surely above 0: little is open that a scan from these places would show.", run)


def _write(found: Exploration, most: int, output: str | None, json: bool) -> None:
    from prf.shell.cli import console, storage
    from prf.shell.cli.files import open_output

    columns = {
        "x": found.xy[:, 0],
        "y": found.xy[:, 1],
        "theta": found.theta,
        "gain_nats": found.gain,
        "low": found.low,
        "high": found.high,
        "metres": found.metres,
        "gain_per_metre": found.gain_per_metre,
        "p_free": found.p_free,
    }
    rows = list(zip(*(column[:most].round(4).tolist() for column in columns.values()), strict=True))
    table = "\n".join([",".join(columns), *(",".join(map(repr, row)) for row in rows)])
    if output is not None:
        with open_output(output) as stream:
            stream.write(f"{table}\n")
    if json:
        content = [dict(zip(columns, row, strict=True)) for row in rows]
        storage.emit_object("prf.explore/1", {"places": content, "entropy": found.entropy})
    elif output is None:
        console.emit(table)
