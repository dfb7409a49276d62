"""Scenes by hand, judged from points alone: is each called right that is right, and wrong that is wrong?

Rooms, halls, streets and stairs of rectangles and columns, sampled with noise, without scans, times or rays. Wrong ones
hold a second copy that is shifted, raised or turned, as maps have it whose second half was displaced. Nothing is tuned
on them.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mapq.api import classify
from mapq.cloud import PointCloud

Floats = NDArray[np.float64]
Rng = np.random.Generator

DENSITY, NOISE = 120.0, 0.01
"""Points a square metre, and metres."""
NOTHING, MOST = 0.03, 0.8
"""Share of the area called of a right scene at most, and of a wrong one's displaced surfaces at least."""


class Scene(NamedTuple):
    """Parts of a scene, and the motion (4, 4) of its second copy; None: it is right."""

    parts: list[Callable[[Rng], Floats]]
    motion: Floats | None = None
    tolerance: float = 0.3


def sheet(corner: tuple[float, ...], one: tuple[float, ...], other: tuple[float, ...]) -> Callable[[Rng], Floats]:
    """Return what samples a parallelogram."""
    c, a, b = (np.array(each, np.float64) for each in (corner, one, other))

    def sample(rng: Rng) -> Floats:
        normal = np.cross(a, b)
        area = float(np.linalg.norm(normal))
        n = rng.poisson(DENSITY * area)
        u, v = rng.random((2, n, 1))
        return np.asarray(c + u * a + v * b + NOISE * rng.standard_normal((n, 1)) * normal / area)

    return sample


def wall(x0: float, y0: float, x1: float, y1: float, top: float, low: float = 0.0) -> Callable[[Rng], Floats]:
    """Return what samples an upright rectangle."""
    return sheet((x0, y0, low), (x1 - x0, y1 - y0, 0.0), (0.0, 0.0, top - low))


def floor(x0: float, y0: float, x1: float, y1: float, z: float = 0.0) -> Callable[[Rng], Floats]:
    """Return what samples a level rectangle."""
    return sheet((x0, y0, z), (x1 - x0, 0.0, 0.0), (0.0, y1 - y0, 0.0))


def box(x: float, y: float, along: float, across: float, low: float, top: float) -> list[Callable[[Rng], Floats]]:
    """Return what samples the sides and the lid of a box."""
    x1, y1 = x + along, y + across
    sides = [wall(x, y, x1, y, top, low), wall(x1, y, x1, y1, top, low)]
    return [*sides, wall(x1, y1, x, y1, top, low), wall(x, y1, x, y, top, low), floor(x, y, x1, y1, top)]


def column(x: float, y: float, radius: float, top: float) -> Callable[[Rng], Floats]:
    """Return what samples an upright cylinder."""

    def sample(rng: Rng) -> Floats:
        n = rng.poisson(DENSITY * 2.0 * np.pi * radius * top)
        turn, r = rng.uniform(0.0, 2.0 * np.pi, n), radius + NOISE * rng.standard_normal(n)
        return np.column_stack([x + r * np.cos(turn), y + r * np.sin(turn), rng.uniform(0.0, top, n)])

    return sample


def blob(x: float, y: float, radius: float, low: float, top: float) -> Callable[[Rng], Floats]:
    """Return what samples leaves."""

    def sample(rng: Rng) -> Floats:
        n = rng.poisson(4.0 * DENSITY * radius * (top - low))
        return np.column_stack([rng.normal((x, y), 0.5 * radius, (n, 2)), rng.uniform(low, top, n)])

    return sample


def room(along: float = 9.0, across: float = 7.0, top: float = 2.8) -> list[Callable[[Rng], Floats]]:
    """Return a room with floor, ceiling, a cupboard and a table."""
    walls = [wall(0, 0, along, 0, top), wall(along, 0, along, across, top)]
    walls += [wall(along, across, 0, across, top), wall(0, across, 0, 0, top)]
    level = [floor(0, 0, along, across), floor(0, 0, along, across, top)]
    return [*walls, *level, *box(2, 0.1, 1.6, 0.5, 0.0, 1.9), *box(4, 3, 1.6, 0.8, 0.72, 0.75)]


def hall() -> list[Callable[[Rng], Floats]]:
    """Return a hall with columns, crates and a gallery."""
    parts = room(24.0, 14.0, 5.0)
    parts += [column(x, y, 0.3, 5.0) for x in (4, 10, 16) for y in (4.5, 9.5)]
    for x, y in ((6, 2), (8, 11), (13, 6), (19, 3), (20, 10)):
        parts += box(x, y, 1.2, 0.8, 0.0, 0.9)
    return [*parts, floor(0, 12, 24, 14, 2.6), wall(0, 12, 24, 12, 3.6, 2.6)]


def street() -> list[Callable[[Rng], Floats]]:
    """Return a street with facades, recessed windows, garden walls, kerbs, cars, a fence and hedges."""
    parts = [
        floor(0, 0, 40, 8),
        floor(0, -2.2, 40, 0, 0.13),
        wall(0, 0, 40, 0, 0.13),
        wall(0, -2.2, 24, -2.2, 8.0, 3.0),
    ]
    for x in np.arange(0.0, 24.0, 3.0).tolist():
        parts += [wall(x, -2.2, x + 1.5, -2.2, 3.0), wall(x + 1.5, -2.35, x + 3.0, -2.35, 3.0, 0.9)]
        parts += [wall(x + 1.5, -2.2, x + 3.0, -2.2, 0.9)]
    parts += [wall(24, -2.2, 40, -2.2, 1.4), wall(24, -2.45, 40, -2.45, 1.4), wall(0, 9.0, 40, 9.0, 7.0)]
    parts += [wall(5, 8.2, 20, 8.2, 1.0), *box(8, 5.6, 4.2, 1.8, 0.3, 1.4), *box(20, 5.7, 4.4, 1.8, 0.3, 1.5)]
    return [*parts, *(blob(30 + 1.5 * k, -3.4, 0.8, 0.1, 1.6) for k in range(6))]


