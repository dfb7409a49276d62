"""Maps of simulated worlds with known truth, on which the shipped model is trained: ``python -m data.training_worlds``.

A world (`data.training_scenes`) is scanned by a sensor of some kind from some way through it; poses are then left as
registered maps have them, good to some centimetres, or displaced. What is suspicious is known exactly: each point's
true surface is, and so is by how much the scans that see a half metre of it lie apart along its normal.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import dijkstra

from data.training_scenes import Site, make_site
from data.true_ranges import true_ranges, with_metres
from mapq.cloud import PointCloud
from mapq.configuration import SURFACES, PerturbSettings, SegmentSettings
from mapq.io import write_patches
from mapq.kernels.raycast import cast_beams
from mapq.labels import metres_of
from mapq.patches import Patches
from mapq.perturb.build import label_points
from mapq.perturb.errors import displaced
from mapq.perturb.known import FEWEST, Surfaces, known_disagreement, mean_of
from mapq.posed import PosedScans, drive_passes
from mapq.segmentation import segment
from mapq.simulate.scene import MOVING, Kind

Floats = NDArray[np.float64]
Rng = np.random.Generator

N_POINTS = 50_000, 300_000
THINNEST = 0.05
"""Share of the points of a map that is kept at least."""
MOST_BEAMS, FEWEST_OF_SCAN = 1_500_000, 6_000
NOISE, BIAS = (0.003, 0.05), 0.01
ERRORS, GROSS_SHARE, GROSS = (0.04, 0.4), 0.45, (0.3, 1.2)
"""Metres of small errors, how many maps have larger ones, and metres of these."""
JITTER = 0.003, 0.025
"""Metres by which poses of a right map are off."""
CELL = 0.5
"""Metres: side of the pieces of surface in which scans are compared with each other and with those beside them."""
PASSES_GLASS, MIXED, SPOT = 0.75, 0.02, 0.003
"""Shares of beams that go through glass and that may meet an edge, and radians from a beam's middle to its rim."""
MIXED_STEP = 0.05, 2.0
"""Metres between near and far side of an edge at which a beam returns a range between both."""
MOST_PANES, MOST_SCANS = 3, 90
GRAZING = 0.05
"""Cosine of the angle of incidence below which nothing returns."""
PLAN_CELL, BODY = 0.3, 0.35
"""Metres: side of the cells in which ways are looked for, and how far they stay from walls."""


class Sensor(NamedTuple):
    """A laser scanner.

    Attributes
    ----------
    kind : str
        "spinning", "terrestrial" or "tilting".
    noise, bias : float
        Standard deviation of ranges in metres, and by how much they are too long.
    reach : float
        Largest range in metres.
    elevations : (2,) tuple of float
        Lowest and highest beam in radians.
    width : float
        Radians that a scan spans sideways.
    rings : int
        Of a spinning one; lines of a tilting one.
    lost : float
        Share of beams that do not return.
    mount : float
        Metres above the ground.
    """

    kind: str
    noise: float
    bias: float
    reach: float
    elevations: tuple[float, float]
    width: float
    rings: int
    lost: float
    mount: float


class ScannedWorld(NamedTuple):
    """Scans of a world with their right poses.

    Attributes
    ----------
    site : Site
    sensor : Sensor
    way : str
        How the sensor moved.
    poses : (k, 4, 4) float64
        Right ones.
    times : (k,) float64
        Seconds.
    xyz : (n, 3) float64
        Points in the frame of their scan, with noise.
    scan, ring : (n,) int32
    hit : (n, 3) float64
        True place in the world.
    surface : (n,) int64
        True planar surface; -1 for rough things, -2 for what moves and for mixed ranges.
    """

    site: Site
    sensor: Sensor
    way: str
    poses: Floats
    times: Floats
    xyz: Floats
    scan: NDArray[np.int32]
    ring: NDArray[np.int32]
    hit: Floats
    surface: NDArray[np.int64]

    def take(self, some: NDArray[Any]) -> ScannedWorld:
        """Return some of the points."""
        parts = {name: getattr(self, name)[some] for name in ("xyz", "scan", "ring", "hit", "surface")}
        return self._replace(**parts)

    def posed(self) -> PosedScans:
        """Return the scans at their right poses, as :func:`mapq.perturb.build` takes them."""
        parts = [self.xyz[self.scan == scan] for scan in range(len(self.poses))]
        names = tuple(f"scan {scan}" for scan in range(len(parts)))

        def load(scan: int) -> PointCloud:
            return PointCloud.from_world(parts[scan], source=names[scan])

        return PosedScans(names, self.poses, self.times, load, np.arange(len(parts)), f"world of {self.site.kind}")


