"""Make a map with known errors: an urban world, driven through and rendered from odometry."""

from __future__ import annotations

import os
from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Any

import typer

from prf.shell.options import Force, Json, Output, Seed

if TYPE_CHECKING:
    from mapq.simulate import Report

EXAMPLES = (
    "mapq simulate -o map.ply --seed 1",
    "mapq simulate -o small.ply --size small --seed 1 --json",
    "mapq simulate -o clean.ply --size small --seed 1 --drift 0",
    "mapq simulate -o city/ --size city --n-points 100000000 --seed 1",
)


CITY, CITY_POINTS = "city", 10_000_000
"""Name of the size that is a folder of tiles, and its points if not told."""


def simulate(
    size: Annotated[
        str,
        typer.Option(
            "--size",
            metavar="small|medium|large|city",
            help="A world of about 55 000, 560 000 or 1 120 000 points; the options below change parts of it. Or a "
            "city of any number of points, as LAZ tiles in a folder.",
        ),
    ] = "medium",
    n_points: Annotated[
        int | None, typer.Option("--n-points", metavar="N", help="Points of the map, about.  [by --size]")
    ] = None,
    blocks: Annotated[
        int | None,
        typer.Option("--blocks", metavar="N", help="Blocks that the robot rounds, one after the other.  [by --size]"),
    ] = None,
    loops: Annotated[
        int | None, typer.Option("--loops", metavar="N", help="How often the robot rounds each block.  [2]")
    ] = None,
    drift: Annotated[
        float | None,
        typer.Option("--drift", metavar="FACTOR", help="Drift of odometry, times the usual; 0 gives a clean map.  [1]"),
    ] = None,
    look_alikes: Annotated[
        float | None,
        typer.Option(
            "--look-alikes",
            metavar="FACTOR",
            help="True walls close to each other (gaps, fences, garden walls), times the usual; 0 for none.  [1]",
        ),
    ] = None,
    variety: Annotated[
        float | None,
        typer.Option(
            "--variety",
            metavar="FACTOR",
            help="Lorries side by side, sheds, balconies, hedges: 3 at most.  [0]",
        ),
    ] = None,
    clutter: Annotated[
        float | None, typer.Option("--clutter", metavar="FACTOR", help="Cars, trees, people, times the usual.  [1]")
    ] = None,
    noise: Annotated[
        float | None, typer.Option("--noise", metavar="METRES", help="Standard deviation of a range.  [0.015]")
    ] = None,
    all_round: Annotated[
        bool, typer.Option("--all-round", help="The laser looks all round, as on cars; else half a turn ahead.")
    ] = False,
    max_range: Annotated[
        float | None, typer.Option("--max-range", metavar="METRES", help="Longest range of the laser.  [35]")
    ] = None,
    disagreement: Annotated[
        float | None,
        typer.Option(
            "--disagreement",
            metavar="METRES",
            help="Suspicious is where passes disagree by more than this along the normal.  [0.05]",
        ),
    ] = None,
    tile_points: Annotated[
        int | None, typer.Option("--tile-points", metavar="N", help="Of a city: points of a tile, about.  [2500000]")
    ] = None,
    seed: Seed = None,
    output: Output = None,
    force: Force = False,
    json: Json = False,
) -> None:
    """Make a map with known errors: an urban world, driven through and rendered from odometry.

    A street lined with offices, a block rounded twice, a pathway under an archway; a 2D laser that nods. The point
    field `truth` is 1 where passes over one true surface disagree in the map; docs/simulation.md lists the fields. A
    city is made without a drive, tile by tile; docs/scale.md.
    """
    from mapq.io import write_cloud
    from mapq.io.write import check_name
    from mapq.simulate import Settings, simulate_with_report
    from prf.shell import jsonout
    from prf.shell.errors import UsageError
    from prf.shell.lock import claim_output
    from prf.shell.progress import progress
    from prf.shell.seeds import resolve_seed
    from prf.shell.streams import refuse_json_beside, say_beside

    if output is None:
        raise UsageError("the map has no name. Give one with -o MAP.ply.")
    refuse_json_beside(output, json)
    changes = {
        "n_points": n_points,
        "blocks": blocks,
        "loops": loops,
        "drift": drift,
        "look_alikes": look_alikes,
        "variety": variety,
        "clutter": clutter,
        "noise": noise,
        "all_round": all_round or None,
        "max_range": max_range,
        "disagreement": disagreement,
    }
    if size == CITY:
        _make_city(output, changes, tile_points, resolve_seed(seed), force, json)
        return
    if tile_points is not None:
        raise UsageError("--tile-points is for --size city: other worlds are one file.")
    check_name(output)
    claim_output(output, force)
    settings, used_seed = Settings.of_size(size, changes), resolve_seed(seed)
    with progress(1.0, "casting beams") as bar:
        simulation = simulate_with_report(settings, used_seed, bar.update)
    write_cloud(output, simulation.cloud)
    if json:
        content = {"output": output, "seed": used_seed, "settings": settings.as_dict()}
        jsonout.emit_object("mapq.simulate/1", {**content, **simulation.report._asdict()})
        return
    say = say_beside(output)
    for name, value in _rows(simulation.report, output, used_seed):
        say(f"{name:<16}{value}")


