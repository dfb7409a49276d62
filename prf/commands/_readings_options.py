"""Options that choose readings, the same in every verb that takes a log."""

from __future__ import annotations

from typing import Annotated

import typer

MaxRange = Annotated[
    float | None,
    typer.Option("--max-range", metavar="METRES", help="No return from here on.  [0.97 x the largest range]"),
]
WindowOption = Annotated[
    tuple[float, float, float, float] | None,
    typer.Option("--window", metavar="X0 Y0 X1 Y1", help="Metres.  [all sensors and 99.5 % of the returns + 1 m]"),
]
EveryScan = Annotated[int, typer.Option("--every-scan", metavar="K", min=1, help="Scans 0, K, 2K ...")]
EveryBeam = Annotated[int, typer.Option("--every-beam", metavar="K", min=1, help="Beams 0, K, 2K ...")]
Scans = Annotated[str | None, typer.Option("--scans", metavar="START:STOP:STEP", help="Only these scans.")]
SkipScans = Annotated[str | None, typer.Option("--skip-scans", metavar="START:STOP:STEP", help="All but these scans.")]