def stairs() -> list[Callable[[Rng], Floats]]:
    """Return two flights of stairs with a landing."""
    parts = room(8.0, 5.0, 6.0)
    for k in range(10):
        parts += [floor(1 + 0.3 * k, 1, 1.3 + 0.3 * k, 2.4, 0.17 * (k + 1))]
        parts += [wall(1 + 0.3 * k, 1, 1 + 0.3 * k, 2.4, 0.17 * (k + 1), 0.17 * k)]
    return [*parts, floor(4, 1, 5.5, 4, 1.7), wall(1, 2.4, 4, 2.4, 1.0)]


def moved(x: float = 0.0, y: float = 0.0, z: float = 0.0, degrees: float = 0.0) -> Floats:
    """Return a motion (4, 4): a turn about the vertical, then a shift."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.array([[c, -s, 0, x], [s, c, 0, y], [0, 0, 1, z], [0, 0, 0, 1.0]])


THIN = [wall(3, 2.0, 9, 2.0, 2.8), wall(3, 2.12, 9, 2.12, 2.8), wall(3, 2.0, 3, 2.12, 2.8)]
CARPETS = [floor(1, 4, 3.5, 6.5, 0.012), floor(6, 3, 8, 6, 0.02), *box(6.5, 1, 0.9, 0.6, 0.0, 0.4)]
SCENES: dict[str, Scene] = {
    "room": Scene(room()),
    "room, thin wall seen from both sides": Scene(room() + THIN),
    "the same at 0.1 m": Scene(room() + THIN, None, 0.1),
    "room, shifted copy": Scene(room(), moved(0.4, 0.35)),
    "room, copy turned by 4 degrees": Scene(room(16.0, 12.0), moved(0.25, -0.2, degrees=4.0)),
    "room, copy raised by 0.4 m": Scene(room(), moved(z=0.4)),
    "room, floor raised by 0.15 m, at 0.1 m": Scene(room(), moved(z=0.15), 0.1),
    "room with carpets and crates, at 0.1 m": Scene(room() + CARPETS, None, 0.1),
    "hall": Scene(hall()),
    "hall, shifted copy": Scene(hall(), moved(0.5, 0.3)),
    "stairs": Scene(stairs()),
    "street": Scene(street()),
    "street, shifted copy": Scene(street(), moved(0.6, 0.45)),
}


def cloud_of(scene: Scene, seed: int, thinned: int) -> tuple[PointCloud, Floats]:
    """Return the points of a scene, and how far (n,) the copy of each one's surface lies off along its normal."""
    rng = np.random.default_rng(seed)
    points, apart = [], []
    for part in scene.parts:
        copies = [part(rng)] if scene.motion is None else [part(rng)[::2], part(rng)[::2]]
        away = copies[0] - copies[0].mean(axis=0)
        normal = np.linalg.eigh(away.T @ away)[1][:, 0]
        if scene.motion is not None:
            copies[1] = copies[1] @ scene.motion[:3, :3].T + scene.motion[:3, 3]
        for each in copies:
            points.append(each)
            shift = (
                np.zeros(len(each)) if scene.motion is None else (each @ (scene.motion[:3, :3].T - np.eye(3))) @ normal
            )
            apart.append(np.abs(shift + (0.0 if scene.motion is None else scene.motion[:3, 3] @ normal)))
    xyz, metres = np.concatenate(points), np.concatenate(apart)
    kept = rng.random(len(xyz)) * thinned < 1.0
    return PointCloud.from_world(xyz[kept]), metres[kept]


def judge(scene: Scene, seed: int, thinned: int) -> dict[str, Any]:
    """Return the share of the area called that is wrong (nan: none is), and of the area that is right."""
    cloud, metres = cloud_of(scene, seed, thinned)
    result = classify(cloud, tolerance=scene.tolerance)
    patch, n = result.patches.patch, len(result.patches)
    inside = patch >= 0
    apart = np.bincount(patch[inside], metres[inside], n) / np.maximum(result.patches.counts, 1)
    wrong, right = apart > 1.1 * scene.tolerance, apart < scene.tolerance / 3.0
    area, called = result.area, result.is_suspicious
    share = {
        name: float(area[some & called].sum() / area[some].sum()) if some.any() else float("nan")
        for name, some in (("found", wrong), ("called", right))
    }
    good = not share["called"] > NOTHING if scene.motion is None else share["found"] >= MOST
    return {**share, "patches": n, "good": good, "mean_p": float(result.probability.mean()) if n else float("nan")}


def main() -> None:
    """Print a row a scene."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--thinned", type=int, nargs="+", default=[1, 3])
    given = parser.parse_args()
    print(f"{'':42}{'one of':>7}{'patches':>9}{'found':>8}{'called':>8}{'mean p':>8}")
    for name, scene in SCENES.items():
        for thinned in given.thinned:
            rows = [judge(scene, seed, thinned) for seed in range(given.seeds)]
            means = [float(np.mean([row[key] for row in rows])) for key in ("patches", "found", "called", "mean_p")]
            verdict = "right" if all(row["good"] for row in rows) else "WRONG"
            print(f"{name:42}{thinned:>7}{means[0]:>9.0f}" + "".join(f"{each:>8.2f}" for each in means[1:]), verdict)


if __name__ == "__main__":
    main()
