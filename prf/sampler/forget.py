"""Letting readings of a run go where its draws agree, with what remains of them.

A beam is settled where every draw explains it alike: a return by a wall of which the draws know the place within the
noise, no return by ground that is free in all of them. Of settled beams so many stay as show all ground that was seen.
Those that stay take over what the others say: on each stretch of a wall the slope and the curvature of the log
likelihood as the wall moves across (for normal errors of beams at angles a the sum of w / (s cos a)^2 with its mean),
in free ground the weight. So later readings can still move a wall, or show that it is gone. What no draw explains is
thinned, and stands for nothing but itself.

Where poses were sampled the beams stand at the mean poses, and go on as one body. Walls are compared as this sees them
in each draw; and they are held by no more than the draws know of their places.
"""

from __future__ import annotations

import dataclasses
import logging
from typing import Any

import numpy as np
from numpy.typing import NDArray

from prf.kernels import constants as c
from prf.kernels.score.laser import add_densities
from prf.model.ranges import laser_array, make_rays
from prf.poses.body import body_of
from prf.poses.plane import compose, seen_from
from prf.readings import Readings
from prf.readings.ground import Passages, draw_evenly, strata_of, weights
from prf.results import RunData
from prf.results.score.scene import first_edges, first_hits
from prf.shell.errors import InputError

logger = logging.getLogger(__name__)

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]

DENSITY = 2.0
"""Settled beams a square metre of seen ground that stay."""
FEWEST_DRAWS = 8
"""Draws of a run that can say what is settled."""
MOST_DRAWS = 48
"""Draws that must agree, and as many others by which the error is measured."""
EXPLAINED = 4.0
"""Standard deviations within which a wall explains a return."""
KNOWN = 1.0
"""Standard deviations of the noise within which draws must know the place of a wall."""
ALIKE = 0.15
"""Standard deviations by which the wall before a beam may move apart from its stretch, from draw to draw."""
STEP = 0.5
"""Standard deviations of the noise over which slopes are taken."""
LEAST_CURVATURE = 1e-3
"""Share of the curvature of a normal error that a beam has at least, far from its wall as it may lie."""
LEAST_COSINE = 0.05
GRAZING = 0.25
"""Cosine between a beam and the normal of its wall below which it stands for others of its kind alone."""
STRETCHES = (0.4, 0.1)
"""Metres of a wall on which beams stand for one another; the second where it does not move as a whole."""
SQUARE = 1.0
"""Side of the squares, metres, in which those that end in free ground, or where draws differ, do."""
OPEN = 4.0
"""Factor on the density where draws differ."""


def forgetting(run: RunData, laser: Readings) -> tuple[Readings, dict[str, Any]]:
    """Return readings of a run's laser that stand for all of them, and what its manifest says of it."""
    if len(run.draws) < FEWEST_DRAWS:
        raise InputError(
            f"{run.name}: {len(run.draws)} draws are too few to tell what is settled ({FEWEST_DRAWS}). Sample it "
            "longer, or leave out forget."
        )
    evidence = Evidence(run, laser)
    found, error = evidence.condensed()
    report = {"n_beams": laser.n_beams, "n_kept": found.n_beams, "nats": error, "nats_per_beam": error / laser.n_beams}
    poses = ""
    if run.trajectory is not None:
        report["n_poses"] = len(run.trajectory.scan)
        poses = f"; its {report['n_poses']:,} poses are fixed to one another at their means"
    logger.info(
        f"forgot {laser.n_beams - found.n_beams:,} of the {laser.n_beams:,} beams of {run.name}; the others stand for "
        f"them to {error:.2g} nats, {error / laser.n_beams:.1g} a beam{poses} (docs/sessions.md)"
    )
    return found, {"forgotten": report}


