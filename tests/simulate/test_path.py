"""The robot's drive: it keeps clear of walls, reaches every place, and measures at the given spacing."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pytest
import shapely
from scipy.sparse import csgraph
from shapely import box

from prf.model.window import Window
from prf.shell.errors import InputError
from prf.simulate import World, office, plan_drive, roadmap, scans_along
from prf.simulate.path import SPEED, TURNING, PathFile, read_path
from prf.simulate.roadmap import short_tour, viewpoints

RADIUS = 0.25
REACH = 2.5


@pytest.fixture(scope="module")
def floor() -> World:
    return office(30.0, 20.0, np.random.default_rng(1))


def test_the_robot_keeps_clear_of_walls_and_of_the_border(floor: World) -> None:
    corners = plan_drive(roadmap(floor, RADIUS), REACH)
    way = shapely.LineString(corners)
    assert way.distance(floor.occupied) >= RADIUS
    assert box(*floor.window).buffer(-RADIUS).contains(way)
    assert floor.free_at(scans_along(corners, (0.1, 0.1)).pose[:, :2]).all()


def test_the_robot_reaches_every_place(floor: World) -> None:
    road = roadmap(floor, RADIUS)
    corners = plan_drive(road, REACH)
    way = shapely.LineString(corners)
    assert shapely.distance(way, shapely.points(road.xy)).max() <= REACH
    from_stops = csgraph.dijkstra(road.steps, indices=viewpoints(road, REACH), min_only=True)
    assert from_stops.max() <= REACH
    assert shapely.distance(way, shapely.points(road.xy[viewpoints(road, REACH)])).max() < 1e-9
    assert way.length < 2.5 * road.area / REACH, "one drive, not one to each place and back"


def test_only_what_is_connected_is_visited() -> None:
    rooms = shapely.union_all([box(1.0, 1.0, 4.0, 5.0), box(5.0, 1.0, 9.0, 7.0)])
    world = World.from_polygons(box(0.5, 0.5, 9.5, 7.5) - rooms, Window(0.0, 0.0, 10.0, 8.0))
    assert roadmap(world, RADIUS).xy[:, 0].min() > 5.0
    with pytest.raises(InputError, match="no space for a robot of radius 3 m"):
        roadmap(world, 3.0)


def test_a_narrow_door_is_passed_and_a_narrower_one_is_not() -> None:
    for width, passes in ((0.8, True), (0.5, False)):
        walls = box(0.5, 0.5, 9.5, 7.5) - box(1.0, 1.0, 4.9, 7.0) - box(5.1, 1.0, 9.0, 7.0)
        gap = box(4.8, 3.03, 5.2, 3.03 + width)
        world = World.from_polygons(walls - gap, Window(0.0, 0.0, 10.0, 8.0))
        reached = roadmap(world, RADIUS).xy[:, 0]
        assert (reached.min() < 4.0 and reached.max() > 6.0) == passes


def test_tours_are_hardly_longer_than_the_shortest() -> None:
    rng = np.random.default_rng(2)
    excess = []
    for _ in range(20):
        xy = rng.random((7, 2))
        lengths = np.hypot(*(xy[:, None] - xy).T)
        tour = short_tour(lengths, 3)
        assert tour[0] == 3
        assert sorted(tour.tolist()) == list(range(7))
        others = [place for place in range(7) if place != 3]
        best = min(
            sum(lengths[a, b] for a, b in itertools.pairwise((3, *order))) for order in itertools.permutations(others)
        )
        excess.append(sum(lengths[a, b] for a, b in itertools.pairwise(tour)) / best - 1.0)
    assert min(excess) > -1e-9
    assert np.mean(excess) < 0.05


L_SHAPE = np.array([(0.0, 0.0), (4.0, 0.0), (4.0, 3.0)])


def test_scans_are_spaced_in_metres_and_radians() -> None:
    scans = scans_along(L_SHAPE, (0.5, np.pi / 8.0))
    # 8 on the first leg, 4 in the turn, 6 on the second, and the first one
    assert len(scans.time) == 19
    np.testing.assert_allclose(scans.pose[8], (4.0, 0.0, 0.0))
    np.testing.assert_allclose(scans.pose[12], (4.0, 0.0, np.pi / 2.0), atol=1e-6)
    np.testing.assert_allclose(scans.pose[18], (4.0, 3.0, np.pi / 2.0), atol=1e-6)
    assert scans.time[-1] == pytest.approx(7.0 / SPEED + 0.5 * np.pi / TURNING, abs=1e-3)
    assert (np.diff(scans.time) > 0.0).all()


def test_the_given_number_of_scans() -> None:
    spread = scans_along(L_SHAPE, (0.5, 0.5), 1000)
    assert len(spread.time) == 1000
    assert 0.0 < np.hypot(*(spread.pose[-1, :2] - L_SHAPE[-1])) < 0.02
    assert len(scans_along(L_SHAPE, n_scans=5).time) == 5


def test_headings_turn_the_shorter_way() -> None:
    zigzag = np.array([(0.0, 0.0), (-1.0, 0.01), (-2.0, -0.01), (-1.0, -0.01)])
    heading = np.unwrap(scans_along(zigzag, (0.1, 0.1)).pose[:, 2])
    assert np.ptp(heading) <= np.pi + 0.05
    assert np.abs(np.diff(heading)).max() <= 0.1 + 1e-6


WORLD = World.from_polygons(box(4.0, 1.0, 5.0, 7.0), Window(0.0, 0.0, 10.0, 8.0))


def written(folder: Path, text: str) -> PathFile:
    (folder / "path.csv").write_text(text)
    return read_path(folder / "path.csv")


def test_columns_by_name(tmp_path: Path) -> None:
    named = written(tmp_path, "u,theta,y,x\n# drive\n\n0,1.5,2,3\n1,-1,4,5\n")
    assert named.rows.tolist() == [[3.0, 2.0, 1.5], [5.0, 4.0, -1.0]]
    assert named.line.tolist() == [4, 5]
    assert named.has_headings
    assert not written(tmp_path, "y,x,name\n1,2,a\n").has_headings
    assert not written(tmp_path, "x,y,t\n1,2,5\n").has_headings


def test_poses_are_scans_as_they_are(tmp_path: Path) -> None:
    scans = written(tmp_path, "x,y,theta\n1,1,0\n2,1,3\n2,2,-3\n").scans()
    assert scans.pose.tolist() == [[1.0, 1.0, 0.0], [2.0, 1.0, 3.0], [2.0, 2.0, -3.0]]
    # 2 s a metre, 1 s a radian
    assert scans.time == pytest.approx([0.0, 5.0, 7.0 + 2.0 * np.pi - 6.0], abs=1e-3)
    timed = written(tmp_path, "t,x,y,theta\n0.5,1,1,0\n9.25,2,1,3\n").scans()
    assert timed.time.tolist() == [0.5, 9.25]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("x,y\n", "without a row"),
        ("x,y\n1,2\n1\n", r"path\.csv:3: row of 1 fields"),
        ("1,2\n", r"path\.csv:1: the header has no column x, y"),
        ("x,y,theta\n1,2,nan\n", r"path\.csv:2"),
        ("x,y\n1,two\n", r"path\.csv:2"),
    ],
)
def test_what_is_no_path_is_refused(text: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=message):
        written(tmp_path, text)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("x,y\n1,1\n4.5,2\n", r"path\.csv:3: \(4\.5, 2\) is occupied or outside"),
        ("x,y\n1,1\n-1,2\n", r"path\.csv:3"),
        ("x,y\n1,2\n2,2\n\n8,2\n", r"path\.csv:5: the way from the waypoint of line 3 runs into a wall"),
    ],
)
def test_ways_into_walls_are_refused(text: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=message):
        written(tmp_path, text).check(WORLD)
