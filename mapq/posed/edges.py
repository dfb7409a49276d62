"""Which edges of a graph are wrong: what they claim beside how the clouds of their two ends fit."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from mapq.cloud import PointCloud
from mapq.posed.check_scans import PRIOR, CheckedScans, log_odds_wrong, probability_of
from mapq.posed.graph import GraphEdge
from mapq.posed.register import (
    GOOD,
    Alignment,
    Floats,
    ScanSurface,
    joined_surface,
    moved_by,
    refined,
    register,
    shared_part,
)
from mapq.posed.scans import PosedScans

BESIDE, NEIGHBOURING = 2, 10.0
"""Scans before and after each end that are its neighbourhood, and metres within which they have to be."""
RIGHT = np.repeat([0.04, 0.006], 3)
"""Metres and radians by which edges that are right are off, ..."""
WRONG = np.repeat([0.6, 0.1], 3)
"""... and by which those that are wrong are."""
REACH, TURNS = 1.2, tuple(np.radians([-10.0, -7.5, -5.0, -2.5, 2.5, 5.0, 7.5, 10.0]).tolist())
"""Metres and radians off the poses, and off what an edge claims, up to which the fit is searched."""
SHARED, LIES = 60, 0.5
"""Points of the neighbourhood of an end that must lie on surfaces of the other, and their share of those beside any."""


class EdgeError(NamedTuple):
    """How far an edge of a graph is off what the clouds of its ends say."""

    ids: tuple[int, int]  # vertices from which and to which it leads
    error_m: float | None  # None where its ends share no surface
    error_rad: float | None
    p_wrong: float
    row: int  # of the file, from 0
    scans: tuple[int, int]  # its ends, -1 where there is none


def check_edges(
    checked: CheckedScans,
    cloud: PointCloud,
    scans: PosedScans,
    edges: Sequence[GraphEdge],
    progress: Callable[[float], None] = lambda done: None,
) -> tuple[EdgeError, ...]:
    """Return the errors of edges, the worst first.

    The clouds are put where the other scans want them: what an optimiser has spread over a chain is taken back
    first. `progress` receives the share done.
    """
    motion = checked.corrections.motion
    poses = scans.poses.copy()
    poses[:, :3, 3] -= cloud.shift * cloud.unit
    settled = motion @ poses
    surfaces = [_moved(surface, motion[scan]) for scan, surface in enumerate(checked.scene.surfaces)]
    rows = []
    for number, edge in enumerate(edges):
        rows.append(_checked(surfaces, settled, edge))
        progress((number + 1) / len(edges))
    rows.sort(key=lambda pair: -pair[0])
    return tuple(row for _, row in rows)


def _moved(surface: ScanSurface, motion: Floats) -> ScanSurface:
    """Return a surface after a motion."""
    normal = surface.normal @ motion[:3, :3].T
    return joined_surface(moved_by(motion, surface.xyz), normal, surface.is_oriented)


def _checked(surfaces: Sequence[ScanSurface], poses: Floats, edge: GraphEdge) -> tuple[float, EdgeError]:
    """Return the log-odds that an edge is wrong, and its row."""
    prior = float(np.log(PRIOR / (1.0 - PRIOR)))
    unknown = prior, EdgeError(edge.ids, None, None, PRIOR, edge.row, edge.scans)
    one, other = edge.scans
    if min(one, other) < 0 or one == other:
        return unknown
    claimed = poses[one] @ edge.motion @ np.linalg.inv(poses[other])
    places = poses[:, :3, 3]
    fit = _best_fit(_around(surfaces, places, one, other), _around(surfaces, places, other, one), claimed)
    if fit is None:
        return unknown
    apart = claimed @ np.linalg.inv(fit.motion)
    at = moved_by(fit.motion, fit.at[None])[0]
    turn = Rotation.from_matrix(apart[:3, :3]).as_rotvec()
    twist = np.concatenate([moved_by(apart, at[None])[0] - at, turn])
    log_odds = log_odds_wrong(fit.information, fit.information @ twist, RIGHT, WRONG)
    measured = np.linalg.inv(poses[one]) @ fit.motion @ poses[other]
    off = float(np.linalg.norm(measured[:3, 3] - edge.motion[:3, 3]))
    return log_odds, EdgeError(
        edge.ids, off, float(np.linalg.norm(turn)), probability_of(log_odds), edge.row, edge.scans
    )


def _around(surfaces: Sequence[ScanSurface], places: Floats, end: int, other: int) -> ScanSurface:
    """Return the surfaces of an end of an edge and of the scans about it that are not closer to the other end."""
    near = range(max(end - BESIDE, 0), min(end + BESIDE + 1, len(surfaces)))
    far = np.linalg.norm(places - places[end], axis=1) > NEIGHBOURING
    parts = [surfaces[scan] for scan in near if abs(scan - end) < abs(scan - other) and not far[scan]]
    xyz, normal = (np.concatenate([part[k] for part in parts]) for k in (0, 1))
    return joined_surface(xyz, normal, all(part.is_oriented for part in parts))


def _best_fit(one: ScanSurface, other: ScanSurface, claimed: Floats) -> Alignment | None:
    """Return the best fit of the other neighbourhood on the one, near its place and near the claimed one."""
    other = shared_part(other, one, [np.eye(4), claimed])
    found = [refined(other, one, np.eye(4)), refined(other, one, claimed)]
    if not any(fit is not None and fit.share >= GOOD for fit in found):
        found.append(register(other, one, np.eye(4), REACH, TURNS))
    fits = [fit for fit in found if fit is not None and fit.n_fitting >= SHARED and fit.share >= LIES]
    return max(fits, key=lambda fit: fit.n_fitting, default=None)
