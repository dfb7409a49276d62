"""Make demo-office.log.gz and demo-office.geojson: a robot with a laser drives through an office.

The plan, the drive and the scanner are written down below; the ray caster is a plain one over all walls, and shares no
code with the package that maps from the log. Run it anywhere, with numpy alone::

    python data/make_demo_log.py [FOLDER]

The same numpy gives the same bytes.
"""

from __future__ import annotations

import gzip
import json
import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SEED = 20050726
N_SCANS = 31
N_BEAMS = 180
REACH = 30.0
NO_RETURN = 81.83
NOISE = 0.03
OUTLIERS = 0.02
MISSES = 0.02
SPEED = 0.5

# Rectangles x0 y0 x1 y1 in metres. Walls and what stands against them: together they make the rectilinear part.
WALLS = np.array(
    [
        # outer walls; the glass entrance at the east end of the corridor lets the beam out
        (0.0, 0.0, 22.0, 0.3),
        (0.0, 13.7, 22.0, 14.0),
        (0.0, 0.0, 0.3, 14.0),
        (21.7, 0.0, 22.0, 6.4),
        (21.7, 7.8, 22.0, 14.0),
        # south side of the corridor, between its doors
        (0.3, 6.0, 3.6, 6.2),
        (4.5, 6.0, 6.1, 6.2),
        (7.0, 6.0, 11.9, 6.2),
        (13.3, 6.0, 16.9, 6.2),
        (19.4, 6.0, 21.7, 6.2),
        # north side of the corridor
        (0.3, 8.0, 2.0, 8.2),
        (2.9, 8.0, 7.1, 8.2),
        (8.0, 8.0, 9.7, 8.2),
        (11.1, 8.0, 15.3, 8.2),
        (16.2, 8.0, 18.4, 8.2),
        (19.3, 8.0, 21.7, 8.2),
        # between the rooms
        (4.9, 0.3, 5.1, 6.0),
        (9.5, 0.3, 9.7, 6.0),
        (15.5, 0.3, 15.7, 6.0),
        (4.3, 8.2, 4.5, 13.7),
        (8.5, 8.2, 8.7, 13.7),
        (16.8, 8.2, 17.0, 13.7),
        # cupboards, shelves, desks and the kitchen's counter
        (0.3, 3.6, 0.8, 5.4),
        (5.7, 0.3, 7.5, 1.1),
        (8.7, 2.4, 9.5, 4.2),
        (14.9, 0.9, 15.5, 2.7),
        (16.4, 0.3, 21.7, 0.95),
        (21.0, 0.95, 21.7, 2.2),
        (0.3, 9.4, 0.9, 13.0),
        (3.7, 10.6, 4.3, 13.2),
        (5.2, 13.2, 7.4, 13.7),
        (12.0, 12.3, 13.6, 13.7),
        (21.2, 11.2, 21.7, 13.2),
    ]
)

# Centre x y, size along and across, turned by degrees: what stands free.
BLOCKS = np.array(
    [
        (2.3, 2.1, 1.6, 0.8, 0.0),
        (12.3, 2.9, 3.2, 1.2, 0.0),
        (10.4, 5.1, 0.8, 0.12, 40.0),
        (6.4, 11.0, 1.6, 0.8, 30.0),
        (15.3, 11.9, 2.2, 0.12, 65.0),
        (10.2, 12.2, 1.6, 0.8, 90.0),
        (19.0, 12.3, 1.8, 0.8, -35.0),
    ]
)

# Centre x y and radius of what is round: pillars and tables, as octagons.
ROUNDS = np.array([(11.3, 10.4, 0.28), (14.2, 10.4, 0.28), (18.4, 3.3, 0.6), (20.2, 9.8, 0.55)])

