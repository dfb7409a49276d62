"""The way driven: which positions are joined, what is left out, what guards and starts make of it."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

from prf.configuration import Configuration
from prf.kernels.state.guards import GUARD_WAY
from prf.model.coloring import Coloring, violations
from prf.model.layout import make_guards
from prf.model.window import Window
from prf.readings import Readings
from prf.readings.way import (
    LONGEST_JOIN,
    LONGEST_SEEN_JOIN,
    STRAIGHT,
    Sightlines,
    cleared,
    sensor_tracks,
    sightlines_of,
    way_guards,
    way_of,
)
from prf.sampler.prepare import prepare
from prf.sampler.starts import contour_map, find_start_map, map_of_region
from prf.sampler.target import Target, make_chain
from tests.reference.beams import Sensor
from tests.reference.free_way import is_free
from tests.reference.worlds import draw_world

ROOM = Window(0.0, 0.0, 10.0, 10.0)
NOTHING = np.zeros((0, 2))
RADIUS = 0.2


def sight(walls: np.ndarray = NOTHING) -> Sightlines:
    """Walls, and ground that no beam reached."""
    return sightlines_of([], ROOM)._replace(walls=walls)


def way(track: list[list[float]], walls: np.ndarray = NOTHING, radius: float = RADIUS) -> list[list[float]]:
    found: list[list[float]] = way_of([np.array(track)], sight(walls), ROOM, radius).round(9).tolist()
    return found


def test_positions_are_joined_up_to_a_metre_and_a_half() -> None:
    assert way([[1.0, 1.0], [2.0, 1.0], [2.0, 2.0]]) == [[1.0, 1.0, 2.0, 1.0], [2.0, 1.0, 2.0, 2.0]]
    assert way([[1.0, 1.0], [2.0, 2.0]]) == [[1.0, 1.0, 2.0, 2.0]]
    assert way([[1.0, 1.0], [1.0 + LONGEST_JOIN, 1.0]]) == [[1.0, 1.0, 2.5, 1.0]]
    assert way([[1.0, 1.0], [2.6, 1.0]]) == [[1.0, 1.0, 1.0, 1.0], [2.6, 1.0, 2.6, 1.0]]


def test_a_wall_within_the_radius_parts_them() -> None:
    track = [[1.0, 1.0], [2.0, 1.0]]
    alone = [[1.0, 1.0, 1.0, 1.0], [2.0, 1.0, 2.0, 1.0]]
    assert way(track, np.array([[1.5, 1.15]])) == alone
    assert way(track, np.array([[1.5, 1.25], [0.5, 1.0], [9.0, 9.0]])) == [[1.0, 1.0, 2.0, 1.0]]


def beams(origin: list[list[float]], to: list[list[float]]) -> Readings:
    """One beam from each origin that ends at each place."""
    pairs = [(a, b) for a in origin for b in to]
    start, end = (np.array(part) for part in zip(*pairs, strict=True))
    angle = np.arctan2(*(end - start).T[::-1])
    return Readings.from_arrays(start, angle, np.hypot(*(end - start).T))


def test_returns_that_most_beams_pass_by_part_nothing_and_walls_do() -> None:
    person = [[1.5, 1.0]]
    track = [np.array([[1.0, 1.0], [2.0, 1.0]])]
    behind = [[1.4 + 0.02 * i, 0.2] for i in range(10)]
    through = beams([[1.5, 3.0]], behind)
    found = way_of(track, sightlines_of([beams([[1.5, 3.0]], person), through], ROOM), ROOM, RADIUS)
    assert found.tolist() == [[1.0, 1.0, 2.0, 1.0]]
    found = way_of(track, sightlines_of([beams([[1.5, 3.0], [1.4, 3.0], [1.6, 3.0]], person)], ROOM), ROOM, RADIUS)
    assert len(found) == 2


def test_positions_farther_apart_are_joined_where_beams_passed_all_along() -> None:
    fan = [[4.0, 1.0 + 0.01 * i] for i in range(-40, 41)]
    seen = sightlines_of([beams([[0.5, 1.0 + 0.05 * i] for i in range(-5, 6)], fan)], ROOM)
    for length, is_joined in ((LONGEST_SEEN_JOIN - 0.1, True), (LONGEST_SEEN_JOIN + 0.1, False)):
        track = [np.array([[0.7, 1.0], [0.7 + length, 1.0]])]
        assert len(way_of(track, seen, ROOM, RADIUS)) == (1 if is_joined else 2)
    below = sightlines_of([beams([[0.5, 1.05 + 0.05 * i] for i in range(5)], [[4.0, 1.05], [4.0, 1.2]])], ROOM)
    assert len(way_of([np.array([[0.7, 1.0], [3.0, 1.0]])], below, ROOM, RADIUS)) == 2


def test_positions_outside_and_on_the_border_are_left_out() -> None:
    assert way([[-0.5, 1.0], [0.5, 1.0], [1.0, 1.0]]) == [[0.5, 1.0, 1.0, 1.0]]
    assert way([[0.0, 1.0], [0.5, 1.0]]) == [[0.5, 1.0, 0.5, 1.0]]
    assert way([[-1.0, 1.0], [-0.5, 1.0]]) == []


def test_tracks_are_joined_each_for_itself_and_pieces_are_kept_once() -> None:
    one, other = np.array([[1.0, 1.0], [1.0, 1.0], [1.0, 1.0]]), np.array([[1.2, 1.0], [1.4, 1.0]])
    found = way_of([one, other, one], sight(), ROOM, RADIUS)
    assert found.tolist() == [[1.0, 1.0, 1.0, 1.0], [1.2, 1.0, 1.4, 1.0]]
    assert way_of([], sight(), ROOM, RADIUS).shape == (0, 4)


@pytest.mark.parametrize("seed", range(5))
def test_straightening_uncovers_nothing_of_the_way(seed: int) -> None:
    """Discs round the original way lie in the ground that guards hold free, and there are fewer pieces."""
    rng = np.random.default_rng(seed)
    turn = np.cumsum(rng.normal(0.0, 0.05, 400))
    steps = 0.03 * np.column_stack([np.cos(turn), np.sin(turn)])
    steps[rng.random(400) < 0.1] = 0.0
    track = 5.0 + np.cumsum(steps, axis=0)
    track = track[ROOM.contains(track, strictly=True)]
    found = way_of([track], sight(), ROOM, RADIUS)
    assert len(found) < 0.3 * len(track)
    kept = shapely.union_all(shapely.linestrings(found.reshape(-1, 2, 2)))
    original = shapely.LineString(track)
    assert shapely.hausdorff_distance(shapely.LineString(track), kept) <= STRAIGHT + 1e-9
    held = shapely.buffer(kept, RADIUS + STRAIGHT, quad_segs=200)
    assert shapely.covers(held, shapely.buffer(original, RADIUS - 1e-4, quad_segs=200))
    assert shapely.covers(cleared(found, RADIUS), held)
    assert shapely.covers(shapely.buffer(kept, 1.03 * (RADIUS + STRAIGHT)), cleared(found, RADIUS))


def test_guards_hold_the_pieces_in_every_cell_that_they_come_near() -> None:
    pieces = np.array([[1.0, 1.0, 3.3, 2.1], [7.0, 7.0, 7.0, 7.0]])
    shapes = way_guards(pieces, RADIUS)
    assert shapes[:, 0].tolist() == [GUARD_WAY, GUARD_WAY]
    assert shapes[:, 5].tolist() == [RADIUS + STRAIGHT] * 2
    chain = make_chain(Target(ROOM, 0.2, way=pieces, driven_radius=RADIUS), Coloring.empty(ROOM))
    grid, lists = chain.edge_index.grid, chain.guards.lists
    low = np.array([grid.x0, grid.y0]) + grid.cell * np.indices((grid.nx, grid.ny)).reshape(2, -1).T
    cells = shapely.box(*low.T, *(low + grid.cell).T)
    for cell, (x, y) in enumerate(np.indices((grid.nx, grid.ny)).reshape(2, -1).T.tolist()):
        at = 1 + x + grid.nx * y
        listed = set(lists[lists[at] : lists[at + 1]].tolist())
        near = shapely.dwithin(cells[cell], shapely.linestrings(pieces.reshape(-1, 2, 2)), RADIUS + STRAIGHT)
        assert set(np.flatnonzero(near).tolist()) <= listed
    assert len(lists) < 0.2 * 2 * len(cells) + len(cells) + 2
    assert len(make_guards(grid, np.zeros(0, np.int64), way_guards(pieces[:0], RADIUS)).lists) == 1


def readings(origin: list[list[float]], scan: list[int], angle: float = 0.0) -> Readings:
    n = len(scan)
    return Readings.from_arrays(np.array(origin), np.full(n, angle), np.full(n, 2.0), scan=scan, beam=0, source="a.log")


def test_a_ring_counts_as_its_middle_scan_by_scan() -> None:
    ring = readings([[1.0, 1.0], [1.2, 1.0], [2.0, 1.0], [2.2, 1.0]], [3, 3, 7, 7])
    (track,) = sensor_tracks(ring)
    np.testing.assert_allclose(track, [[1.1, 1.0], [2.1, 1.0]])


def test_the_configuration_decides_about_the_way() -> None:
    log = readings([[1.0, 1.0], [1.5, 1.0], [2.0, 1.0]], [0, 1, 2], np.pi / 2)
    config = Configuration.of(window=(*ROOM,), max_range=5.0, resolution=0.5)
    assert prepare(config, log).target.way.tolist() == [[1.0, 1.0, 2.0, 1.0]]
    assert prepare(config, log).target.driven_radius == 0.1
    whole = readings([[1.0, 1.0], [1.5, 1.0], [2.0, 1.0], [2.0, 2.0]], [0, 1, 2, 3])
    assert prepare(config, log, driven=[whole]).target.way.tolist() == [[1.0, 1.0, 2.0, 1.0], [2.0, 1.0, 2.0, 2.0]]
    none = config.replace(driven_radius=0.0)
    assert len(prepare(none, log).target.way) == 0


def driven_settings(seed: int) -> Target:
    """A laser in a world of the prior, driven for a metre from each of its places, whatever stood there."""
    found = draw_world(0.3, ROOM, Sensor(6.0), 6, 30, np.random.default_rng(seed))
    place = np.unique(found.data.readings.origin, axis=0)
    to = np.clip(place + np.random.default_rng(seed).normal(0.0, 0.7, place.shape), 0.01, 9.99)
    return Target(ROOM, 0.3, found.data, way=np.hstack([place, to]), driven_radius=0.3)


@pytest.mark.parametrize("seed", range(8))
def test_every_start_leaves_the_way_free(seed: int) -> None:
    target, rng = driven_settings(seed), np.random.default_rng(seed)
    for coloring in (
        contour_map(target, rng),
        find_start_map("prior", target, rng, lambda: True),
        map_of_region(shapely.box(*ROOM), target),
        find_start_map("empty", target, rng, lambda: False),
    ):
        assert not violations(coloring)
        assert is_free(target, coloring)
    assert find_start_map("prior", target, rng, lambda: True).n_edges > 0
