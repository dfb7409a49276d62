"""Where chains of walls start: lines that returns lie on, found greedily, each with a wall behind it.

It is a start and no law: what is wrong the chain puts right. Chains use different halves of the returns.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from prf.model.coloring import Coloring
from prf.model.ranges import unit_vectors
from prf.model.walls import N_WALL, corners_of, map_of_walls
from prf.readings.way import cleared
from prf.sampler.target import Target, white_places

Floats = NDArray[np.float64]

SHARE = 0.5
"""Share of the returns that a start is made of."""
MOST_RETURNS = 8_000
TRIES = 12
"""Lines through two returns that are tried for one that is kept."""
APART = 0.5
"""Metres between the two at most."""
HOLE = 0.3
"""Metres between neighbours on a line at most."""
SHORTEST, FEWEST = 0.15, 5
"""Metres, and returns, of a line."""
MOST_FAILURES = 30
THICKEST = 0.5
"""Metres between two faces of one wall at most."""


class Face(NamedTuple):
    """A line that returns lie on, the free ground on its right."""

    a: Floats  # (2,) metres
    b: Floats

    @property
    def unit(self) -> Floats:
        """Direction."""
        found: Floats = (self.b - self.a) / np.hypot(*(self.b - self.a))
        return found

    @property
    def length(self) -> float:
        """Metres."""
        return float(np.hypot(*(self.b - self.a)))

    def seen(self, xy: Floats) -> Floats:
        """Places (n, 2) along the face, and across it to the left."""
        u, off = self.unit, xy - self.a
        return np.stack([off @ u, off @ np.array([-u[1], u[0]])], axis=-1)


def lines_map(target: Target, rng: np.random.Generator) -> Coloring:
    """Return walls behind the lines of a random half of the returns; none covers a sensor or the way driven."""
    if target.laser is None:
        return Coloring.empty(target.window)
    model, readings = target.laser.model, target.laser.readings
    chosen = np.flatnonzero((readings.range < model.limit) & (rng.random(readings.n_beams) < SHARE))
    chosen = rng.permutation(chosen)[:MOST_RETURNS]
    hit = readings.select(np.sort(chosen))
    ends = hit.origin + hit.range[:, None] * unit_vectors(hit.angle)
    inside = target.window.contains(ends, strictly=True)
    faces = found_faces(ends[inside], hit.origin[inside], max(0.03, 2.0 * model.noise), rng)
    assert target.walls is not None
    walls = with_bodies(faces, target.walls.thickness)
    return map_of_walls(allowed(walls, target), target.window)


def found_faces(ends: Floats, origin: Floats, near: float, rng: np.random.Generator) -> list[Face]:
    """Return the faces of returns (n, 2) seen from origins (n, 2), the one with most returns on it taken first."""
    left, faces, failures = np.ones(len(ends), np.bool_), [], 0
    tree = cKDTree(ends) if len(ends) else None
    while tree is not None and failures < MOST_FAILURES and left.sum() >= FEWEST:
        on = np.zeros(0, np.int64)
        for seed in rng.choice(np.flatnonzero(left), TRIES):
            others = np.array([k for k in tree.query_ball_point(ends[seed], APART) if left[k] and k != seed], np.int64)
            if len(others) == 0:
                continue
            trial = run_on(ends, np.flatnonzero(left), ends[seed], ends[rng.choice(others)], near)
            on = trial if len(trial) > len(on) else on
        if len(on) < FEWEST:
            failures += 1
            continue
        face = fitted(ends[on], origin[on])
        along = face.seen(ends)
        covered = (np.abs(along[:, 1]) < 1.5 * near) & (along[:, 0] > -near) & (along[:, 0] < face.length + near)
        left &= ~covered
        left[on] = False
        failures = failures + 1 if face.length < SHORTEST else 0
        if face.length >= SHORTEST:
            faces.append(face)
    return faces


def run_on(ends: Floats, left: NDArray[np.int64], p: Floats, q: Floats, near: float) -> NDArray[np.int64]:
    """Return those returns that are left, by number, next to the line pq without a hole up to p."""
    if (p == q).all():
        return np.zeros(0, np.int64)
    along = Face(p, q).seen(ends[left])
    close = np.abs(along[:, 1]) < near
    order = np.argsort(along[close, 0])
    place, on = along[close, 0][order], left[close][order]
    part = np.append(0, np.cumsum(np.diff(place) > HOLE))
    return np.asarray(on[part == part[np.argmin(np.abs(place))]])


def fitted(ends: Floats, origin: Floats) -> Face:
    """Return the face of returns (n, 2), the ground of most of their sensors on its right."""
    middle = ends.mean(axis=0)
    u = np.linalg.svd(ends - middle, full_matrices=False)[2][0]
    along = (ends - middle) @ u
    face = Face(middle + along.min() * u, middle + along.max() * u)
    return Face(face.b, face.a) if np.median(face.seen(origin)[:, 1]) > 0.0 else face


def with_bodies(faces: list[Face], thickness: float) -> Floats:
    """Return walls (n, N_WALL) behind faces, up to the face of the other side; of `thickness` where there is none."""
    walls, gone = [], set()
    for i in sorted(range(len(faces)), key=lambda k: -faces[k].length):
        face = faces[i]
        if i in gone or face.length < 1e-6:
            continue
        depth = min(thickness, 0.9 * face.length)
        for k, other in enumerate(faces):
            along = face.seen(np.stack([other.b, other.a]))
            shared = min(along[1, 0], face.length) - max(along[0, 0], 0.0)
            apart = float(along[:, 1].mean())
            if k != i and face.unit @ other.unit < -0.97 and 0.02 < apart < THICKEST and shared > 0.5 * other.length:
                gone.add(k)
                if shared > 0.3 * face.length and apart < face.length:
                    depth = apart
        shift = 0.5 * depth * np.array([-face.unit[1], face.unit[0]])
        walls.append([*(face.a + shift), *(face.b + shift), depth])
    return np.array(walls).reshape(-1, N_WALL)


def allowed(walls: Floats, target: Target) -> Floats:
    """Return the walls inside the window that cover no sensor and leave the way driven clear."""
    if len(walls) == 0:
        return walls
    shapes = shapely.polygons(corners_of(walls))
    x0, y0, x1, y1 = target.window
    fits = shapely.contains_properly(shapely.box(x0, y0, x1, y1), shapes)
    places = shapely.points(np.unique(white_places(target), axis=0))
    hit = shapely.STRtree(shapes).query(places, predicate="intersects")[1]
    fits[hit] = False
    fits &= ~shapely.intersects(shapes, cleared(target.way, 1.01 * target.driven_radius))
    return np.asarray(walls[fits])
