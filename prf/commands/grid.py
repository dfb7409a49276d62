"""Build an occupancy grid, the baseline, from localized readings."""

from __future__ import annotations

import logging
from enum import StrEnum
from typing import TYPE_CHECKING, Annotated

import typer

from prf.commands._readings_options import (
    Config,
    EveryBeam,
    EveryScan,
    Frame,
    Laser,
    MaxRange,
    Scans,
    SkipScans,
    Sonar,
    SonarCone,
    SonarMaxRange,
    SonarTopic,
    Topic,
    WindowOption,
    refuse_shared_stream,
)
from prf.shell.options import Force, Json, Output, Presets

if TYPE_CHECKING:
    from prf.occupancy.build import BuiltGrid

logger = logging.getLogger(__name__)

EXAMPLES = (
    "prf grid --laser data/demo-office.log.gz -o office.npz",
    "prf grid --laser intel.log.gz --max-range 40 --skip-scans 5::10",
    "prf grid --laser drive.bag --topic /scan --frame odom",
    "prf grid --sonar ring.csv --method log-odds --resolution 0.05 --config site.toml",
)


class Method(StrEnum):
    """How readings change a cell."""

    counts = "count"
    log_odds = "log-odds"


class NoReturn(StrEnum):
    """What a laser beam without return says."""

    ignore = "ignore"
    free = "free"


def grid(
    laser: Laser = None,
    sonar: Sonar = None,
    topic: Topic = None,
    sonar_topic: SonarTopic = None,
    frame: Frame = None,
    output: Output = None,
    config: Config = None,
    preset: Presets = None,
    method: Annotated[
        Method, typer.Option("--method", help="Count hits and misses (Beta 0.5, 0.5), or add clamped log odds.")
    ] = Method.counts,
    resolution: Annotated[float, typer.Option("--resolution", metavar="METRES", help="Side of a cell.")] = 0.1,
    window: WindowOption = None,
    max_range: MaxRange = None,
    no_return: Annotated[
        NoReturn,
        typer.Option("--no-return", help="Laser beams without return: leave them out, or take them for free space."),
    ] = NoReturn.ignore,
    hit_probability: Annotated[
        float, typer.Option("--hit-probability", metavar="SHARE", help="Log odds: occupied, given one hit.")
    ] = 0.7,
    miss_probability: Annotated[
        float, typer.Option("--miss-probability", metavar="SHARE", help="Log odds: occupied, given one miss.")
    ] = 0.4,
    clamp: Annotated[
        float, typer.Option("--clamp", metavar="NATS", help="Log odds stay within plus and minus this.")
    ] = 3.5,
    sonar_max_range: SonarMaxRange = None,
    sonar_cone: SonarCone = None,
    sonar_thickness: Annotated[
        float, typer.Option("--sonar-thickness", metavar="METRES", help="Depth of the arc that a sonar reading marks.")
    ] = 0.2,
    every_scan: EveryScan = 1,
    every_beam: EveryBeam = 1,
    scans: Scans = None,
    skip_scans: SkipScans = None,
    force: Force = False,
    json: Json = False,
) -> None:
    """Build an occupancy grid, the baseline, from localized readings.

    Every cell is updated on its own: a reading hits the cell in which it ends and misses those that it passed. The
    grid is a .npz file, by default the log's stem with .grid.npz; score, query, render, export and inspect take it in
    place of a RUN.
    """
    options = {name: value for name, value in locals().items() if name not in NOT_SETTINGS}

    from prf.logs import read_logs
    from prf.occupancy import GridConfig, build_grid, write_grid
    from prf.sampler.asked import ask
    from prf.sampler.output import default_output
    from prf.shell.errors import UsageError
    from prf.shell.files import STREAM, refuse_inputs
    from prf.shell.lock import claim_output
    from prf.shell.manifest import describe_process
    from prf.shell.output_names import refuse_other_format

    logs = [log for log in (laser, sonar) if log is not None]
    if not logs:
        raise UsageError("Nothing to map: give --laser LOG, --sonar LOG, or both.")
    refuse_shared_stream({"--laser": laser, "--sonar": sonar, "--config": config})
    if output == STREAM:
        raise UsageError("-o -: a grid is a .npz archive. Name one.")
    target = output or str(default_output(logs[0]).with_suffix(".grid.npz"))
    claim_output(target, force)
    advice = "a grid is written as a .npz archive. Name one; prf render draws it and prf export converts it."
    refuse_other_format(target, (".npz",), advice)
    refuse_inputs([target], [*logs, config])
    asked = ask(options, config, IN_SETTINGS_FILE, preset or ())
    settings = GridConfig(**asked.values)
    readings = read_logs(laser, sonar, topic=topic, frame=frame, sonar_topic=sonar_topic, cone=settings.sonar_cone)
    # Options of this verb have values even where nobody gave them.
    default = GridConfig()
    sources = {name: place for name, place in asked.places.items() if getattr(settings, name) != getattr(default, name)}
    built = build_grid(*readings, settings, {**describe_process(logs), "sources": sources})
    write_grid(target, built.grid)
    if built.n_outside:
        logger.warning(f"{built.n_outside} readings dropped: their sensors stand outside the window")
    _report(built, target, json)


NOT_SETTINGS = ("laser", "sonar", "output", "config", "preset", "force", "json")
IN_SETTINGS_FILE = ("window", "max_range", "sonar_max_range", "sonar_cone")
"""What a grid takes of a settings file; its inverse models share no other parameter with the sensors' densities."""


def _report(built: BuiltGrid, target: str, json: bool) -> None:
    """Print what came of it."""
    from prf.shell import console, jsonout

    made = built.grid
    result = {
        "grid": target,
        "method": made.settings["method"],
        "shape": list(made.occupancy.shape),
        "resolution": made.resolution,
        "window": list(made.window),
        "n_beams": built.n_beams,
        "n_outside": built.n_outside,
        "share_seen": made.share_seen,
    }
    if json:
        jsonout.emit_object("prf.grid.built/1", result)
        return
    n_rows, n_columns = made.occupancy.shape
    console.summarize(f"{n_columns} x {n_rows} cells of {made.resolution:g} m, {made.share_seen:.1%} seen, {target}")
    console.summarize(f"{built.n_beams} readings, method {result['method']}")
