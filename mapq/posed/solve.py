"""Corrections of scans that make relations of pairs agree, by robust least squares; most scans are right."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_matrix, csc_matrix
from scipy.sparse.linalg import splu
from scipy.spatial.transform import Rotation

from mapq.posed.register import Alignment, Floats, Ints, motion_about, moved_by

RIGHT = np.repeat([0.03, 0.003], 3)
"""Metres and radians by which scans that are right are off."""
WIDE = np.repeat([0.5, 0.05], 3)
"""Metres and radians by which those are off that are wrong."""
SADDLE = 16.0
"""Squared standard deviations at which the weight of a relation, or of a scan's being right, is a quarter."""
TRUST = 0.1
"""What the prior of a scan counts, beside a relation: rather are many scans moved than relations called wrong."""
NARROWING, LAST_ROUNDS = 4.0, 6
"""Factor by which that shrinks from round to round, and rounds after it did."""
MOST_DENSE = 300
"""Scans up to which a full inverse is quicker than one scan after the other."""


class Relation(NamedTuple):
    """What two scans say of each other: the fit moves the `one` onto the `other`."""

    one: int
    other: int
    fit: Alignment


class Corrections(NamedTuple):
    """Motions of scans, in the frame of the map."""

    motion: Floats  # (n, 4, 4)
    slope: Floats  # (6,) of twists, in units of the way or time along which they grow
    information: Floats  # (n, 6, 6) that the other scans have on the motion of each, about its place
    twist: Floats  # (n, 6) the motion by that information alone, but for a wide prior
    slope_covariance: Floats  # (6, 6)
    cost: float


class _System(NamedTuple):
    """The relations in arrays."""

    one: Ints  # (m,)
    other: Ints  # (m,)
    at: Floats  # (m, 3)
    goal: Floats  # (m, 4, 4)
    root: Floats  # (m, 6, 6) of the information


def cross_matrices(v: Floats) -> Floats:
    """Return the matrices (n, 3, 3) of cross products with vectors (n, 3)."""
    zero = np.zeros(len(v))
    x, y, z = v.T
    return np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(-1, 3, 3)


def solve(relations: Sequence[Relation], places: Floats, along: Floats | None = None) -> Corrections:
    """Return the corrections of scans at places (n, 3).

    Geman and McClure's weights of relations, and of the prior that a scan is right, whose scale shrinks (graduated
    non-convexity). With `along` (n,) the scans are right but for motions in proportion to it.
    """
    n = len(places)
    system = _arrays(relations)
    motion, slope = np.tile(np.eye(4), (n, 1, 1)), np.zeros(6)
    line = np.zeros(n) if along is None else along
    scale, last = np.inf, LAST_ROUNDS
    while last:
        error, twist = _errors(system, motion), twists(motion, places)
        off = (twist - line[:, None] * slope) / RIGHT
        squares = (error**2).sum(axis=1), (off**2).sum(axis=1)
        top = max(float(part.max(initial=0.0)) for part in squares)
        scale = max(min(scale / NARROWING, top), SADDLE)
        last -= scale == SADDLE
        weights = [factor * (scale / (scale + part)) ** 2 for factor, part in zip((1.0, TRUST), squares, strict=True)]
        jacobian, prior = _jacobian(system, motion, places), _prior(n, line)
        counted = [np.repeat(part, 6) for part in weights]
        normal = (jacobian.T.multiply(counted[0]) @ jacobian + prior.T.multiply(counted[1]) @ prior).tocsc()
        normal += _pins(n, along is None)
        right = -(jacobian.T @ (counted[0] * error.ravel()) + prior.T @ (counted[1] * off.ravel()))
        step = splu(normal).solve(right)
        slope = slope + step[6 * n :]
        for scan in range(n):
            about = moved_by(motion[scan], places[scan][None])[0]
            motion[scan] = motion_about(about, step[6 * scan : 6 * scan + 6]) @ motion[scan]
    costs = [float((SADDLE * part / (SADDLE + part)).sum()) for part in squares]
    cost = costs[0] + TRUST * costs[1]
    return _with_information(motion, slope, places, normal, weights[1] * (along is None), cost)


def _arrays(relations: Sequence[Relation]) -> _System:
    """Return relations as arrays."""
    at = np.array([each.fit.at for each in relations]).reshape(-1, 3)
    goal = np.array([each.fit.motion for each in relations]).reshape(-1, 4, 4)
    information = np.array([each.fit.information for each in relations]).reshape(-1, 6, 6)
    root = np.swapaxes(np.linalg.cholesky(information), 1, 2) if len(at) else information
    one, other = (np.array([each[k] for each in relations], np.int64) for k in (0, 1))
    return _System(one, other, at, goal, root)