ROUGH, NOT_KNOWN = -1, -2


def make_world(seed: int, kind: str | None = None) -> ScannedWorld:
    """Return a world of a drawn or given kind, scanned by a sensor on a way that are drawn as well.

    Parameters
    ----------
    seed : int
        The same seed gives the same points.
    kind : str, optional
        One of :data:`data.training_scenes.SITES`.
    """
    rng = np.random.default_rng([seed, 0])
    site = make_site(rng, kind)
    sensor = draw_sensor(site, rng)
    poses, times, way = draw_poses(site, sensor, rng)
    budget = np.exp(rng.uniform(*np.log(N_POINTS))) / np.exp(rng.uniform(np.log(THINNEST), 0.0))
    n_beams = int(np.clip(budget / len(poses), FEWEST_OF_SCAN, MOST_BEAMS / len(poses)))
    parts = [scan_from(site, sensor, pose, time, n_beams, rng) for pose, time in zip(poses, times, strict=True)]
    number = np.repeat(np.arange(len(parts), dtype=np.int32), [len(part[0]) for part in parts])
    xyz, ring, hit, surface = (np.concatenate([part[k] for part in parts]) for k in range(4))
    return ScannedWorld(site, sensor, way, poses, times, xyz, number, ring, hit, surface)


def training_clouds(seed: int, kind: str | None = None) -> Iterator[PointCloud]:
    """Yield a right map of a world and a wrong one, each with points of its own, labelled as `mapq.perturb.build` does.

    Fields are `scan`, `time`, `pass_id`, `to_sensor_x/y/z`, `suspicious` (0, 1, 255 = ambiguous or not known) and
    `disagreement` (metres along the normal, nan where not known).
    """
    world = make_world(seed, kind)
    for is_wrong in (False, True):
        yield labelled(*draw_map(world, seed, is_wrong))


def draw_map(world: ScannedWorld, seed: int, is_wrong: bool) -> tuple[ScannedWorld, Floats, str]:
    """Return the points and poses (k, 4, 4) of a right or a wrong map of a scanned world, and what was drawn."""
    rng = np.random.default_rng([seed, 1 + is_wrong])
    thinned, thinning = thin(world, rng)
    jitter = float(np.exp(rng.uniform(*np.log(JITTER))))
    used, error = world.poses, "right"
    if is_wrong:
        used, error = wrong_poses(world.poses, rng)
    used = jittered(used, jitter, rng)
    site, sensor = world.site.kind, world.sensor
    about = f"{site}, {sensor.kind} {sensor.rings}, noise {sensor.noise:.3f}, {world.way} {len(used)} scans, {thinning}"
    return thinned, used, f"seed {seed}: {about}, {error}, jitter {jitter:.3f}"


# Sensors and where they go.


def draw_sensor(site: Site, rng: Rng) -> Sensor:
    """Return a sensor that fits into the world."""
    kind = str(rng.choice(["spinning", "terrestrial", "tilting"], p=[0.5, 0.28, 0.22]))
    noise = float(np.exp(rng.uniform(np.log(NOISE[0]), np.log(0.012 if kind == "terrestrial" else NOISE[1]))))
    bias, lost = rng.uniform(-BIAS, BIAS), rng.uniform(0.0, 0.1)
    mount = rng.uniform(0.4, 1.9) if np.isfinite(site.height) else rng.uniform(1.0, 2.2)
    if kind == "spinning":
        rings = int(rng.choice([16, 32, 64]))
        fan = (
            (-15.0, 15.0)
            if rings == 16
            else ((-25.0, 15.0), (-24.0, 2.0), (-22.5, 22.5), (-45.0, 45.0))[rng.integers(4)]
        )
        reach, width = rng.uniform(30.0, 80.0), 360.0
    elif kind == "terrestrial":
        rings, fan, reach, width = 0, (-55.0, rng.uniform(30.0, 80.0)), rng.uniform(40.0, 120.0), 360.0
    else:
        rings, fan = int(rng.integers(40, 160)), (-rng.uniform(20.0, 45.0), rng.uniform(20.0, 45.0))
        reach, width = rng.uniform(15.0, 40.0), float(rng.choice([120.0, 180.0, 270.0]))
    low, high = np.radians(fan)
    return Sensor(kind, noise, bias, reach, (float(low), float(high)), np.radians(width), rings, lost, mount)


