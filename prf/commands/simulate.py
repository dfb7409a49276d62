"""Simulate a robot in a world that is known: logs of laser and sonar, with their truth."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any

import typer

from prf.configuration import Configuration
from prf.shell.cli.options import Force, Json, Output, Seed, with_settings
from prf.shell.cli.settings import Loaded

EXAMPLES = (
    "prf simulate --seed 1 -o wing",
    "prf simulate --world arak --scale 0.1 --size 30 30 --seed 1 -o draw",
    "prf simulate --seed 1 --odometry wheels -o drift",
    "prf simulate --world map.yaml --path drive.csv --no-laser --sonar -o run",
)


World = Annotated[
    str,
    typer.Option(
        "--world",
        metavar="office|arak|FILE",
        help="A generated floor, a draw from the prior, GeoJSON of occupied area, or the yaml file of a ROS map.",
    ),
]
Size = Annotated[
    tuple[float, float] | None,
    typer.Option("--size", metavar="W H", help="Of an office or of a draw's window, metres.  [60 40]"),
]
Scale = Annotated[float | None, typer.Option("--scale", metavar="1/METRE", help="Scale parameter p of a draw.  [0.1]")]
PathFile = Annotated[
    str | None,
    typer.Option("--path", metavar="FILE", help="CSV of waypoints x,y, or of poses x,y,theta to measure at."),
]
Readings = Annotated[
    int | None,
    typer.Option("--readings", metavar="N", help="So many readings instead, about: of the sonar, or else laser beams."),
]
Laser = Annotated[bool, typer.Option("--laser/--no-laser", help="Write laser.log.gz.")]
Sonar = Annotated[bool, typer.Option("--sonar", help="Write sonar.csv.gz, of a ring of 16 transducers.")]


@with_settings(Configuration, "simulate", "trajectory.pose_noise", "trajectory.odometry", "trajectory.odometry_noise")
def simulate(
    *,
    world: World = "office",
    size: Size = None,
    scale: Scale = None,
    path: PathFile = None,
    readings: Readings = None,
    laser: Laser = True,
    sonar: Sonar = False,
    settings: Loaded[Configuration],
    seed: Seed = None,
    output: Output = None,
    force: Force = False,
    json: Json = False,
) -> None:
    """Simulate a robot in a world that is known: logs of laser and sonar, with their truth.

    The robot drives through all space that it can reach. DIR gets truth.geojson, plan.png, laser.log.gz, sonar.csv.gz,
    path.csv and manifest.json: sample, grid and score take the logs, score and export the truth. Robot and sensors are
    the table [simulate] of the settings. With --pose-noise or --odometry the logs have poses with errors, and
    true_poses.csv and .tum the true ones. For one loop give its waypoints as --path.
    """
    from prf.shell.cli import storage
    from prf.shell.cli.console import progress
    from prf.shell.cli.files import STREAM
    from prf.shell.cli.outputs import claim, refuse_existing
    from prf.shell.cli.storage import resolve_seed
    from prf.shell.errors import UsageError
    from prf.simulate import config_of, refuse_absent_sensor, summary, write_simulation
    from prf.simulate import simulate as make

    if output is None or output == STREAM:
        raise UsageError("the result is a directory. Name one with -o DIR.")
    errors = settings.settings.trajectory
    if errors.pose_noise == "auto":
        raise UsageError("--pose-noise auto: there are no scans to judge by yet. Give METRES RADIANS.")
    refuse_existing(output, force, is_folder=True)
    claim(output)
    refuse_absent_sensor(settings.sources, laser, sonar)
    options = {"size": size, "scale": scale, "path": path, "readings": readings, "pose_noise": errors.pose_noise}
    config = config_of(settings.settings.simulate, world, laser, sonar, odometry_noise=errors.step_noise, **options)
    with progress(1.0, "casting beams") as bar:
        simulation = make(config, resolve_seed(seed), bar)
    write_simulation(output, simulation)
    result = {"output": output, **summary(simulation)}
    if json:
        storage.emit_object("prf.simulate/1", result)
    else:
        _report(result)


def _report(result: dict[str, Any]) -> None:
    """Print the table for a person."""
    from prf.shell.cli import console

    for name, value in _rows(result):
        console.summarize(f"{name:<10}{value}")


def _rows(result: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield its rows."""
    x0, y0, x1, y1 = result["window"]
    yield "world", f"{result['world']}, {x1 - x0:g} x {y1 - y0:g} m, {result['n_walls']:,} walls"
    if result["n_redrawn"]:
        yield "redrawn", f"{result['n_redrawn']} times, for too little free space"
    yield "drive", f"{result['path_length']:,.0f} m in {result['duration']:,.0f} s, {result['n_scans']:,} scans"
    if "pose_rmse" in result:
        metres, radians = result["pose_rmse"]
        yield (
            "poses",
            f"err by {metres:.3g} m, {radians:.3g} rad (RMS); true ones in true_poses.csv",
        )
    if result["n_beams"]:
        yield "laser", f"{result['n_beams']:,} beams, {result['n_beams_returned']:,} with a return"
    if result["n_sonar"]:
        yield "sonar", f"{result['n_sonar']:,} readings, {result['n_sonar_returned']:,} with a return"
    yield "seed", str(result["seed"])
    yield "output", f"{result['output']}/, its picture {result['output']}/plan.png"