# Where the robot drives, room by room; it looks where it goes.
ROUTE = np.array(
    [
        (21.0, 7.1), (18.9, 7.1), (18.85, 9.0), (18.6, 11.1), (20.5, 11.0), (18.0, 10.3), (18.85, 8.9), (18.85, 7.2),
        (18.1, 6.1), (16.7, 4.6), (17.2, 2.0), (20.2, 1.8), (20.2, 4.6), (18.2, 6.1), (17.0, 7.1),
        (15.75, 7.5), (15.75, 9.3), (12.75, 9.5), (12.75, 11.2), (10.2, 11.0), (9.4, 9.8), (10.4, 8.7), (10.4, 7.4),
        (12.6, 7.0), (12.6, 5.0), (10.3, 4.0), (10.3, 1.4), (14.3, 1.4), (14.5, 4.4), (12.6, 5.7), (11.8, 7.1),
        (7.55, 7.2), (7.55, 9.4), (5.2, 9.8), (5.0, 12.3), (7.8, 12.4), (7.55, 8.9), (7.4, 7.3),
        (6.55, 6.7), (6.55, 4.6), (8.0, 2.0), (6.0, 2.4), (6.55, 5.6), (6.5, 6.8), (4.2, 7.0),
        (4.05, 4.9), (3.8, 3.3), (1.2, 3.1), (2.2, 4.9), (4.05, 5.2), (4.0, 6.7), (2.6, 7.1), (2.45, 8.4), (2.4, 12.3),
        (1.5, 12.6), (1.6, 9.6), (2.4, 8.9), (2.4, 7.2), (1.0, 7.1), (3.0, 7.0),
    ]
)  # fmt: skip


def rectilinear_rings(boxes: Array) -> list[Array]:
    """Return the boundary of a union of axis-parallel boxes as rings of corners, the union on their left."""
    xs, ys = np.unique(boxes[:, [0, 2]]), np.unique(boxes[:, [1, 3]])
    full = np.zeros((len(xs) + 1, len(ys) + 1), dtype=bool)
    for x0, y0, x1, y1 in boxes:
        columns = slice(1 + np.searchsorted(xs, x0), 1 + np.searchsorted(xs, x1))
        full[columns, 1 + np.searchsorted(ys, y0) : 1 + np.searchsorted(ys, y1)] = True
    successor = {}
    for i, j in np.argwhere(full):
        corners = [(i - 1, j - 1), (i, j - 1), (i, j), (i - 1, j)]
        neighbours = [(i, j - 1), (i + 1, j), (i, j + 1), (i - 1, j)]
        for side, neighbour in enumerate(neighbours):
            if not full[neighbour]:
                if corners[side] in successor:
                    raise ValueError(
                        f"two boxes touch in a point only, at {xs[corners[side][0]], ys[corners[side][1]]}"
                    )
                successor[corners[side]] = corners[(side + 1) % 4]
    rings = []
    while successor:
        start, corner = next(iter(successor.items()))
        del successor[start]
        ring = [start]
        while corner != start:
            ring.append(corner)
            corner = successor.pop(corner)
        rings.append(without_straight(np.array([(xs[i], ys[j]) for i, j in ring])))
    return rings


def without_straight(ring: Array) -> Array:
    """Return a ring without corners at which nothing turns."""
    before, after = ring - np.roll(ring, 1, axis=0), np.roll(ring, -1, axis=0) - ring
    turns: NDArray[np.bool_] = np.abs(cross(before, after)) > 1e-12
    return ring[turns]


def cross(a: Array, b: Array) -> Array:
    """Return the cross products of vectors in the plane."""
    product: Array = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return product


def block_rings() -> list[Array]:
    """Return the outlines of `BLOCKS` and `ROUNDS`, counter-clockwise."""
    rings = []
    for x, y, along, across, degrees in BLOCKS:
        corner = np.array([(-along, -across), (along, -across), (along, across), (-along, across)]) / 2
        cos, sin = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
        rings.append(np.round(corner @ np.array([(cos, sin), (-sin, cos)]) + (x, y), 4))
    turn = np.radians(22.5 + 45 * np.arange(8))
    octagon = np.column_stack((np.cos(turn), np.sin(turn)))
    rings.extend(np.round((x, y) + radius * octagon, 4) for x, y, radius in ROUNDS)
    return rings


def signed_area(ring: Array) -> float:
    """Return the area inside a ring, negative if it runs clockwise."""
    return float(cross(ring, np.roll(ring, -1, axis=0)).sum() / 2)


def inside(point: Array, ring: Array) -> bool:
    """Return whether a ring goes round a point that is not on it."""
    a, b = ring, np.roll(ring, -1, axis=0)
    rows = (a[:, 1] > point[1]) != (b[:, 1] > point[1])
    a, b = a[rows], b[rows]
    x = a[:, 0] + (point[1] - a[:, 1]) / (b[:, 1] - a[:, 1]) * (b[:, 0] - a[:, 0])
    return int(np.count_nonzero(x > point[0])) % 2 == 1


def polygons(rings: list[Array]) -> list[list[Array]]:
    """Return the rings as polygons: an outline, then the holes in it."""
    outlines = [[ring] for ring in rings if signed_area(ring) > 0]
    for hole in (ring for ring in rings if signed_area(ring) < 0):
        # A corner of the hole is a corner of occupied space, so the innermost outline round it is its own.
        around = [polygon for polygon in outlines if inside(hole[0], polygon[0])]
        min(around, key=lambda polygon: signed_area(polygon[0])).append(hole)
    return outlines