class Evidence:
    """The n beams of a run's laser beside its draws, and which of them are settled by what.

    Attributes
    ----------
    body : Trajectory or None
        Of sampled poses that of all of them as one (:mod:`prf.poses.body`); None of given ones.
    weight : (n,) float64
        Beams that each counts as.
    distance : (n_draws, n) float64
        To the first wall in each draw, metres; inf: none. Every second draw must agree, the others measure the error.
    hit, free, stray : (n,) bool
        Settled by a wall; settled by free ground; explained by no draw. On all others draws differ.
    mean, spread, cosine : (n,) float64
        Distance of the wall in the mean and noise there, metres; cosine of the beam with the wall's normal.
    stretch, square : (n,) int64
        Numbers of the stretch of wall, and of the square, in which it ends.
    """

    def __init__(self, run: RunData, laser: Readings) -> None:
        self.laser, self.model, self.window = laser, run.laser_model(), run.draws.window
        self.weight = laser.weight.copy()
        self.body = None if run.trajectory is None else body_of(run.trajectory)
        self.ray = make_rays(self.window, self.model, laser.origin, laser.angle, laser.range)
        self.returned: Bools = np.isfinite(self.ray[:, c.RANGE]) & (self.ray[:, c.RANGE] >= 0.0)
        chosen = np.unique(np.linspace(0, len(run.draws) - 1, 2 * MOST_DRAWS).astype(np.int64)).tolist()
        segments = [run.draws[i].segments() for i in chosen]
        self.distance = np.array(
            [first_edges(self._rays(i), each, self.window) for i, each in zip(chosen, segments, strict=True)]
        )
        middle = len(segments) // 2
        self._sort(segments[middle], self._rays(chosen[middle]))

    def _rays(self, draw: int) -> Floats:
        """Return the beams where a draw has the body that they are part of: map and poses may move as a whole."""
        if self.body is None:
            return self.ray
        local = seen_from(self.body.mean, np.column_stack([self.laser.origin, self.laser.angle]))
        moved = compose(self.body.given + self.body.draws[draw], local)
        return make_rays(self.window, self.model, moved[:, :2], moved[:, 2], self.laser.range)

    def _sort(self, reference: Floats, ray: Floats) -> None:
        """Find which beams are settled, and by what: on a stretch of a wall of one draw, or in free ground.

        `reference`: the walls of that draw; `ray`: the beams as it has them.
        """
        agreeing = self.distance[::2]
        near = np.where(np.isfinite(agreeing), agreeing, 0.0)
        spread = np.maximum(self.model.noise, self.model.noise_relative * near)
        reading = np.where(self.returned, self.ray[:, c.RANGE], 0.0)
        explained = self.returned & (np.abs(reading - agreeing) <= EXPLAINED * spread)
        distance, edge = first_hits(ray, reference, self.window)
        met = edge != c.NONE
        wall = np.vstack([reference, [0.0, 0.0, 1.0, 0.0]])[edge]  # the last stands for none
        along = wall[:, 2:] - wall[:, :2]
        length = np.hypot(*along.T)
        direction = ray[:, c.DIRECTION_X : c.DIRECTION_Y + 1]
        cosine = np.abs(direction[:, 0] * along[:, 1] - direction[:, 1] * along[:, 0]) / length
        self.cosine = np.maximum(cosine, LEAST_COSINE)
        is_known = near.std(axis=0) * self.cosine <= KNOWN * spread.mean(axis=0)
        self.hit: Bools = explained.all(axis=0) & is_known & met
        self.free: Bools = ~self.returned & np.isinf(agreeing).all(axis=0)
        self.stray: Bools = self.returned & ~explained.any(axis=0)
        self.mean, self.spread = near.mean(axis=0), spread.mean(axis=0)
        end = ray[:, :2] + np.where(met, distance, 0.0)[:, None] * direction
        place = ((end - wall[:, :2]) * along).sum(axis=1) / length
        off = (near - self.mean) * self.cosine
        self.stretch, apart = np.full(len(self.ray), c.NONE, np.int64), self.hit.copy()
        for metres in STRETCHES:
            key = np.column_stack([edge, np.floor(place / metres), cosine < GRAZING]).astype(np.int64)
            own = np.unique(key, axis=0, return_inverse=True)[1].reshape(-1)
            alike = apart & self._move_alike(off, own, apart)
            self.stretch[alike] = own[alike] + 1 + self.stretch.max()
            apart &= ~alike
        self.hit &= ~apart
        self.stretch[self.hit] = np.unique(self.stretch[self.hit], return_inverse=True)[1]
        square = np.column_stack([np.floor(self._ends() / SQUARE).astype(np.int64), self.free])
        self.square = np.unique(square, axis=0, return_inverse=True)[1].reshape(-1)
        if self.body is not None:
            self._temper(off[:, self.hit], edge[self.hit].astype(np.int64))

    def _temper(self, off: Floats, wall: Ints) -> None:
        """Let settled beams hold each wall no more than draws know its place: at fixed poses they would hold it more.

        All of a wall together: what poses leave unknown of its place is the same along it. `off` (n_draws, n_hit):
        metres across the wall from its mean place; `wall` (n_hit,): its number.
        """
        curvature = self._slopes()[1][self.hit]
        hold = np.maximum(np.bincount(wall, curvature), LEAST_CURVATURE)
        moved = np.array([np.bincount(wall, curvature * each) for each in off]) / hold
        share = 1.0 / np.maximum(self.model.weight * hold * moved.var(axis=0, ddof=1), 1.0)
        self.weight[self.hit] *= share[wall]

    def _move_alike(self, off: Floats, stretch: Ints, chosen: Bools) -> Bools:
        """Return which beams find from draw to draw that their stretch of wall as a whole has moved.

        Others end near corners, or where draws know the wall by parts. `off` (n_draws, n): metres across the wall from
        its mean place. `chosen` (n,): beams that count.
        """
        n = stretch.max() + 1
        size = np.maximum(np.bincount(stretch[chosen], minlength=n), 1)
        moved = np.array([np.bincount(stretch[chosen], each[chosen], n) for each in off]) / size
        alone = off - moved[:, stretch]
        return np.asarray(np.sqrt((alone**2).mean(axis=0)) <= ALIKE * self.spread * self.cosine)

    def condensed(self) -> tuple[Readings, float]:
        """Return the beams that stay, with what they stand for, and the error in nats."""
        plain = 1.0 / (self.spread * self.cosine) ** 2
        slope, curvature = self._slopes()
        kept = self._chosen(self.weight * plain)
        weight, reading = self.weight.copy(), self.laser.range.copy()
        rest = ~(self.hit | self.stray)
        for group, chosen, value, own in (
            (self.stretch, self.hit, curvature, self.weight * plain),
            (self.square, rest, self.weight, self.weight),
        ):
            some = chosen & kept
            total, left = (
                np.bincount(group[chosen], value[chosen]),
                np.bincount(group[some], own[some], group.max() + 1),
            )
            weight[some] *= total[group[some]] / left[group[some]]
        n = max(int(self.stretch.max()), 0) + 1
        pull, hold = (np.bincount(self.stretch[self.hit], v[self.hit], n) for v in (slope, curvature))
        gone = np.bincount(self.stretch[self.hit & ~kept], minlength=n) > 0
        standing = self.hit & kept & gone[self.stretch]
        place = self.stretch[standing]
        reading[standing] = self.mean[standing] + pull[place] / hold[place] / self.cosine[standing]
        weight[self.hit & ~standing] = self.weight[self.hit & ~standing]
        found = dataclasses.replace(self.laser, weight=weight, range=reading).select(kept)
        return found, self._error(found, kept)

    def _slopes(self) -> tuple[Floats, Floats]:
        """Return how the log likelihood of each beam grows as its wall moves away, 1/m, and how that falls, 1/m2.

        Across the wall, at its mean place; (n,) each.
        """
        step = STEP * self.spread
        near, here, far = (
            self.weight * self._log_density(self.ray[:, c.RANGE], self.mean + each) for each in (-step, 0.0, step)
        )
        slope = (far - near) / (2.0 * step * self.cosine)
        curvature = (2.0 * here - near - far) / (step * self.cosine) ** 2
        return slope, np.maximum(curvature, LEAST_CURVATURE / (self.spread * self.cosine) ** 2)

    def _ends(self) -> Floats:
        """Return where beams end, (n, 2) in metres."""
        reach = np.where(self.returned, self.ray[:, c.RANGE], self.ray[:, c.MAX_DISTANCE])
        return np.asarray(self.ray[:, :2] + reach[:, None] * self.ray[:, c.DIRECTION_X : c.DIRECTION_Y + 1])

    def _chosen(self, information: Floats) -> Bools:
        """Return which beams stay."""
        start, end = np.ascontiguousarray(self.ray[:, :2]), self._ends()
        passages = Passages(self.window, start, end)
        area, kept = passages.seen_area(), np.zeros(len(end), np.bool_)
        is_open = ~(self.hit | self.free | self.stray)
        for some, share in ((self.hit, 1.0), (self.free, 0.5), (self.stray, 0.25), (is_open, OPEN)):
            rows = np.flatnonzero(some)
            budget = share * DENSITY * area
            if len(rows) > budget:
                strata = strata_of(self.window, start[rows], end[rows], self.returned[rows])
                rows = rows[draw_evenly(strata, weights(strata, budget))]
            kept[rows] = True
        passages.complete(kept)
        for group, chosen in ((self.stretch, self.hit), (self.square, ~(self.hit | self.stray))):
            best = np.lexsort((-information, ~kept, group))
            best = best[chosen[best]]
            kept[best[np.unique(group[best], return_index=True)[1]]] = True  # one of each, if none is kept so far
        return kept

    def _error(self, found: Readings, kept: Bools) -> float:
        """Return the standard deviation over other draws of what the log likelihood changes by, nats."""
        other = self.distance[1::2]
        ray = make_rays(self.window, self.model, found.origin, found.angle, found.range)
        before = np.array([self.weight @ self._log_density(self.ray[:, c.RANGE], each) for each in other])
        after = np.array([found.weight @ self._log_density(ray[:, c.RANGE], each[kept]) for each in other])
        return float(np.std(after - before, ddof=1)) * self.model.weight

    def _log_density(self, readings: Floats, distance: Floats) -> Floats:
        total = np.zeros(len(readings))
        free = np.zeros(len(readings), np.bool_)
        add_densities(
            laser_array(self.model), np.ascontiguousarray(readings), np.ascontiguousarray(distance), free, total
        )
        return np.asarray(np.log(np.maximum(total, 1e-300)))
