"""The rule of truth on points made by hand."""

from __future__ import annotations

import numpy as np
import pytest

from mapq.configuration import SimulateSettings
from mapq.kernels.raycast import NOTHING, cast_beams
from mapq.simulate.robot import Trajectory
from mapq.simulate.scene import Kind, SceneBuilder, World
from mapq.simulate.street import add_traffic
from mapq.simulate.truth import Observed, judge
from tests.reference import mapq_raycast as reference

SETTINGS = SimulateSettings(disagreement=0.2, cell=1.0, visit_gap=25.0, visit_points=3)


def seen(visits: list[tuple[float, tuple[float, float], int]], surface: int = 0, normal=(0.0, 1.0, 0.0)) -> Observed:  # type: ignore[no-untyped-def]
    """Return points of one cell of a wall along x: each visit has a time, a displacement and a number of points."""
    time = np.concatenate([t + 0.1 * np.arange(n) for t, _, n in visits])
    moved = np.concatenate([np.tile(m, (n, 1)) for _, m, n in visits]).astype(float)
    n = len(time)
    hits = np.column_stack([np.linspace(0.2, 0.8, n), np.zeros(n), np.full(n, 0.5)])
    surfaces = np.full(n, surface, np.int32)
    things = np.where(surfaces < 0, 7, -1).astype(np.int32)
    return Observed(hits, moved, time, surfaces, things, np.tile(normal, (n, 1)))


def suspicious(points: Observed) -> list[bool]:
    return judge(points, SETTINGS).suspicious.tolist()


def test_passes_that_disagree_along_the_normal_are_both_suspicious() -> None:
    points = seen([(0.0, (0.0, 0.0), 3), (60.0, (0.0, 0.25), 4)])
    truth = judge(points, SETTINGS)
    assert truth.suspicious.all()
    np.testing.assert_allclose(truth.disagreement, 0.25)


def test_a_displacement_along_the_wall_is_plausible() -> None:
    assert not any(suspicious(seen([(0.0, (0.0, 0.0), 3), (60.0, (2.0, 0.1), 4)])))


def test_seen_once_or_within_the_gap_is_plausible_however_displaced() -> None:
    assert not any(suspicious(seen([(0.0, (0.0, 3.0), 9)])))
    assert not any(suspicious(seen([(0.0, (0.0, 0.0), 3), (20.0, (0.0, 0.5), 3)])))


def test_what_moved_together_is_plausible() -> None:
    assert not any(suspicious(seen([(0.0, (0.5, 1.0), 5), (60.0, (0.5, 1.1), 5)])))


def test_a_pass_of_few_points_accuses_nobody_but_is_judged() -> None:
    assert suspicious(seen([(0.0, (0.0, 0.0), 3), (60.0, (0.0, 0.5), 2)])) == [False] * 3 + [True] * 2


def test_of_three_passes_those_far_from_any_other_are_suspicious() -> None:
    points = seen([(0.0, (0.0, 0.0), 3), (60.0, (0.0, 0.15), 3), (120.0, (0.0, 0.3), 3)])
    truth = judge(points, SETTINGS)
    assert truth.suspicious.tolist() == [True] * 3 + [False] * 3 + [True] * 3
    np.testing.assert_allclose(truth.disagreement, [0.3] * 3 + [0.15] * 3 + [0.3] * 3)


def test_flat_ground_never_disagrees_and_things_do_in_any_direction() -> None:
    visits = [(0.0, (0.0, 0.0), 3), (60.0, (0.5, 0.0), 3)]
    assert not any(suspicious(seen(visits, normal=(0.0, 0.0, 1.0))))
    assert all(suspicious(seen(visits, surface=-1)))


def test_cells_are_apart_and_what_moves_has_none() -> None:
    one = seen([(0.0, (0.0, 0.0), 3), (60.0, (0.0, 0.5), 3)])
    shifted = one._replace(hits=one.hits + np.where(one.time > 30.0, 4.0, 0.0)[:, None] * (1.0, 0.0, 0.0))
    assert not any(suspicious(shifted))
    moving = one._replace(surface=np.full(6, -1, np.int32), thing=np.full(6, -1, np.int32))
    truth = judge(moving, SETTINGS)
    assert not truth.suspicious.any()
    assert (truth.cell == -1).all()


