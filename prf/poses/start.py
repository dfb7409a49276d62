"""Where chains of uncertain poses start: at poses at which the scans agree.

Odometry is first corrected on the way, then loops are closed, near given poses if there are any. Poses without odometry
are aligned as they are given.
"""

from __future__ import annotations

import dataclasses
import logging
from typing import NamedTuple

import numpy as np

from prf.poses.align import align, disturbed
from prf.poses.errors import independence
from prf.poses.follow import Followed, follow
from prf.poses.graph import HELD, Pull, pull_of
from prf.poses.loops import Way, close_loops, closures
from prf.poses.model import PoseModel, PosePrior
from prf.poses.pieces import LoopMatch
from prf.poses.plane import Floats
from prf.poses.scans import WallPoints, scans_of
from prf.readings import Readings
from prf.shell.cli.console import Report, progress, report_nothing

logger = logging.getLogger(__name__)

FAR = 5.0  # metres, a usual range: how far an error of the heading moves points
LEAST_SCALE = 1.3  # times that odometry errs more than was said, from which it is taken to
LEAST_FIT = 0.5  # up to 1, of a scan that lies on what was seen just before it
MOST_UNFIT = 0.12  # share that lies worse, beyond which scans are too far apart: of raw Intel 0, of one in five .15
LEFT = 0.1  # metres that points lie apart once loops are closed, about
MOST_POINTS = 200_000  # more add little


class Agreed(NamedTuple):
    """Poses at which scans agree, one way that the robot may have gone."""

    poses: Floats  # (n, 3)
    pull: Pull  # what holds them besides scans
    share: float  # its probability, about


class Start(NamedTuple):
    """Where chains start: at draws about each of the ways that the robot may have gone."""

    model: PoseModel  # starts at the likeliest way; its odometry errs as scans show
    scans: WallPoints
    ways: list[Agreed]  # the likeliest first
    loops: list[LoopMatch]  # of odometry: plausible closures, used on that or not
    independence: float = 1.0  # independent readings of the model that a beam is worth

    @property
    def poses(self) -> Floats:
        """Return the poses (n, 3) of the likeliest way."""
        return self.ways[0].poses

    def draw(
        self, rng: np.random.Generator, sign: float = 1.0, way: float = 0.0, report: Report = report_nothing
    ) -> Floats:
        """Return poses (n, 3), about a draw of their posterior, so that chains start apart; sign -1: the opposite one.

        `way`: a number from 0 to 1; ways have parts of it by their probabilities. The share done is reported.
        """
        parts = np.cumsum([each.share for each in self.ways])
        poses, pull, _ = self.ways[min(int(np.searchsorted(parts, way, side="right")), len(parts) - 1)]
        if not len(self.scans.owner):
            return poses.copy()
        found = disturbed(self.scans, poses, pull, rng, sign, report)
        is_held = pull.sharpness[0] >= HELD
        found[0, is_held] = poses[0, is_held]
        return found


def find_trajectory(model: PoseModel, laser: Readings, noise: float, rng: np.random.Generator | None = None) -> Floats:
    """Return poses at which scans agree, for a chain to start at.

    Parameters
    ----------
    model : PoseModel
        The uncertain poses; their given ones are returned where it has no laser.
    laser : Readings
        The readings that `model.laser` has the frames of, in the same order.
    noise : float
        Standard deviation of a range, metres.
    rng : numpy.random.Generator, optional
        Draws about from the posterior of the poses (:meth:`Start.draw`); without it the poses are its mode.

    Returns
    -------
    (n, 3) float64
        x, y in metres and heading in radians.
    """
    start = find_start(model, laser, noise)
    return start.poses if rng is None else start.draw(rng)


