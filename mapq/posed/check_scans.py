"""Which scans are wrong, and by which motion: what the other scans ask of each, all pairs that overlap together."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_matrix

from mapq.axes import TO_SENSOR
from mapq.cloud import PointCloud
from mapq.posed.register import Floats, ScanSurface, register, surface_of
from mapq.posed.scans import PosedScans, driven
from mapq.posed.solve import RIGHT, WIDE, Corrections, Relation, solve

CELL = 2.0
"""Metres: side of the cubes by which scans overlap."""
NEXT, OTHERS = 2, 4
"""Scans before and after each, and others that overlap it most, to which it is compared."""
OVERLAP = 0.1
"""Least share of the cubes of the scan with fewer that the other has as well."""
PRIOR = 0.05
"""Probability that a scan, or an edge, is wrong, before anything is known of it."""
LEVER = 10.0
"""Metres off a scan at which its turns count as shifts."""
STANDING = 1.0
"""Metres: on a shorter way motions grow with time."""
LINE_GAIN = 5.0
"""Of the cost (squared standard deviations) by which a line has to explain motions better than single scans do."""
BOUND = 1.96


class ScanMotion(NamedTuple):
    """The motion that the other scans ask of a scan: its sensor's shift in metres, and its turn to the left."""

    scan: int
    file: str
    dx: float
    dy: float
    dz: float
    yaw: float  # radians
    low: float  # 95 % bounds of the length of the shift
    high: float
    p_wrong: float


class Drift(NamedTuple):
    """Shift that grows along the way or with time: metres a unit, with 95 % bounds."""

    value: float
    low: float
    high: float
    unit: str  # ``m/m`` or ``m/min``
    rise: float  # of `value`, upwards


class PlacedScans(NamedTuple):
    """Scans as they are compared, in the frame of the map's points."""

    surfaces: tuple[ScanSurface, ...]
    places: Floats  # (k, 3) of the sensors


class CheckedScans(NamedTuple):
    """What a check of scans found."""

    rows: tuple[ScanMotion, ...]  # worst first
    drift: Drift | None
    scene: PlacedScans
    corrections: Corrections


def check_scans(
    cloud: PointCloud, scans: PosedScans, progress: Callable[[float], None] = lambda done: None
) -> CheckedScans:
    """Return the motions that scans ask of one another; of a cloud that :func:`mapq.posed.merge_scans` made of them.

    `progress` receives the share done.
    """
    scene = scene_of(cloud, scans.poses)
    pairs, relations = pairs_of(scene), []
    for number, pair in enumerate(pairs):
        if (relation := relate(scene, *pair)) is not None:
            relations.append(relation)
        progress((number + 1) / len(pairs))
    alone = solve(relations, scene.places)
    along, unit = _along(scans)
    line = solve(relations, scene.places, along)
    drift = None
    if alone.cost - line.cost > LINE_GAIN and line.cost < solve(relations, scene.places, _step(alone)).cost:
        drift = _drift(line, float(along.max()), unit)
    found = alone if drift is None else line
    rows = [_row(found, scan, scans.names[scan]) for scan in range(len(scans))]
    rows.sort(key=lambda pair: -pair[0])
    return CheckedScans(tuple(row for _, row in rows), drift, scene, found)


def scene_of(cloud: PointCloud, poses: Floats) -> PlacedScans:
    """Return the surfaces of the scans of a map."""
    places = poses[:, :3, 3] - cloud.shift * cloud.unit
    number = np.asarray(cloud.fields["scan"], np.int64)
    order = np.argsort(number, kind="stable")
    groups = np.split(order, np.searchsorted(number[order], np.arange(1, len(poses))))
    is_seen = TO_SENSOR[0] in cloud.fields
    surfaces = [
        surface_of(cloud.xyz[rows], place if is_seen else None) for rows, place in zip(groups, places, strict=True)
    ]
    return PlacedScans(tuple(surfaces), places)


