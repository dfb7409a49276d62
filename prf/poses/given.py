"""How far given poses err, as scans show that disagree with one another there."""

from __future__ import annotations

import logging
import math
from typing import Literal, NamedTuple

import numpy as np

from prf.poses.align import align
from prf.poses.errors import MEDIAN
from prf.poses.graph import pull_of
from prf.poses.model import pose_model
from prf.poses.plane import in_words, wrapped
from prf.poses.scans import scans_of
from prf.poses.start import FAR
from prf.readings import Readings
from prf.readings.steps import devices_of, jitter_of
from prf.shell.errors import ConfigError

MOST_SCANS = 250  # of a log that are compared, evenly
MANY_SCANS = 200  # of a log, from which on that takes seconds
FEWEST_SCANS = 8
FIRST = (0.1, 0.03)  # m, rad: errors that are looked for at first; ...
MOST_ROUNDS = 4  # ... larger ones pull the poses back to where they are given, until that is seen
ROOM = 0.8  # share of what is looked for up to which errors are not held back
MEDIAN_2D = math.sqrt(2.0 * math.log(2.0))
"""Median of the length of a normal vector in the plane, in standard deviations."""
ADVISED = (0.04, 0.015)
"""Metres and radians from which on a map is better with poses that are sampled too (benchmarks/README.md)."""
GOOD, COVERED = (0.1, math.radians(1.0)), 0.05
"""Metres and radians up to which noise of the ranges covers them, metres of that at least (docs/poses.md)."""
LEAST = (0.01, 0.002)
"""Metres and radians that poses are taken to err by at least, where it is not given."""
FAR_OFF, SMOOTH = 0.3, 0.4
"""Metres from which on poses that jitter by less than this share of them are raw odometry."""


logger = logging.getLogger(__name__)


class PoseErrors(NamedTuple):
    """Standard deviations of given poses."""

    metres: float
    radians: float
    jitter: float = math.inf  # metres that successive poses differ by independently, at most; inf: not known

    def words(self) -> str:
        """Return them for a person."""
        return in_words(self.metres, self.radians)

    def flags(self) -> str:
        """Return the options by which they are sampled with the map; empty where they do little harm."""
        if self.metres < ADVISED[0] and self.radians < ADVISED[1]:
            return ""
        return "--odometry wheels" if self.is_odometry else self.pose_noise()

    def pose_noise(self) -> str:
        """Return the option that says by how much they err."""
        return f"--pose-noise {max(self.metres, LEAST[0]):.2g} {max(self.radians, LEAST[1]):.2g}"

    def covered(self) -> float | None:
        """Return the noise of ranges, metres, that covers them; None where they err too far for that."""
        is_good = self.metres <= GOOD[0] and self.radians <= GOOD[1]
        return max(COVERED, math.ceil(100.0 * self.metres) / 100.0) if is_good and not self.is_odometry else None

    def advice(self, flags: str = "") -> str:
        """Return what to do about them, by these `flags` instead of :meth:`flags`; empty where they do little harm."""
        if not self.flags():
            return ""
        why = ", though they run on smoothly, as raw odometry does" if self.is_odometry else ""
        noise = None if flags else self.covered()
        either = "" if noise is None else f"--noise {noise:.2g} covers that, or "
        return (
            f"poses err by about {self.words()}, as scans disagree with one another{why}: "
            f"{either}sample them with the map, prf sample {flags or self.flags()}"
        )

    @property
    def is_odometry(self) -> bool:
        """Whether poses err far, but not one by one: errors that add up along the way."""
        return self.metres > FAR_OFF and self.jitter < SMOOTH * self.metres


def given_errors(laser: Readings, noise: float) -> PoseErrors | None:
    """Return how far the given poses of a laser's scans err independently; None where the scans do not show it.

    The scans are aligned with one another (:func:`prf.poses.align.align`), held to the given poses by as much as these
    seem to err; what all have in common, and what changes slowly along the way, stays unseen in part. `noise`: standard
    deviation of a range, metres.
    """
    scans = np.unique(laser.scan)
    if len(scans) < FEWEST_SCANS:
        return None
    chosen = laser.select(np.isin(laser.scan, scans[:: 1 + len(scans) // MOST_SCANS]))
    if len(scans) >= MANY_SCANS:
        logger.info(f"comparing scans of {laser.source}, to see how far poses err ...")
    held, found = np.array(FIRST), np.zeros(2)
    for _ in range(MOST_ROUNDS):
        model = pose_model(chosen, None, held.tolist())
        points, given = scans_of(model, chosen, noise), model.prior.given
        if not len(points.owner):
            return None
        error = float(held[0] + FAR * held[1])
        off = align(points, given, pull_of(model.prior), error, np.random.default_rng(0), layouts=1) - given
        shift, turn = np.hypot(off[:, 0], off[:, 1]), np.abs(wrapped(off[:, 2]))
        found = np.array([np.median(shift) / MEDIAN_2D, np.median(turn) / MEDIAN])
        if (found <= ROOM * held).all():
            break
        held = np.maximum(held, found / ROOM)
    jitter = max((jitter_of(pose).metres for pose in devices_of(laser.notes.scans)), default=math.inf)
    return PoseErrors(float(found[0]), float(found[1]), jitter if jitter > 0.0 else math.inf)


def warn_of_errors(laser: Readings, noise: float) -> None:
    """Log a warning where given poses err by more than the noise of ranges, metres, covers."""
    found = given_errors(laser, noise)
    if found is not None and found.advice() and noise < (found.covered() or math.inf):
        logger.warning(f"{laser.source}: {found.advice()}")


def pose_noise(
    asked: tuple[float, float] | Literal["auto"] | None, laser: Readings | None, noise: float
) -> tuple[float, float] | None:
    """Return the errors of given poses that were asked for, or that the scans of a laser show."""
    if asked != "auto":
        return asked
    found = None if laser is None else given_errors(laser, noise)
    if found is None:
        raise ConfigError("--pose-noise auto: there are too few scans to show how far poses err. Give METRES RADIANS.")
    logger.info(f"poses err by about {found.words()}, as scans disagree with one another")
    return max(found.metres, LEAST[0]), max(found.radians, LEAST[1])
