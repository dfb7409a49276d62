"""Graphs of relative poses: their linear equations, and the poses that fit best.

Changes of a pose are those of its own frame: ahead, to the side (m) and turned (rad).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix, csc_matrix

from prf.poses.model import PosePrior
from prf.poses.plane import Floats, seen_from, wrapped

Ints = NDArray[np.int64]
HELD = 1e6
"""One over the standard deviation, m or rad, of the first pose where it fixes the frame."""


class Relations(NamedTuple):
    """Measured poses of states `head` in the frames of states `tail`."""

    tail: Ints  # (k,)
    head: Ints  # (k,)
    pose: Floats  # (k, 3)
    root: Floats  # (k, 3, 3) square root of the information: the rows weigh errors to unit variance

    def join(self, other: Relations) -> Relations:
        """Return both."""
        pairs = [np.concatenate(pair) for pair in zip(self, other, strict=True)]
        return Relations(pairs[0], pairs[1], pairs[2], pairs[3])


def root_of(covariance: Floats) -> Floats:
    """Return the square roots (k, 3, 3) of the information, by the covariances (k, 3, 3) of errors."""
    return np.asarray(np.swapaxes(np.linalg.cholesky(np.linalg.inv(covariance)), 1, 2))


def errors(relations: Relations, poses: Floats) -> Floats:
    """Return the errors (k, 3) of relations in standard deviations."""
    error = seen_from(poses[relations.tail], poses[relations.head]) - relations.pose
    error[:, 2] = wrapped(error[:, 2])
    return np.asarray(np.einsum("kij,kj->ki", relations.root, error))


def derivatives(relations: Relations, poses: Floats) -> tuple[Floats, Floats]:
    """Return the derivatives (k, 3, 3) of the errors by changes of tails and of heads."""
    seen = seen_from(poses[relations.tail], poses[relations.head])
    by_tail, by_head = np.zeros((2, len(seen), 3, 3))
    by_tail[:, [0, 1, 2], [0, 1, 2]] = -1.0
    by_tail[:, 0, 2], by_tail[:, 1, 2] = seen[:, 1], -seen[:, 0]
    cosine, sine = np.cos(seen[:, 2]), np.sin(seen[:, 2])
    by_head[:, 0, 0], by_head[:, 0, 1], by_head[:, 1, 0], by_head[:, 1, 1] = cosine, -sine, sine, cosine
    by_head[:, 2, 2] = 1.0
    return relations.root @ by_tail, relations.root @ by_head


class Disturbance(NamedTuple):
    """Errors in standard deviations of what holds poses."""

    given: Floats  # (n, 3)
    relations: Floats  # (k, 3)


class Pull(NamedTuple):
    """What holds poses besides scans: given poses, and relations between poses."""

    given: Floats  # (n, 3)
    sharpness: Floats  # (n, 3) one over the standard deviations from the given poses; 0: free
    relations: Relations

    def strain(self, poses: Floats) -> float:
        """Return half the squared errors at poses (n, 3): what their log density is lower by than without any."""
        off = self.sharpness * seen_from(poses, self.given)
        return 0.5 * float(np.square(off).sum() + np.square(errors(self.relations, poses)).sum())

    def equations(
        self, poses: Floats, disturbance: Disturbance | None = None, weight: Floats | None = None
    ) -> tuple[csc_matrix, Floats]:
        """Return the normal matrix (3 n, 3 n) of the errors, and the right hand side (3 n,).

        `weight` (k,): of the relations. `disturbance`: added to the errors, so that what solves the equations is a draw
        from the density if it is standard normal.
        """
        n, relations = len(poses), self.relations
        off = self.sharpness * seen_from(poses, self.given)
        error = errors(relations, poses)
        if disturbance is not None:
            off += disturbance.given
            error += disturbance.relations
        weight = np.ones(len(error)) if weight is None else weight
        right = self.sharpness * off
        sides, parts, axis = (relations.tail, relations.head), derivatives(relations, poses), np.arange(3)
        rows, columns, values = [np.arange(3 * n)], [np.arange(3 * n)], [np.square(self.sharpness).ravel()]
        for at, by in zip(sides, parts, strict=True):
            np.add.at(right, at, -np.einsum("k,kij,ki->kj", weight, by, error))
            for other, by_other in zip(sides, parts, strict=True):
                block = np.einsum("k,kij,kil->kjl", weight, by, by_other)
                rows.append(np.broadcast_to(3 * at[:, None, None] + axis[:, None], block.shape).ravel())
                columns.append(np.broadcast_to(3 * other[:, None, None] + axis, block.shape).ravel())
                values.append(block.ravel())
        place = (np.concatenate(rows), np.concatenate(columns))
        return coo_matrix((np.concatenate(values), place), shape=(3 * n, 3 * n)).tocsc(), right.ravel()


def pull_of(prior: PosePrior, poses: Floats | None = None) -> Pull:
    """Return the density of the poses as errors in standard deviations.

    `poses` (n, 3): where steps pull as they do there, as far as the robot slipped or was carried; else none did.
    """
    n, steps = len(prior.given), np.arange(len(prior.motion))
    sharpness = np.zeros((n, 3)) if prior.is_held else 1.0 / prior.noise[:, [0, 0, 1]]
    if prior.is_held:
        sharpness[0] = HELD
    precision = 1.0 / np.square(prior.spread) if poses is None or not len(steps) else prior.precision(poses)
    root = np.sqrt(precision)[:, :, None] * np.eye(3)
    return Pull(prior.given, sharpness, Relations(steps, steps + 1, prior.motion, root))
