"""Maps to start from: valid, every sensor in white, and different from chain to chain."""

from __future__ import annotations

import itertools
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
import shapely

from prf.configuration import Cooling
from prf.kernels import constants as c
from prf.model.coloring import Coloring, black_at, occupied_polygons, violations
from prf.model.window import Window
from prf.sampler import Ensemble, starts
from prf.sampler.anneal import Annealed, anneal, inverse_temperature
from prf.sampler.session import StopRule
from prf.sampler.starts import contour_map, find_start_map, map_of_region
from prf.sampler.target import Execution, Target, make_chain
from prf.shell.cli.storage import spawn_generators
from prf.shell.errors import ArgumentError, ConfigError
from tests.driving import find_starts
from tests.reference.beams import Sensor
from tests.reference.slow_sonar import Ring
from tests.reference.sonar_worlds import draw_sonar_world
from tests.reference.worlds import World, draw_world, office

ROOM = Window(0.0, 0.0, 10.0, 10.0)


def never() -> bool:
    return False


@pytest.fixture(scope="module")
def target(data_dir: Path) -> Target:
    window, data = office(data_dir, 3, 2)
    return Target(window, 0.1, data)


def log_posterior(target: Target, coloring: Coloring) -> float:
    sums = make_chain(target, coloring).graph.sums
    return float(sums[c.LOG_PRIOR] + sums[c.LOG_LIKELIHOOD])


def test_contours_are_valid_better_than_nothing_and_differ(target: Target) -> None:
    assert target.laser is not None
    empty = log_posterior(target, Coloring.empty(target.window))
    found = [contour_map(target, np.random.default_rng(k)) for k in range(3)]
    for coloring in found:
        assert not violations(coloring)
        assert not black_at(coloring, target.laser.readings.origin).any()
        assert coloring.n_edges > 100
        assert log_posterior(target, coloring) > empty + 2000.0
    assert len({coloring.xy.tobytes() for coloring in found}) == 3
    again = contour_map(target, np.random.default_rng(0))
    assert np.array_equal(again.xy, found[0].xy)


@pytest.mark.parametrize("seed", range(6))
def test_contours_of_small_worlds_are_valid(seed: int) -> None:
    world = draw_world(0.4, ROOM, Sensor(6.0), 5, 60, np.random.default_rng(seed))
    coloring = contour_map(Target(ROOM, 0.4, world.data), np.random.default_rng(seed))
    assert not violations(coloring)
    assert not black_at(coloring, world.data.readings.origin).any()


def test_a_region_that_touches_sensors_border_and_itself_becomes_a_map() -> None:
    world = draw_world(0.4, ROOM, Sensor(6.0), 3, 10, np.random.default_rng(1))
    squares = [shapely.box(0, 0, 2, 2), shapely.box(2, 2, 4, 4), shapely.box(8, 8, 10, 10)]
    on_sensors = shapely.buffer(shapely.points(world.data.readings.origin), 0.3)
    region = shapely.union_all([*squares, *on_sensors])
    coloring = map_of_region(region, Target(ROOM, 0.4, world.data))
    assert not violations(coloring)
    assert not black_at(coloring, world.data.readings.origin).any()
    assert occupied_polygons(coloring).area == pytest.approx(region.area, rel=0.1)


def test_a_draw_of_the_prior_leads_to_a_map_of_the_readings(target: Target, monkeypatch: pytest.MonkeyPatch) -> None:
    assert target.laser is not None
    monkeypatch.setattr(starts, "LOOK", 3000)
    empty = log_posterior(target, Coloring.empty(target.window))
    found = [find_start_map("prior", target, np.random.default_rng(k), never) for k in range(2)]
    for coloring in found:
        assert not violations(coloring)
        assert not black_at(coloring, target.laser.readings.origin).any()
        assert log_posterior(target, coloring) > empty + 2000.0
    assert not np.array_equal(found[0].xy[:5], found[1].xy[:5])


@pytest.mark.parametrize("seed", range(5))
def test_a_search_cut_short_still_frees_every_sensor(seed: int) -> None:
    """From draws whose black covers half of the window."""
    world = draw_world(0.3, ROOM, Sensor(6.0), 8, 20, np.random.default_rng(seed))
    target = Target(ROOM, 0.3, world.data)
    coloring = find_start_map("prior", target, np.random.default_rng(seed), lambda: True)
    assert not violations(coloring)
    assert not black_at(coloring, world.data.readings.origin).any()
    assert coloring.n_edges > 0


def test_sonar_may_start_from_the_prior_and_not_from_a_grid() -> None:
    data = draw_sonar_world(0.3, ROOM, Ring(), 3, 12, 0.5, np.random.default_rng(3)).data
    target = Target(ROOM, 0.3, sonar=data)
    coloring = find_start_map("prior", target, np.random.default_rng(1), lambda: True)
    assert not black_at(coloring, data.readings.origin).any()
    with pytest.raises(ConfigError, match="start grid"):
        contour_map(target, np.random.default_rng(1))


