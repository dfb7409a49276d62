"""The laser's parameters, and its beams laid out: reach, impacts against shapely, the grid's traps, no leaks."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from scipy import integrate

from prf.kernels import constants as c
from prf.kernels.readings.laser_change import FADED
from prf.kernels.state.chain import Chain
from prf.model.arak import exact_draws
from prf.model.coloring import Coloring, black_at
from prf.model.ranges import aims_of, best_log_density, laser_array, make_rays, window_exit
from prf.model.sensors import LaserModel
from prf.model.window import INTERIOR, Window
from prf.sampler.target import Execution, Target, laser_data, make_chain
from prf.shell.errors import ArgumentError
from tests.kernels.entries import hit_table, log_likelihoods
from tests.reference.beams import Sensor, exit_by_shapely, impacts, mass_from
from tests.reference.recompute import recompute_impacts

UNIT = Window(0.0, 0.0, 1.0, 1.0)
ROOM = Window(-5.0, -5.0, 5.0, 5.0)
LONG = Window(3.0, -1.5, 43.0, 2.5)
FAR = Window(1e5, -3e5, 1e5 + 20.0, -3e5 + 12.0)
CASES = [
    pytest.param(UNIT, 4.0, id="unit"),
    pytest.param(ROOM, 0.4, id="room"),
    pytest.param(LONG, 0.5, id="long"),
    pytest.param(FAR, 0.3, id="far from the origin"),
]


def test_weights_that_leave_nothing_for_hits_are_refused() -> None:
    with pytest.raises(ArgumentError, match="sum"):
        LaserModel(10.0, outlier_probability=0.6, miss_probability=0.4)
    assert LaserModel(10.0, outlier_probability=0.6, miss_probability=0.3).hit_probability == pytest.approx(0.1)


@pytest.mark.parametrize(("window", "scale"), CASES)
def test_rays_leave_the_window_where_shapely_finds_it(window: Window, scale: float) -> None:
    rng = np.random.default_rng(4)
    origin = rng.uniform(window[:2], window[2:], (200, 2))
    angle = np.concatenate([rng.uniform(-np.pi, np.pi, 160), np.arange(-20, 20) * np.pi / 2])
    direction = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    expected = [exit_by_shapely(window, start, turn) for start, turn in zip(origin, direction, strict=True)]
    tolerance = 1e-12 * max(abs(bound) for bound in window)
    assert window_exit(window, origin, direction) == pytest.approx(np.array(expected), rel=1e-9, abs=tolerance)


def test_rays_keep_readings_and_reach() -> None:
    origin, angle = np.full((4, 2), 0.5), np.zeros(4)
    ray = make_rays(UNIT, LaserModel(0.3), origin, angle, np.array([0.1, 0.3, 7.0, np.inf]))
    assert ray[:, c.RANGE].tolist() == [0.1, math.inf, math.inf, math.inf]
    assert ray[:, c.MAX_DISTANCE].tolist() == [0.3] * 4
    assert make_rays(UNIT, LaserModel(9.0), origin, angle, np.ones(4))[:, c.MAX_DISTANCE].tolist() == [0.5] * 4


def test_a_reading_beyond_the_window_is_censored_at_its_border() -> None:
    origin, angle = np.full((5, 2), 0.5), np.zeros(5)
    ray = make_rays(UNIT, LaserModel(9.0), origin, angle, np.array([0.4, 0.5, 3.0, 9.0, np.inf]))
    assert ray[:, c.RANGE].tolist() == [0.4, -0.5, -0.5, -0.5, -0.5]


@pytest.mark.parametrize("distance", [0.02, 0.5, 1.99, 2.0, 2.005, 2.05, 4.0, 9.0, math.inf])
@pytest.mark.parametrize("bound", [0.05, 2.0, 7.999, 8.0])
def test_densities_below_the_border_and_the_mass_beyond_sum_to_one(bound: float, distance: float) -> None:
    """Against the formula, and by quadrature with cuts round the peak."""
    model, sensor = LaserModel(8.0), Sensor(8.0)

    def log_density(reading: float) -> float:
        found = np.zeros(1)
        log_likelihoods(laser_array(model), np.array([reading]), np.array([distance]), found)
        return float(found[0])

    mass = math.exp(log_density(-bound))
    assert mass == pytest.approx(mass_from(sensor, bound, distance), rel=1e-12)
    peak = min(distance, 10.0) + 0.03 * np.array([-9.0, -3.0, -1.0, 0.0, 1.0, 3.0, 9.0])
    cuts = np.unique(np.clip([0.0, *peak, bound], 0.0, bound)).tolist()
    pieces = [integrate.quad(lambda r: math.exp(log_density(r)), *ends)[0] for ends in itertools.pairwise(cuts)]
    if distance < bound or distance == math.inf:  # no obstacle is met between the border and the maximum range
        assert sum(pieces) + mass == pytest.approx(1.0, abs=1e-7)


def test_beams_that_end_beyond_the_window_do_not_depend_on_what_is_inside() -> None:
    """They left a share of black at two metres; now they weigh as beams without return do."""
    window, n = Window(0.0, 0.0, 4.0, 4.0), 13
    origin, angle = np.full((n, 2), 0.7), np.linspace(0.5, 1.1, n)
    wall = exact_draws(0.3, window, 20, np.random.default_rng(3))
    for coloring in wall:
        if black_at(coloring, origin[:1])[0]:
            continue
        beyond, silent = (
            make_chain(Target(window, 0.3, laser_data(origin, angle, ranges, LaserModel(10.0))), coloring)
            for ranges in (np.full(n, 8.0), np.full(n, np.inf))
        )
        assert beyond.graph.sums[c.LOG_LIKELIHOOD] == silent.graph.sums[c.LOG_LIKELIHOOD]


def chain_at(
    coloring: Coloring, origin: np.ndarray, angle: np.ndarray, scale: float, max_range: float, cell: float | None = None
) -> Chain:
    """Chain with traced beams; the colour of the sensors does not matter here."""
    data = laser_data(origin, angle, np.full(len(angle), np.inf), LaserModel(max_range))
    return make_chain(Target(coloring.window, scale, data, execution=Execution(cell=cell)), coloring)


def aimed_at_vertices(coloring: Coloring, rng: np.random.Generator, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Origins and angles of rays whose direction is that of an interior vertex, to the last bit of the angle."""
    inner = coloring.xy[coloring.side == INTERIOR]
    origin = rng.uniform(coloring.window[:2], coloring.window[2:], (n, 2))
    goal = inner[rng.integers(len(inner), size=n)]
    return origin, np.arctan2(*(goal - origin).T[::-1])


