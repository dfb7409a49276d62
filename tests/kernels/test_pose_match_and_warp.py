"""The proposal of a matched pose: its equations are derivatives, its density that of its draws, its point its own."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
import shapely

from prf.kernels import constants as c
from prf.kernels.poses import field as f
from prf.kernels.poses import match as m
from prf.kernels.poses import warp as w
from prf.kernels.poses.state import Poses
from prf.model.coloring import Coloring, black_at, violations
from prf.model.layout import make_guards, read_coloring
from prf.readings.way import way_guards
from prf.sampler.bends import Fields, splines
from tests.kernels.entries import parts_are_called
from tests.reference.pose_worlds import (
    BARE,
    BOTH,
    DRIVEN,
    LASER,
    UNLIKE,
    PoseWorld,
    Rig,
    begin,
    draw_pose_world,
    scratch,
)
from tests.reference.recompute import cell_lists, recompute_edge_cells, recompute_log_prior

pytestmark = [pytest.mark.uncompiled, parts_are_called]

RIGS = pytest.mark.parametrize("rig", [LASER, DRIVEN, BOTH], ids=["errors", "odometry", "both"])


def symmetric(rows: np.ndarray) -> np.ndarray:
    """The matrix whose lower triangle is given by rows."""
    full = np.zeros((3, 3))
    full[np.tril_indices(3)] = rows
    return full + np.tril(full, -1).T


@pytest.mark.parametrize("rig", [LASER, UNLIKE, DRIVEN, BOTH], ids=["errors", "unlike errors", "odometry", "both"])
def test_the_gradient_of_the_priors_is_a_derivative(rig: Rig) -> None:
    rng = np.random.default_rng(1)
    world = draw_pose_world(rig, rng)
    _, turns = begin(world)
    state, prior = turns.state, world.model.prior
    for i in range(int(prior.is_held), rig.n):
        at = world.truth[i] + rng.normal(0.0, 0.1, 3)
        state.work[:] = 0.0
        m.add_priors(state, state.work, at, i)
        poses = state.pose.copy()

        def density(changed: np.ndarray, poses: np.ndarray = poses, i: int = i) -> float:
            poses[i] = changed
            return prior.log_density(poses)

        np.testing.assert_allclose(state.work[m.GRADIENT : m.GRADIENT + 3], slope(density, at), rtol=1e-5, atol=1e-5)


def slope(function, at: np.ndarray) -> np.ndarray:
    """Central differences."""
    steps = 1e-6 * np.eye(3)
    return np.array([(function(at + step) - function(at - step)) / 2e-6 for step in steps])


def test_what_a_beam_adds_are_the_squares_of_derivatives() -> None:
    """Of the range that the edge would give, which `add_beam` knows at one place alone."""
    rng = np.random.default_rng(2)
    model = np.zeros(c.N_LASER_MODEL)
    model[[c.NOISE, c.HIT, c.OUTLIER_DENSITY, c.WEIGHT]] = 0.1, 0.9, 1e-9, 0.5
    for _ in range(20):
        pose, bearing = rng.uniform(-1.0, 1.0, 3), rng.uniform(-0.5, 0.5)
        xy = np.array([2.0, -9.0, 2.0 + rng.uniform(-1.0, 1.0), 9.0])

        def ray_at(pose: np.ndarray, bearing: float = bearing) -> np.ndarray:
            u = np.array([np.cos(pose[2] + bearing), np.sin(pose[2] + bearing)])
            return np.concatenate([pose[:2] + 0.3 * np.array([np.cos(pose[2]), np.sin(pose[2])]), u])

        def distance(pose: np.ndarray, xy: np.ndarray = xy) -> float:
            ox, oy, ux, uy = ray_at(pose)
            ex, ey = xy[2] - xy[0], xy[3] - xy[1]
            return float(((xy[0] - ox) * ey - (xy[1] - oy) * ex) / (ux * ey - uy * ex))

        ray = np.zeros(c.N_RAY)
        ray[:4], ray[c.DISTANCE] = ray_at(pose), distance(pose)
        ray[c.RANGE] = ray[c.DISTANCE] + 0.07
        work = np.zeros(48)
        m.add_beam(model, work, pose, ray, xy, 1.0)
        by_pose = slope(distance, pose)
        np.testing.assert_allclose(
            symmetric(work[m.NORMAL : m.GRADIENT]), 0.5 * 100.0 * np.outer(by_pose, by_pose), rtol=1e-4
        )
        np.testing.assert_allclose(work[m.GRADIENT : m.ROOT], 0.5 * 7.0 * by_pose, rtol=1e-4)


@RIGS
def test_draws_have_the_density_that_the_ratio_takes(rig: Rig) -> None:
    rng = np.random.default_rng(3)
    world = draw_pose_world(rig, rng)
    chain, turns = begin(world)
    state, i = turns.state, 1
    assert m.match(chain.graph, chain.edge_index, chain.beams, state, i)
    root = np.zeros((3, 3))
    root[np.tril_indices(3)] = state.work[m.ROOT : m.STEP]
    np.testing.assert_allclose(root @ root.T, symmetric(state.work[m.NORMAL : m.GRADIENT]), rtol=1e-9)
    mean = state.work[m.MEAN : m.MEAN + 3].copy()
    for _ in range(50):
        normal = rng.standard_normal(3)
        found = np.array(m.solve_root(state.work, *normal))
        np.testing.assert_allclose(root.T @ found, normal, rtol=1e-9, atol=1e-12)
        pose = mean + m.INFLATION * found + [0.0, 0.0, 2.0 * np.pi * rng.integers(-1, 2)]
        assert m.half_square(state, pose) == pytest.approx(0.5 * normal @ normal, rel=1e-9)
    np.testing.assert_allclose(root @ root.T @ m.newton_step(state.work), state.work[m.GRADIENT : m.ROOT], atol=1e-9)


@RIGS
def test_where_a_match_leads_does_not_depend_on_the_pose_that_it_replaces(rig: Rig) -> None:
    world = draw_pose_world(rig, np.random.default_rng(4))
    chain, turns = begin(world)
    found = []
    for offset in (0.0, 0.1, -0.3):
        turns.place(chain, world.truth + offset * np.eye(rig.n)[:, [1]])
        state = turns.state
        state.new_ray[:], state.new_pose[:] = offset, offset
        assert m.match(chain.graph, chain.edge_index, chain.beams, state, 1)
        found.append(state.work[m.NORMAL : m.MEAN + 3].copy())
    np.testing.assert_array_equal(found[1:], [found[0]] * 2)


def test_walks_are_scaled_by_what_a_pose_may_vary_by() -> None:
    world = draw_pose_world(BOTH, np.random.default_rng(5))
    chain, turns = begin(world)
    turns.measure(chain)
    state = turns.state
    for i in range(BOTH.n):
        assert m.gather(chain.graph, chain.edge_index, chain.beams, state, i, state.pose[i], 1.0)
        root = np.zeros((3, 3))
        root[np.tril_indices(3)] = state.spread[i]
        normal = symmetric(state.work[m.NORMAL : m.GRADIENT])
        np.testing.assert_allclose(root @ root.T, np.linalg.inv(normal), rtol=1e-8, atol=1e-14)


# A warp: undone by its opposite, its Jacobian that of differences; maps stay valid, and colours where they are.


CENTRE = (2.5, 3.1)
GRID = np.array([-1.0, -1.0, 1.5])
MIXTURE = np.random.default_rng(8).normal(0.0, 0.15, (7, 7, 2))


def field(radius: float, x: float = 0.0, y: float = 0.0, turn: float = 0.0) -> Poses:
    state = begin(draw_pose_world(BARE, np.random.default_rng(5)))[1].state
    work = state.work
    work[f.CENTRE : f.CENTRE + 2], work[f.RADIUS], work[f.MOTION : f.MOTION + 3] = CENTRE, radius, (x, y, turn)
    return state._replace(field_grid=GRID, mixture=MIXTURE.copy())


def turn_round(state: Poses) -> None:
    state.work[f.MOTION : f.MOTION + 3] *= -1.0
    state.mixture[:] *= -1.0


def moved(state: Poses, point: np.ndarray) -> np.ndarray:
    assert f.displace(state, *point)
    return state.work[f.PLACE : f.PLACE + 2].copy()


FIELDS = pytest.mark.parametrize(
    "field_of",
    [(2.0, 0.2, -0.1, 0.2), (1.0, -0.15, 0.1, -0.15), (np.inf, 0.3, 0.2, 0.3), (0.0,)],
    ids=["wide", "narrow", "all", "mixture"],
)


@FIELDS
def test_the_opposite_field_leads_back(field_of: tuple[float, ...]) -> None:
    rng, still, state = np.random.default_rng(1), 0, field(*field_of)
    for point in rng.uniform(0.5, 4.5, (100, 2)):
        there = moved(state, point)
        log_scaled, turned = state.work[f.LOG_SCALED], state.work[f.TURNED]
        turn_round(state)
        np.testing.assert_allclose(moved(state, there), point, rtol=0.0, atol=1e-12)
        assert state.work[f.LOG_SCALED] == pytest.approx(-log_scaled, abs=1e-11)
        assert state.work[f.TURNED] == pytest.approx(-turned, abs=1e-11)
        turn_round(state)
        still += bool((there == point).all())
    assert (still > 5) == (0.0 < field_of[0] < np.inf)


@FIELDS
def test_its_jacobian_and_its_turn_are_those_of_differences(field_of: tuple[float, ...]) -> None:
    rng, state = np.random.default_rng(2), field(*field_of)
    for point in rng.uniform(1.8, 3.2, (50, 2)):
        steps = 1e-5 * np.eye(2)
        slope = np.array([(moved(state, point + step) - moved(state, point - step)) / 2e-5 for step in steps]).T
        moved(state, point)
        assert state.work[f.LOG_SCALED] == pytest.approx(np.log(np.linalg.det(slope)), abs=1e-8)
        left, _, right = np.linalg.svd(slope)
        nearest = left @ right
        assert state.work[f.TURNED] == pytest.approx(np.arctan2(nearest[1, 0], nearest[0, 0]), abs=1e-8)


def test_a_mixture_is_the_splines_of_its_coefficients() -> None:
    state, places = field(0.0), np.random.default_rng(4).uniform(0.0, 6.0, (40, 2))
    matrices = splines(places, GRID, (7, 7))
    expected = np.stack([matrix @ MIXTURE.reshape(49, 2) for matrix in matrices], axis=2)
    for place, (by_x, by_y) in zip(places, expected, strict=True):
        f.mixture_at(state, *place)
        found = state.work[[f.MOVED, f.SLOPES, f.SLOPES + 1, f.MOVED + 1, f.SLOPES + 2, f.SLOPES + 3]]
        np.testing.assert_allclose(found, [*by_x, *by_y], rtol=0.0, atol=1e-14)


def test_a_field_that_is_used_moves_no_two_points_to_one_place() -> None:
    """Half of its slope is below 1/2 wherever it acts; steeper ones are drawn, and not used."""
    rng = np.random.default_rng(3)
    chain, turns = begin(draw_pose_world(BARE, rng))
    turns.bend(Fields(GRID, 3.0 * np.stack([MIXTURE, MIXTURE[::-1]])))
    state, used, mixed = turns.state, 0, 0
    for _ in range(300):
        if not f.draw_field(chain.graph.window, state, rng):
            continue
        used += 1
        is_mixture = state.work[f.RADIUS] == 0.0
        mixed += is_mixture
        centre, radius = state.work[f.CENTRE : f.CENTRE + 2], min(state.work[f.RADIUS], 3.0)
        if is_mixture:
            centre, radius = np.array([3.0, 3.0]), 3.0
        points = centre + rng.uniform(-radius, radius, (8, 2))
        for one, other in itertools.pairwise(points):
            gap = np.hypot(*(one - other))
            apart = np.hypot(*(moved(state, one) - moved(state, other)))
            assert gap / 3.0 < apart < 3.0 * gap  # (1 + 1/2) / (1 - 1/2)
    assert 50 < used < 290
    assert 10 < mixed < 140


def warped(world: PoseWorld, tries: int, seed: int, way: np.ndarray | None = None):  # type: ignore[no-untyped-def]
    """Chain, poses, and the map before, after each accepted warp."""
    chain, turns = begin(world)
    if way is not None:
        guards = make_guards(chain.edge_index.grid, np.zeros(0, np.int64), way_guards(way, 0.01))
        chain = chain._replace(guards=guards)
    rng = np.random.default_rng(seed)
    trial, index = scratch(chain)
    for _ in range(tries):
        before = read_coloring(chain.graph)
        if w.warp(chain, trial, index, turns.state, rng):
            yield chain, turns.state, before


def test_a_warped_map_is_valid_and_colours_stay_beside_its_walls() -> None:
    """No edge passes a point that is farther from all of them than any vertex moved."""
    accepted = flipped = 0
    for seed in (2, 4):
        world = draw_pose_world(BARE, np.random.default_rng([9, seed]))
        for chain, state, before in warped(world, 25, seed):
            accepted += 1
            after = read_coloring(chain.graph)
            assert violations(after) == []
            edges = shapely.union_all(shapely.linestrings(before.segments().reshape(-1, 2, 2)))
            reach = np.hypot(*(after.xy - before.xy).T).max()
            places = np.random.default_rng(0).uniform(0.0, 6.0, (400, 2))
            places = places[shapely.distance(shapely.points(places), edges) > reach]
            np.testing.assert_array_equal(black_at(before, places), black_at(after, places))
            flipped += before.anchor_black != after.anchor_black
            assert cell_lists(chain.edge_index.cell_edges, chain.edge_index.cell_count) == recompute_edge_cells(chain)
            assert chain.graph.sums[c.LOG_PRIOR] == pytest.approx(recompute_log_prior(chain), abs=1e-9)
            np.testing.assert_array_equal(state.pose, state.new_pose)
    assert accepted > 6
    assert flipped > 0


def beside_a_wall(coloring: Coloring) -> np.ndarray:
    """A white place 5 cm from the middle of the longest edge that lies about the middle of the window."""
    ends = coloring.segments().reshape(-1, 2, 2)
    middle = ends.mean(axis=1)
    near = np.argmax(coloring.edge_lengths() - 9.0 * (np.hypot(*(middle - 3.0).T) > 1.5))
    along = (ends[near, 1] - ends[near, 0]) / np.hypot(*(ends[near, 1] - ends[near, 0]))
    sides = middle[near] + 0.05 * np.outer([1.0, -1.0], [-along[1], along[0]])
    return np.asarray(sides[~black_at(coloring, sides)][0])


def test_the_way_driven_stays_white() -> None:
    """Walls may be carried over a way as thin as this, and no edge is near to it afterwards."""
    crossed = kept = 0
    for seed in range(2):
        world = draw_pose_world(BARE, np.random.default_rng([9, seed]))
        place = beside_a_wall(world.coloring)
        for chain, _, _ in warped(world, 25, seed, np.array([[*place, *place]])):
            kept += 1
            assert not black_at(read_coloring(chain.graph), place)
        crossed += any(black_at(read_coloring(chain.graph), place) for chain, _, _ in warped(world, 25, seed))
    assert kept > 8
    assert crossed > 0, "no wall would have been"


def test_a_held_pose_lies_beyond_every_field() -> None:
    held = DRIVEN._replace(n=4, n_beams=2)
    world, accepted = draw_pose_world(held, np.random.default_rng(1)), 0
    for _, state, _ in warped(world, 60, 1):
        accepted += 1
        np.testing.assert_array_equal(state.pose[0], world.model.prior.given[0])
        assert (state.pose[1:] != world.truth[1:]).any()
    assert accepted > 5
