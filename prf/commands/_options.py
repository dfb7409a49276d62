"""Options that choose readings and the model of their sensors, the same in every verb that takes a log.

None means the default that the help text gives in brackets.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated

import typer

Laser = Annotated[
    str | None, typer.Option("--laser", metavar="LOG", help="Localized laser readings; - is standard input.")
]
Sonar = Annotated[
    str | None, typer.Option("--sonar", metavar="LOG", help="Localized sonar readings, alone or with a laser's.")
]
Topic = Annotated[
    str | None,
    typer.Option(
        "--topic",
        metavar="NAME",
        help="Laser: topic of a bag, device of a Player log, kind of CARMEN lines.  [all, in a bag the only one]",
    ),
]
PointData = Annotated[
    str | None,
    typer.Option("--point-data", metavar="FILE.csv", help="Values at points, CSV x,y,value; alone or with a log."),
]
Frame = Annotated[
    str | None,
    typer.Option(
        "--frame",
        metavar="NAME",
        help="Frame, or topic of poses, that poses are taken in; with --poses what these are of.  [map]",
    ),
]
Poses = Annotated[
    str | None,
    typer.Option("--poses", metavar="FILE", help="Poses for scans without or with worse ones: TUM, KITTI, g2o, CSV."),
]
PoseNoise = Annotated[
    tuple[float, float] | None,
    typer.Option("--pose-noise", metavar="METRES RADIANS", help="The poses err by so much, independently."),
]
Odometry = Annotated[
    str | None,
    typer.Option("--odometry", metavar="KIND", help="The poses are odometry: precise, wheels or poor."),
]
Config = Annotated[
    str | None,
    typer.Option("--config", metavar="FILE.toml", help="Settings file; flags and --set win over it."),
]
SonarMaxRange = Annotated[
    float | None, typer.Option("--sonar-max-range", metavar="METRES", help="Sonar: no return from here on.  [3.5]")
]
SonarCone = Annotated[
    float | None,
    typer.Option("--sonar-cone", metavar="RAD", help="Full field of view, where the log has none.  [0.349]"),
]
Scale = Annotated[
    float | None, typer.Option("--scale", metavar="1/METRE", help="Scale parameter p of the prior.  [0.1]")
]
WindowOption = Annotated[
    tuple[float, float, float, float] | None,
    typer.Option("--window", metavar="X0 Y0 X1 Y1", help="Metres.  [all sensors and 99.5 % of the returns + 1 m]"),
]
MaxRange = Annotated[
    float | None,
    typer.Option("--max-range", metavar="METRES", help="No return from here on.  [0.97 x the largest range]"),
]
DrivenRadius = Annotated[
    float | None,
    typer.Option(
        "--driven-radius",
        metavar="METRES",
        help="A disc of this radius round the sensor was free all along the way driven; 0: not known.  [0.1]",
    ),
]
DrivenPoses = Annotated[
    str | None,
    typer.Option("--driven-poses", metavar="used|all", help="The way: of the scans in use, or of the log.  [used]"),
]
EveryScan = Annotated[int | None, typer.Option("--every-scan", metavar="K", min=1, help="Scans 0, K, 2K ...  [1]")]
EveryBeam = Annotated[int | None, typer.Option("--every-beam", metavar="K", min=1, help="Beams 0, K, 2K ...  [1]")]
Scans = Annotated[str | None, typer.Option("--scans", metavar="START:STOP:STEP", help="Only these scans.")]
SkipScans = Annotated[str | None, typer.Option("--skip-scans", metavar="START:STOP:STEP", help="All but these scans.")]
Noise = Annotated[
    float | None, typer.Option("--noise", metavar="METRES", help="Standard deviation of a range.  [0.03; score: 0.05]")
]
NoiseRelative = Annotated[
    float | None,
    typer.Option("--noise-relative", metavar="SHARE", help="The same as a share of the distance.  [0.01; score: 0]"),
]
OutlierProbability = Annotated[
    float | None, typer.Option("--outlier-probability", metavar="SHARE", help="Share of outliers.  [0.05]")
]
MissProbability = Annotated[
    float | None, typer.Option("--miss-probability", metavar="SHARE", help="No return from a wall.  [0.02; score: 0]")
]


def refuse_shared_stream(inputs: Mapping[str, str | None]) -> None:
    """Raise UsageError if more than one of the options is given as standard input."""
    from prf.shell.cli.files import STREAM
    from prf.shell.errors import UsageError

    streams = [f"{flag} -" for flag, path in inputs.items() if path == STREAM]
    if len(streams) > 1:
        raise UsageError(f"{' '.join(streams)}: standard input can be read once only.")
