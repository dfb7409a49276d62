"""What is said of the readings of a run."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from prf.sampler.config import Prepared
    from prf.sampler.session import Session

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


def describe_session(session: Session) -> str:
    """Return in a line what a run is about."""
    window = session.sampler.settings.window
    return (
        f"{_readings(session)}, window {window.width:.1f} x {window.height:.1f} m, "
        f"{len(session.sampler.chains)} chains, seed {session.output.seed}"
    )


def _readings(session: Session) -> str:
    """Return how many readings of each sensor the run uses, in words."""
    used = session.output
    thinned = int(used.process.get("n_beams_thinned", 0))
    parts = [words_for_beams(len(used.beams.range), thinned)] if used.beams is not None else []
    parts += [f"{len(used.cones.range)} sonar readings"] if used.cones is not None else []
    return " and ".join(parts + ([f"{len(used.points.value)} points"] if used.points is not None else []))