def draw_poses(site: Site, sensor: Sensor, rng: Rng) -> tuple[Floats, Floats, str]:
    """Return right poses (k, 4, 4), times (k,) in seconds, and the kind of the way."""
    plan = _Plan(site)
    ways = ("drive", "loop", "two visits", "standing", "standpoints")
    chances = (0.1, 0.1, 0.2, 0.1, 0.5) if sensor.kind == "terrestrial" else (0.3, 0.25, 0.2, 0.15, 0.1)
    way = str(rng.choice(ways, p=chances))
    if way == "standing":
        xy = np.repeat(plan.places(1, rng), int(rng.integers(3, 16)), axis=0)
        heading = np.linspace(0.0, rng.uniform(1.0, 6.28), len(xy))
    elif way == "standpoints":
        xy = plan.places(int(rng.integers(2, 13)), rng)
        heading = rng.uniform(-np.pi, np.pi, len(xy))
    else:
        xy, heading = _driven_way(plan, way, rng)
        if sensor.kind == "tilting" and sensor.width < np.pi:
            heading = heading + rng.uniform(-1.0, 1.0, len(xy))
    step = rng.uniform(0.2, 4.0) if way not in ("standpoints",) else rng.uniform(60.0, 400.0)
    tilt = np.radians(rng.uniform(0.0, 2.0)) * rng.standard_normal((len(xy), 2))
    poses = np.tile(np.eye(4), (len(xy), 1, 1))
    poses[:, :3, :3] = [_rotation(roll, pitch, yaw) for (roll, pitch), yaw in zip(tilt, heading, strict=True)]
    poses[:, :2, 3] = xy
    poses[:, 2, 3] = site.ground(xy) + min(sensor.mount, site.height - 0.3)
    return poses, step * np.arange(len(xy), dtype=np.float64), way


def _driven_way(plan: _Plan, way: str, rng: Rng) -> tuple[Floats, Floats]:
    """Return places (k, 2) and headings (k,) of a drive, of a loop that comes back, or of two visits."""
    spacing, n_most = np.exp(rng.uniform(np.log(0.5), np.log(4.0))), int(rng.integers(8, MOST_SCANS + 1))
    stops = plan.places(int(rng.integers(3, 7)), rng)
    if way == "loop":
        stops = np.concatenate([stops, stops[:2]])
    line = plan.way_along(stops)
    if way == "two visits":
        line = np.concatenate([line, plan.way_along(stops[::-1])])
    steps = np.hypot(*np.diff(line, axis=0).T)
    driven = np.concatenate([[0.0], np.cumsum(steps)])
    wanted = driven[-1] / spacing
    # What comes back must do so, at wider spacing; a drive may end where the scans do.
    n = int(np.clip(wanted, 3, n_most if way == "drive" else max(n_most, min(driven[-1] / 4.0, MOST_SCANS))))
    length = driven[-1] if way != "drive" else min(driven[-1], n * spacing)
    at = np.linspace(0.0, length, n)
    xy = np.column_stack([np.interp(at, driven, line[:, axis]) for axis in (0, 1)])
    ahead = np.column_stack([np.interp(at + 0.7, driven, line[:, axis]) for axis in (0, 1)])
    behind = np.column_stack([np.interp(at - 0.7, driven, line[:, axis]) for axis in (0, 1)])
    return xy, np.arctan2(*(ahead - behind).T[::-1])


