"""Held-out readings, and the sensor model by which they are scored."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from prf.configuration import Configuration
from prf.kernels.readings.cones import READING
from prf.kernels.readings.sonar_features import POSE_X, POSE_Y
from prf.model.ranges import make_poses, unit_vectors, window_exit
from prf.model.sensors import LaserModel, SonarModel
from prf.model.window import Window
from prf.poses.given import pose_noise
from prf.poses.model import LocalReadings, pose_model
from prf.readings import Readings, thin
from prf.readings.describe import default_max_range
from prf.readings.readings import fields_of_view
from prf.shell.errors import InputError

Floats = NDArray[np.float64]

SQUARE = 0.2  # side in metres of the squares that every kind of map is evaluated on: a point on a wall has no colour
CLIP = 1e-3  # probabilities are kept so far from 0 and 1 before their logarithm is taken
OUTSIDE = 0.5  # probability of a point that a map does not know


class UncertainPoses(NamedTuple):
    """Given poses of held-out scans, and the standard deviations of their errors."""

    given: Floats  # (n_scans, 3)
    noise: Floats  # (3,) metres, metres, radians
    local: LocalReadings  # the beams, as their scans' given poses have them

    def select(self, mask: NDArray[np.bool_]) -> UncertainPoses:
        """Return the poses of scans that still have a beam where `mask` (n_beams,) picks some."""
        kept, owner = np.unique(self.local.owner[mask], return_inverse=True)
        local = LocalReadings(owner.astype(np.int32), self.local.origin[mask], self.local.angle[mask])
        return self._replace(given=self.given[kept], local=local)


class HeldOut(NamedTuple):
    """Beams with a return, one row each, and what was left out."""

    # origin, direction: (n, 2) sensor positions in metres, unit vectors
    origin: Floats
    direction: Floats
    range: Floats  # (n,) metres, below the maximum range of `model`
    model: LaserModel
    n_no_return: int  # beams without return, which are not scored
    poses: UncertainPoses | None = None  # None: the poses are certain
    # (n,) which beams are censored wherever they are moved; None: those that end beyond the window where they are
    censored: NDArray[np.bool_] | None = None

    def select(self, mask: NDArray[np.bool_]) -> HeldOut:
        """Return the beams that `mask` (n,) picks."""
        if mask.all():
            return self
        return self._replace(
            origin=self.origin[mask],
            direction=self.direction[mask],
            range=self.range[mask],
            poses=None if self.poses is None else self.poses.select(mask),
            censored=None if self.censored is None else self.censored[mask],
        )

    def at(self, poses: Floats) -> HeldOut:
        """Return the beams, n for each row of `poses` (k, n_scans, 3), as they are if these are the scans' poses."""
        assert self.poses is not None
        local, k = self.poses.local, len(poses)
        x, y = np.moveaxis(poses[..., :2], -1, 0)[:, :, local.owner]
        cosine, sine = np.cos(poses[..., 2])[:, local.owner], np.sin(poses[..., 2])[:, local.owner]
        ahead, aside = local.origin.T
        origin = np.stack([x + cosine * ahead - sine * aside, y + sine * ahead + cosine * aside], axis=-1)
        ahead, aside = unit_vectors(local.angle).T
        direction = np.stack([cosine * ahead - sine * aside, sine * ahead + cosine * aside], axis=-1)
        return HeldOut(
            origin.reshape(-1, 2),
            direction.reshape(-1, 2),
            np.tile(self.range, k),
            self.model,
            self.n_no_return,
            censored=None if self.censored is None else np.tile(self.censored, k),
        )

    def as_censored(self, window: Window | None) -> HeldOut:
        """Return the beams, of which those that end beyond the window now remain censored when they are moved."""
        return self._replace(censored=self.range >= self.rays(window)[:, 4])

    def returns(self) -> Floats:
        """Return the ends of the beams, (n, 2) in metres."""
        return self.origin + self.range[:, None] * self.direction

    def rays(self, window: Window | None) -> Floats:
        """Return the (n, 5) rays of the kernels; they reach to the maximum range, or where they leave the window."""
        reach = np.full(len(self.range), self.model.limit)
        if window is not None:
            reach = np.minimum(reach, window_exit(window, self.origin, self.direction))
        return np.ascontiguousarray(np.column_stack([self.origin, self.direction, reach]))

    def readings(self, rays: Floats) -> Floats:
        """Return the readings (n,) as the kernels take them: -m for one that is censored at m, the reach of its ray."""
        reach = rays[:, 4]
        censored = self.range >= reach if self.censored is None else self.censored
        return np.where(censored, -reach, self.range)


def hold_out(readings: Readings, config: Configuration) -> HeldOut:
    """Return the beams of a whole log to score."""
    max_range = default_max_range(readings) if config.laser.max_range is None else config.laser.max_range
    if not math.isfinite(max_range):
        raise InputError(f"{readings.source}: no reading has a finite range. There is nothing to score.")
    model = config.laser.replace(max_range=max_range)
    kept = thin(readings, **config.readings.selection())
    returned = kept.range < max_range
    if not returned.any():
        raise InputError(f"{readings.source}: no beam has a return below {max_range:g} m. There is nothing to score.")
    direction = unit_vectors(kept.angle)
    beams = kept.select(returned)
    poses = _uncertain_poses(beams, pose_noise(config.trajectory.pose_noise, beams, model.noise))
    n_no_return = int(np.count_nonzero(~returned))
    return HeldOut(kept.origin[returned], direction[returned], kept.range[returned], model, n_no_return, poses)


def _uncertain_poses(beams: Readings, noise: tuple[float, float] | None) -> UncertainPoses | None:
    """Return the poses of the scans of these beams; None where they are certain."""
    if noise is None:
        return None
    model = pose_model(beams, None, noise)
    assert model.laser is not None
    return UncertainPoses(model.prior.given, np.array(noise)[[0, 0, 1]], model.laser)


class HeldOutSonar(NamedTuple):
    """Sonar readings, those without return included."""

    # (n, N_POSE) as the kernels take them; the reading is inf where there was no return below the maximum range
    pose: Floats
    model: SonarModel

    @property
    def origin(self) -> Floats:
        """Where the sensors are, (n, 2) in metres."""
        return np.ascontiguousarray(self.pose[:, POSE_X : POSE_Y + 1])

    @property
    def range(self) -> Floats:
        """Metres, (n,); inf for no return."""
        return self.pose[:, READING]

    def select(self, mask: NDArray[np.bool_]) -> HeldOutSonar:
        """Return the readings that `mask` (n,) picks."""
        return HeldOutSonar(np.ascontiguousarray(self.pose[mask]), self.model)


def hold_out_sonar(readings: Readings, config: Configuration) -> HeldOutSonar:
    """Return the readings of a whole log to score."""
    kept, model = thin(readings, **config.readings.selection()), config.sonar
    view = fields_of_view(kept, config.sonar.cone)
    return HeldOutSonar(make_poses(model, kept.origin, kept.angle, view, kept.range), model)