@pytest.mark.parametrize("max_range", [0.3, 10.0], ids=["short", "long"])
@pytest.mark.parametrize(("window", "scale"), CASES)
def test_impacts_are_those_of_shapely(window: Window, scale: float, max_range: float) -> None:
    rng = np.random.default_rng(5)
    reach = max_range * max(window.width, window.height)
    for coloring in exact_draws(scale, window, 4, rng):
        origin = rng.uniform(window[:2], window[2:], (100, 2))
        angle = np.concatenate([rng.uniform(-np.pi, np.pi, 70), np.arange(30) % 4 * np.pi / 2])
        chain = chain_at(coloring, origin, angle, scale, reach)
        expected = impacts(coloring, origin, angle, reach)
        found = chain.beams.ray[:, c.DISTANCE]
        assert np.array_equal(np.isinf(found), np.isinf(expected))
        tolerance = 1e-10 * max(abs(bound) for bound in window)
        near = np.isfinite(found)
        assert near.any()
        assert found[near] == pytest.approx(expected[near], rel=1e-9, abs=tolerance)


def round_sensors(window: Window, cell: float, chain: Chain) -> tuple[np.ndarray, np.ndarray]:
    """Sensors on round coordinates, and on borders and corners of the very cells, looking along axes and diagonals."""
    grid = chain.edge_index.grid
    i, k = np.meshgrid(np.arange(1, grid.nx - 1), np.arange(1, grid.ny - 1))
    corners = np.stack([grid.x0 + i.ravel() * grid.cell, grid.y0 + k.ravel() * grid.cell], axis=1)
    lattice = np.stack(
        np.meshgrid(
            np.arange(math.ceil(window.x_min), math.floor(window.x_max) + 1, 1.0),
            np.arange(math.ceil(window.y_min), math.floor(window.y_max) + 1, 1.0),
        ),
        axis=-1,
    ).reshape(-1, 2)
    middles = corners + np.array([0.0, 0.5 * cell])
    xy = np.concatenate([corners, middles, lattice])
    xy = xy[window.contains(xy)]
    xy = xy[np.random.default_rng(6).permutation(len(xy))[:150]]
    origin = np.repeat(xy, 8, axis=0)
    return origin, np.tile(np.arange(8) * np.pi / 4, len(xy))


@pytest.mark.parametrize("cell", [0.125, 0.25, 0.3])
def test_sensors_on_borders_of_cells_see_what_asking_every_edge_shows(cell: float) -> None:
    rng = np.random.default_rng(7)
    for coloring in exact_draws(0.5, ROOM, 3, rng):
        bare = chain_at(coloring, np.zeros((0, 2)), np.zeros(0), 0.5, 30.0, cell)
        origin, angle = round_sensors(ROOM, cell, bare)
        chain = chain_at(coloring, origin, angle, 0.5, 30.0, cell)
        brute = recompute_impacts(chain)
        assert np.array_equal(brute.distance, chain.beams.ray[:, c.DISTANCE])
        assert np.array_equal(brute.edge, chain.beams.impact_edge)
        assert np.isfinite(brute.distance).mean() > 0.5