def joined(*parts: Observed) -> Observed:
    return Observed(*(np.concatenate(values) for values in zip(*parts, strict=True)))


def beside(part: Observed, to: tuple[float, float, float], surface: int, normal=(0.0, 1.0, 0.0)) -> Observed:  # type: ignore[no-untyped-def]
    """Return the points on another surface, shifted by `to`."""
    n = len(part.time)
    return part._replace(
        hits=part.hits + np.array(to), surface=np.full(n, surface, np.int32), normal=np.tile(normal, (n, 1))
    )


FACADE = seen([(0.0, (0.0, 0.0), 5), (60.0, (0.0, 0.3), 5)])
PANE = seen([(0.0, (0.0, 0.0), 4)])


class TestSeenOnce:
    def test_a_pane_in_a_doubled_facade_is_suspicious(self) -> None:
        truth = judge(joined(FACADE, beside(PANE, (1.1, 0.25, 0.0), 1)), SETTINGS)
        assert truth.suspicious.all()
        np.testing.assert_allclose(truth.disagreement, 0.3)

    @pytest.mark.parametrize("normal", [(1.0, 0.0, 0.0), (0.8, 0.6, 0.0), (0.0, 0.0, 1.0)])
    def test_a_wall_that_is_not_parallel_to_it_is_not(self, normal: tuple[float, float, float]) -> None:
        truth = judge(joined(FACADE, beside(PANE, (1.1, 0.25, 0.0), 1, normal)), SETTINGS)
        assert truth.suspicious.tolist() == [True] * 10 + [False] * 4

    @pytest.mark.parametrize("normal", [(0.0, -1.0, 0.0), (0.4, 0.9165, 0.0)])
    def test_nearly_parallel_and_facing_away_is_parallel(self, normal: tuple[float, float, float]) -> None:
        assert judge(joined(FACADE, beside(PANE, (1.1, 0.25, 0.0), 1, normal)), SETTINGS).suspicious.all()

    def test_what_is_farther_than_a_cell_and_a_half_is_not(self) -> None:
        truth = judge(joined(FACADE, beside(PANE, (1.8, 0.0, 0.0), 0)), SETTINGS)
        assert truth.suspicious.tolist() == [True] * 10 + [False] * 4

    def test_a_visit_continues_in_the_adjacent_cell(self) -> None:
        """However long it lasts, and however far apart its mean times are."""
        long = seen([(t, (0.0, 0.005 * t), 2) for t in range(0, 100, 10)])
        brief = beside(seen([(95.0, (0.0, 0.5), 4)]), (1.0, 0.0, 0.0), 0)
        assert not judge(joined(long, brief), SETTINGS).suspicious.any()
        later = brief._replace(time=brief.time + 30.0)
        assert judge(joined(long, later), SETTINGS).suspicious.all()

    def test_passes_of_few_points_beside_it_accuse_nobody(self) -> None:
        few = seen([(60.0, (0.0, 0.3), 2)])
        assert not judge(joined(PANE, beside(few, (1.0, 0.0, 0.0), 0)), SETTINGS).suspicious.any()

    def test_a_cell_that_two_visits_agree_in_asks_no_other(self) -> None:
        agreed = beside(seen([(0.0, (0.0, 0.0), 3), (60.0, (0.0, 0.1), 3)]), (1.0, 0.0, 0.0), 0)
        assert judge(joined(FACADE, agreed), SETTINGS).suspicious.tolist() == [True] * 10 + [False] * 6

    def test_a_clean_map_stays_clean(self) -> None:
        rng = np.random.default_rng(0)
        time = np.sort(rng.uniform(0, 500, 400))
        hits = rng.uniform(0, 6, (400, 3)) * (1.0, 0.0, 1.0)
        normal = np.tile((0.0, 1.0, 0.0), (400, 1))
        moved = np.tile((0.7, -0.4), (400, 1))
        truth = judge(
            Observed(hits, moved, time, np.zeros(400, np.int32), np.full(400, -1, np.int32), normal), SETTINGS
        )
        assert truth.disagreement.max() < 1e-12


