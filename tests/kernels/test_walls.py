"""Maps of walls: every move by a reference that enumerates proposals, and what is kept by increments by its twin."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
import shapely

from prf.kernels import constants as c
from prf.kernels._jit import core_entry
from prf.kernels.poses.field import draw_field
from prf.kernels.poses.state import WARP, Poses
from prf.kernels.poses.turn import run_poses
from prf.kernels.poses.warp import warp_vertices
from prf.kernels.readings.cones import CONE_LOG_LIKELIHOOD
from prf.kernels.state.build import recompute_sums, trace_all
from prf.kernels.state.chain import Chain
from prf.kernels.state.proposal import find_cells
from prf.kernels.walls.shape import is_covered
from prf.kernels.walls.step import accept_walls, apply_walls, log_move_ratio, propose_walls
from prf.kernels.walls.table import ON_FIRST, SEEN, TOTAL_WEIGHT, WEIGHT, Walls, fill, wall_prior_change
from prf.model.coloring import Coloring, black_at, check
from prf.model.layout import grow, make_image, make_targets, pixel_centres, read_coloring
from prf.model.orientation import Orientation
from prf.model.sensors import LaserModel, PointModel, SonarModel
from prf.model.walls import WallPrior, corners_of, map_of_walls, scratch_walls, united, walls_of
from prf.model.window import Window
from prf.sampler.lines import allowed
from prf.sampler.poses import PoseTurns
from prf.sampler.schedules import Plain
from prf.sampler.target import Execution, Target, laser_data, make_chain, point_data, run_chain, sonar_data, with_map
from tests.reference.pose_worlds import BARE, LASER, begin, draw_pose_world, scratch
from tests.reference.recompute import recompute_cones, recompute_impacts
from tests.reference.slow_walls import Bar, Plan, bars, log_density, log_ratios

WINDOW = Window(0.0, -1.0, 4.0, 2.5)
PRIOR = WallPrior(density=3.0, length=0.8, thickness=0.1, free_end=0.7, crossing=1.1)
TARGET = Target(WINDOW, 0.1, orientation=Orientation(1.7, 0.3), walls=PRIOR, execution=Execution(cell=0.3))
TOLERANCE = 1e-7


@core_entry
def attempt(chain: Chain, walls: Walls, move: int, rng: np.random.Generator) -> tuple[bool, bool, float, float]:
    """Propose and apply what is legal; return (legal, whether `accept` decides by log R, log R, change of prior)."""
    fill(chain.graph, chain.targets, walls)
    legal, log_forward, log_reverse = propose_walls(chain, walls, move, rng)
    if not legal:
        return False, True, -math.inf, -math.inf
    find_cells(chain.edge_index.grid, chain.proposal)
    log_ratio = log_move_ratio(chain.move_probabilities, move, log_forward, log_reverse)
    prior = wall_prior_change(chain.graph, walls, chain.density, chain.lines)
    if prior == -math.inf:
        return False, True, -math.inf, -math.inf
    walls.new[:, ON_FIRST:] = 0.0
    low = accept_walls(chain, walls, log_ratio, prior + log_ratio - 1e-9, rng)[0]
    walls.new[:, ON_FIRST:] = 0.0
    high = accept_walls(chain, walls, log_ratio, prior + log_ratio + 1e-9, rng)[0]
    apply_walls(chain, walls, prior, 0.0)
    return True, low and not high, log_ratio, prior


def plan_of(chain: Chain) -> Plan:
    targets, lines = chain.targets, chain.lines
    shares = np.diff(targets.cumulative, prepend=0.0).tolist()
    cells = [(cell % targets.grid.nx, cell // targets.grid.nx) for cell in targets.cell.tolist()]
    return Plan(
        WINDOW,
        PRIOR,
        float(lines[c.ORIENTATION]),
        float(lines[c.ANGLE]),
        lines[c.N_LINES :].copy(),
        float(chain.tuning[c.AIMED_SHARE]),
        targets.grid,
        dict(zip(cells, shares, strict=True)),
    )


def chain_with_targets(rng: np.random.Generator) -> Chain:
    targets = make_targets(WINDOW, 0.06, rng.uniform(WINDOW[:2], (1.5, 2.5), (200, 2)))
    weight = np.cumsum(rng.exponential(size=len(targets.cell)))
    targets.cumulative[:] = weight / weight[-1]
    chain = make_chain(TARGET, Coloring.empty(WINDOW))._replace(targets=targets)
    chain.tuning[c.AIMED_SHARE] = 0.6
    chain.move_probabilities[:] = rng.dirichlet(np.full(c.N_WALL_MOVES, 4.0))
    return chain


pytestmark = pytest.mark.uncompiled


@pytest.mark.parametrize(("turns", "least"), [(8, 1), pytest.param(20, 3, marks=pytest.mark.slow)])
def test_every_move_has_the_ratio_that_enumeration_gives(turns: int, least: int) -> None:
    rng = np.random.default_rng(7)
    chain, seen, weights = chain_with_targets(rng), np.zeros(c.N_WALL_MOVES, int), set()
    chain.density[c.INVERSE_TEMPERATURE] = 1.0
    for turn in range(turns):
        while chain.graph.counts[c.NEEDS_ROOM]:
            chain = grow(chain)
        chain = run_chain(chain, rng, int(chain.graph.counts[c.STEP]) + 40)
        for move in (c.WALL_BIRTH, c.WALL_BIRTH, *range(c.N_WALL_MOVES), c.GAP, c.MERGE_WALLS, c.HOLLOW, c.FILL_WALLS):
            if chain.graph.counts[c.NEEDS_ROOM]:
                chain = grow(chain)
            scratch, x = scratch_walls(chain), walls_of(read_coloring(chain.graph))
            for _ in range(20):
                legal, decides, log_ratio, prior = attempt(chain, scratch, move, rng)
                if legal:
                    break
            if not legal:
                continue
            y, plan = walls_of(read_coloring(chain.graph)), plan_of(chain)
            back = c.WALL_REVERSE[move]
            moved = math.log(chain.move_probabilities[back] / chain.move_probabilities[move])
            expected = [moved + found for found in log_ratios(move, x, y, plan)]
            assert min((abs(log_ratio - each) for each in expected), default=np.inf) < TOLERANCE * (
                1.0 + abs(log_ratio)
            ), (c.WALL_MOVES[move], turn, log_ratio, expected)
            assert prior == pytest.approx(log_density(y, plan) - log_density(x, plan), abs=1e-8), c.WALL_MOVES[move]
            assert decides
            seen[move] += 1
            weights |= set(scratch.row[: chain.graph.counts[c.WALLS], WEIGHT])
            assert scratch.counts[TOTAL_WEIGHT] == scratch.row[: chain.graph.counts[c.WALLS], WEIGHT].sum()
    assert weights == {1.0, float(SEEN)}
    assert seen.min() >= least, dict(zip([name for name, _ in c.WALL_MOVES], seen.tolist(), strict=True))


def chain_with_readings(rng: np.random.Generator) -> Chain:
    """A chain of beams and points, with an image, at a map of walls; levels decide one after the other."""
    origin = rng.uniform((0.5, 0.5), (3.5, 1.5), (40, 2))
    laser = laser_data(origin, rng.uniform(-3.0, 3.0, 40), rng.uniform(0.3, 2.0, 40), LaserModel(max_range=3.0))
    values = point_data(
        rng.uniform((0.1, -0.9), (3.9, 2.4), (60, 2)), rng.random(60), PointModel(kind="gaussian", sigma=2.0)
    )
    execution = Execution(cell=0.3, resolution=0.07, levels=2)
    target = Target(
        WINDOW, 0.1, laser, points=values, orientation=Orientation(1.7, 0.3), walls=PRIOR, execution=execution
    )
    return make_chain(target, Coloring.empty(WINDOW))


def covering(walls: list[Bar], xy: np.ndarray) -> np.ndarray:
    inside = [shapely.contains_xy(wall.polygon(), *xy.T) for wall in walls] or [np.zeros(len(xy), np.bool_)]
    return np.asarray(np.sum(inside, axis=0))


def test_twins_agree() -> None:
    rng = np.random.default_rng(2)
    chain = chain_with_readings(rng)
    chain.density[c.LIKELIHOOD_POWER] = 0.05
    chain.move_probabilities[:] = [0.05] * 7 + [0.2, 0.2, 0.125, 0.125]
    for until in range(100, 2700, 100):
        chain = run_chain(chain, rng, until)
        raw = read_coloring(chain.graph)
        walls, sums = bars(walls_of(raw)), chain.graph.sums.copy()
        plain = Plan(WINDOW, PRIOR, 1.7, 0.3, chain.lines[c.N_LINES :], 0.0, chain.targets.grid, {})
        assert sums[c.LOG_PRIOR] + chain.lines[c.LOG_NORMALISER] == pytest.approx(log_density(walls_of(raw), plain))
        impacts = recompute_impacts(chain)
        np.testing.assert_array_equal(impacts.edge, chain.beams.impact_edge)
        np.testing.assert_allclose(impacts.distance, chain.beams.ray[:, c.DISTANCE])

        column = chain.points.column
        np.testing.assert_array_equal(covering(walls, column[:2].T), column[4])
        colours = np.where(column[4] > 0, column[3], column[2])
        np.testing.assert_allclose(np.where(column[4] > 0, column[2] - column[3], column[3] - column[2]), column[5])
        assert sums[c.LOG_LIKELIHOOD] == pytest.approx(impacts.total + colours.sum())
        np.testing.assert_array_equal(covering(walls, pixel_centres(chain.image.grid)), chain.image.black)
        np.testing.assert_array_equal(make_image(raw, chain.graph, 0.07).n_edges, chain.image.n_edges)
        assert not covering(walls, chain.sensors.xy).any()
        recompute_sums(chain)
        np.testing.assert_allclose(chain.graph.sums, sums, rtol=1e-9, atol=1e-9)
    assert chain.outcomes[:, c.ACCEPTED].min() > 0


def test_twins_agree_on_cones_whose_lines_cross() -> None:
    rng = np.random.default_rng(9)
    xy, angle = rng.uniform((0.5, 0.5), (3.5, 1.5), (25, 2)), rng.uniform(-3.0, 3.0, 25)
    sonar = sonar_data(xy, angle, np.full(25, 0.5), rng.uniform(0.3, 2.0, 25), SonarModel(max_range=2.5))
    target = Target(WINDOW, 0.1, sonar=sonar, walls=PRIOR, execution=Execution(cell=0.3))
    chain = make_chain(target, Coloring.empty(WINDOW))
    chain.density[c.LIKELIHOOD_POWER] = 0.1
    for until in range(100, 900, 100):
        chain = run_chain(chain, rng, until)
        found = recompute_cones(chain)
        np.testing.assert_allclose(chain.cones.pose[:, CONE_LOG_LIKELIHOOD], found[:, CONE_LOG_LIKELIHOOD], atol=1e-9)
        assert chain.graph.sums[c.LOG_LIKELIHOOD] == pytest.approx(found[:, CONE_LOG_LIKELIHOOD].sum())
    assert chain.graph.counts[c.WALLS] > 2


def test_a_map_of_walls_is_read_as_it_was_written_and_covers_what_its_walls_do() -> None:
    walls = np.array([[0.5, 0.0, 3.0, 0.0, 0.2], [1.0, 0.05, 1.0, 1.5, 0.1], [0.9, 1.4, 3.5, 1.6, 0.12]])
    raw = map_of_walls(walls, WINDOW)
    np.testing.assert_allclose(walls_of(raw), walls, atol=1e-12)
    region = united(raw)
    check(region)
    xy = np.random.default_rng(0).uniform(WINDOW[:2], WINDOW[2:], (500, 2))
    inside = np.any([shapely.contains_xy(wall.polygon(), *xy.T) for wall in bars(walls)], axis=0)
    np.testing.assert_array_equal(black_at(region, xy), inside)
    assert united(Coloring.empty(WINDOW)).n_edges == 0
    in_a_point = np.array([[0.5, 0.0, 1.5, 0.0, 0.25], [1.5, 0.25, 2.5, 0.25, 0.25]])
    check(united(map_of_walls(in_a_point, WINDOW)))


@core_entry
def covered(chain: Chain, xy: np.ndarray, found: np.ndarray) -> None:
    for k in range(xy.shape[0]):
        found[k] = is_covered(chain.graph, xy[k, 0], xy[k, 1])


def test_a_place_is_covered_where_a_wall_is_whatever_the_map_was_before() -> None:
    rng = np.random.default_rng(3)
    chain = make_chain(TARGET, Coloring.empty(WINDOW))
    walls = np.array([[0.5, 0.0, 3.0, 0.0, 0.2], [1.0, 0.05, 1.0, 1.5, 0.1]])
    chain = with_map(chain, TARGET, map_of_walls(walls, WINDOW))
    assert chain.graph.counts[c.WALLS] == 2
    xy, found = rng.uniform(WINDOW[:2], WINDOW[2:], (200, 2)), np.zeros(200, np.bool_)
    covered(chain, xy, found)
    expected = np.any([shapely.contains_xy(wall.polygon(), *xy.T) for wall in bars(walls)], axis=0)
    np.testing.assert_array_equal(found, expected)


def test_walls_stay_rectangles_where_they_are_warped_with_poses_and_sums_stay_those_of_the_map() -> None:
    rng = np.random.default_rng(12)
    world = draw_pose_world(LASER, rng)
    window = world.target.window
    target = dataclasses.replace(world.target, walls=PRIOR)
    a = rng.uniform((window.x_min + 1.5, window.y_min + 1.5), (window.x_max - 1.5, window.y_max - 1.5), (12, 2))
    angle = rng.uniform(0.0, np.pi, 12)
    rows = np.column_stack([a, a + np.column_stack([np.cos(angle), np.sin(angle)]), np.full(12, 0.1)])
    begun = world._replace(target=target, coloring=map_of_walls(allowed(rows, target), window))
    chain, turns = begin(begun)
    turns.state.spread[:] = [0.03, 0.0, 0.03, 0.0, 0.0, 0.03]
    n_warped = 0
    for until in (60, 120, 180):
        chain = run_chain(chain, rng, until - 40)
        before = walls_of(read_coloring(chain.graph))
        run_poses(chain, *scratch(chain), turns.state, 0.5, until, rng)
        after = walls_of(read_coloring(chain.graph))
        np.testing.assert_allclose(corners_of(after).reshape(-1, 2), map_of_walls(after, window).xy)
        np.testing.assert_allclose(after[:, 4], before[:, 4], atol=1e-12)
        n_warped += int(np.abs(after - before).max(initial=0.0) > 0.0)
        sums = chain.graph.sums.copy()
        chain = turns.laid_out(chain)
        trace_all(chain)
        recompute_sums(chain)
        np.testing.assert_allclose(sums[1:], chain.graph.sums[1:], rtol=1e-9, atol=1e-9)
        xy = turns.sites()
        assert not covering(bars(after), xy).any()
    assert n_warped > 0
    assert turns.state.outcomes[WARP, c.ACCEPTED] > 0


def test_the_jacobian_of_a_warp_of_walls_is_that_of_differences() -> None:
    """Over middle, direction and length: by the determinant of what the field does to them."""
    rng = np.random.default_rng(5)
    world = draw_pose_world(BARE, rng)
    window = world.target.window
    middle = np.array(window.centre)
    wall = np.array([[*(middle - np.array([0.4, 0.1])), *(middle + np.array([0.3, 0.2])), 0.1]])
    target = dataclasses.replace(world.target, walls=PRIOR)

    def end(numbers: np.ndarray, state: Poses) -> tuple[np.ndarray, float]:
        x, y, theta, length = numbers
        half = 0.5 * length * np.array([np.cos(theta), np.sin(theta)])
        rows = np.array([[x - half[0], y - half[1], x + half[0], y + half[1], 0.1]])
        chain = make_chain(target, map_of_walls(rows, window))
        trial = scratch(chain)[0]
        moved, log_scaled = warp_vertices(chain.graph, trial, state)
        assert moved
        a, b = (0.5 * (trial.vertex_xy[i] + trial.vertex_xy[k]) for i, k in ((0, 3), (1, 2)))
        return np.array([*(0.5 * (a + b)), np.arctan2(*(b - a)[::-1]), np.hypot(*(b - a))]), log_scaled

    turns = PoseTurns(target, make_chain(target, map_of_walls(wall, window)), Plain())
    checked = 0
    while checked < 5:
        if not draw_field(np.array(window), turns.state, rng):
            continue
        step = wall[0, 2:4] - wall[0, :2]
        here = np.array([*(0.5 * (wall[0, :2] + wall[0, 2:4])), np.arctan2(step[1], step[0]), np.hypot(*step)])
        _, log_scaled = end(here, turns.state)
        tiny = 1e-6
        columns = [
            (end(here + tiny * unit, turns.state)[0] - end(here - tiny * unit, turns.state)[0]) / (2.0 * tiny)
            for unit in np.eye(4)
        ]
        assert log_scaled == pytest.approx(np.log(abs(np.linalg.det(np.array(columns)))), abs=1e-5)
        checked += abs(log_scaled) > 1e-4
