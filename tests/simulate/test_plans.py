"""Office floors: of the given size, whole, every room within reach of a robot."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

from prf.model.coloring import violations
from prf.shell.errors import ConfigError
from prf.simulate import World, office, roadmap
from prf.simulate.plans import MARGIN, draft_office
from prf.simulate.roadmap import CELL

SIZES = [
    (60.0, 40.0),
    (22.0, 14.0),
    (35.0, 25.0),
    (12.0, 5.0),
    (8.0, 7.0),
    (4.0, 4.0),
    (100.0, 12.0),
    (6.0, 30.0),
    (3.0, 20.0),
]
RADIUS = 0.25


def world_of(size: tuple[float, float], seed: int, furniture: bool = True) -> World:
    return office(*size, np.random.default_rng(seed), furniture)


@pytest.mark.parametrize("size", SIZES)
def test_every_room_can_be_reached(size: tuple[float, float]) -> None:
    for seed in range(2 if size[0] > 30.0 else 10):
        draft = draft_office(*size, np.random.default_rng(seed))
        reached = roadmap(world_of(size, seed), RADIUS).xy
        assert draft.rooms
        for room in draft.rooms:
            within = ((reached > room[:2]) & (reached < room[2:])).all(axis=1)
            share = within.sum() * CELL**2 / (room.width * room.height)
            assert share > 0.15, f"seed {seed}, room {room}"


@pytest.mark.parametrize("size", SIZES)
def test_a_plan_is_a_valid_map_of_its_size(size: tuple[float, float]) -> None:
    for seed in range(3):
        world = world_of(size, seed)
        assert violations(world.coloring()) == []
        assert world.window == (-MARGIN, -MARGIN, size[0] + MARGIN, size[1] + MARGIN)
        assert world.occupied.bounds == (0.0, 0.0, *size)
        outside = shapely.difference(shapely.box(*world.window), shapely.box(0.0, 0.0, *size))
        free = shapely.difference(shapely.box(*world.window), world.occupied)
        assert any(part.equals(outside) for part in shapely.get_parts(free)), "the building is closed"


def test_walls_are_as_thick_as_walls() -> None:
    """Of the outlines that look at each other across occupied space none is nearer than a door's leaf."""
    world = world_of((60.0, 40.0), 4, furniture=False)
    eroded = world.occupied.buffer(-0.024, join_style="mitre")
    assert shapely.difference(world.occupied, eroded.buffer(0.0241, join_style="mitre")).area < 0.02
    # but for leaves of doors walls are 0.1 m thick or more
    thick = world.occupied.buffer(-0.049, join_style="mitre").buffer(0.0491, join_style="mitre")
    assert 0.0 < shapely.difference(world.occupied, thick).area < 0.06 * world.occupied.area


def test_plans_follow_the_seed_alone() -> None:
    one, again, other = (world_of((30.0, 20.0), seed) for seed in (1, 1, 2))
    assert np.array_equal(one.walls, again.walls)
    assert len(other.walls) != len(one.walls)


def test_the_default_is_a_wing_with_doors_in_varied_states() -> None:
    bare, furnished = (world_of((60.0, 40.0), 1, furniture) for furniture in (False, True))
    assert 500 < len(bare.walls) < len(furnished.walls) < 3000
    lengths = np.hypot(*(furnished.walls[:, 2:] - furnished.walls[:, :2]).T)
    slanted = (np.abs(furnished.walls[:, 2:] - furnished.walls[:, :2]) > 1e-3).all(axis=1) & (lengths > 0.8)
    assert slanted.sum() >= 20  # both sides of ten leaves that stand ajar


def test_a_building_too_small_is_refused() -> None:
    for size in ((2.0, 9.0), (9.0, -1.0)):
        with pytest.raises(ConfigError):
            office(*size, np.random.default_rng(1))
