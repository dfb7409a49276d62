"""The returns of scans as points with normals, in the frames of the states that own them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from prf.model.ranges import unit_vectors
from prf.poses.model import PoseModel
from prf.poses.plane import Floats, compose
from prf.readings import Readings

NEIGHBOURS = 7  # points of a scan that a normal is fitted to, the own one included
LEAST = 3  # fewer have none
NEAR, NEAR_SHARE = 0.3, 0.05  # metres, and share of the distance, within which points of one scan are one wall's
FLAT = 2.5  # standard deviations of a range from the fitted line up to which it is a wall
FAR_NOISE = 0.01  # share of the distance that the standard deviation of a range has at least
APART = 1e4  # metres between scans in the tree of neighbours, more than any range


class WallPoints(NamedTuple):
    """Points that beams returned from and that lie on something flat."""

    owner: NDArray[np.int64]  # (n,) state
    point: Floats  # (n, 2) metres, in the frame of the state
    normal: Floats  # (n, 2) unit vectors toward the sensor, in the same frame
    weight: Floats  # (n,) one over the variance of a range, 1/m2
    n_states: int

    def at(self, poses: Floats) -> tuple[Floats, Floats]:
        """Return the points (n, 2) and their normals (n, 2) in the world if the states are at `poses`."""
        own = poses[self.owner]
        world = compose(own, np.column_stack([self.point, np.zeros(len(own))]))[:, :2]
        cosine, sine = np.cos(own[:, 2]), np.sin(own[:, 2])
        x, y = self.normal.T
        return world, np.column_stack([cosine * x - sine * y, sine * x + cosine * y])

    def select(self, mask: NDArray[np.bool_] | NDArray[np.int64]) -> WallPoints:
        """Return the chosen points."""
        return WallPoints(self.owner[mask], self.point[mask], self.normal[mask], self.weight[mask], self.n_states)


def scans_of(model: PoseModel, laser: Readings, noise: float) -> WallPoints:
    """Return the returns of the laser; those without neighbours on a line are left out."""
    if model.laser is None:
        none = np.zeros((0, 2))
        return WallPoints(np.zeros(0, np.int64), none, none, np.zeros(0), len(model.scan))
    hit = laser.returned
    owner, origin = model.laser.owner[hit].astype(np.int64), model.laser.origin[hit]
    away = laser.range[hit]
    point = origin + away[:, None] * unit_vectors(model.laser.angle[hit])
    normal, is_flat = _normals(owner, point, away, noise)
    normal *= np.where(np.einsum("ij,ij->i", normal, origin - point) < 0.0, -1.0, 1.0)[:, None]
    weight = 1.0 / np.square(np.maximum(noise, FAR_NOISE * away))
    return WallPoints(owner, point, normal, weight, len(model.scan)).select(is_flat)


def _normals(owner: NDArray[np.int64], point: Floats, away: Floats, noise: float) -> tuple[Floats, NDArray[np.bool_]]:
    """Return normals (n, 2) of lines fitted to neighbours of the same scan, and which of these are lines."""
    tree = cKDTree(np.column_stack([point, APART * owner]))
    distance, near = tree.query(tree.data, k=NEIGHBOURS)
    used = (distance < (NEAR + NEAR_SHARE * away)[:, None]) & (near < len(point))
    weight = used / np.maximum(used.sum(axis=1), 1)[:, None]
    around = point[np.minimum(near, len(point) - 1)]
    around = around - (weight[:, :, None] * around).sum(axis=1)[:, None]
    spread = np.einsum("nk,nki,nkj->nij", weight, around, around)
    value, vector = np.linalg.eigh(spread)
    limit = np.square(FLAT * np.maximum(noise, FAR_NOISE * away))
    is_flat = (used.sum(axis=1) >= LEAST) & (value[:, 0] < limit) & (value[:, 1] > 4.0 * value[:, 0])
    return vector[:, :, 0], is_flat
