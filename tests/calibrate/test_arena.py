"""A real sonar in an arena whose walls are known: fitted at some places, judged at the others."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import shapely

from benchmarks.real_sonar import ARENA_MAX_RANGE, ARENA_WINDOW, arena_plan
from prf.calibrate import calibrate_sonar
from prf.configuration import Configuration
from prf.score import read_occupied_area
from prf.window import Window
from tests.logs.sonar_sets import ARENA_POSITIONS, ARENA_WALLS, arena_readings


def test_the_plan_has_the_walls_and_no_others(tmp_path: Path) -> None:
    area = read_occupied_area(arena_plan(tmp_path / "arena.geojson"))
    assert area.window == Window(*ARENA_WINDOW)
    inside = 2.1 * 0.84 + 1.68 * 0.84 + 0.84 * 0.42  # bottom, middle, top
    assert 2.9 * 2.9 - area.region.area == pytest.approx(inside - 0.42 * 0.02, abs=0.01)
    assert not shapely.contains_xy(area.region, 0.01 * np.array(ARENA_POSITIONS)).any()
    edge = area.region.boundary
    assert max(edge.distance(shapely.Point(wall.mean(axis=0))) for wall in ARENA_WALLS) < 0.011


@pytest.mark.slow
def test_what_some_places_tell_helps_at_the_others(shared_data: Path, tmp_path: Path) -> None:
    area = read_occupied_area(arena_plan(tmp_path / "arena.geojson"))
    readings = arena_readings(shared_data / "prf/sonar/arena_known_map")
    config = Configuration.of(sonar_max_range=ARENA_MAX_RANGE)
    found = calibrate_sonar(readings, area, config, np.random.default_rng(1))
    assert (found.n_readings, found.n_in_view, found.folds) == (900, 900, 5)
    assert found.held_out[1] < found.held_out[0] - 0.4
    assert found.fit.loss < found.no_map - 900
    assert np.isfinite(found.fit.error).all()
    value = dict(zip(found.family.names, found.fit.value.tolist(), strict=True))
    assert 0.03 < value["noise_relative"] < 0.06
