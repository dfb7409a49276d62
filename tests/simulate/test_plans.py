"""Office floors: as asked for, whole, every room within reach of a robot."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import shapely

from prf.coloring import violations
from prf.shell.errors import ConfigError
from prf.simulate import OfficePlan, World, office, roadmap
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


def world_of(plan: OfficePlan, seed: int) -> World:
    return office(plan, np.random.default_rng(seed))


@pytest.mark.parametrize("size", SIZES)
def test_every_room_can_be_reached(size: tuple[float, float]) -> None:
    plan = OfficePlan(*size)
    for seed in range(2 if size[0] > 30.0 else 10):
        draft = draft_office(plan, np.random.default_rng(seed))
        reached = roadmap(world_of(plan, seed), RADIUS).xy
        assert draft.rooms
        for room in draft.rooms:
            within = ((reached > room[:2]) & (reached < room[2:])).all(axis=1)
            share = within.sum() * CELL**2 / (room.width * room.height)
            assert share > 0.15, f"seed {seed}, room {room}"


@pytest.mark.parametrize("size", SIZES)
def test_a_plan_is_a_valid_map_of_its_size(size: tuple[float, float]) -> None:
    for seed in range(3):
        world = world_of(OfficePlan(*size), seed)
        assert violations(world.coloring()) == []
        assert world.window == (-MARGIN, -MARGIN, size[0] + MARGIN, size[1] + MARGIN)
        assert world.occupied.bounds == (0.0, 0.0, *size)
        outside = shapely.difference(shapely.box(*world.window), shapely.box(0.0, 0.0, *size))
        free = shapely.difference(shapely.box(*world.window), world.occupied)
        assert any(part.equals(outside) for part in shapely.get_parts(free)), "the building is closed"


def test_walls_are_as_thick_as_walls() -> None:
    """Of the outlines that look at each other across occupied space none is nearer than a door's leaf."""
    world = world_of(OfficePlan(furniture=False), 4)
    eroded = world.occupied.buffer(-0.024, join_style="mitre")
    assert shapely.difference(world.occupied, eroded.buffer(0.0241, join_style="mitre")).area < 0.02
    # but for leaves of doors walls are 0.1 m thick or more
    thick = world.occupied.buffer(-0.049, join_style="mitre").buffer(0.0491, join_style="mitre")
    assert 0.0 < shapely.difference(world.occupied, thick).area < 0.06 * world.occupied.area


def test_plans_follow_the_seed_alone() -> None:
    plan = OfficePlan(30.0, 20.0)
    one, again, other = (world_of(plan, seed) for seed in (1, 1, 2))
    assert np.array_equal(one.walls, again.walls)
    assert len(other.walls) != len(one.walls)


def test_the_default_is_a_wing_with_doors_in_varied_states() -> None:
    bare, furnished = (world_of(OfficePlan(furniture=furniture), 1) for furniture in (False, True))
    assert 500 < len(bare.walls) < len(furnished.walls) < 3000
    lengths = np.hypot(*(furnished.walls[:, 2:] - furnished.walls[:, :2]).T)
    slanted = (np.abs(furnished.walls[:, 2:] - furnished.walls[:, :2]) > 1e-3).all(axis=1) & (lengths > 0.8)
    assert slanted.sum() >= 20  # both sides of ten leaves that stand ajar


def test_room_and_door_sizes_are_used() -> None:
    small, large = (
        draft_office(OfficePlan(40.0, 30.0, room=room), np.random.default_rng(5)).rooms for room in (3.0, 6.0)
    )
    widths = [np.median([room.width for room in rooms]) for rooms in (small, large)]
    assert widths == pytest.approx([3.0, 6.0], rel=0.25)
    wide = world_of(dataclasses.replace(OfficePlan(20.0, 14.0), door=1.5), 6)
    assert roadmap(wide, 0.6).area > 0.2 * wide.window.area


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"width": 2.0}, "size"),
        ({"height": -1.0}, "height"),
        ({"room": float("nan")}, "room"),
        ({"door": 0.5}, "door"),
        ({"room": 1.5}, "room"),
        ({"corridor": 0.8}, "corridor"),
    ],
)
def test_sizes_of_which_nothing_can_be_made_are_refused(changes: dict[str, float], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        OfficePlan(**changes)