def test_the_empty_start_is_the_empty_map(target: Target) -> None:
    assert find_start_map("empty", target, np.random.default_rng(1), never).n_edges == 0


def test_chains_start_at_the_given_maps(target: Target) -> None:
    with_image = Target(target.window, 0.1, target.laser, execution=Execution(resolution=1.0))
    sampler = Ensemble(with_image, spawn_generators(1, 2), starts_from="grid")
    find_starts(sampler)
    edges = [int(chain.chain.graph.counts[c.EDGES]) for chain in sampler.chains]
    assert min(edges) > 100
    assert edges[0] != edges[1]
    assert sampler.step == 0


# The best map: cooled chains end better than they sampled, on a map that is the truth but for the noise.


STEPS = 300_000
SHORT = 40_000


def score_of(annealed_target: Target, coloring: Coloring) -> float:
    """The maximised density, from a fresh chain at the map."""
    graph = make_chain(annealed_target, coloring).graph
    prior = (
        graph.counts[c.EDGES] * np.log(annealed_target.scale) - 2.0 * annealed_target.scale * graph.sums[c.TOTAL_LENGTH]
    )
    return float(prior + graph.sums[c.LOG_LIKELIHOOD])


@pytest.fixture(scope="module")
def world() -> World:
    return draw_world(0.2, ROOM, Sensor(6.0), 6, 60, np.random.default_rng(5))


@pytest.fixture(scope="module")
def annealed_target(world: World) -> Target:
    return Target(ROOM, 0.2, world.data)


@pytest.fixture(scope="module")
def annealed(annealed_target: Target) -> Annealed:
    return anneal(annealed_target, spawn_generators(1, 3), StopRule(STEPS))


class TestAnneal:
    def test_best_is_a_valid_map_with_the_score_that_it_states(
        self, annealed_target: Target, annealed: Annealed
    ) -> None:
        assert violations(annealed.best) == []
        assert occupied_polygons(annealed.best).is_valid
        assert annealed.score == pytest.approx(score_of(annealed_target, annealed.best), rel=1e-9)
        assert annealed.score == max(annealed.by_chain)
        assert annealed.share == 1.0

    def test_it_beats_the_truth(self, world: World, annealed_target: Target, annealed: Annealed) -> None:
        assert annealed.score > score_of(annealed_target, world.coloring)

    def test_it_beats_what_sampling_meets(self, annealed_target: Target, annealed: Annealed) -> None:
        """The negative control: the same steps without cooling."""
        hot = Cooling(warm=0.999, polish=0.0)
        warm = anneal(annealed_target, spawn_generators(1, 3), StopRule(STEPS), cooling=hot)
        assert warm.score < annealed.score

    def test_threads_change_nothing(self, annealed_target: Target) -> None:
        one = anneal(annealed_target, spawn_generators(1, 2), StopRule(SHORT))
        with ThreadPoolExecutor(2) as pool:
            two = anneal(annealed_target, spawn_generators(1, 2), StopRule(SHORT), pool.map)
        assert one.by_chain == two.by_chain
        np.testing.assert_array_equal(one.best.xy, two.best.xy)

    def test_a_stop_keeps_the_best_so_far(self, annealed_target: Target) -> None:
        seen: list[float] = []
        found = anneal(
            annealed_target,
            spawn_generators(1, 1),
            StopRule(10 * STEPS),
            on_progress=lambda moment: seen.append(moment.score),
            stop_requested=lambda: len(seen) >= 2,
        )
        assert found.share < 1.0
        assert found.score == seen[-1]

    def test_few_vertices_on_the_demo_office(self, data_dir: Path) -> None:
        window, data = office(data_dir, 4, 4)
        found = anneal(Target(window, 0.1, data), spawn_generators(1, 1), StopRule(200_000))
        assert found.best.n_vertices < 300, "splinters: the mode over vertices, not over lines"


class TestCooling:
    def test_temperature_falls_from_one_to_nothing(self) -> None:
        cooling = Cooling()
        temperatures = [1.0 / inverse_temperature(cooling, share) for share in np.linspace(0.0, 1.0, 101)]
        assert temperatures[0] == temperatures[29] == 1.0
        assert all(later <= before for before, later in itertools.pairwise(temperatures))
        assert min(t for t in temperatures if t > 1e-9) >= cooling.coldest
        assert temperatures[-1] < 1e-9

    @pytest.mark.parametrize(
        "wrong", [{"coldest": 0.0}, {"coldest": 2.0}, {"warm": 0.9, "polish": 0.2}, {"warm": -0.1}]
    )
    def test_what_does_not_cool_is_refused(self, wrong: dict[str, float]) -> None:
        with pytest.raises(ArgumentError):
            Cooling(**wrong)
