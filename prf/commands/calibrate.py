"""Fit the parameters of sensors to readings in a known map."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from prf.commands import _options as o
from prf.configuration import Configuration
from prf.shell.cli.options import Force, Json, Output, with_settings
from prf.shell.cli.settings import Loaded

if TYPE_CHECKING:
    from prf.calibrate import Calibrated

EXAMPLES = (
    "prf calibrate --sonar ring.csv --map floor.geojson -o sonar.toml",
    "prf calibrate --laser office.log.gz --map office.yaml --every-scan 10",
    "prf calibrate --sonar ring.csv --laser ring.log --map floor.geojson -o robot.toml --json",
)


@with_settings(Configuration, "laser.max_range", "sonar.max_range", "sonar.cone", "readings")
def calibrate(
    *,
    known: Annotated[
        str, typer.Option("--map", metavar="MAP", help="True map: GeoJSON polygons, or the .yaml of a map for ROS.")
    ],
    sonar: o.Sonar = None,
    laser: o.Laser = None,
    output: Output = None,
    settings: Loaded[Configuration],
    force: Force = False,
    json: Json = False,
) -> None:
    """Fit the parameters of sensors to readings in a known map.

    Poses and walls are taken as true; what is found are the parameters under which the readings are most probable, with
    weak priors round the defaults, and their standard errors. `prf score MAP --config` tests them on other scans.
    -o writes them as a settings file for --config. Without -o they are printed only.
    """
    from prf.calibrate import calibrate_laser, calibrate_sonar, fitted_text, read_known_map
    from prf.sampler.prepare import read_configured, with_poses
    from prf.shell.cli.files import open_output
    from prf.shell.cli.outputs import claim_output
    from prf.shell.errors import UsageError

    if not sonar and not laser:
        raise UsageError("Nothing to calibrate by: give --sonar LOG, --laser LOG, or both.")
    config = settings.settings
    logs = [*(sonar or ()), *(laser or ())]
    if output is not None:
        claim_output(output, force, inputs=with_poses([known, *logs], config), suffixes=(".toml",), json=json)
    area = read_known_map(known)
    beams, cones = read_configured(config, laser or (), sonar or ())
    found = []
    if cones is not None:
        found.append(calibrate_sonar(cones, area, config))
    if beams is not None:
        found.append(calibrate_laser(beams, area, config))
    if output is not None:
        with open_output(output) as stream:
            stream.write(fitted_text(found))
    _report(found, output, json)


def _report(found: list[Calibrated], output: str | None, json: bool) -> None:
    """Print what came of it."""
    from prf.calibrate import lines_of, report_of
    from prf.shell.cli import storage
    from prf.shell.cli.console import is_verbose, say_beside

    if json:
        parts = {part.kind: report_of(part) for part in found}
        storage.emit_object("prf.calibrate/2", {**parts, "output": output})
        return
    say, most = say_beside(output), None if is_verbose() or len(found) == 1 else 4
    for part in found:
        for line in lines_of(part, most):
            say(line)
    if output is not None:
        say(f"{'wrote':22} {output}; use it as --config {output}")
