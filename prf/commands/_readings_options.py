"""Options that choose readings and the model of their sensors, the same in every verb that takes a log.

None stands for the default that the help text gives in brackets.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated

import typer

SCIENCE = (
    "scale",
    "window",
    "max_range",
    "topic",
    "sonar_topic",
    "frame",
    "beam_density",
    "every_scan",
    "every_beam",
    "scans",
    "skip_scans",
    "noise",
    "noise_relative",
    "outlier_probability",
    "miss_probability",
    "sonar_max_range",
    "sonar_cone",
    "driven_radius",
    "driven_poses",
)
"""Options of sample and anneal that are fields of the configuration; what is not given is resolved from the log."""

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
SonarTopic = Annotated[
    str | None,
    typer.Option(
        "--sonar-topic", metavar="NAME", help="The same of the sonar's log, in a bag several with commas.  [all]"
    ),
]
Frame = Annotated[
    str | None,
    typer.Option("--frame", metavar="NAME", help="Frame or odometry topic that poses are taken in.  [map]"),
]
Config = Annotated[
    str | None,
    typer.Option("--config", metavar="FILE.toml", help="Parameters of prior and sensors; options win over the file."),
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
BeamDensity = Annotated[
    float | None,
    typer.Option("--beam-density", metavar="1/METRE2", help="Thin a denser log of a laser to about this.  [16]"),
]
NoThinning = Annotated[bool, typer.Option("--no-thinning", help="Use every beam: as --beam-density 0.")]
Scans = Annotated[str | None, typer.Option("--scans", metavar="START:STOP:STEP", help="Only these scans.")]
SkipScans = Annotated[str | None, typer.Option("--skip-scans", metavar="START:STOP:STEP", help="All but these scans.")]
Noise = Annotated[
    float | None, typer.Option("--noise", metavar="METRES", help="Standard deviation of a range.  [0.03]")
]
NoiseRelative = Annotated[
    float | None, typer.Option("--noise-relative", metavar="SHARE", help="The same as a share of the distance.  [0.01]")
]
OutlierProbability = Annotated[
    float | None, typer.Option("--outlier-probability", metavar="SHARE", help="Stray readings.  [0.05]")
]
MissProbability = Annotated[
    float | None, typer.Option("--miss-probability", metavar="SHARE", help="No return from a wall.  [0.02]")
]


def refuse_shared_stream(inputs: Mapping[str, str | None]) -> None:
    """Raise UsageError if more than one of the options is given as standard input."""
    from prf.shell.errors import UsageError
    from prf.shell.files import STREAM

    streams = [f"{flag} -" for flag, path in inputs.items() if path == STREAM]
    if len(streams) > 1:
        raise UsageError(f"{' '.join(streams)}: standard input can be read once only.")


def chosen_density(beam_density: float | None, no_thinning: bool) -> float | None:
    """Return the density of beams asked for, if any; raise UsageError if the two options contradict each other."""
    from prf.shell.errors import UsageError

    if no_thinning and beam_density:
        raise UsageError(f"--no-thinning and --beam-density {beam_density:g}: give one of them.")
    return 0.0 if no_thinning else beam_density