class _Plan:
    """The cells of a world that a sensor can reach."""

    def __init__(self, site: Site) -> None:
        self.low = site.corners[0]
        self.shape = tuple(np.ceil((site.corners[1] - self.low) / PLAN_CELL).astype(int) + 1)
        taken = np.zeros(self.shape, bool)
        for points in _outlines(site):
            index = np.round((points - self.low) / PLAN_CELL).astype(int)
            inside = ((index >= 0) & (index < self.shape)).all(axis=1)
            taken[tuple(index[inside].T)] = True
        grid = np.stack(np.meshgrid(*(np.arange(n) for n in self.shape), indexing="ij"), axis=-1).reshape(-1, 2)
        taken |= ~site.may_stand(self.low + PLAN_CELL * grid).reshape(self.shape)
        free = ndimage.distance_transform_edt(~taken) * PLAN_CELL > BODY
        regions, _ = ndimage.label(free)
        cells = np.argwhere(free)
        nearest = cells[np.argmin(((self.low + cells * PLAN_CELL - site.start) ** 2).sum(axis=1))]
        self.cells = np.argwhere(regions == regions[tuple(nearest)])
        self.number = np.full(self.shape, -1)
        self.number[tuple(self.cells.T)] = np.arange(len(self.cells))
        self.edges = self._edges()

    def _edges(self) -> csr_array:
        rows, columns = [], []
        for dx, dy in ((1, 0), (0, 1), (1, 1), (1, -1)):
            beside = self.cells + np.array((dx, dy))
            inside = ((beside >= 0) & (beside < self.shape)).all(axis=1)
            other = np.where(inside, self.number[tuple(np.where(inside[:, None], beside, 0).T)], -1)
            rows.append(np.flatnonzero(other >= 0))
            columns.append(other[other >= 0])
        row, column = np.concatenate(rows), np.concatenate(columns)
        length = np.hypot(*(self.cells[row] - self.cells[column]).T)
        return coo_array((length, (row, column)), shape=(len(self.cells),) * 2).tocsr()

    def places(self, n: int, rng: Rng) -> Floats:
        """Return n reachable places (n, 2), of some at random those that are far from one another."""
        tried = rng.integers(len(self.cells), size=(n, 3))
        kept = [tried[0, 0]]
        for some in tried[1:]:
            away = np.linalg.norm(self.cells[some][:, None] - self.cells[kept], axis=2).min(axis=1)
            kept.append(some[np.argmax(away)])
        return np.asarray(self.low + PLAN_CELL * (self.cells[kept] + rng.uniform(-0.2, 0.2, (n, 2))))

    def way_along(self, stops: Floats) -> Floats:
        """Return the shortest way (m, 2) through reachable places (n, 2), smoothed a little."""
        index = np.clip(np.round((stops - self.low) / PLAN_CELL).astype(int), 0, np.array(self.shape) - 1)
        nodes = self.number[tuple(index.T)]
        _, before = dijkstra(self.edges, directed=False, indices=nodes[:-1], return_predecessors=True)
        cells = []
        for source, goal in zip(before, nodes[1:], strict=True):
            piece = [int(goal)]
            while source[piece[-1]] >= 0:
                piece.append(int(source[piece[-1]]))
            cells += piece[::-1]
        line = self.low + PLAN_CELL * self.cells[cells].astype(float)
        return np.column_stack([ndimage.uniform_filter1d(axis, 3, mode="nearest") for axis in line.T])


def _outlines(site: Site) -> Iterator[Floats]:
    """Yield points (n, 2) along everything that stands in a sensor's way."""
    walls, posts, blobs = site.world.scene.walls, site.world.scene.posts, site.world.scene.blobs
    for wall in walls:
        level = float(site.ground(wall[None, :2])[0])
        if wall[5] < level + 2.0 and wall[6] > level + 0.25:
            along = np.arange(0.0, wall[4] + PLAN_CELL, 0.5 * PLAN_CELL)[:, None]
            yield wall[:2] + np.minimum(along, wall[4]) * wall[2:4]
    for x, y, radius in [*posts[:, :3], *blobs[blobs[:, 2] - blobs[:, 4] < 2.0][:, [0, 1, 3]]]:
        turn = np.linspace(0.0, 2.0 * np.pi, 8 + int(2.0 * np.pi * radius / PLAN_CELL))
        yield np.array([x, y]) + radius * np.column_stack([np.cos(turn), np.sin(turn)])


def _rotation(roll: float, pitch: float, yaw: float) -> Floats:
    """Return the rotation (3, 3) about x, then y, then z."""
    (a, b, c), (p, q, r) = np.cos([roll, pitch, yaw]), np.sin([roll, pitch, yaw])
    about_x = np.array([[1, 0, 0], [0, a, -p], [0, p, a]])
    about_y = np.array([[b, 0, q], [0, 1, 0], [-q, 0, b]])
    return np.asarray(np.array([[c, -r, 0], [r, c, 0], [0, 0, 1]]) @ about_y @ about_x)


# Scans.


