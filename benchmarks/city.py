"""The test city: nine buildings with recessed windows, ground, cars and trees, with the plane of each point.

    python -m benchmarks.city [N_POINTS]       writes city.npz (xyz, plane) of about so many points

The scene that `docs/segmentation.md` reports on: 36 facades with windows 0.25 m behind them, the ground, 60 cars and
100 trees on 180 x 176 m; points at random on the surfaces, 2 cm of noise along all axes.
"""

from __future__ import annotations

import math
import sys
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

SIGMA = 0.02
RECESS = 0.25
NOT_A_PLANE = -1
GROUND = 36
BLOCK = np.array([60.0, 58.0])
"""Metres from building to building, along x and y."""


class City(NamedTuple):
    """Points (n, 3) and their planes (n,): facades 0-35, ground 36, -1 for windows, cars and trees."""

    xyz: NDArray[np.float64]
    plane: NDArray[np.int32]


def make_city(n_points: int = 1_000_000, seed: int = 0) -> City:
    """Return the city with about `n_points` points, in random order."""
    rng = np.random.default_rng(seed)
    density = 1.0 / _spacing(n_points) ** 2
    parts = [_ground(rng, density)]
    for number in range(9):
        parts += _building(rng, density, number)
    parts += [_car(rng, density) for _ in range(60)]
    parts += [_tree(rng, density) for _ in range(100)]
    xyz = np.concatenate([part.xyz for part in parts])
    plane = np.concatenate([part.plane for part in parts])
    order = rng.permutation(len(xyz))
    return City((xyz + rng.normal(0.0, SIGMA, xyz.shape))[order], plane[order])


def _spacing(n_points: int) -> float:
    """Return the spacing at which the surfaces hold `n_points`; a million points lie 18 cm apart."""
    return 0.1795 * math.sqrt(1e6 / n_points)


def _rectangle(
    rng: np.random.Generator,
    density: float,
    corner: NDArray[np.float64],
    u: NDArray[np.float64],
    v: NDArray[np.float64],
) -> NDArray[np.float64]:
    n = rng.poisson(density * np.linalg.norm(np.cross(u, v)))
    return corner + rng.uniform(0, 1, (n, 1)) * u + rng.uniform(0, 1, (n, 1)) * v


def _origins() -> NDArray[np.float64]:
    return np.array([BLOCK * (i, j) + (10.0, 10.0) for i in range(3) for j in range(3)])


SIZES = np.array([[40.0, 38.0], [38.0, 40.0], [42.0, 36.0]])


def _ground(rng: np.random.Generator, density: float) -> City:
    xyz = _rectangle(rng, density, np.zeros(3), np.array([180.0, 0, 0]), np.array([0, 176.0, 0]))
    inside = np.zeros(len(xyz), bool)
    for number, origin in enumerate(_origins()):
        size = SIZES[number % 3]
        inside |= ((xyz[:, :2] > origin) & (xyz[:, :2] < origin + size)).all(axis=1)
    kept = xyz[~inside]
    return City(kept, np.full(len(kept), GROUND, np.int32))


def _building(rng: np.random.Generator, density: float, number: int) -> list[City]:
    (x, y), (width, depth) = _origins()[number], SIZES[number % 3]
    height = 6.2 + 0.2 * (number % 4)
    corners = np.array([[x, y], [x + width, y], [x + width, y + depth], [x, y + depth]])
    return [
        _facade(rng, density, corners[side], corners[(side + 1) % 4], height, 4 * number + side) for side in range(4)
    ]


def _facade(
    rng: np.random.Generator,
    density: float,
    start: NDArray[np.float64],
    end: NDArray[np.float64],
    height: float,
    number: int,
) -> City:
    """Return a wall with windows of 1.2 x 1.4 m every 3 m, recessed inwards (counter-clockwise corners)."""
    length = float(np.linalg.norm(end - start))
    along = np.append((end - start) / length, 0.0)
    inward = np.array([-along[1], along[0], 0.0])
    up = np.array([0.0, 0.0, 1.0])
    xyz = _rectangle(rng, density, np.append(start, 0.0), along * length, up * height)
    s, z = (xyz - np.append(start, 0.0)) @ along, xyz[:, 2]
    window = (np.abs((s % 3.0) - 1.5) < 0.6) & (np.abs((z % 3.0) - 1.6) < 0.7) & (z < height - 0.4)
    window &= (s > 0.6) & (s < length - 0.6)
    xyz[window] += RECESS * inward
    return City(xyz, np.where(window, NOT_A_PLANE, number).astype(np.int32))


def _car(rng: np.random.Generator, density: float) -> City:
    """Return a car as a half ellipsoid of 4.4 x 1.8 x 1.5 m on a street."""
    street = rng.integers(0, 3)
    along, across = rng.uniform(5, 170), 60.0 * street + rng.uniform(3, 7)
    turned = rng.uniform() < 0.5
    direction = rng.normal(size=(rng.poisson(density * 18.0), 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    direction[:, 2] = np.abs(direction[:, 2])
    half = np.array([0.9, 2.2, 1.5]) if turned else np.array([2.2, 0.9, 1.5])
    centre = np.array([across, along, 0.0]) if turned else np.array([along, across, 0.0])
    xyz = centre + direction * half
    return City(xyz, np.full(len(xyz), NOT_A_PLANE, np.int32))


def _tree(rng: np.random.Generator, density: float) -> City:
    """Return a crown, points all through a ball, on a trunk."""
    foot = np.append(rng.uniform((2, 2), (178, 174)), 0.0)
    radius = rng.uniform(1.2, 2.2)
    direction = rng.normal(size=(rng.poisson(density * 4.0 * np.pi * radius**2), 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    crown = direction * radius * rng.uniform(0, 1, (len(direction), 1)) ** (1 / 3) + (0, 0, 2.5 + radius)
    angle = rng.uniform(0, 2 * np.pi, rng.poisson(density * 2.5 * 2 * np.pi * 0.2))
    trunk = np.column_stack([0.2 * np.cos(angle), 0.2 * np.sin(angle), rng.uniform(0, 2.5, len(angle))])
    xyz = np.concatenate([crown, trunk]) + foot
    return City(xyz, np.full(len(xyz), NOT_A_PLANE, np.int32))


if __name__ == "__main__":
    city = make_city(int(sys.argv[1]) if len(sys.argv) > 1 else 1_000_000)
    np.savez("city.npz", xyz=city.xyz, plane=city.plane)
    print(len(city.xyz))
