"""Office floors: of the given size, whole, every room within reach of a robot."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from shapely import MultiPolygon, Polygon, box

from prf.model.arak import exact_draws
from prf.model.coloring import Coloring, violations
from prf.model.window import Window
from prf.simulate import World, office, roadmap
from prf.simulate.floorplan import MARGIN, draft_office
from prf.simulate.roadmap import CELL
from prf.simulate.world import without_straight
from tests.reference.slow_coloring import edge_set

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


def test_the_default_is_a_wing_with_doors_in_varied_states() -> None:
    bare, furnished = (world_of((60.0, 40.0), 1, furniture) for furniture in (False, True))
    assert 500 < len(bare.walls) < len(furnished.walls) < 3000
    lengths = np.hypot(*(furnished.walls[:, 2:] - furnished.walls[:, :2]).T)
    slanted = (np.abs(furnished.walls[:, 2:] - furnished.walls[:, :2]) > 1e-3).all(axis=1) & (lengths > 0.8)
    assert slanted.sum() >= 20  # both sides of ten leaves that stand ajar


# Worlds: walls with free space on their left, corners only where something turns, back to the same coloring.


ROOM = Window(0.0, 0.0, 10.0, 8.0)
RING = Polygon(box(1.0, 1.0, 9.0, 7.0).exterior, [box(2.0, 2.0, 8.0, 6.0).exterior])


def beside(world: World, left: float) -> np.ndarray:
    """Points beside the middle of every wall, to its left by so many metres."""
    ends = world.walls.reshape(-1, 2, 2)
    along = np.diff(ends, axis=1)[:, 0]
    along /= np.hypot(*along.T)[:, None]
    return ends.mean(axis=1) + left * np.column_stack([-along[:, 1], along[:, 0]])


@pytest.mark.parametrize("region", [RING, MultiPolygon([RING, box(4.0, 3.0, 5.0, 4.0)]), box(-1.0, 3.0, 4.0, 9.0)])
def test_free_space_lies_on_the_left_of_walls(region: Polygon) -> None:
    world = World.from_polygons(region, ROOM)
    assert world.free_at(beside(world, 1e-6)).all()
    assert not world.free_at(beside(world, -1e-6)).any()


def test_walls_of_draws_from_the_prior() -> None:
    for coloring in exact_draws(0.4, ROOM, 20, np.random.default_rng(1)):
        world = World.from_coloring(coloring)
        assert world.free_at(beside(world, 1e-9)).all()
        assert not world.free_at(beside(world, -1e-9)).any()
        assert len(world.walls) == coloring.n_edges
        assert edge_set(world.coloring()) == edge_set(coloring)


@pytest.mark.parametrize("black", [False, True])
def test_one_colour_has_no_walls(black: bool) -> None:
    world = World.from_coloring(Coloring.empty(ROOM, black))
    assert world.walls.shape == (0, 4)
    assert world.free_at([(5.0, 4.0)]).tolist() == [not black]
    assert (world.coloring().n_edges, world.coloring().anchor_black) == (0, black)


def test_points_on_walls_and_outside_are_not_free() -> None:
    world = World.from_polygons(RING, ROOM)
    points = [(0.5, 0.5), (1.0, 4.0), (1.5, 4.0), (2.0, 4.0), (5.0, 4.0), (11.0, 4.0), (0.0, 0.0), (np.nan, 1.0)]
    assert world.free_at(points).tolist() == [True, False, False, False, True, False, True, False]


def test_vertices_in_the_middle_of_walls_are_removed() -> None:
    rng = np.random.default_rng(2)
    for turn in rng.uniform(0.0, 360.0, 20):
        region = shapely.affinity.rotate(RING, turn)
        dense = shapely.segmentize(region, 0.37)
        assert len(shapely.get_coordinates(dense)) > 60
        bare = without_straight(dense)
        assert len(shapely.get_coordinates(bare)) == 10
        assert bare.symmetric_difference(region).area < 1e-8


def test_a_ring_that_is_closed_twice_keeps_its_corner() -> None:
    ring = [(1.0, 1.0), (5.0, 1.0), (5.0, 4.0), (1.0, 4.0), (1.0, 1.0), (1.0, 1.0)]
    world = World.from_polygons(Polygon(ring), ROOM)
    assert (len(world.walls), world.occupied.area) == (4, 12.0)


def test_what_has_no_area_is_removed() -> None:
    needle = Polygon([(0.0, 0.0), (3.0, 0.0), (1.0, 0.0)])
    assert without_straight(MultiPolygon([needle, box(4.0, 4.0, 5.0, 5.0)])).area == 1.0
