"""Worlds: walls with free space on their left, corners only where something turns, back to the same coloring."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from shapely import MultiPolygon, Polygon, box

from prf.model.arak import exact_draws
from prf.model.coloring import Coloring
from prf.model.window import Window
from prf.shell.errors import InputError
from prf.simulate import World
from prf.simulate.world import without_straight
from tests.reference.slow_coloring import edge_set

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


def test_rings_are_closed_and_the_window_is_no_wall() -> None:
    world = World.from_polygons(RING, ROOM)
    assert len(world.walls) == 8
    assert {tuple(end) for end in world.walls[:, :2]} == {tuple(end) for end in world.walls[:, 2:]}
    cut = World.from_polygons(box(-1.0, 3.0, 4.0, 9.0), ROOM)
    assert {tuple(sorted((wall[:2], wall[2:]))) for wall in map(tuple, cut.walls.tolist())} == {
        ((0.0, 3.0), (4.0, 3.0)),
        ((4.0, 3.0), (4.0, 8.0)),
    }
    assert (cut.walls[0, 2:] == cut.walls[1, :2]).all() or (cut.walls[1, 2:] == cut.walls[0, :2]).all()


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


def test_polygons_that_touch_at_a_point_are_refused() -> None:
    with pytest.raises(InputError, match="invalid coloring"):
        World.from_polygons(MultiPolygon([box(1.0, 1.0, 2.0, 2.0), box(2.0, 2.0, 3.0, 3.0)]), ROOM)