def find_start(model: PoseModel, laser: Readings, noise: float) -> Start:
    """Return poses at which scans agree, arguments as of :func:`find_trajectory`; always the same for the same."""
    scans, given = scans_of(model, laser, noise), model.prior.given
    if not len(scans.owner):
        return Start(model, scans, [Agreed(given.copy(), pull_of(model.prior), 1.0)], [])
    logger.info(f"laying {len(given):,} scans on one another, for a trajectory to start from ...")
    with progress(3.0, "laying scans on one another") as report:
        return _agreed(model, scans, report)


def _agreed(model: PoseModel, scans: WallPoints, report: Report) -> Start:
    """Return where chains start, of wall points of scans; following, loops and aligning take about a third each."""
    ways, error = [Way(model.prior.given, [], 0.0)], float(model.prior.noise[0] @ [1.0, FAR])
    followed = follow(scans, model.prior, report) if len(model.prior.motion) else None
    report(1.0)
    if followed is not None:
        _warn_of_gaps(model.prior, followed.fits)
        model = _as_it_errs(model, followed.scale)
        ways, error = close_loops(scans, followed, pull_of(model.prior)), LEFT
        n_used = sum(loop.is_used for loop in ways[0].loops)
        left = len(ways[0].loops) - n_used
        logger.info(f"start trajectory: {n_used} closures of loops, {left} plausible ones left out")
    whole = scans
    scans = scans.select(np.arange(len(scans.owner)) % (1 + len(scans.owner) // MOST_POINTS) == 0)
    odds = np.exp([way.log_odds for way in ways])
    agreed = list[Agreed]()
    for way, share in zip(ways, (odds / odds.sum()).tolist(), strict=True):
        report(2.0 + len(agreed) / len(ways))
        pull = pull_of(model.prior) if followed is None else _as_followed(model.prior, way.poses, followed)
        poses = align(scans, way.poses, pull, error, np.random.default_rng(0))
        agreed.append(Agreed(poses, pull, share))
    weight = independence(whole, agreed[0].poses)
    scans = scans._replace(weight=weight * scans.weight)
    found = Start(model, scans, agreed, ways[0].loops, weight)
    disputed = closures([match for way in ways for match in way.apart] if len(ways) > 1 else [])
    model = dataclasses.replace(model, start=found.poses, draw_start=found.draw, disputed=disputed)
    return found._replace(model=model)


def _warn_of_gaps(prior: PosePrior, fits: Floats) -> None:
    """Warn where many scans do not lie on what was seen just before: too little is left to correct odometry by."""
    share = float(np.mean(fits < LEAST_FIT))
    if share > MOST_UNFIT:
        ahead, turn = np.median(np.hypot(*prior.motion[:, :2].T)), np.degrees(np.median(np.abs(prior.motion[:, 2])))
        logger.warning(
            f"{share:.0%} of the scans do not lie on what was seen before them: half are {ahead:.1f} m and {turn:.0f} "
            "degrees apart or more, and the trajectory may be wrong by metres. Keep more: --every-scan 1"
        )


def _as_it_errs(model: PoseModel, scale: Floats) -> PoseModel:
    """Return a model whose odometry errs as many times more, places and turns (2,), as scans show."""
    if scale.max() < LEAST_SCALE:
        return model
    found = model.scaled(*scale.tolist())
    used = ", ".join(f"{value:.3g}" for value in found.odometry or ())
    logger.warning(
        f"scans show odometry to err by {scale[0]:.2g} times as far, and to turn {scale[1]:.2g} times as far off, as "
        f"its standard deviations have it; used instead: trajectory.odometry_noise {used}"
    )
    return found


def _as_followed(prior: PosePrior, poses: Floats, followed: Followed) -> Pull:
    """Return what pulls poses (n, 3): odometry, and over slips what scans said, or they would slide along corridors."""
    pull, is_slip = pull_of(prior, poses), prior.parts(poses)[1] > 0.5
    root, motion = pull.relations.root, prior.motion.copy()
    root[is_slip] = followed.steps.root[is_slip]
    motion[is_slip] = followed.steps.pose[is_slip]
    return pull._replace(relations=pull.relations._replace(pose=motion, root=root))