def twists(motion: Floats, places: Floats) -> Floats:
    """Return motions (n, 4, 4) as twists (n, 6) about places (n, 3)."""
    shift = np.einsum("nij,nj->ni", motion[:, :3, :3], places) + motion[:, :3, 3] - places
    return np.hstack([shift, Rotation.from_matrix(motion[:, :3, :3]).as_rotvec()])


def _errors(system: _System, motion: Floats) -> Floats:
    """Return errors (m, 6) of relations in standard deviations."""
    if not len(system.at):
        return np.zeros((0, 6))
    relative = np.linalg.inv(motion[system.other]) @ motion[system.one]
    apart = twists(relative, system.at) - twists(system.goal, system.at)
    turn = relative[:, :3, :3] @ np.swapaxes(system.goal[:, :3, :3], 1, 2)
    apart[:, 3:] = Rotation.from_matrix(turn).as_rotvec()
    return np.asarray(np.einsum("mij,mj->mi", system.root, apart))


def _jacobian(system: _System, motion: Floats, places: Floats) -> csc_matrix:
    """Return how twists of scans change the errors (6m, 6n + 6)."""
    m, n = len(system.at), len(places)
    rows, columns, values = [], [], []
    for scan, sign in ((system.one, 1.0), (system.other, -1.0)):
        block = np.tile(np.eye(6), (m, 1, 1))
        block[:, :3, 3:] = -cross_matrices(system.at - places[scan])
        block = sign * system.root @ block
        rows.append(np.broadcast_to(6 * np.arange(m)[:, None, None] + np.arange(6)[:, None], block.shape).ravel())
        columns.append(np.broadcast_to(6 * scan[:, None, None] + np.arange(6), block.shape).ravel())
        values.append(block.ravel())
    place = np.concatenate(rows), np.concatenate(columns)
    return coo_matrix((np.concatenate(values), place), shape=(6 * m, 6 * n + 6)).tocsc()


def _prior(n: int, line: Floats) -> csc_matrix:
    """Return how twists, and the slope of the line, change what the prior weighs (6n, 6n + 6)."""
    index, part = np.arange(6 * n), np.tile(np.arange(6), n)
    values = np.concatenate([1.0 / RIGHT[part], -np.repeat(line, 6) / RIGHT[part]])
    place = np.concatenate([index, index]), np.concatenate([index, 6 * n + part])
    return coo_matrix((values, place), shape=(6 * n, 6 * n + 6)).tocsc()


def _pins(n: int, no_line: bool) -> csc_matrix:
    """Return what is added to the normal matrix: little, and for the slope all where there is no line."""
    diagonal = np.concatenate([np.full(6 * n, 1e-3), np.full(6, 1e12 if no_line else 1e-3)])
    return coo_matrix((diagonal, (np.arange(6 * n + 6),) * 2)).tocsc()


def _with_information(
    motion: Floats, slope: Floats, places: Floats, normal: csc_matrix, own: Floats, cost: float
) -> Corrections:
    """Return the corrections, with what others say of each scan: without the `own` weight (n,) of its prior."""
    covariance, last = _blocks_of_inverse(normal)
    twist = twists(motion, places)
    whole = np.linalg.inv(covariance)
    vector = np.einsum("nij,nj->ni", whole, twist)
    values, axes = np.linalg.eigh(whole - own[:, None, None] * np.diag(RIGHT**-2.0))
    information = np.einsum("nij,nj,nkj->nik", axes, np.maximum(values, 0.0), axes)
    wide = information + np.diag(WIDE**-2.0)
    return Corrections(motion, slope, information, np.linalg.solve(wide, vector[..., None])[..., 0], last, cost)


def _blocks_of_inverse(normal: csc_matrix) -> tuple[Floats, Floats]:
    """Return the blocks (n, 6, 6) on the diagonal of the inverse of a matrix (6n + 6, 6n + 6), and the last one."""
    n = normal.shape[0] // 6
    blocks = np.zeros((n, 6, 6))
    factor = splu(normal) if n > MOST_DENSE else None
    whole = np.linalg.inv(normal.toarray()) if factor is None else None
    for k in range(n):
        at = slice(6 * k, 6 * k + 6)
        if factor is None:
            assert whole is not None
            blocks[k] = whole[at, at]
        else:
            unit = np.zeros((6 * n, 6))
            unit[at] = np.eye(6)
            blocks[k] = factor.solve(unit)[at]
    return blocks[:-1], blocks[-1]