def scan_from(
    site: Site, sensor: Sensor, pose: Floats, time: float, n_beams: int, rng: Rng
) -> tuple[Floats, NDArray[np.int32], Floats, NDArray[np.int64]]:
    """Return what one scan sees: points (n, 3) in its frame, their rings, true places in the world, and surfaces."""
    beams, ring = _beams(sensor, n_beams, rng)
    world_beams = np.ascontiguousarray(beams @ pose[:3, :3].T)
    ranges, items = _cast_through_glass(site, pose[:3, 3], world_beams, time, sensor.reach, rng)
    world = site.world
    surface = world.surface[items].astype(np.int64)
    surface[np.isin(world.kind[items], MOVING)] = NOT_KNOWN
    measured, is_mixed = _mixed(site, pose[:3, 3], world_beams, (ranges, time, sensor.reach), rng)
    surface[is_mixed] = NOT_KNOWN
    cosine = np.abs(np.einsum("ij,ij->i", world.normal[np.maximum(surface, 0)], world_beams))
    chance = sensor.lost + 0.7 * (ranges / sensor.reach) ** 3
    kept = np.isfinite(ranges) & (rng.random(len(ranges)) > chance) & ((surface < 0) | (cosine > GRAZING))
    measured = measured + sensor.bias + sensor.noise * rng.standard_normal(len(ranges))
    kept &= measured > 0.3
    hit = pose[:3, 3] + ranges[kept, None] * world_beams[kept]
    return measured[kept, None] * beams[kept], ring[kept], hit, surface[kept]


