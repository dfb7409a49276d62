"""Score how well a map predicts held-out readings."""

from __future__ import annotations

import logging
from typing import Annotated, Any

import typer

from prf.commands._readings_options import EveryBeam, EveryScan, MaxRange, Scans, SkipScans
from prf.shell.options import Json, Seed

logger = logging.getLogger(__name__)

EXAMPLES = (
    "prf score office --laser heldout.log.gz --json",
    "prf score intel.grid.npz --laser intel.log.gz --scans 5::10 --max-range 40",
    "prf score plan.geojson --laser office.log.gz --every-scan 10 --seed 1",
)


def score(
    scored: Annotated[
        str,
        typer.Argument(
            metavar="RUN|GRID|MAP", help="From prf sample or prf grid, or GeoJSON polygons of occupied area."
        ),
    ],
    laser: Annotated[
        str, typer.Option("--laser", metavar="HELDOUT", help="Laser readings that the map was not made from.")
    ],
    max_range: MaxRange = None,
    noise: Annotated[float, typer.Option("--noise", metavar="METRES", help="Standard deviation of a range.")] = 0.05,
    noise_relative: Annotated[
        float, typer.Option("--noise-relative", metavar="SHARE", help="The same as a share of the distance.")
    ] = 0.0,
    outlier_probability: Annotated[
        float, typer.Option("--outlier-probability", metavar="SHARE", help="Stray readings.")
    ] = 0.05,
    miss_probability: Annotated[
        float, typer.Option("--miss-probability", metavar="SHARE", help="No return from a wall.")
    ] = 0.0,
    every_scan: EveryScan = 1,
    every_beam: EveryBeam = 1,
    scans: Scans = None,
    skip_scans: SkipScans = None,
    seed: Seed = None,
    json: Json = False,
) -> None:
    """Score how well a map predicts held-out readings.

    Beams with a return are scored one by one: by the density that the map gives each (beam_nll, nats), by points known
    to be occupied or free (auc, nll, brier), and by the distance to the first obstacle (within_0.2m, rmse in metres).
    Held-out readings are a log of their own, or scans that the map was not made from: --skip-scans 5::10 there, --scans
    5::10 here.
    """
    options = {name: value for name, value in locals().items() if name not in NOT_SETTINGS}

    from prf.logs import read_readings
    from prf.score import ScoreConfig, hold_out, open_map
    from prf.score import score as score_map
    from prf.shell.seeds import resolve_seed

    found = open_map(scored)
    held_out = hold_out(read_readings(laser), ScoreConfig(**options))
    result = score_map(found, held_out, resolve_seed(seed))
    if result["n_outside"]:
        logger.warning(f"{result['n_outside']} beams dropped: their sensors stand outside the window of the map")
    if result["within_0.2m"] != result["within_0.2m"]:
        logger.warning(f"{scored}: the run has no best map yet, so within_0.2m and rmse are unknown")
    _report(result, json)


NOT_SETTINGS = ("scored", "laser", "seed", "json")


def _report(result: dict[str, Any], json: bool) -> None:
    """Print the scores."""
    from prf.shell import console, jsonout

    if json:
        jsonout.emit_object("prf.score/1", result)
        return
    width = max(map(len, result))
    for name, value in result.items():
        console.emit(f"{name:{width}}  {f'{value:.6g}' if isinstance(value, float) else value}")
