"""Options that several verbs of `prf` share and that are not settings: logs, and when to stop."""

from __future__ import annotations

from typing import Annotated

import typer

from prf.shell.cli.options import parse_duration

Laser = Annotated[
    list[str] | None,
    typer.Option(
        "--laser", metavar="LOG", help="Localized laser readings; - is standard input; several: in one frame."
    ),
]
Sonar = Annotated[
    list[str] | None,
    typer.Option("--sonar", metavar="LOG", help="Localized sonar readings, alone or with a laser's; also several."),
]
PointData = Annotated[
    str | None,
    typer.Option("--point-data", metavar="FILE.csv", help="Values at points, CSV x,y,value; alone or with a log."),
]
Steps = Annotated[
    int | None,
    typer.Option(
        "--steps",
        metavar="N",
        min=1,
        help="Steps a chain in total, burn-in included; up to whole rounds of 10,000 or more.",
    ),
]
TimeBudget = Annotated[
    float | None,
    typer.Option(
        "--time-budget",
        metavar="TIME",
        parser=parse_duration,
        help="Time instead of steps, from when readings and trajectory are prepared; seconds, or 90s, 5m, 1h30m.",
    ),
]
