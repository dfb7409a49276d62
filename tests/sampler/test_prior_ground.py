"""Ground that no reading concerns: steps there leave every likelihood as it is, and what is closed stays."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest
import shapely

from prf.kernels import constants as c
from prf.kernels.readings.cones import CONE_LOG_LIKELIHOOD
from prf.kernels.state.build import recompute_sums
from prf.kernels.state.chain import Chain
from prf.kernels.state.grid import Grid
from prf.model.coloring import Coloring, Draws, black_at, from_polygons, violations
from prf.model.layout import pixel_centres, read_coloring
from prf.model.ranges import beam_influence
from prf.model.sensors import LaserModel
from prf.model.window import Window
from prf.sampler import Ensemble, mcmc_draws
from prf.sampler.chain import ChainRun
from prf.sampler.checkpoint import load_checkpoint, save_checkpoint
from prf.sampler.prior import BURN_IN_DRAWS, chosen_thin
from prf.sampler.schedules import LadderPlan
from prf.sampler.starts import (
    PriorGround,
    closed_boxes,
    closed_rays,
    coned_cells,
    influence_of,
    passed_cells,
    prior_ground,
)
from prf.sampler.target import Execution, LaserData, Target, laser_data, make_chain, run_chain, settle_image
from prf.shell.cli.storage import spawn_generators
from tests.driving import advance, find_starts, step_to
from tests.reference.beams import Sensor
from tests.reference.chain_state import digest, structural_faults
from tests.reference.free_way import blocked_pairs
from tests.reference.recompute import differences
from tests.reference.slow_points import Flips, lattice, observe
from tests.reference.slow_sonar import Ring
from tests.reference.sonar_worlds import draw_data, ring_all_round
from tests.reference.worlds import World, draw_world

ROOM = Window(0.0, 0.0, 16.0, 16.0)
SCALE = 0.25
NO_PROBES = np.zeros(0, np.int64)
KINDS = ("laser", "no returns", "censored", "sonar", "both on a way")


def never() -> bool:
    return False


def world() -> World:
    return draw_world(SCALE, ROOM, Sensor(4.0), 3, 40, np.random.default_rng(8))


def target_of(kind: str) -> Target:
    """Sensors in a world of the prior, of which most is out of reach."""
    found, rng = world(), np.random.default_rng(9)
    laser: LaserData | None = found.data
    sonar = None
    if kind == "no returns":
        ranges = np.where(rng.random(120) < 0.5, np.inf, found.data.readings.range)
        laser = dataclasses.replace(found.data, readings=dataclasses.replace(found.data.readings, range=ranges))
    if kind == "censored":
        laser = beside_the_border(rng)
    if kind in ("sonar", "both on a way"):
        places = np.unique(found.data.readings.origin, axis=0)
        sonar = draw_data(found.coloring, Ring(3.0), ring_all_round(places, 8, 0.4, rng), rng)
    laser = None if kind == "sonar" else laser
    target = Target(ROOM, SCALE, laser, sonar=sonar, execution=Execution(resolution=0.5))
    if kind == "both on a way":
        target = dataclasses.replace(target, way=np.array([[1.0, 14.0, 14.0, 14.5]]), driven_radius=0.2)
    return target


def beside_the_border(rng: np.random.Generator) -> LaserData:
    """A sensor half a metre from the border, whose readings end within the window and far beyond it."""
    angle = rng.uniform(-np.pi, np.pi, 80)
    readings = np.where(rng.random(80) < 0.7, rng.uniform(0.3, 7.0, 80), np.inf)
    return laser_data(np.tile([0.5, 8.0], (80, 1)), angle, readings, LaserModel(8.0, noise=0.02))


def log_likelihoods(chain: Chain) -> bytes:
    return chain.beams.ray[:, c.BEAM_LOG_LIKELIHOOD].tobytes() + chain.cones.pose[:, CONE_LOG_LIKELIHOOD].tobytes()


def ends(coloring: Coloring) -> set[tuple[float, ...]]:
    return {tuple(sorted([(a, b), (x, y)])) for a, b, x, y in coloring.segments().tolist()}  # type: ignore[misc]


def closed_region(target: Target, chain: Chain) -> shapely.Geometry:
    """Beams up to what they meet, and the cells of cones."""
    rays = closed_rays(chain, influence_of(target, chain))
    boxes = closed_boxes(chain.edge_index.grid, coned_cells(target, chain))
    tips = rays[:, 1:3] + rays[:, 5:6] * rays[:, 3:5]
    lines = shapely.linestrings(np.stack([rays[:, 1:3], tips], axis=1))
    return shapely.GeometryCollection([*lines, *shapely.box(*boxes[:, 1:5].T)])


def meeting(coloring: Coloring, region: shapely.Geometry) -> Coloring:
    lines = shapely.linestrings(coloring.segments().reshape(-1, 2, 2))
    return coloring._replace(edges=coloring.edges[shapely.intersects(lines, region)])


@pytest.mark.parametrize("kind", KINDS)
def test_steps_there_leave_every_likelihood_to_the_last_bit(kind: str) -> None:
    target, rng = target_of(kind), np.random.default_rng(1)
    chain = make_chain(target, Coloring.empty(ROOM))
    ground = PriorGround(target, chain)
    n_frozen = n_new = 0
    for _ in range(8):
        chain = run_chain(chain, rng, int(chain.graph.counts[c.STEP]) + 5000)
        before, likelihoods = read_coloring(chain.graph), log_likelihoods(chain)
        total, step = float(chain.graph.sums[c.LOG_LIKELIHOOD]), int(chain.graph.counts[c.STEP])
        outcomes, region = chain.outcomes.copy(), closed_region(target, chain)
        guards = ground.closed(chain)
        chain = ground.settle(ground.refresh(ground.refresh(chain, guards, rng, 1500), guards, rng, 1500))
        after = read_coloring(chain.graph)
        assert chain.graph.counts[c.STEP] == step
        assert np.array_equal(chain.outcomes, outcomes)
        assert chain.graph.sums[c.LOG_LIKELIHOOD] == total
        assert log_likelihoods(chain) == likelihoods
        assert closed_region(target, chain) == region
        n_frozen += len(ends(meeting(before, region)))
        assert ends(meeting(after, region)) == ends(meeting(before, region))
        n_new += len(ends(after) - ends(before))
        assert violations(after) == []
        assert blocked_pairs(target, after) == 0
        holds_after_a_block(chain)
    assert n_frozen > 20
    assert n_new > 100


def holds_after_a_block(chain: Chain) -> None:
    recompute_sums(chain)
    assert differences(chain) == []
    assert structural_faults(chain) == []


def test_closed_cells_left_open_are_caught() -> None:
    """The negative control: without the boxes likelihoods of the map are no longer those that are kept."""
    target, rng = target_of("laser"), np.random.default_rng(1)
    chain = make_chain(target, Coloring.empty(ROOM))
    ground = PriorGround(target, chain)
    guards = ground.closed(chain)
    guards = guards._replace(lists=np.zeros_like(guards.lists))
    chain = ground.settle(ground.refresh(run_chain(chain, rng, 20_000), guards, rng, 10_000))
    assert {"log likelihood", "beam log likelihoods"} <= set(differences(chain))


def test_room_is_made_on_the_way() -> None:
    """From the empty map to a thousand edges, in an index of cells with hardly any room."""
    wide = Window(0.0, 0.0, 60.0, 60.0)
    target = Target(wide, 0.15, world().data, execution=Execution(resolution=1.0))
    chain = make_chain(target, Coloring.empty(wide))
    room = len(chain.graph.edge_length)
    ground = prior_ground(target, chain)
    assert ground is not None
    chain = ground.settle(ground.refresh(chain, ground.closed(chain), np.random.default_rng(2), 200_000))
    assert len(chain.graph.edge_length) > room
    assert chain.graph.counts[c.EDGES] > room
    assert chain.graph.counts[c.STEP] == 0
    holds_after_a_block(chain)


def test_a_start_has_no_steps_and_is_what_its_map_says() -> None:
    for plan in (None, LadderPlan(2, 0.0)):
        sampler = ChainRun(target_of("both on a way"), np.random.default_rng(3), NO_PROBES)
        if plan is not None:
            sampler.temper(plan)
        sampler.find_start(math.inf, never)
        assert sampler.step == 0
        assert not sampler.chain.outcomes.any()
        assert sampler.chain.graph.counts[c.EDGES] > 10
        assert differences(sampler.chain) == structural_faults(sampler.chain) == []
        assert not sampler.chain.image.black_time.any()
        for _ in range(2):
            sampler.advance()
            assert differences(sampler.chain) == structural_faults(sampler.chain) == []
        for each in sampler.ladder.hot if sampler.ladder is not None else []:
            assert differences(each) == structural_faults(each) == []


def test_a_search_that_is_stopped_starts_all_the_same() -> None:
    sampler = ChainRun(target_of("laser"), np.random.default_rng(3), NO_PROBES)
    sampler.find_start(math.inf, lambda: True)
    assert sampler.step == sampler.chain.graph.counts[c.EDGES] == 0


@pytest.mark.parametrize("kind", ["laser", "both on a way"])
@pytest.mark.parametrize("tiles", [0, 3])
def test_a_resumed_run_is_the_same_to_the_last_bit(kind: str, tiles: int, tmp_path: Path) -> None:
    target = target_of(kind).with_execution(tiles=tiles)
    whole = Ensemble(target, spawn_generators(7, 1))
    assert whole.chains[0].ground is not None
    find_starts(whole)
    for k in range(6):
        if k == 3:
            save_checkpoint(tmp_path, whole, "this run")
        advance(whole)
    resumed = Ensemble(target, spawn_generators(7, 1))
    load_checkpoint(tmp_path, resumed, "this run")
    for _ in range(3):
        advance(resumed)
    one, other = whole.chains[0], resumed.chains[0]
    assert one.chain.graph.counts[c.EDGES] > 20
    assert digest(one.chain, one.rng) == digest(other.chain, other.rng)


def test_the_image_is_the_average_over_every_step_and_over_nothing_else() -> None:
    """What proposals there make of the map counts from the next step on."""
    sampler = ChainRun(target_of("laser"), np.random.default_rng(3), NO_PROBES)
    sampler.find_start(math.inf, never)
    image = sampler.chain.image
    centres, black = pixel_centres(image.grid), np.zeros(image.black.size, np.int64)
    turned = 0
    for _ in range(4):
        for _ in range(20):
            black += black_at(read_coloring(sampler.chain.graph), centres)
            step_to(sampler, sampler.step + 1)
        before = sampler.chain.image.black.copy()
        sampler.redraw_ground(3000)
        sampler.settle()
        turned += int((sampler.chain.image.black != before).sum())
    assert turned > 40
    settle_image(sampler.chain)
    assert np.array_equal(sampler.chain.image.black_time, black)
    assert sampler.step == 80


def test_there_is_none_with_point_values_or_hardly_any_unseen_ground() -> None:
    target, found = target_of("laser"), world()
    start = Coloring.empty(ROOM)
    assert prior_ground(target, make_chain(target, start)) is not None
    values = observe(found.coloring, Flips(), lattice(5, 1.0, 15.0), np.random.default_rng(1))
    for none in (
        dataclasses.replace(target, points=values),
        dataclasses.replace(target, laser=None),
        dataclasses.replace(target, scale=0.01),
    ):
        assert prior_ground(none, make_chain(none, start)) is None


def test_beams_close_what_may_concern_their_readings_and_the_cells_that_they_pass_count() -> None:
    target = target_of("laser")
    chain = make_chain(target, Coloring.empty(ROOM))
    assert target.laser is not None
    laser, model = target.laser.readings, target.laser.model
    influence = np.minimum(beam_influence(model, laser.range), model.limit)
    tips = laser.origin + influence[:, None] * np.column_stack([np.cos(laser.angle), np.sin(laser.angle)])
    rays = closed_rays(chain, influence_of(target, chain))
    found = rays[:, 1:3] + rays[:, 5:6] * rays[:, 3:5]
    inside = ROOM.contains(tips)
    np.testing.assert_allclose(found[inside], tips[inside], atol=1e-9)
    grid = chain.edge_index.grid
    passed = passed_cells(grid, rays)
    for share in (0.0, 0.3, 1.0 - 1e-9):
        column, row = np.floor((rays[:, 1:3] + share * (found - rays[:, 1:3]) - (grid.x0, grid.y0)) / grid.cell).T
        assert passed[row.astype(int), column.astype(int)].all()
    assert passed.mean() < 0.6


def test_a_wall_frees_the_ground_behind_it() -> None:
    """Of beams that it stops; those that miss it close the ground beside it."""
    origin, angle = np.tile([4.0, 8.0], (41, 1)), np.linspace(-0.4, 0.4, 41)
    target = Target(ROOM, SCALE, laser_data(origin, angle, np.full(41, 10.0), LaserModel(12.0)))
    wall = from_polygons(shapely.box(7.0, 7.5, 7.2, 8.5), ROOM)
    empty, walled = (closed_region(target, make_chain(target, start)) for start in (Coloring.empty(ROOM), wall))
    behind, beside = shapely.LineString([[11.0, 7.8], [11.0, 8.2]]), shapely.LineString([[11.0, 10.0], [11.0, 10.4]])
    assert [region.intersects(behind) for region in (empty, walled)] == [True, False]
    assert [region.intersects(beside) for region in (empty, walled)] == [True, True]
    front, back = shapely.LineString([[7.0, 7.5], [7.0, 8.5]]), shapely.LineString([[7.2, 7.5], [7.2, 8.5]])
    assert walled.intersects(front)
    assert not walled.intersects(back.segmentize(0.5).intersection(shapely.box(7.0, 7.7, 8.0, 8.3)))


@pytest.mark.parametrize("seed", range(5))
def test_boxes_cover_the_closed_cells_and_no_other_and_none_twice(seed: int) -> None:
    rng = np.random.default_rng(seed)
    is_closed = rng.random((17, 11)) < (0.0, 0.2, 0.6, 0.9, 1.0)[seed]
    is_closed[3:9, 2:7] = seed > 0
    grid = Grid(-3.0, 2.0, 0.5, 11, 17)
    boxes = closed_boxes(grid, is_closed)
    count = np.zeros(is_closed.shape, int)
    for x0, y0, x1, y1 in ((boxes[:, 1:5] - [-3.0, 2.0, -3.0, 2.0]) / 0.5).round().astype(int).tolist():
        count[y0:y1, x0:x1] += 1
    assert np.array_equal(count, is_closed.astype(int))
    assert len(boxes) <= np.count_nonzero(is_closed)


# Draws from the prior by the chain: spacing, burn-in, seeds. Their laws are looked at in tests/statistical.


UNIT = Window(0.0, 0.0, 1.0, 1.0)


def same(one: Draws, two: Draws) -> bool:
    return np.array_equal(one.xy, two.xy) and np.array_equal(one.edges, two.edges)


def test_draws_are_valid_and_repeat_with_their_seed() -> None:
    draws, thin = mcmc_draws(1.0, UNIT, 50, seed=3)
    assert len(draws) == 50
    assert thin == chosen_thin(1.0, UNIT)
    assert not any(violations(coloring) for coloring in draws)
    assert same(draws, mcmc_draws(1.0, UNIT, 50, seed=3)[0])
    assert not same(draws, mcmc_draws(1.0, UNIT, 50, seed=4)[0])


def test_the_first_draw_knows_nothing_of_the_spacing() -> None:
    close, thin = mcmc_draws(1.0, UNIT, 3, thin=300, seed=5)
    wide, twice = mcmc_draws(1.0, UNIT, 1, thin=600, seed=5)
    assert (thin, twice) == (300, 600)
    assert same(Draws.from_colorings([close[0]]), wide)
    assert not same(Draws.from_colorings([close[1]]), wide)


def test_the_spacing_grows_with_the_edges_to_be_expected() -> None:
    assert chosen_thin(1.0, UNIT) == 1329
    assert chosen_thin(0.4, Window(0.0, 0.0, 10.0, 10.0)) == 11_354
    assert BURN_IN_DRAWS >= 20


@pytest.mark.slow
def test_the_white_start_is_forgotten() -> None:
    """The very first draw of many seeds: half of the centres are black, and edges are as many as the law says."""
    first = [mcmc_draws(1.0, UNIT, 1, seed=seed)[0] for seed in range(60)]
    z_black = (np.mean([draws.anchor_black[0] for draws in first]) - 0.5) / np.sqrt(0.25 / 60)
    edges = np.array([draws.n_edges[0] for draws in first])
    z_edges = (edges.mean() - (4.0 + 4.0 * np.pi)) / (edges.std(ddof=1) / np.sqrt(60))
    assert abs(z_black) < 4.0
    assert abs(z_edges) < 4.0
