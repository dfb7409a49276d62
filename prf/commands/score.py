"""Score how well a map predicts held-out readings."""

from __future__ import annotations

import logging
from typing import Annotated, Any

import typer

from prf.configuration import SCORE_DEFAULTS, Configuration, PoseOptions
from prf.shell.cli.options import Json, Seed, with_settings
from prf.shell.cli.settings import Loaded

MAIN = {
    "kind": "",
    "n_draws": "maps",
    "n_beams": "held-out beams with a return",
    "pose_ess": "effective samples of a held-out pose",
    "beam_nll": "nats a beam, lower is better",
    "auc": "1 is best, 0.5 a guess: do occupied points rank above free ones",
    "nll": "nats a point, lower is better",
    "brier": "squared error of the probability of a point, lower is better",
    "within_0.2m": "share of beams whose first obstacle is so near, higher is better",
    "rmse": "m, of the first obstacle",
    "n_readings": "held-out sonar readings",
    "sonar_nll": "nats a reading, lower is better",
    "iou_occupied": "overlap with the true plan, 1 is best",
    "iou_free": "the same of free space",
    "seed": "",
}
"""What is printed without ``-v``, and in words what it is (docs/scores.md has all)."""

FEW = 5.0
"""Effective samples of a pose below which its integral is doubtful."""

logger = logging.getLogger(__name__)

EXAMPLES = (
    "prf score office --laser heldout.log.gz --json",
    "prf score intel.grid.npz --laser intel.log.gz --scans 5::10 --max-range 40",
    "prf score ring --sonar ring.csv --scans 5::10 --config sonar.toml",
    "prf score ring --sonar ring.csv --truth floor.geojson --json",
)


@with_settings(Configuration, "laser", "sonar", "readings", "trajectory.pose_noise", defaults=SCORE_DEFAULTS)
def score(
    scored: Annotated[
        str,
        typer.Argument(
            metavar="RUN|GRID|MAP", help="From prf sample or prf grid, or GeoJSON polygons of occupied area."
        ),
    ],
    *,
    laser: Annotated[
        list[str] | None,
        typer.Option("--laser", metavar="HELDOUT", help="Laser readings that the map was not made from."),
    ] = None,
    sonar: Annotated[
        list[str] | None, typer.Option("--sonar", metavar="HELDOUT", help="Sonar readings, alone or with a laser's.")
    ] = None,
    truth: Annotated[
        str | None,
        typer.Option("--truth", metavar="PLAN.geojson", help="True plan: cells in view of the readings are compared."),
    ] = None,
    square: Annotated[
        float,
        typer.Option(
            "--square",
            metavar="METRES",
            help="Side of the square round a held-out point whose probability is scored; 0: the point, of a GRID its "
            "cell.",
        ),
    ] = 0.2,
    settings: Loaded[Configuration],
    seed: Seed = None,
    json: Json = False,
) -> None:
    """Score how well a map predicts held-out readings.

    Laser beams with a return are scored one by one: by the density that the map gives each (beam_nll, nats), by squares
    round points known to be occupied or free (auc, nll, brier; of a RUN by the probability that a beam ends there), and
    by the distance to the first obstacle (within_0.2m, rmse in metres). Sonar readings are scored by their density, or
    the probability of no return (sonar_nll, nats). Cells of a true plan give iou_occupied and iou_free. Held-out
    readings are a log of their own, or scans that the map was not made from: --skip-scans 5::10 there, --scans 5::10
    here. With --pose-noise their poses are integrated out, on any kind of map. -v prints all figures, --json too.
    """
    from prf.results.score import hold_out, hold_out_sonar, open_map, poses_of_run, read_occupied_area, true_cells
    from prf.results.score import score as score_map
    from prf.sampler.prepare import read_configured
    from prf.shell.cli.storage import resolve_seed
    from prf.shell.errors import UsageError

    lasers, sonars = laser or [], sonar or []
    if not lasers and not sonars and truth is None:
        raise UsageError("Nothing to score by: give --laser HELDOUT, --sonar HELDOUT or --truth PLAN.geojson.")
    configuration = settings.settings
    _check_poses(configuration.trajectory, lasers, sonars)
    found = open_map(scored)
    if lasers and not configuration.readings.poses and (own := poses_of_run(scored, lasers)):
        logger.info(f"{' and '.join(lasers)}: poses of {' and '.join(own['poses'])}, as {scored} was sampled with")
        configuration = configuration.replace(**own)
    readings = read_configured(configuration, lasers, sonars)
    beams = None if readings[0] is None else hold_out(readings[0], configuration)
    cones = None if readings[1] is None else hold_out_sonar(readings[1], configuration)
    cells = None if truth is None else true_cells(read_occupied_area(truth), beams, cones)
    result = score_map(found, beams, resolve_seed(seed) if lasers else None, cones, cells, square)
    _warn(scored, result)
    _report(result, json)


def _check_poses(options: PoseOptions, lasers: list[str], sonars: list[str]) -> None:
    """Refuse poses that are uncertain in a way that cannot be scored."""
    from prf.shell.errors import UsageError

    if options.pose_noise is not None and (not lasers or sonars):
        raise UsageError("--pose-noise: only a laser's poses are integrated out. Give --laser, and no --sonar.")
    if options.step_noise is not None:
        raise UsageError(
            "trajectory.odometry: held-out poses are not followed by odometry, only given ones are integrated out. "
            "Leave it out, and give poses (--poses) and their errors (--pose-noise)."
        )


def _warn(scored: str, result: dict[str, Any]) -> None:
    """Warn of what could not be scored, or not well."""
    if result.get("pose_ess", FEW) < FEW:
        logger.warning(
            f"beam_nll is uncertain: {result['pose_ess']:.1f} effective samples of a held-out pose (docs/scores.md)"
        )
    for key, what in (("n_outside", "beams"), ("n_readings_outside", "sonar readings")):
        if result.get(key):
            logger.warning(f"{result[key]} {what} dropped: their sensors are outside the window of the map")
    if result.get("within_0.2m", 0.0) != result.get("within_0.2m", 0.0):
        logger.warning(f"{scored}: the run has no best map yet, so within_0.2m and rmse are unknown")


def _report(result: dict[str, Any], json: bool) -> None:
    """Print the scores."""
    from prf.shell.cli import console, storage

    if json:
        storage.emit_object("prf.score/1", result)
        return
    shown = {name: value for name, value in result.items() if name in MAIN or console.is_verbose()}
    width = max(map(len, shown))
    for name, value in shown.items():
        words = f"{value:.6g}" if isinstance(value, float) else str(value)
        console.emit(f"{name:{width}}  {words:10}  {MAIN.get(name, '')}".rstrip())
