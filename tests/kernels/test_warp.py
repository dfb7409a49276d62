"""A warp: undone by its opposite, its Jacobian that of differences; maps stay valid, and colours where they are."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
import shapely

from prf.kernels import constants as c
from prf.kernels.poses import warp as w
from prf.model.coloring import Coloring, black_at, violations
from prf.model.layout import make_guards, read_coloring
from prf.readings.ground import way_guards
from tests.reference.pose_worlds import BARE, DRIVEN, PoseWorld, begin, draw_pose_world, scratch
from tests.reference.recompute import cell_lists, recompute_edge_cells, recompute_log_prior

pytestmark = pytest.mark.uncompiled

CENTRE = (2.5, 3.1)


def field(radius: float, x: float, y: float, turn: float) -> np.ndarray:
    work = np.zeros(48)
    work[w.CENTRE : w.CENTRE + 2], work[w.RADIUS], work[w.MOTION : w.MOTION + 3] = CENTRE, radius, (x, y, turn)
    return work


def moved(work: np.ndarray, point: np.ndarray) -> np.ndarray:
    assert w.displace(work, *point)
    return work[w.PLACE : w.PLACE + 2].copy()


FIELDS = [field(2.0, 0.2, -0.1, 0.2), field(1.0, -0.15, 0.1, -0.15), field(np.inf, 0.3, 0.2, 0.3)]


@pytest.mark.parametrize("work", FIELDS, ids=["wide", "narrow", "all"])
def test_the_opposite_field_leads_back(work: np.ndarray) -> None:
    rng, still = np.random.default_rng(1), 0
    for point in rng.uniform(0.5, 4.5, (100, 2)):
        there = moved(work, point)
        log_scaled, turned = work[w.LOG_SCALED], work[w.TURNED]
        work[w.MOTION : w.MOTION + 3] *= -1.0
        np.testing.assert_allclose(moved(work, there), point, rtol=0.0, atol=1e-12)
        assert work[w.LOG_SCALED] == pytest.approx(-log_scaled, abs=1e-11)
        assert work[w.TURNED] == pytest.approx(-turned, abs=1e-11)
        work[w.MOTION : w.MOTION + 3] *= -1.0
        still += bool((there == point).all())
    assert (still > 5) == np.isfinite(work[w.RADIUS])


@pytest.mark.parametrize("work", FIELDS, ids=["wide", "narrow", "all"])
def test_its_jacobian_and_its_turn_are_those_of_differences(work: np.ndarray) -> None:
    rng = np.random.default_rng(2)
    for point in rng.uniform(1.8, 3.2, (50, 2)):
        steps = 1e-5 * np.eye(2)
        slope = np.array([(moved(work, point + step) - moved(work, point - step)) / 2e-5 for step in steps]).T
        moved(work, point)
        assert work[w.LOG_SCALED] == pytest.approx(np.log(np.linalg.det(slope)), abs=1e-8)
        left, _, right = np.linalg.svd(slope)
        nearest = left @ right
        assert work[w.TURNED] == pytest.approx(np.arctan2(nearest[1, 0], nearest[0, 0]), abs=1e-8)


def test_a_field_that_is_used_moves_no_two_points_to_one_place() -> None:
    """Half of its slope is below 1/2 wherever it acts; steeper ones are drawn, and not used."""
    rng = np.random.default_rng(3)
    chain, turns = begin(draw_pose_world(BARE, rng))
    state, used = turns.state, 0
    for _ in range(300):
        if not w.draw_field(chain.graph.window, state, rng):
            continue
        used += 1
        centre, radius = state.work[w.CENTRE : w.CENTRE + 2], min(state.work[w.RADIUS], 3.0)
        points = centre + rng.uniform(-radius, radius, (8, 2))
        for one, other in itertools.pairwise(points):
            gap = np.hypot(*(one - other))
            apart = np.hypot(*(moved(state.work, one) - moved(state.work, other)))
            assert gap / 3.0 < apart < 3.0 * gap  # (1 + 1/2) / (1 - 1/2)
    assert 50 < used < 290


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
