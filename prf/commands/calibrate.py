"""Fit the parameters of sensors to readings in a known map."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from prf.commands._options import (
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
    Topic,
    refuse_shared_stream,
)
from prf.shell.options import Assignments, Force, Json, Output

if TYPE_CHECKING:
    from prf.calibrate import Calibrated

EXAMPLES = (
    "prf calibrate --sonar ring.csv --map floor.geojson -o sonar.toml",
    "prf calibrate --laser office.log.gz --map office.yaml --every-scan 10",
    "prf calibrate --sonar ring.csv --laser ring.log --map floor.geojson -o robot.toml --json",
)


def calibrate(
    known: Annotated[
        str, typer.Option("--map", metavar="MAP", help="True map: GeoJSON polygons, or the .yaml of a map for ROS.")
    ],
    sonar: Sonar = None,
    laser: Laser = None,
    topic: Topic = None,
    frame: Frame = None,
    output: Output = None,
    sonar_max_range: SonarMaxRange = None,
    sonar_cone: SonarCone = None,
    max_range: MaxRange = None,
    every_scan: EveryScan = None,
    every_beam: EveryBeam = None,
    scans: Scans = None,
    skip_scans: SkipScans = None,
    config: Config = None,
    assignments: Assignments = None,
    force: Force = False,
    json: Json = False,
) -> None:
    """Fit the parameters of sensors to readings in a known map.

    Poses and walls are taken as true; what is found are the parameters under which the readings are most probable, with
    weak priors round the defaults, and their standard errors. `prf score MAP --config` tests them on other scans.
    -o writes them as a settings file for --config. Without -o they are printed only.
    """
    options = locals()

    from prf.calibrate import calibrate_laser, calibrate_sonar, fitted_text, read_known_map
    from prf.configuration import load_configuration
    from prf.sampler.prepare import read_configured
    from prf.shell.errors import UsageError
    from prf.shell.files import open_output, refuse_inputs
    from prf.shell.lock import claim_output
    from prf.shell.output_names import refuse_other_format
    from prf.shell.streams import refuse_json_beside

    if sonar is None and laser is None:
        raise UsageError("Nothing to calibrate by: give --sonar LOG, --laser LOG, or both.")
    refuse_shared_stream({"--map": known, "--sonar": sonar, "--laser": laser, "--config": config})
    refuse_json_beside(output, json)
    if output is not None:
        claim_output(output, force)
        refuse_other_format(output, (".toml",), "parameters are written as a settings file. Name a .toml.")
        refuse_inputs([output], [known, sonar, laser])
    settings = load_configuration(options).settings
    area = read_known_map(known)
    beams, cones = read_configured(settings, laser, sonar)
    found = []
    if cones is not None:
        found.append(calibrate_sonar(cones, area, settings))
    if beams is not None:
        found.append(calibrate_laser(beams, area, settings))
    if output is not None:
        with open_output(output) as stream:
            stream.write(fitted_text(found))
    _report(found, output, json)


def _report(found: list[Calibrated], output: str | None, json: bool) -> None:
    """Print what came of it."""
    from prf.calibrate import lines_of, report_of
    from prf.shell import jsonout
    from prf.shell.streams import say_beside

    if json:
        parts = {part.kind: report_of(part) for part in found}
        jsonout.emit_object("prf.calibrate/2", {**parts, "output": output})
        return
    say = say_beside(output)
    for part in found:
        for line in lines_of(part):
            say(line)
