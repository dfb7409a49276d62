"""Make a map with known errors: an urban world, driven through and rendered from odometry."""

from __future__ import annotations

import os
from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated

import typer

from mapq.configuration import Configuration, SimulateSettings, sources_of, typed_keys
from prf.shell.cli.options import Force, Json, Output, Seed, with_settings
from prf.shell.cli.settings import Loaded

if TYPE_CHECKING:
    from mapq.simulate import Report

EXAMPLES = (
    "mapq simulate -o map.ply --seed 1",
    "mapq simulate -o small.ply --size small --seed 1 --json",
    "mapq simulate -o clean.ply --size small --seed 1 --drift 0 --set simulate.clutter=0",
    "mapq simulate -o city/ --size city --n-points 100000000 --seed 1",
)


CITY, CITY_POINTS = "city", 10_000_000
"""Name of the size that is a folder of tiles, and its default number of points."""


@with_settings(Configuration, "simulate", shown={"simulate.n_points": "by --size"})
def simulate(
    *,
    settings: Loaded[Configuration],
    size: Annotated[
        str,
        typer.Option(
            "--size",
            metavar="small|medium|large|city",
            help="A world of about 55 000, 560 000 or 1 120 000 points; or a city of any number of points, as LAZ "
            "tiles in a folder.",
        ),
    ] = "medium",
    seed: Seed = None,
    output: Output = None,
    force: Force = False,
    json: Json = False,
) -> None:
    """Make a map with known errors: an urban world, driven through and rendered from odometry.

    A street of offices, a block driven around twice, a pathway under an archway; a 2D laser that nods. The point field
    `truth` is 1 where passes over one true surface disagree in the map; docs/simulation.md describes the other fields
    and the table [simulate] of the settings. A city is made without a drive, tile by tile; docs/scale.md.
    """
    from mapq.io import write_cloud
    from mapq.io.write import check_name
    from mapq.simulate import simulate_with_report
    from prf.shell.cli import storage
    from prf.shell.cli.console import progress, say_beside
    from prf.shell.cli.outputs import claim_output
    from prf.shell.cli.storage import resolve_seed
    from prf.shell.errors import UsageError

    if output is None:
        raise UsageError("the map has no name. Give one with -o MAP.ply.")
    if size == CITY:
        _make_city(output, settings, resolve_seed(seed), force, json)
        return
    check_name(output)
    claim_output(output, force, json=json)
    changes = {name: getattr(settings.settings.simulate, name) for name in _given(settings)}
    chosen, used_seed = SimulateSettings.of_size(size, changes), resolve_seed(seed)
    with progress(1.0, "casting beams") as bar:
        simulation = simulate_with_report(chosen, used_seed, bar)
    write_cloud(output, simulation.cloud)
    if json:
        content = {"output": output, "seed": used_seed, "settings": chosen.model_dump()}
        storage.emit_object("mapq.simulate/1", {**content, **simulation.report._asdict()})
        return
    say = say_beside(output)
    for name, value in _rows(simulation.report, output, used_seed):
        say(f"{name:<16}{value}")


def _make_city(folder: str, settings: Loaded[Configuration], seed: int, force: bool, json: bool) -> None:
    """Write a city as LAZ tiles into a folder."""
    from mapq.simulate.city import write_city
    from prf.shell.cli import console, storage
    from prf.shell.cli.console import progress
    from prf.shell.cli.files import STREAM
    from prf.shell.cli.outputs import claim, claim_output
    from prf.shell.errors import OutputExists, UsageError

    given = _given(settings)
    others = [source for name, source in given.items() if name != "n_points"]
    if others:
        raise UsageError(f"{others[0]}: not for --size city, which is made without a drive.")
    if folder == STREAM:
        raise UsageError("a city is a folder of tiles. Name one with -o FOLDER.")
    if not os.path.isdir(folder):
        claim_output(folder, force)
    elif os.listdir(folder) and not force:
        raise OutputExists(f"{folder} already exists. Use --force to overwrite.")
    claim(folder)
    n_points = settings.settings.simulate.n_points if "n_points" in given else CITY_POINTS
    with progress(1.0, "making tiles") as bar:
        counts = write_city(folder, n_points, seed, progress=bar)
    if json:
        storage.emit_object("mapq.city/1", {"output": folder, "seed": seed, **counts})
        return
    share = counts["suspicious_points"] / counts["points"]
    console.summarize(f"{'tiles':<16}{counts['tiles']} in {folder}")
    console.summarize(f"{'points':<16}{counts['points']:,}, {share:.1%} suspicious")
    console.summarize(f"{'seed':<16}{seed}")


def _given(settings: Loaded[Configuration]) -> dict[str, str]:
    """Return key to what has set it, of keys of a world; a file of settings may hold defaults, which are by size."""
    typed, values, usual = typed_keys(settings, "simulate"), settings.settings.simulate, SimulateSettings()
    given = sources_of(settings, "simulate").items()
    return {name: each for name, each in given if name in typed or getattr(values, name) != getattr(usual, name)}


def _rows(report: Report, output: str, seed: int) -> Iterator[tuple[str, str]]:
    """Yield the table for a person."""
    kinds = ", ".join(f"{n:,} {kind.replace('_', ' ')}" for kind, n in report.points_by_kind.items() if n > 0)
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
    yield "map", output