@pytest.mark.parametrize(("window", "scale"), CASES)
def test_rays_through_vertices_see_what_asking_every_edge_shows(window: Window, scale: float) -> None:
    rng = np.random.default_rng(8)
    for coloring in exact_draws(scale, window, 3, rng):
        origin, angle = aimed_at_vertices(coloring, rng, 1000)
        reach = 3.0 * max(window.width, window.height)
        chain = chain_at(coloring, origin, angle, scale, reach)
        brute = recompute_impacts(chain)
        assert np.array_equal(brute.distance, chain.beams.ray[:, c.DISTANCE])
        # A ray that grazes a vertex meets both its edges at one distance: either may be named.
        for beam in np.flatnonzero(brute.edge != chain.beams.impact_edge):
            one, two = (chain.graph.edge_vertices[e[beam]] for e in (brute.edge, chain.beams.impact_edge))
            assert len({*one.tolist(), *two.tolist()}) == 3


@pytest.mark.parametrize(("window", "scale"), CASES)
def test_no_light_leaks_through_vertices(window: Window, scale: float) -> None:
    """A ray meets the edges an even number of times if the window's border behind has its origin's colour, else odd."""
    rng = np.random.default_rng(9)
    n_through = 0
    for coloring in exact_draws(scale, window, 3, rng):
        origin, angle = aimed_at_vertices(coloring, rng, 2000)
        direction = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        reach = window_exit(window, origin, direction)
        distance = np.empty((len(angle), coloring.n_edges))
        hit_table(np.hstack([origin, direction]), coloring.segments(), distance)
        end = origin + (reach * (1.0 - 1e-9))[:, None] * direction
        # An edge that ends beyond `end` by rounding alone would show nothing: leave out what is within a hair of it.
        clear = (np.abs(distance - reach[:, None]) > 1e-7 * reach[:, None]).all(axis=1) & window.contains(end)
        odd = (distance < reach[:, None]).sum(axis=1) % 2 == 1
        assert np.array_equal(odd[clear], (black_at(coloring, origin) != black_at(coloring, end))[clear])
        n_through += int(clear.sum())
    assert n_through > 5000


def test_a_ray_that_grazes_a_vertex_meets_both_edges_or_none() -> None:
    """Vertices at places that floats hold exactly, so that the ray's line runs through them without rounding."""
    rays = np.array([[0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0], [0.0, 0.0, -1.0, 0.0]])
    through = np.array([[1.0, -1.0, 2.0, 0.0], [2.0, 0.0, 3.0, 1.0]])
    peak_below = np.array([[1.0, -1.0, 2.0, 0.0], [2.0, 0.0, 3.0, -1.0]])
    peak_above = np.array([[1.0, 1.0, 2.0, 0.0], [2.0, 0.0, 3.0, 1.0]])
    for segments, numbers in ((through, [1]), (peak_below, [0, 2]), (peak_above, [0, 2])):
        for turned in (segments, segments[:, [2, 3, 0, 1]]):
            distance = np.empty((3, 2))
            hit_table(rays, turned, distance)
            hits = distance[0][np.isfinite(distance[0])]
            assert len(hits) in numbers
            assert (hits == 2.0).all()
            assert np.isinf(distance[1:]).all()


def test_no_beams_and_no_edges() -> None:
    empty = Coloring.empty(ROOM)
    chain = chain_at(empty, np.zeros((0, 2)), np.zeros(0), 0.4, 8.0)
    assert chain.graph.sums[c.LOG_LIKELIHOOD] == 0.0
    chain = chain_at(empty, np.zeros((3, 2)), np.arange(3.0), 0.4, 4.9)
    assert np.isinf(chain.beams.ray[:, c.DISTANCE]).all()
    assert chain.graph.sums[c.LOG_LIKELIHOOD] == pytest.approx(3 * math.log(0.95))


MODELS = [
    LaserModel(8.0),
    LaserModel(30.0, noise=0.05, noise_relative=0.02),
    LaserModel(6.0, noise=2.0, outlier_probability=0.9),
    LaserModel(80.0, noise=0.002, noise_relative=0.0, outlier_probability=1e-6),
    LaserModel(10.0, noise=0.01, noise_relative=0.2),
]


@pytest.mark.parametrize("model", MODELS)
def test_no_distance_gives_a_reading_more_than_its_best(model: LaserModel) -> None:
    """Nor does an obstacle off the aim of a beam help it by more than what the bounds allow for."""
    bounds = -model.max_range * np.array([0.01, 0.3, 0.9, 1.0])
    readings = np.concatenate([np.geomspace(0.01, 0.999 * model.max_range, 40), bounds, [np.inf]])
    ones = np.ones(len(readings))
    best, (near, far) = model.weight * best_log_density(model, readings), aims_of(model, readings, ones)
    grid = np.append(np.linspace(1e-3, model.max_range, 4001), np.inf)
    highest = -np.inf
    for i, reading in enumerate(readings.tolist()):
        close = np.append(grid, np.linspace(0.9, 1.1, 2001) * min(abs(reading), model.max_range))
        values = np.zeros(len(close))
        log_likelihoods(laser_array(model), np.full(len(close), reading), close, values)
        assert values.max() <= best[i]
        highest = max(highest, values.max() - best[i])
        # Cut: the new obstacle at d is before the old one, or there was none.
        order = np.argsort(-close)
        before = np.minimum.accumulate(values[order])
        off = ~((near[i] <= close[order]) & (close[order] <= far[i]))
        assert (values[order] - before)[off].max(initial=0.0) <= FADED
    assert highest > -0.1