def _beams(sensor: Sensor, n: int, rng: Rng) -> tuple[Floats, NDArray[np.int32]]:
    """Return directions (m, 3) of about n beams in the frame of the sensor, and their rings."""
    low, high = sensor.elevations
    if sensor.kind == "terrestrial":
        rows = max(int(np.sqrt(n * (high - low) / sensor.width)), 8)
    else:
        rows = min(sensor.rings, n // 100)
    columns = n // rows
    ring, column = np.repeat(np.arange(rows), columns), np.tile(np.arange(columns), rows)
    up = low + (high - low) * ring / max(rows - 1, 1)
    side = sensor.width * ((column + rng.random()) / columns - 0.5)
    if sensor.kind == "tilting":
        ahead, left, rise = np.cos(side) * np.cos(up), np.sin(side), np.abs(np.cos(side)) * np.sin(up)
    else:
        ahead, left, rise = np.cos(up) * np.cos(side), np.cos(up) * np.sin(side), np.sin(up)
    return np.stack([ahead, left, rise], axis=1), ring.astype(np.int32)


def _cast(site: Site, origins: Floats, beams: Floats, time: float, reach: float, rng: Rng) -> tuple[Floats, Any]:
    n = len(beams)
    ranges, items = np.empty(n), np.empty(n, np.int32)
    cast_beams(site.world.scene, origins, beams, np.full(n, time), rng.random(n), reach, ranges, items)
    return ranges, items


def _cast_through_glass(
    site: Site, origin: Floats, beams: Floats, time: float, reach: float, rng: Rng
) -> tuple[Floats, NDArray[np.int64]]:
    """Return ranges (n,), inf for none, and items (n,) of first returns; most beams go through glass."""
    origins = np.tile(origin, (len(beams), 1))
    ranges, items = _cast(site, origins, beams, time, reach, rng)
    for _ in range(MOST_PANES):
        is_glass = np.isfinite(ranges) & (site.world.kind[items] == Kind.RECESS)
        through = np.flatnonzero(is_glass & (rng.random(len(beams)) < PASSES_GLASS))
        passed = ranges[through] + 1e-3
        some = beams[through]
        ahead = origins[through] + passed[:, None] * some
        further, items[through] = _cast(site, ahead, np.ascontiguousarray(some), time, reach, rng)
        ranges[through] = np.where(passed + further < reach, passed + further, np.inf)
    return ranges, items.astype(np.int64)


def _mixed(
    site: Site, origin: Floats, beams: Floats, seen: tuple[Floats, float, float], rng: Rng
) -> tuple[Floats, NDArray[np.bool_]]:
    """Return the ranges (n,) of which some lie between both sides of an edge, and which do."""
    ranges, time, reach = seen
    some = np.flatnonzero((rng.random(len(beams)) < MIXED) & np.isfinite(ranges))
    beside = beams[some] + SPOT * rng.standard_normal((len(some), 3))
    beside /= np.linalg.norm(beside, axis=1, keepdims=True)
    other, _ = _cast(site, np.tile(origin, (len(some), 1)), beside, time, reach, rng)
    step = np.abs(other - ranges[some])
    at_edge = (step > MIXED_STEP[0]) & (step < MIXED_STEP[1])
    measured, is_mixed = ranges.copy(), np.zeros(len(ranges), bool)
    edges = some[at_edge]
    measured[edges] += rng.uniform(0.1, 0.9, len(edges)) * (other[at_edge] - ranges[edges])
    is_mixed[edges] = True
    return measured, is_mixed


def thin(world: ScannedWorld, rng: Rng) -> tuple[ScannedWorld, str]:
    """Return a share of the points, at most as many as a map shall have, and how it was drawn."""
    aim = float(np.exp(rng.uniform(*np.log(N_POINTS))))
    share = min(1.0, max(aim / max(len(world.scan), 1), THINNEST))
    step = round(1.0 / share)
    way = str(rng.choice(["random", "voxels", "voxels of scans", "rings", "even"]))
    kept = np.ones(len(world.scan), bool)
    if way == "rings" and world.sensor.rings >= 16 * step:
        kept = (world.ring + world.scan) % step == 0
    elif way.startswith("voxels"):
        kept = _one_a_voxel(world, aim, way != "voxels", rng)
    elif way == "even":
        weight = (world.xyz**2).sum(axis=1)
        kept = rng.random(len(weight)) < np.minimum(weight / np.quantile(weight, 1.0 - 0.5 * share), 1.0)
    kept &= rng.random(len(kept)) < min(aim * 1.2, N_POINTS[1]) / max(float(kept.sum()), 1.0)
    return world.take(kept), f"{way} 1/{len(kept) / max(float(kept.sum()), 1.0):.1f}"


def _one_a_voxel(world: ScannedWorld, aim: float, of_scan: bool, rng: Rng) -> NDArray[np.bool_]:
    """Return which points to keep: one of each cube, of a side that leaves about the number aimed at."""
    order = rng.permutation(len(world.hit))
    kept = np.ones(len(order), bool)
    for side in 0.02 * 1.4 ** np.arange(8):
        key = np.floor(world.hit[order] / side).astype(np.int64)
        if of_scan:
            key = np.column_stack([key, world.scan[order]])
        key -= key.min(axis=0)
        flat = np.ravel_multi_index(tuple(key.T), tuple(key.max(axis=0) + 1))
        kept[:] = False
        kept[order[np.unique(flat, return_index=True)[1]]] = True
        if np.count_nonzero(kept) < 1.3 * aim:
            break
    return kept


# Errors of poses.


def jittered(poses: Floats, metres: float, rng: Rng) -> Floats:
    """Return poses each of which is off by up to some metres, and by angles that make as much 15 m off."""
    moved = poses.copy()
    for pose in moved:
        angles = metres / 15.0 * rng.uniform(-1.0, 1.0, 3) * (0.3, 0.3, 1.0)
        pose[:3, :3] = _rotation(*angles) @ pose[:3, :3]
        pose[:3, 3] += metres * rng.uniform(-0.7, 0.7, 3) * (1.0, 1.0, 0.5)
    return moved


def wrong_poses(poses: Floats, rng: Rng) -> tuple[Floats, str]:
    """Return poses with errors of a drawn kind and size, and what they are."""
    size = float(np.exp(rng.uniform(*np.log(GROSS if rng.random() < GROSS_SHARE else ERRORS))))
    way = np.hypot(*np.diff(poses[:, :2, 3], axis=0).T).sum()
    degrees = float(rng.choice([0.0, np.degrees(size / max(way, 10.0)) * rng.uniform(0.3, 1.5)]))
    seed = int(rng.integers(2**31))
    kinds = ("drift", "missed loop", "each scan", "halves", "some scans", "random walk")
    kind = str(rng.choice(kinds, p=(0.26, 0.18, 0.06, 0.22, 0.2, 0.08)))
    if kind == "drift":
        moved = displaced(poses, PerturbSettings(drift=(size, degrees)), seed)
    elif kind == "missed loop":
        moved = displaced(poses, PerturbSettings(missed_loop=(size, degrees)), seed)
    elif kind == "each scan":
        moved = displaced(poses, PerturbSettings(offset=0.5 * size, yaw=0.3 * degrees), seed)
    elif kind == "random walk":
        moved = _wandered(poses, 0.6 * size, rng)
    else:
        moved = _some_moved(poses, kind == "halves", size, rng)
    upward = str(rng.choice(["level", "raised", "both"], p=(0.55, 0.3, 0.15)))
    if upward == "raised":
        moved = poses
    if upward != "level":
        moved = _raised(moved, kind, size, rng)
    return moved, f"{kind} {size:.2f} m, {upward}"


def _raised(poses: Floats, kind: str, size: float, rng: Rng) -> Floats:
    """Return poses that lie higher or lower: more and more, all from one on, or some of them."""
    n, moved = len(poses), poses.copy()
    if kind in ("drift", "random walk"):
        steps = np.ones(n) if kind == "drift" else rng.standard_normal(n)
        rise = np.cumsum(steps) - steps[0]
        rise /= max(float(np.abs(rise).max()), 1e-9)
    elif kind in ("halves", "missed loop"):
        rise = (np.arange(n) >= rng.uniform(0.3, 0.7) * n).astype(np.float64)
    else:
        rise = (rng.random(n) < 0.2).astype(np.float64)
        rise[int(rng.integers(n))] = 1.0
    moved[:, 2, 3] += size * float(rng.choice([-1.0, 1.0])) * rise
    return moved


def _wandered(poses: Floats, size: float, rng: Rng) -> Floats:
    """Return poses that wander off, in levels and yaw, up to `size` metres."""
    steps = np.cumsum(rng.standard_normal((len(poses), 3)), axis=0)
    steps *= size / np.maximum(np.abs(steps).max(axis=0), 1e-9)
    moved = poses.copy()
    for pose, (x, y, yaw) in zip(moved, steps, strict=True):
        pose[:2, 3] += x, y
        pose[:3, :3] = _rotation(0.0, 0.0, yaw / 40.0) @ pose[:3, :3]
    return moved


def _some_moved(poses: Floats, half: bool, size: float, rng: Rng) -> Floats:
    """Return poses of which half of them, by time, by place or at random, or a few, are moved together."""
    n = len(poses)
    if half:
        direction = rng.standard_normal(2)
        along = (np.arange(n), poses[:, :2, 3] @ direction, rng.random(n))[int(rng.integers(3))]
        some = np.argsort(along, kind="stable")[: max(n // 2, 1)]
    else:
        some = rng.permutation(n)[: int(rng.integers(1, max(n // 6, 1) + 1))]
    turn = rng.uniform(0.0, 2.0 * np.pi)
    motion = np.eye(4)
    roll = rng.choice([0.0, 0.0, np.radians(0.3)]) * rng.standard_normal(2)
    motion[:3, :3] = _rotation(roll[0], roll[1], rng.choice([0.0, size / 15.0]) * rng.uniform(-1.0, 1.0))
    pivot = poses[some, :3, 3].mean(axis=0)
    rise = rng.choice([0.0, 0.0, 0.5]) * rng.uniform(-1.0, 1.0)
    motion[:3, 3] = pivot - motion[:3, :3] @ pivot + size * np.array([np.cos(turn), np.sin(turn), rise])
    moved = poses.copy()
    moved[some] = motion @ poses[some]
    return moved


# Truth.


def labelled(world: ScannedWorld, used: Floats, source: str) -> PointCloud:
    """Return the map that poses (k, 4, 4) make of the scans, with its truth."""
    metres = true_disagreement(world, used)
    xyz = np.einsum("nij,nj->ni", used[world.scan, :3, :3], world.xyz) + used[world.scan, :3, 3]
    to_sensor = (used[world.scan, :3, 3] - xyz).astype(np.float32)
    fields: dict[str, NDArray[Any]] = {
        "scan": world.scan,
        "suspicious": label_points(metres, PerturbSettings()),
        "disagreement": metres.astype(np.float32),
        "time": world.times[world.scan],
        "pass_id": drive_passes(world.poses)[world.scan],
    }
    fields |= {f"to_sensor_{axis}": to_sensor[:, k] for k, axis in enumerate("xyz")}
    return PointCloud.from_world(xyz.astype(np.float32), fields, source)


def true_disagreement(world: ScannedWorld, used: Floats) -> Floats:
    """Return for each point (n,) how far the scans that see its piece of surface lie apart along its normal, in metres.

    As :func:`mapq.perturb.known.known_disagreement`, for pieces of the true surfaces; nan for what moves and for
    mixed ranges.
    """
    metres = np.full(len(world.scan), np.nan)
    known = world.surface != NOT_KNOWN
    if known.any():
        surfaces = _pieces(world.take(known))
        metres[known], _ = known_disagreement(surfaces, world.poses, used, PerturbSettings().plausible_below)
    return metres


def _pieces(world: ScannedWorld) -> Surfaces:
    """Return pieces of the true surfaces, and cubes of rough things, with the scans that see them or one beside."""
    normal = world.site.world.normal[np.maximum(world.surface, 0)]
    index = _cells_on(world.hit, normal, world.surface >= 0)
    key = np.column_stack([world.surface, index])
    low = key.min(axis=0) - 1
    shape = tuple((key.max(axis=0) + 2 - low).tolist())
    found, first, piece = np.unique(
        np.ravel_multi_index(tuple((key - low).T), shape), return_index=True, return_inverse=True
    )
    n_pieces, n_scans = len(found), len(world.poses)
    pairs, entry, counts = np.unique(piece * n_scans + world.scan, return_inverse=True, return_counts=True)
    at, by = pairs // n_scans, pairs % n_scans
    points_at = csr_array((counts, (at, by)), shape=(n_pieces, n_scans))
    flat = world.surface[first] >= 0
    seen = (_beside(key[first] - low, found, shape, flat) @ points_at).tocoo()
    enough = seen.data >= FEWEST
    order = np.lexsort((seen.col[enough], seen.row[enough]))
    seen_at, seen_by = seen.row[enough][order].astype(np.int64), seen.col[enough][order].astype(np.int64)
    place = mean_of(piece, n_pieces, world.hit)
    return Surfaces(place, normal[first], flat, entry, at, by, seen_at, seen_by, CELL)


def _cells_on(hit: Floats, normal: Floats, is_flat: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return the number (n, 3) of the square of each point in its plane, or of its cube."""
    level = np.column_stack([-normal[:, 1], normal[:, 0], np.zeros(len(normal))])
    length = np.linalg.norm(level, axis=1)
    level = np.where(length[:, None] > 0.05, level / np.maximum(length, 1e-9)[:, None], [1.0, 0.0, 0.0])
    upward = np.cross(normal, level)
    in_plane = np.column_stack(
        [np.einsum("ij,ij->i", hit, level), np.einsum("ij,ij->i", hit, upward), np.zeros(len(hit))]
    )
    return np.floor(np.where(is_flat[:, None], in_plane, hit) / CELL).astype(np.int64)


def _beside(
    key: NDArray[np.int64], found: NDArray[np.int64], shape: tuple[int, ...], flat: NDArray[np.bool_]
) -> csr_array:
    """Return the matrix (m, m) of pieces of one surface that are the same or touch."""
    rows, columns = [], []
    for du in (-1, 0, 1):
        for dv in (-1, 0, 1):
            wanted = np.ravel_multi_index(tuple((key + np.array((0, du, dv, 0))).T), shape)
            place = np.minimum(np.searchsorted(found, wanted), len(found) - 1)
            some = np.flatnonzero((found[place] == wanted) & (flat | ((du == 0) & (dv == 0))))
            rows.append(some)
            columns.append(place[some])
    row, column = np.concatenate(rows), np.concatenate(columns)
    return csr_array((np.ones(len(row), np.int64), (row, column)), shape=(len(found), len(found)))


# Patches to train on.


def training_patches(seed: int, is_wrong: bool) -> Patches:
    """Return the labelled patches of a map, planes and curved ones, labelled by what is true."""
    world, used, source = draw_map(make_world(seed), seed, is_wrong)
    cloud = labelled(world, used, source)
    patches = segment(cloud, SegmentSettings(surfaces=("upright", "level", "curved")))
    # What moves has no truth, and what one scan alone saw nothing can show to be wrong. Of columns points have no truth
    # of their own in wrong maps, but they stand still.
    stands = metres_of(patches.patch, len(patches), (world.surface != NOT_KNOWN).astype(np.float32)) > 0.5
    known = np.isfinite(metres_of(patches.patch, len(patches), cloud.fields["disagreement"]))
    known |= stands & (patches.kinds == SURFACES.index("curved"))
    apart = true_ranges(patches, world.hit, used @ np.linalg.inv(world.poses))
    return with_metres(patches, np.where(known, np.nan_to_num(apart), np.nan))


def main() -> None:
    """Write maps for training: those of even seeds are right, those of odd ones wrong."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--name", default="train", help="what names of files begin with")
    parser.add_argument("--seeds", type=int, nargs=2, default=(0, 40), help="first seed, and the one after the last")
    given = parser.parse_args()
    given.folder.mkdir(parents=True, exist_ok=True)
    for seed in range(*given.seeds):
        patches = training_patches(seed, bool(seed % 2))
        write_patches(given.folder / f"{given.name}-{seed}.patches", patches)
        n_suspicious, n_plausible = (int((patches.label == label).sum()) for label in (1, 0))
        print(f"{len(patches)} patches, {n_suspicious} suspicious, {n_plausible} plausible;", patches.cloud.source)


if __name__ == "__main__":
    main()