def drive() -> tuple[Array, Array]:
    """Return scan poses (n, 3) at equal distances along `ROUTE`, and the metres driven to each."""
    step = np.diff(ROUTE, axis=0)
    length = np.hypot(step[:, 0], step[:, 1])
    mile = np.r_[0, np.cumsum(length)]
    driven = np.linspace(0.3, mile[-1] - 0.3, N_SCANS)
    x, y = np.interp(driven, mile, ROUTE[:, 0]), np.interp(driven, mile, ROUTE[:, 1])
    leg = np.searchsorted(mile, driven) - 1
    return np.column_stack((x, y, np.arctan2(step[leg, 1], step[leg, 0]))), driven


def distances(poses: Array, bearing: Array, rings: list[Array]) -> Array:
    """Return (n_scans, n_beams) distances to the nearest wall, inf if there is none."""
    a = np.concatenate(rings)
    edge = np.concatenate([np.roll(ring, -1, axis=0) for ring in rings]) - a
    angle = poses[:, 2, None] + bearing
    ray = np.stack((np.cos(angle), np.sin(angle)), axis=-1)[:, :, None, :]
    offset = a - poses[:, None, None, :2]
    with np.errstate(divide="ignore", invalid="ignore"):
        slope = cross(ray, edge)
        along = cross(offset, edge) / slope
        across = cross(offset, ray) / slope
    hit = (along > 0) & (across >= 0) & (across <= 1)
    nearest: Array = np.where(hit, along, np.inf).min(axis=-1)
    return nearest


def measure(distance: Array, rng: np.random.Generator) -> Array:
    """Return what the scanner reports: noise, people in the way, echoes that got lost, in whole centimetres."""
    reading = distance + NOISE * rng.standard_normal(distance.shape)
    in_the_way = rng.random(distance.shape) < OUTLIERS
    reading = np.where(in_the_way, rng.uniform(0.3, np.fmax(np.fmin(distance, REACH), 0.3)), reading)
    lost = (rng.random(distance.shape) < MISSES) | ~(reading < REACH)
    return np.where(lost, NO_RETURN, np.fmax(np.round(reading, 2), 0.01))


def write_log(path: Path, poses: Array, driven: Array, readings: Array) -> None:
    """Write a CARMEN log, gzipped without a date so that its bytes depend on its content alone."""
    lines = [
        "# A simulated drive through an office, made by data/make_demo_log.py",
        "# message_name [message contents] ipc_timestamp ipc_hostname logger_timestamp",
        "# message formats defined: PARAM ODOM FLASER",
        "# FLASER num_readings [range_readings] x y theta odom_x odom_y odom_theta",
        "PARAM robot_frontlaser_offset 0.0 nohost 0",
    ]
    for pose, metres, ranges in zip(poses, driven, readings, strict=True):
        at, time = " ".join(f"{value:.6g}" for value in pose), f"{metres / SPEED:.6g}"
        lines.append(f"ODOM {at} {SPEED} 0 0 {time} demo {time}")
        lines.append(f"FLASER {len(ranges)} {' '.join(f'{r:g}' for r in ranges)} {at} {at} {time} demo {time}")
    path.write_bytes(gzip.compress("\n".join([*lines, ""]).encode("ascii"), compresslevel=9, mtime=0))


def write_plan(path: Path, plan: list[list[Array]]) -> None:
    """Write the occupied area as one GeoJSON feature, rings closed, coordinates in metres."""
    coordinates = [[[*ring.tolist(), ring[0].tolist()] for ring in polygon] for polygon in plan]
    feature = {
        "type": "Feature",
        "properties": {"frame": "metres", "made_by": "data/make_demo_log.py"},
        "geometry": {"type": "MultiPolygon", "coordinates": coordinates},
    }
    path.write_text(json.dumps(feature) + "\n", encoding="utf-8")


def main(folder: Path) -> None:
    """Write both files."""
    rings = rectilinear_rings(WALLS) + block_rings()
    poses, driven = drive()
    bearing = -np.pi / 2 + np.arange(N_BEAMS, dtype=np.float64) * (np.pi / N_BEAMS)
    readings = measure(distances(poses, bearing, rings), np.random.default_rng(SEED))
    write_log(folder / "demo-office.log.gz", poses, driven, readings)
    write_plan(folder / "demo-office.geojson", polygons(rings))


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).resolve().parent)
