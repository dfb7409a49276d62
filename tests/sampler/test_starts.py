"""Maps to start from: valid, every sensor in white, and different from chain to chain."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import shapely

from prf.kernels import constants as c
from prf.model.coloring import Coloring, black_at, occupied_polygons, violations
from prf.model.window import Window
from prf.sampler import Sampler, starts
from prf.sampler.posterior import Settings, make_chain
from prf.sampler.starts import contour_map, find_start_map, map_of_region
from prf.shell.cli.provenance import spawn_generators
from prf.shell.errors import ConfigError
from tests.reference.beams import Sensor
from tests.reference.slow_sonar import Ring
from tests.reference.sonar_worlds import draw_sonar_world
from tests.reference.worlds import draw_world, office

ROOM = Window(0.0, 0.0, 10.0, 10.0)


def never() -> bool:
    return False


@pytest.fixture(scope="module")
def settings(data_dir: Path) -> Settings:
    window, data = office(data_dir, 3, 2)
    return Settings(window, 0.1, data)


def log_posterior(settings: Settings, coloring: Coloring) -> float:
    sums = make_chain(settings, coloring).graph.sums
    return float(sums[c.LOG_PRIOR] + sums[c.LOG_LIKELIHOOD])


def test_contours_are_valid_better_than_nothing_and_differ(settings: Settings) -> None:
    assert settings.laser is not None
    empty = log_posterior(settings, Coloring.empty(settings.window))
    found = [contour_map(settings, np.random.default_rng(k)) for k in range(3)]
    for coloring in found:
        assert not violations(coloring)
        assert not black_at(coloring, settings.laser.readings.origin).any()
        assert coloring.n_edges > 100
        assert log_posterior(settings, coloring) > empty + 2000.0
    assert len({coloring.xy.tobytes() for coloring in found}) == 3
    again = contour_map(settings, np.random.default_rng(0))
    assert np.array_equal(again.xy, found[0].xy)


@pytest.mark.parametrize("seed", range(6))
def test_contours_of_small_worlds_are_valid(seed: int) -> None:
    world = draw_world(0.4, ROOM, Sensor(6.0), 5, 60, np.random.default_rng(seed))
    coloring = contour_map(Settings(ROOM, 0.4, world.data), np.random.default_rng(seed))
    assert not violations(coloring)
    assert not black_at(coloring, world.data.readings.origin).any()


def test_a_region_that_touches_sensors_border_and_itself_becomes_a_map() -> None:
    world = draw_world(0.4, ROOM, Sensor(6.0), 3, 10, np.random.default_rng(1))
    squares = [shapely.box(0, 0, 2, 2), shapely.box(2, 2, 4, 4), shapely.box(8, 8, 10, 10)]
    on_sensors = shapely.buffer(shapely.points(world.data.readings.origin), 0.3)
    region = shapely.union_all([*squares, *on_sensors])
    coloring = map_of_region(region, Settings(ROOM, 0.4, world.data))
    assert not violations(coloring)
    assert not black_at(coloring, world.data.readings.origin).any()
    assert occupied_polygons(coloring).area == pytest.approx(region.area, rel=0.1)


def test_a_draw_of_the_prior_leads_to_a_map_of_the_readings(
    settings: Settings, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert settings.laser is not None
    monkeypatch.setattr(starts, "LOOK", 3000)
    empty = log_posterior(settings, Coloring.empty(settings.window))
    found = [find_start_map("prior", settings, np.random.default_rng(k), never) for k in range(2)]
    for coloring in found:
        assert not violations(coloring)
        assert not black_at(coloring, settings.laser.readings.origin).any()
        assert log_posterior(settings, coloring) > empty + 2000.0
    assert not np.array_equal(found[0].xy[:5], found[1].xy[:5])


@pytest.mark.parametrize("seed", range(5))
def test_a_search_cut_short_still_frees_every_sensor(seed: int) -> None:
    """From draws whose black covers half of the window."""
    world = draw_world(0.3, ROOM, Sensor(6.0), 8, 20, np.random.default_rng(seed))
    settings = Settings(ROOM, 0.3, world.data)
    coloring = find_start_map("prior", settings, np.random.default_rng(seed), lambda: True)
    assert not violations(coloring)
    assert not black_at(coloring, world.data.readings.origin).any()
    assert coloring.n_edges > 0


def test_sonar_may_start_from_the_prior_and_not_from_a_grid() -> None:
    data = draw_sonar_world(0.3, ROOM, Ring(), 3, 12, 0.5, np.random.default_rng(3)).data
    settings = Settings(ROOM, 0.3, sonar=data)
    coloring = find_start_map("prior", settings, np.random.default_rng(1), lambda: True)
    assert not black_at(coloring, data.readings.origin).any()
    with pytest.raises(ConfigError, match="start grid"):
        contour_map(settings, np.random.default_rng(1))


def test_the_empty_start_is_the_empty_map(settings: Settings) -> None:
    assert find_start_map("empty", settings, np.random.default_rng(1), never).n_edges == 0


def test_chains_start_at_the_given_maps(settings: Settings) -> None:
    with_image = Settings(settings.window, 0.1, settings.laser, resolution=1.0)
    with Sampler(with_image, spawn_generators(1, 2), 1, starts_from="grid") as sampler:
        sampler.find_starts(never)
        edges = [int(chain.chain.graph.counts[c.EDGES]) for chain in sampler.chains]
        assert min(edges) > 100
        assert edges[0] != edges[1]
        assert sampler.step == 0