def test_no_points_at_all() -> None:
    none = Observed(*(values[:0] for values in PANE))
    assert len(judge(none, SETTINGS).suspicious) == 0


@pytest.mark.parametrize("turn", [0.3, 1.2, 2.9])
def test_the_order_of_the_points_and_the_direction_of_the_wall_do_not_matter(turn: float) -> None:
    normal = np.array([np.cos(turn), np.sin(turn)])
    points = seen([(0.0, (0.0, 0.0), 3), (60.0, tuple(0.25 * normal), 3)], normal=(*normal, 0.0))
    points = points._replace(hits=np.zeros((6, 3)))
    order = np.random.default_rng(1).permutation(6)
    mixed = Observed(*(values[order] for values in points))
    assert all(suspicious(points))
    np.testing.assert_allclose(judge(mixed, SETTINGS).disagreement, judge(points, SETTINGS).disagreement[order])


# Ray casting against a caster without a grid, on random scenes.


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


# Who moves while the robot passes: people on the pavements, cars that come towards it.


def movers(way: Trajectory, width: float, seed: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Return what moves: rows of whether a box, start, velocity, times, half sides, z, heading; and kinds."""
    builder = SceneBuilder()
    settings = SimulateSettings.of_size("small", {"street_width": width, "clutter": 2.0})
    add_traffic(builder, way, settings, np.random.default_rng(seed))
    return builder._movers.array(), np.array([kind for *_, kind in builder._movers.tags])


def straight(length: float = 2000.0) -> Trajectory:
    """Along x."""
    distance = np.linspace(0.0, length, 201)
    return Trajectory(distance, np.column_stack([distance, 0.0 * distance]), 0.0 * distance, np.empty(0))


def circle(radius: float = 12.0, turns: int = 25) -> Trajectory:
    heading = np.linspace(0.0, 2.0 * np.pi * turns, 200 * turns)
    xy = radius * np.column_stack([np.sin(heading), 1.0 - np.cos(heading)])
    return Trajectory(radius * heading, xy, heading, np.empty(0))


def test_cars_come_towards_the_robot_in_the_other_lane() -> None:
    rows, kinds = movers(straight(), 16.0)
    bodies, cabins = rows[kinds == Kind.MOVING_CAR][::2], rows[kinds == Kind.MOVING_CAR][1::2]
    assert len(bodies) == len(cabins) == pytest.approx(2.0 * 2000.0 / 45.0, rel=0.35)
    assert (bodies[:, 0] == 1.0).all(), "boxes"
    assert (bodies[:, 3] < -3.9).all(), "against the robot's heading"
    assert (np.abs(bodies[:, 2] - 2.9) <= 0.3).all(), "left of its lane"
    np.testing.assert_array_equal(bodies[:, 1:7], cabins[:, 1:7])
    np.testing.assert_array_equal(bodies[:, 10], cabins[:, 9])
    assert (cabins[:, 7] < bodies[:, 7]).all(), "a cabin is shorter than its body, and stands on it"


def test_there_are_none_in_narrow_streets_nor_where_the_robot_turns() -> None:
    assert Kind.MOVING_CAR not in movers(straight(), 11.0)[1]
    assert Kind.MOVING_CAR not in movers(circle(), 16.0)[1]
    assert Kind.PERSON in movers(circle(), 16.0)[1]


def test_people_keep_to_the_pavements() -> None:
    rows, kinds = movers(straight(), 11.0)
    assert set(kinds.tolist()) == {Kind.PERSON}
    assert len(rows) == pytest.approx(2.0 * 2000.0 / 11.0, rel=0.25)
    assert ((np.abs(rows[:, 2]) >= 3.5) & (np.abs(rows[:, 2]) <= 4.7)).all()
    assert (np.abs(rows[:, 3]) <= 1.6).all()
