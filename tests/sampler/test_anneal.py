"""The best map: cooled chains end better than they sampled, on a map that is the truth but for the noise."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pytest

from prf.configuration import Cooling
from prf.kernels import constants as c
from prf.model.coloring import Coloring, occupied_polygons, violations
from prf.model.window import Window
from prf.sampler.anneal import Annealed, anneal, inverse_temperature
from prf.sampler.driver import StopRule
from prf.sampler.posterior import Settings, make_chain
from prf.shell.cli.provenance import spawn_generators
from prf.shell.errors import ArgumentError
from tests.reference.beams import Sensor
from tests.reference.worlds import World, draw_world, office

ROOM = Window(0.0, 0.0, 10.0, 10.0)
STEPS = 300_000
SHORT = 40_000


def score_of(settings: Settings, coloring: Coloring) -> float:
    """The maximised density, from a fresh chain at the map."""
    graph = make_chain(settings, coloring).graph
    prior = graph.counts[c.EDGES] * np.log(settings.scale) - 2.0 * settings.scale * graph.sums[c.TOTAL_LENGTH]
    return float(prior + graph.sums[c.LOG_LIKELIHOOD])


@pytest.fixture(scope="module")
def world() -> World:
    return draw_world(0.2, ROOM, Sensor(6.0), 6, 60, np.random.default_rng(5))


@pytest.fixture(scope="module")
def settings(world: World) -> Settings:
    return Settings(ROOM, 0.2, world.data)


@pytest.fixture(scope="module")
def annealed(settings: Settings) -> Annealed:
    return anneal(settings, spawn_generators(1, 3), StopRule(STEPS), threads=2)


class TestAnneal:
    def test_best_is_a_valid_map_with_the_score_that_it_states(self, settings: Settings, annealed: Annealed) -> None:
        assert violations(annealed.best) == []
        assert occupied_polygons(annealed.best).is_valid
        assert annealed.score == pytest.approx(score_of(settings, annealed.best), rel=1e-9)
        assert annealed.score == max(annealed.by_chain)
        assert annealed.share == 1.0

    def test_it_beats_the_truth(self, world: World, settings: Settings, annealed: Annealed) -> None:
        assert annealed.score > score_of(settings, world.coloring)

    def test_it_beats_what_sampling_meets(self, settings: Settings, annealed: Annealed) -> None:
        """The negative control: the same steps without cooling."""
        warm = anneal(settings, spawn_generators(1, 3), StopRule(STEPS), Cooling(warm=0.999, polish=0.0), threads=2)
        assert warm.score < annealed.score

    def test_threads_change_nothing(self, settings: Settings) -> None:
        one, two = (anneal(settings, spawn_generators(1, 2), StopRule(SHORT), threads=threads) for threads in (1, 2))
        assert one.by_chain == two.by_chain
        np.testing.assert_array_equal(one.best.xy, two.best.xy)

    def test_a_stop_keeps_the_best_so_far(self, settings: Settings) -> None:
        seen: list[float] = []
        found = anneal(
            settings,
            spawn_generators(1, 1),
            StopRule(10 * STEPS),
            on_progress=lambda moment: seen.append(moment.score),
            stop_requested=lambda: len(seen) >= 2,
        )
        assert found.share < 1.0
        assert found.score == seen[-1]

    def test_few_vertices_on_the_demo_office(self, data_dir: Path) -> None:
        window, data = office(data_dir, 4, 4)
        found = anneal(Settings(window, 0.1, data), spawn_generators(1, 1), StopRule(200_000))
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
