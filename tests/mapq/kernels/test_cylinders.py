"""The chart of curved patches and regions that grow on cylinders, beside plain versions."""

from __future__ import annotations

import numba
import numpy as np
import pytest

from mapq.features.shape import charted
from mapq.kernels.cylinders import Cylinder, grow_cylinder
from mapq.kernels.planes import Planes, Surface, Tolerance, chart, facing


@numba.njit
def charts(planes: Planes, patch: np.ndarray, points: np.ndarray, out: np.ndarray) -> None:
    """Write place and height (k, 3) of points over patches, and the normals there (k, 3)."""
    for k in range(len(points)):
        out[k, 0], out[k, 1], out[k, 2] = chart(planes, patch[k], points[k])
        out[k, 3], out[k, 4], out[k, 5] = facing(planes, patch[k], points[k])


def slow_chart(planes: Planes, i: int, point: np.ndarray) -> np.ndarray:
    """Turn the point about the axis until it lies over the centre."""
    normal, centre, across, along = planes.normal[i], planes.centre[i], planes.across[i], planes.along[i]
    if planes.bend[i] == 0.0:
        away = point - centre
        return np.array([away @ across, away @ along, away @ normal, *normal])
    radius = 1.0 / planes.bend[i]
    axis = centre - radius * normal
    turned = complex((point - axis) @ normal, (point - axis) @ across)
    angle = np.angle(turned)
    local = np.cos(angle) * normal + np.sin(angle) * across
    return np.array([radius * angle, (point - centre) @ along, abs(turned) - radius, *local])


@pytest.mark.parametrize("seed", range(3))
def test_charts_are_those_by_their_definition(seed: int) -> None:
    rng, m, n = np.random.default_rng(seed), 6, 300
    frames = np.linalg.qr(rng.normal(size=(m, 3, 3)))[0]
    frames *= np.linalg.det(frames)[:, None, None]
    across, along, normal = (np.ascontiguousarray(frames[:, k]) for k in range(3))
    bend = np.where(np.arange(m) % 2, rng.uniform(0.05, 10.0, m), 0.0)
    planes = Planes(normal, rng.normal(size=(m, 3)), across, along, np.ones(m), bend)
    patch, points, found = rng.integers(0, m, n), rng.normal(size=(n, 3)), np.zeros((n, 6))
    charts(planes, patch, points, found)
    expected = np.array([slow_chart(planes, i, point) for i, point in zip(patch, points, strict=True)])
    np.testing.assert_allclose(found, expected, atol=1e-12)
    columns = np.column_stack(charted(points - planes.centre[patch], patch, (across, along, normal), bend))
    np.testing.assert_allclose(columns, expected[:, :3], atol=1e-12)
    # The surface itself has height 0, and its length round the axis is that of the arc.
    on = planes.centre[1] + (np.cos(0.5) - 1.0) / bend[1] * normal[1] + np.sin(0.5) / bend[1] * across[1]
    u, v, height = charted(on[None] - planes.centre[1], np.array([1]), (across, along, normal), bend)
    assert [*u, *v, *height] == pytest.approx([0.5 / bend[1], 0.0, 0.0], abs=1e-12)


@pytest.mark.parametrize("seed", range(3))
def test_growing_lists_what_neighbours_connect_on_the_cylinder(seed: int) -> None:
    rng, n = np.random.default_rng(seed), 400
    cylinder = Cylinder(np.array([0.0, 0.0, 1.0]), np.array([1.0, 2.0, 3.0]), 0.8)
    angle, away = rng.uniform(0.0, 2.0 * np.pi, n), cylinder.radius + rng.choice([0.0, 0.02, 0.2], n)
    ray = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(n)])
    xyz = cylinder.centre + away[:, None] * ray + rng.uniform(0.0, 1.0, n)[:, None] * cylinder.axis
    normal = np.where(rng.random((n, 1)) < 0.1, np.nan, ray + rng.normal(0.0, 0.3, (n, 3))).astype(np.float32)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    neighbours = rng.integers(-1, n, (n, 6)).astype(np.int32)
    neighbours = -np.sort(-neighbours, axis=1)
    free, seeds = rng.random(n) < 0.9, np.arange(20, dtype=np.int32)
    seen, queue = np.zeros(n, np.bool_), np.zeros(n, np.int32)
    surface, tolerance = Surface(xyz, neighbours, normal), Tolerance(float(np.cos(0.5)), 0.1)
    found = queue[: grow_cylinder(surface, seeds, free, cylinder, tolerance, seen, queue)]
    turned = np.abs(np.einsum("ij,ij->i", normal, ray))
    fits = free & (away < 0.9) & ~(turned < tolerance.cos_angle)
    expected, rest = set(), [k for k in seeds.tolist() if fits[k]]
    while rest:
        one = rest.pop()
        if one not in expected:
            expected.add(one)
            rest += [j for j in neighbours[one].tolist() if j >= 0 and fits[j] and not np.isnan(normal[one, 0])]
    assert set(found.tolist()) == expected
    assert len(found) == len(expected) > 5
    assert not seen.any()
