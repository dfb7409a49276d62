"""Build an occupancy grid, the baseline, from localized readings."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING

from prf.commands import _options as o
from prf.configuration import Configuration, named_sources
from prf.shell.cli.options import Force, Json, Output, with_settings
from prf.shell.cli.settings import Loaded

if TYPE_CHECKING:
    from prf.results.occupancy import OccupancyGrid

logger = logging.getLogger(__name__)

EXAMPLES = (
    "prf grid --laser data/demo-office.log.gz -o office.npz",
    "prf grid --laser intel.log.gz --max-range 40 --skip-scans 5::10",
    "prf grid --laser drive.bag --topic /scan --frame odom",
    "prf grid --sonar ring.csv --set grid.method=log-odds --resolution 0.05 --config site.toml",
)


@with_settings(Configuration, "prior.window", "laser.max_range", "sonar.max_range", "sonar.cone", "readings", "grid")
def grid(
    *,
    laser: o.Laser = None,
    sonar: o.Sonar = None,
    output: Output = None,
    settings: Loaded[Configuration],
    force: Force = False,
    json: Json = False,
) -> None:
    """Build an occupancy grid, the baseline, from localized readings.

    Every cell is updated on its own: a reading hits the cell in which it ends and misses those that it passed. The
    grid is a .npz file, by default the log's stem with .grid.npz; score, query, render, export and inspect take it in
    place of a RUN.
    """
    from prf.results.occupancy import build_grid, write_grid
    from prf.sampler.prepare import read_configured, with_poses
    from prf.sampler.session import default_output
    from prf.shell.cli.files import STREAM
    from prf.shell.cli.outputs import claim_output
    from prf.shell.cli.storage import describe_process
    from prf.shell.errors import UsageError

    logs = [*(laser or ()), *(sonar or ())]
    if not logs:
        raise UsageError("Nothing to map: give --laser LOG, --sonar LOG, or both.")
    config = settings.settings
    if output == STREAM:
        raise UsageError("-o -: a grid is a .npz archive. Name one.")
    target = output or str(default_output(logs[0]).with_suffix(".grid.npz"))
    inputs = with_poses(logs, config)
    claim_output(target, force, inputs=[*inputs, settings.file], suffixes=(".npz",))
    readings = read_configured(config, laser or (), sonar or ())
    process = {**describe_process(inputs), "sources": named_sources(settings)}
    made, n_beams, n_outside = build_grid(*readings, config, process)
    write_grid(target, made)
    if n_outside:
        logger.warning(f"{n_outside} readings dropped: their sensors are outside the window")
    _report(made, n_beams, n_outside, target, json)


def _report(made: OccupancyGrid, n_beams: int, n_outside: int, target: str, json: bool) -> None:
    """Print what came of it."""
    from prf.shell.cli import console, storage

    result = {
        "grid": target,
        "method": made.settings["method"],
        "shape": list(made.occupancy.shape),
        "resolution": made.resolution,
        "window": list(made.window),
        "n_beams": n_beams,
        "n_outside": n_outside,
        "share_seen": made.share_seen,
    }
    if json:
        storage.emit_object("prf.grid.built/1", result)
        return
    n_rows, n_columns = made.occupancy.shape
    console.summarize(
        f"Mapped {n_beams:,} readings by the method {result['method']}; {made.share_seen:.1%} of the cells seen."
    )
    console.summarize(f"grid  {target}: {n_columns} x {n_rows} cells of {made.resolution:g} m")