def _make_city(
    folder: str, changes: dict[str, Any], tile_points: int | None, seed: int, force: bool, json: bool
) -> None:
    """Write a city as LAZ tiles into a folder."""
    from mapq.simulate.city_tiles import POINTS_OF_TILE, write_city
    from prf.shell import console, jsonout
    from prf.shell.errors import OutputExists, UsageError
    from prf.shell.files import STREAM
    from prf.shell.lock import claim, claim_output
    from prf.shell.progress import progress

    others = [name for name, value in changes.items() if value is not None and name != "n_points"]
    if others:
        raise UsageError(f"--{others[0].replace('_', '-')} is not for --size city, which is made without a drive.")
    if folder == STREAM:
        raise UsageError("a city is a folder of tiles. Name one with -o FOLDER.")
    if not os.path.isdir(folder):
        claim_output(folder, force)
    elif os.listdir(folder) and not force:
        raise OutputExists(f"{folder} already exists. Use --force to overwrite.")
    claim(folder)
    n_points = CITY_POINTS if changes["n_points"] is None else changes["n_points"]
    with progress(1.0, "making tiles") as bar:
        counts = write_city(folder, n_points, seed, tile_points or POINTS_OF_TILE, bar.update)
    if json:
        jsonout.emit_object("mapq.city/1", {"output": folder, "seed": seed, **counts})
        return
    share = counts["suspicious_points"] / counts["points"]
    console.summarize(f"{'tiles':<16}{counts['tiles']} in {folder}")
    console.summarize(f"{'points':<16}{counts['points']:,}, {share:.1%} suspicious")
    console.summarize(f"{'seed':<16}{seed}")


def _rows(report: Report, output: str, seed: int) -> Iterator[tuple[str, str]]:
    """Yield the table for a person."""
    kinds = ", ".join(f"{n:,} {kind.replace('_', ' ')}" for kind, n in report.points_by_kind.items() if n > 0)
    yield "map", output
    yield "points", f"{report.points:,}: {kinds}"
    yield "drive", f"{report.path_length:.0f} m in {report.duration:.0f} s, {report.passes} passes"
    yield "final drift", f"{report.final_drift:.2f} m, {report.final_drift_deg:.2f} degrees"
    yield (
        "suspicious",
        f"{report.suspicious_points:.1%} of the points, {report.suspicious_wall_points:.1%} of those on vertical "
        f"surfaces, {report.suspicious_cells:.1%} of the cells of these",
    )
    yield "surfaces", f"{report.surfaces:,} vertical ones with 20 points or more"
    yield (
        "look-alikes",
        f"{report.look_alike_surfaces:.1%} of these surfaces, {report.look_alike_points:.1%} of the points on "
        "vertical surfaces",
    )
    yield "seed", str(seed)