def pairs_of(scene: PlacedScans) -> list[tuple[int, int]]:
    """Return the pairs of scans that are compared: neighbours in time, and those that overlap most."""
    n = len(scene.surfaces)
    cells = np.concatenate([np.floor(each.xyz / CELL).astype(np.int64) for each in scene.surfaces])
    scan = np.repeat(np.arange(n), [len(each.xyz) for each in scene.surfaces])
    number = np.unique(cells, axis=0, return_inverse=True)[1].ravel()
    seen = csr_matrix((np.ones(len(scan)), (scan, number)), shape=(n, int(number.max(initial=-1)) + 1))
    seen.data[:] = 1.0
    counts = np.maximum(np.asarray(seen.sum(axis=1)).ravel(), 1.0)
    shared = (seen @ seen.T).tocsr()
    pairs: set[tuple[int, int]] = set()
    for one in range(n):
        others, common = shared[one].indices, shared[one].data
        share = common / np.minimum(counts[one], counts[others])
        others, share = others[share > OVERLAP], share[share > OVERLAP]
        gap = np.abs(others - one)
        best = others[gap > NEXT][np.argsort(-share[gap > NEXT], kind="stable")[:OTHERS]]
        for other in (*others[(gap > 0) & (gap <= NEXT)].tolist(), *best.tolist()):
            pairs.add((min(one, other), max(one, other)))
    return sorted(pairs)


def relate(scene: PlacedScans, one: int, other: int) -> Relation | None:
    """Return what two scans say of each other; None if they share no surface."""
    fit = register(scene.surfaces[one], scene.surfaces[other], np.eye(4))
    return None if fit is None else Relation(one, other, fit)


def _along(scans: PosedScans) -> tuple[Floats, str]:
    """Return the metres driven to each scan (k,), or the minutes where the sensor hardly moved; and the unit."""
    way = driven(scans.poses)
    if way[-1] > STANDING or scans.times is None or not np.ptp(scans.times) > 0.0:
        return way if way[-1] > STANDING else np.linspace(0.0, 1.0, len(way)), "m/m"
    return (scans.times - scans.times[0]) / 60.0, "m/min"


def _step(found: Corrections) -> Floats:
    """Return 1 from the scan on (k,) that moves most against the one before it, as where a loop was missed; else 0."""
    change = np.linalg.norm(np.diff(found.twist[:, :3], axis=0), axis=1)
    return (np.arange(len(found.twist)) > np.argmax(change)).astype(np.float64)


def _drift(found: Corrections, longest: float, unit: str) -> Drift | None:
    """Return the slope of the line, if the shift at its end is clear."""
    value = float(np.linalg.norm(found.slope[:3]))
    direction = found.slope[:3] / max(value, 1e-12)
    error = BOUND * float(np.sqrt(direction @ found.slope_covariance[:3, :3] @ direction))
    if (value - error) * longest < RIGHT[0]:
        return None
    return Drift(value, max(value - error, 0.0), value + error, unit, float(found.slope[2]))


def _row(found: Corrections, scan: int, file: str) -> tuple[float, ScanMotion]:
    """Return the log-odds that a scan is wrong, and its row."""
    information, twist = found.information[scan], found.twist[scan]
    covariance = np.linalg.inv(information + np.diag(WIDE**-2.0))
    length, shift = float(np.linalg.norm(twist[:3])), covariance[:3, :3]
    direction = twist[:3] / max(length, 1e-12)
    error = BOUND * float(np.sqrt(direction @ shift @ direction))
    widest = BOUND * float(np.sqrt(np.linalg.eigvalsh(shift)[-1]))
    log_odds = log_odds_wrong(information, np.linalg.solve(covariance, twist), RIGHT, WIDE)
    low, high = max(length - error, 0.0), length + widest
    values = (*twist[:3].tolist(), float(twist[5]), low, high, probability_of(log_odds))
    return log_odds, ScanMotion(scan, file, *values)


def log_odds_wrong(information: Floats, vector: Floats, right: Floats, wrong: Floats) -> float:
    """Return the log-odds that a twist is drawn from the `wrong` standard deviations (6) instead of the `right` ones.

    `vector` (6): the `information` (6, 6) times what was measured.
    """
    parts = []
    for spread in (wrong, right):
        whole = information + np.diag(spread**-2.0)
        # Evidence of N(0, spread²) for a measurement of this information, up to what both share.
        evidence = 0.5 * vector @ np.linalg.solve(whole, vector) - 0.5 * np.linalg.slogdet(whole)[1]
        parts.append(evidence - np.log(spread).sum())
    return float(parts[0] - parts[1] + np.log(PRIOR / (1.0 - PRIOR)))


def probability_of(log_odds: float) -> float:
    """Return the probability of log-odds."""
    return float(1.0 / (1.0 + np.exp(-np.clip(log_odds, -700.0, 700.0))))
