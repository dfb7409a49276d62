"""Surfaces of scans, and the motion that brings one onto another, point to plane, with its information."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from mapq.kernels.normals import estimate_normals
from mapq.posed.merge import cell_keys

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

SIDE, MOST_THINNED = 0.1, 20_000
"""Metres: side of the cubes that keep one point of a scan; larger ones until so many are left."""
N_NORMALS, N_NEIGHBOURS, N_MOVED = 5000, 12, 600
"""Points of a scan that get a normal, of how many neighbours, and those of them that are matched to other scans."""
FLATNESS, LINE = 0.04, 0.04
"""Of the points of a plane: largest share of the smallest variance of the middle one, least of that of the largest."""
LEVEL, LEVEL_SHARE = 0.8, 0.3
"""Upward component of normals of level ground, and the share of it among the points that are matched."""
REACHES = (1.2, 1.2, 1.0, 0.8, 0.6, 0.4, 0.4)
"""Metres within which a point is matched, round by round, ..."""
SCALES = (0.6, 0.4, 0.3, 0.2, 0.12, 0.08, 0.08)
"""... and at which residual its weight is a quarter."""
CLOSE, SURE = 4, 0.9
"""Rounds left out at first, since most poses are nearly right; share of points that fit from which that is enough."""
LEAST_REACH = 2.0
"""Spacings of the points of a surface within which a point is matched at least."""
AGREE = 0.8
"""Cosine of the angle between normals of points that may be one surface."""
FEWEST = 40
"""Matched points below which scans share no surface."""
NEAR = 2.0
"""Metres off the surface of one scan at which a point of another may belong to it."""
FITS, GOOD = 0.1, 0.75
"""Metres off a plane at which a point fits it; share of matched points that fit from which no start is searched."""
SEARCHED, N_SEARCHED, STEP = 0.8, 80, 0.2
"""Metres up to which shifts are tried where the first fit is bad, points by which they are, and metres between them."""
BESIDE, MEETS, PRICE = 0.6, 0.15, 0.02
"""Metres within which tried points have a surface, and off it at which they count a quarter; share of the points that
a shift by a metre must bring more."""
UNSEEN = 0.01
"""Share of the points whose normals show a direction below which it is not seen: normals have errors."""
FLOOR, INFLATION, NOISE = 0.02, 30.0, 0.03
"""Metres: least standard error of a fit; factor of its variance, as residuals go together; least noise."""


class ScanSurface(NamedTuple):
    """Points of a scan, or of several, on planes."""

    xyz: Floats  # (n, 3)
    normal: Floats  # (n, 3) towards the sensor, where that is known
    moved: Ints  # (m,) those that are matched to others
    tree: cKDTree
    is_oriented: bool
    spacing: float  # metres between neighbours, in the median

    @property
    def centre(self) -> Floats:
        """Middle (3) of the points that are matched."""
        return np.asarray(self.xyz[self.moved].mean(axis=0) if len(self.moved) else np.zeros(3))


class Alignment(NamedTuple):
    """A motion that brings a surface onto another."""

    motion: Floats  # (4, 4)
    at: Floats  # (3,) middle of what they share, before the motion
    information: Floats  # (6, 6) of shift there and turn, per m² and rad²
    share: float  # of the points that have a surface beside them, those that lie on it
    n_fitting: float  # points that lie on it


def surface_of(xyz: Floats, sensor: Floats | None) -> ScanSurface:
    """Return the planes of a scan: points (n, 3), seen from `sensor` (3); None where that is not known."""
    side = SIDE
    thinned = xyz
    while True:
        thinned = thinned[np.unique(cell_keys(thinned, side), return_index=True)[1]]
        if len(thinned) <= MOST_THINNED:
            break
        side *= 1.4
    rows = np.arange(0, len(thinned), 1 + len(thinned) // N_NORMALS)
    normal, is_flat = _normals(thinned, rows)
    some, normal = thinned[rows[is_flat]], normal[is_flat]
    if sensor is not None and len(some):
        normal = normal * np.where(((sensor - some) * normal).sum(axis=1) < 0.0, -1.0, 1.0)[:, None]
    return joined_surface(some, normal, sensor is not None)


def joined_surface(xyz: Floats, normal: Floats, is_oriented: bool) -> ScanSurface:
    """Return the surface of points (n, 3) with normals (n, 3)."""
    tree, some = cKDTree(xyz), _chosen(normal, np.arange(len(xyz)))
    spacing = float(np.median(tree.query(xyz[some], k=2)[0][:, 1])) if len(xyz) > 1 else 0.0
    return ScanSurface(xyz, normal, some, tree, is_oriented, spacing)


def _chosen(normal: Floats, rows: Ints) -> Ints:
    """Return those of some rows (k,) of a surface that are matched to others: of level ground not too many."""
    level = np.abs(normal[rows, 2]) > LEVEL
    upright, flat = rows[~level], rows[level]
    n_flat = int(max(LEVEL_SHARE * N_MOVED, N_MOVED - len(upright)))
    parts = [part[:: 1 + len(part) // most] for part, most in ((upright, N_MOVED), (flat, n_flat))]
    return np.concatenate(parts)


def shared_part(a: ScanSurface, b: ScanSurface, motions: Sequence[Floats]) -> ScanSurface:
    """Return `a` with those of its points matched that one of some motions (4, 4) puts beside `b`."""
    near = np.zeros(len(a.xyz), bool)
    for motion in motions:
        near |= np.isfinite(b.tree.query(moved_by(motion, a.xyz), distance_upper_bound=NEAR)[0])
    return a._replace(moved=_chosen(a.normal, np.flatnonzero(near)))


def _normals(xyz: Floats, rows: Ints) -> tuple[Floats, NDArray[np.bool_]]:
    """Return normals (m, 3) of the planes through neighbours of some points (m,), and which are planes at all."""
    if len(xyz) < N_NEIGHBOURS:
        return np.zeros((len(rows), 3)), np.zeros(len(rows), bool)
    near = cKDTree(xyz, balanced_tree=False, compact_nodes=False).query(xyz[rows], k=N_NEIGHBOURS)[1]
    normal, spread = np.empty((len(rows), 3), np.float32), np.empty((len(rows), 3), np.float32)
    estimate_normals(xyz, rows, near[:, 1:].astype(np.int32), normal, spread)
    is_flat = (spread[:, 0] < FLATNESS * spread[:, 1]) & (spread[:, 1] > LINE * spread[:, 2])
    return normal.astype(np.float64), np.asarray(is_flat)


def moved_by(motion: Floats, xyz: Floats) -> Floats:
    """Return points (n, 3) after a motion (4, 4)."""
    return np.asarray(xyz @ motion[:3, :3].T + motion[:3, 3])


def motion_about(at: Floats, twist: Floats) -> Floats:
    """Return the motion (4, 4) that turns about a place (3) and shifts it: of a twist (6), shift first."""
    motion = np.eye(4)
    motion[:3, :3] = Rotation.from_rotvec(twist[3:]).as_matrix()
    motion[:3, 3] = at + twist[:3] - motion[:3, :3] @ at
    return motion


class _Matches(NamedTuple):
    """Points beside a surface."""

    place: Floats  # (k, 3)
    normal: Floats  # (k, 3) mean of both surfaces
    residual: Floats  # (k,) metres along it
    beside: int  # points that have any of the other surface beside them


def _matches(a: ScanSurface, b: ScanSurface, motion: Floats, reach: float, some: Ints) -> _Matches:
    """Return some points of `a`, moved, that have a surface of `b` with a like normal within `reach` metres."""
    place, normal = moved_by(motion, a.xyz[some]), a.normal[some] @ motion[:3, :3].T
    distance, other = b.tree.query(place, distance_upper_bound=max(reach, LEAST_REACH * b.spacing))
    near = np.flatnonzero(np.isfinite(distance))
    place, normal, other = place[near], normal[near], other[near]
    facing = (normal * b.normal[other]).sum(axis=1)
    is_like = (facing if a.is_oriented and b.is_oriented else np.abs(facing)) > AGREE
    place, normal, other, facing = place[is_like], normal[is_like], other[is_like], facing[is_like]
    both = normal + np.sign(facing)[:, None] * b.normal[other]
    both /= np.linalg.norm(both, axis=1, keepdims=True)
    return _Matches(place, both, ((b.xyz[other] - place) * both).sum(axis=1), len(near))


def register(
    a: ScanSurface, b: ScanSurface, start: Floats, reach: float = SEARCHED, turns: tuple[float, ...] = ()
) -> Alignment | None:
    """Return the motion that brings `a` onto `b`, near the motion `start` (4, 4); None if they share no surface.

    Where what is found does not fit well, level shifts of up to `reach` metres and `turns` (radians) are tried first.
    """
    fit = refined(a, b, start, CLOSE)
    if fit is None or fit.share < SURE:
        fit = refined(a, b, start)
    if fit is not None and fit.share >= GOOD:
        return fit
    searched = _searched(a, b, start, reach, turns)
    other = None if searched is None else refined(a, b, searched)
    return other if fit is None or (other is not None and other.n_fitting > 1.1 * fit.n_fitting) else fit


def _searched(a: ScanSurface, b: ScanSurface, start: Floats, reach: float, turns: tuple[float, ...]) -> Floats | None:
    """Return the shifted and turned start at which most points lie on surfaces; None if none is better."""
    some = a.moved[:: 1 + len(a.moved) // N_SEARCHED]
    place, normal = moved_by(start, a.xyz[some]), a.normal[some] @ start[:3, :3].T
    if not len(place):
        return None
    at, line = place.mean(axis=0), np.arange(-reach, reach + 0.01, STEP)
    steps = np.stack(np.meshgrid(line, line, [0.0]), axis=-1).reshape(-1, 3)
    steps = steps[np.hypot(steps[:, 0], steps[:, 1]) <= reach + 0.01]
    price = PRICE * len(place) * np.hypot(steps[:, 0], steps[:, 1])
    best, found = _meeting(a, b, place[None], normal)[0], None
    for turn in (0.0, *turns):
        rotation = Rotation.from_rotvec([0.0, 0.0, turn]).as_matrix()
        turned = (place - at) @ rotation.T + at
        values = _meeting(a, b, turned + steps[:, None], normal @ rotation.T) - price
        if values.max() > best:
            best = values.max()
            found = motion_about(at, np.concatenate([steps[np.argmax(values)], [0.0, 0.0, turn]])) @ start
    return found


def _meeting(a: ScanSurface, b: ScanSurface, place: Floats, normal: Floats) -> Floats:
    """Return how many (t,) of the points of `a`, at tried places (t, m, 3), lie on surfaces of `b`."""
    distance, other = b.tree.query(place.reshape(-1, 3), distance_upper_bound=BESIDE)
    near = np.flatnonzero(np.isfinite(distance))
    other = other[near]
    facing = (normal[near % len(normal)] * b.normal[other]).sum(axis=1)
    is_like = (facing if a.is_oriented and b.is_oriented else np.abs(facing)) > AGREE
    residual = ((place.reshape(-1, 3)[near] - b.xyz[other]) * b.normal[other]).sum(axis=1)
    worth = is_like / (1.0 + (residual / MEETS) ** 2) ** 2
    return np.bincount(near // len(normal), worth, len(place)).astype(np.float64)


def refined(a: ScanSurface, b: ScanSurface, motion: Floats, skipped: int = 0) -> Alignment | None:
    """Return the motion that robust least squares find from a start; None if too few points match.

    `skipped`: of the rounds, the first of which reach farthest.
    """
    for reach, scale in zip(REACHES[skipped:], SCALES[skipped:], strict=True):
        found = _matches(a, b, motion, reach, a.moved)
        if len(found.residual) < FEWEST:
            return None
        weight = (scale**2 / (scale**2 + found.residual**2)) ** 2
        at = found.place.mean(axis=0)
        jacobian = np.hstack([found.normal, np.cross(found.place - at, found.normal)])
        normal = jacobian.T @ (jacobian * weight[:, None])
        ridge = np.diag(np.repeat([1e-3, 1e-3 * _lever(found.place - at) ** 2], 3)) * weight.sum()
        twist = np.linalg.solve(normal + ridge, jacobian.T @ (weight * found.residual))
        motion = motion_about(at, twist) @ motion
    found = _matches(a, b, motion, REACHES[0], a.moved)
    fits = np.abs(found.residual) < FITS
    if np.count_nonzero(fits) < FEWEST:
        return None
    share = np.count_nonzero(fits) / len(found.residual)
    at = found.place[fits].mean(axis=0)
    information = _information(found.place[fits] - at, found.normal[fits], found.residual[fits], share)
    inverse = np.asarray(np.linalg.inv(motion), np.float64)
    return Alignment(motion, moved_by(inverse, at[None])[0], information, share, float(np.count_nonzero(fits)))


def _lever(place: Floats) -> float:
    """Return the metres off which points (n, 3) lie from their middle."""
    return max(float(np.sqrt((place**2).sum(axis=1).mean())), 1.0)


def _information(place: Floats, normal: Floats, residual: Floats, share: float) -> Floats:
    """Return the information (6, 6) that points have on a motion; none in directions that no normal shows."""
    lever = _lever(place)
    scale = np.repeat([1.0, 1.0 / lever], 3)
    jacobian = np.hstack([normal, np.cross(place, normal)]) * scale
    values, vectors = np.linalg.eigh(jacobian.T @ jacobian / len(place))
    seen = np.maximum(values - UNSEEN, 1e-6)
    noise = max(float(np.mean(residual**2)), NOISE**2)
    variance = INFLATION * noise / (len(place) * seen) + (FLOOR / share) ** 2
    return np.asarray((vectors / variance) @ vectors.T / np.outer(scale, scale))
