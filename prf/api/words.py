"""What is said of the readings of a run."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from prf.posterior import Settings
    from prf.sampler.chains import Sampler
    from prf.sampler.config import Prepared
    from prf.sampler.output import Output

logger = logging.getLogger(__name__)


def words_for_beams(n_used: int, n_thinned: int) -> str:
    """Return how many beams are used, of how many."""
    return f"{n_used:,} of {n_used + n_thinned:,} beams (thinned)" if n_thinned else f"{n_used} beams"


def announce_thinning(prepared: Prepared) -> None:
    """Say why not all beams of a dense log are used, and how to use them."""
    if prepared.n_beams_thinned:
        density = prepared.config.thinning.beam_density
        logger.info(
            f"thinned to about {density:g} beams a square metre of seen ground, since more repeat these and slow every "
            "step; --set thinning.beam_density=0 keeps all (docs/large-jobs.md)"
        )


def warn_of_dropped(prepared: Prepared) -> None:
    """Say how many readings and point observations lie outside the window, if any do."""
    if prepared.n_outside:
        logger.warning(f"{prepared.n_outside} readings dropped: their sensors stand outside the window")
    if prepared.n_points_outside:
        logger.warning(f"{prepared.n_points_outside} points dropped: they lie outside the window or on its border")


def describe_run(sampler: Sampler, output: Output) -> str:
    """Return in a line what a run is about."""
    window, n_thinned = sampler.settings.window, int(output.process.get("n_beams_thinned", 0))
    return (
        f"{_readings(sampler.settings, n_thinned)}, window {window.width:.1f} x {window.height:.1f} m, "
        f"{len(sampler.chains)} chains, seed {output.seed}"
    )


def _readings(settings: Settings, n_thinned: int) -> str:
    """Return how many readings of each sensor the run uses, in words."""
    laser, sonar, points = settings.laser, settings.sonar, settings.points
    parts = [words_for_beams(laser.readings.n_beams, n_thinned)] if laser is not None else []
    parts += [f"{sonar.readings.n_beams} sonar readings"] if sonar is not None else []
    return " and ".join(parts + ([f"{len(points.table.value)} points"] if points is not None else []))
