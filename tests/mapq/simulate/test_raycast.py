"""Ray casting against a caster without a grid, on random scenes."""

from __future__ import annotations

import numpy as np
import pytest

from mapq.kernels.raycast import NOTHING, cast_beams
from mapq.simulate.scene import Kind, SceneBuilder, World
from tests.reference import mapq_raycast as reference


def random_world(rng: np.random.Generator) -> World:
    builder = SceneBuilder()
    for _ in range(25):
        a = rng.uniform(-12, 12, 2)
        holes = ((0.5, 1.5, 0.8, 4.5), (0.5, 2.0, 1.1, 4.2)) if rng.random() < 0.5 else None
        args = (a, a + rng.normal(0, 4, 2), (rng.uniform(0, 1), rng.uniform(2, 6)), Kind.FACADE)
        builder.wall(*args) if holes is None else builder.wall(*args, holes=holes)
    for _ in range(12):
        corner = np.array([*rng.uniform(-12, 12, 2), rng.uniform(0, 4)])
        builder.sheet(corner, rng.normal(0, 2, 3), rng.normal(0, 2, 3), Kind.PARKED_CAR)
    for _ in range(8):
        builder.post(rng.uniform(-12, 12, 2), rng.uniform(0.05, 1), (rng.uniform(0, 1), rng.uniform(1, 5)))
        builder.blob(np.array([*rng.uniform(-12, 12, 2), 2.0]), tuple(rng.uniform(0.5, 2, 2)), rng.uniform(0.3, 4))
    for half in (0.3, (2.0, 0.8), 0.5, (1.0, 2.0)):
        times = (rng.uniform(0, 4), rng.uniform(6, 10))
        builder.mover(rng.uniform(-6, 6, 2), rng.normal(0, 1, 2), times, half, (0.2, 1.6), Kind.PERSON)
    return builder.finish(15.0)


def random_beams(rng: np.random.Generator, n: int) -> tuple[np.ndarray, ...]:
    origins = np.column_stack([rng.uniform(-14, 14, (n, 2)), rng.uniform(0.2, 3, n)])
    directions = rng.normal(0, 1, (n, 3))
    directions[: n // 10, 0] = 0.0  # Along the axes of the grid.
    directions[n // 10 : n // 5, 1] = 0.0
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return origins, directions, rng.uniform(0, 10, n), rng.random(n)


def cast(world: World, beams: tuple[np.ndarray, ...], max_range: float) -> tuple[np.ndarray, np.ndarray]:
    ranges, items = np.empty(len(beams[0])), np.empty(len(beams[0]), np.int32)
    cast_beams(world.scene, *beams, max_range, ranges, items)
    return ranges, items


@pytest.mark.parametrize("seed", range(3))
def test_the_same_hits_as_without_a_grid(seed: int) -> None:
    rng = np.random.default_rng(seed)
    world, beams = random_world(rng), random_beams(rng, 1000)
    ranges, items = cast(world, beams, 14.0)
    expected_ranges, expected_items = reference.cast(world.scene, *beams, 14.0)
    np.testing.assert_array_equal(items, expected_items)
    np.testing.assert_allclose(ranges, expected_ranges, rtol=1e-9)
    kinds = set(world.kind[items[items != NOTHING]])
    assert {Kind.FACADE, Kind.PARKED_CAR, Kind.POST, Kind.FOLIAGE, Kind.PERSON, Kind.GROUND} <= kinds
    assert 0.02 < (items == NOTHING).mean() < 0.9


def test_an_empty_grid_and_a_beam_straight_up() -> None:
    builder = SceneBuilder()
    builder.post(np.array([5.0, 0.0]), 0.5, (0.0, 2.0))
    world = builder.finish(10.0)
    up, ahead = (0.0, 0.0, 1.0), (1.0, 0.0, 0.0)
    beams = (np.array([(0.0, 0.0, 1.0)] * 2), np.array([up, ahead]), np.zeros(2), np.zeros(2))
    ranges, items = cast(world, beams, 20.0)
    np.testing.assert_allclose(ranges, [np.inf, 4.5])
    np.testing.assert_array_equal(items, [NOTHING, 0])


def test_foliage_lets_the_right_share_through() -> None:
    """Two spheres of one metre of path through the middle, each with its own draw: exp(-1/2) twice."""
    builder = SceneBuilder()
    for x in (3.0, 6.0):
        builder.blob(np.array([x, 0.0, 1.0]), (0.5, 0.5), 0.5)
    world = builder.finish(10.0)
    n = 20_000
    origins, directions = np.tile((0.0, 0.0, 1.0), (n, 1)), np.tile((1.0, 0.0, 0.0), (n, 1))
    draws = np.random.default_rng(4).random(n)
    ranges, items = cast(world, (origins, directions, np.zeros(n), draws), 20.0)
    # The two draws of a beam come from one, so their joint law is only near independence.
    assert (items == NOTHING).mean() == pytest.approx(np.exp(-1.0), abs=0.15)
    first = ranges[items == 0]
    assert len(first) / n == pytest.approx(1.0 - np.exp(-0.5), abs=0.015)
    assert first.min() >= 2.5
    assert first.max() <= 3.5
