"""Worlds from GeoJSON of any program, and draws from the prior."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import shapely
from shapely import MultiPolygon, Polygon, box

from prf.arak import exact_draws
from prf.laws import expected_edges
from prf.run.mapfile import map_text
from prf.shell.errors import ConfigError, InputError
from prf.simulate import World, draw_world, read_world, roadmap
from prf.window import Window
from tests.reference.slow_coloring import edge_set

WINDOW = Window(-4.0, 2.0, 6.0, 10.0)


def test_maps_of_prf_come_back_exactly(tmp_path: Path) -> None:
    for coloring in exact_draws(0.3, WINDOW, 5, np.random.default_rng(1)):
        (tmp_path / "map.geojson").write_text(map_text(coloring, {}))
        world = read_world(tmp_path / "map.geojson")
        assert world.window == WINDOW
        assert edge_set(world.coloring()) == edge_set(coloring)


def test_the_demo_office(data_dir: Path) -> None:
    world = read_world(data_dir / "demo-office.geojson")
    assert world.window == (-1.0, -1.0, 23.0, 15.0)
    assert world.free_at([(11.0, 7.0), (2.3, 2.1)]).tolist() == [True, False]


def test_polygons_of_another_program_get_a_window(tmp_path: Path) -> None:
    region = MultiPolygon([box(0.0, 0.0, 4.0, 0.2), box(0.0, 1.0, 4.0, 1.2)])
    (tmp_path / "map.json").write_text(json.dumps(shapely.geometry.mapping(region)))
    world = read_world(tmp_path / "map.json")
    assert world.window == pytest.approx((-1.0, -1.0, 5.0, 2.2))
    assert len(world.walls) == 8


def test_the_window_of_a_spike_reaches_no_farther(tmp_path: Path) -> None:
    spike = Polygon([(0.0, 0.0), (10.0, 1.0), (0.0, 2.0)])
    (tmp_path / "spike.geojson").write_text(json.dumps(shapely.geometry.mapping(spike)))
    assert read_world(tmp_path / "spike.geojson").window == (-1.0, -1.0, 11.0, 3.0)


def test_maps_without_inside_and_outside_are_refused(tmp_path: Path) -> None:
    touching = MultiPolygon([box(0.0, 0.0, 1.0, 1.0), box(1.0, 1.0, 2.0, 2.0)])
    for region, message in ((touching, "touch at a point"), (MultiPolygon(), "neither a polygon nor a window")):
        (tmp_path / "map.json").write_text(json.dumps(shapely.geometry.mapping(region)))
        with pytest.raises(InputError, match=message):
            read_world(tmp_path / "map.json")
    with pytest.raises(InputError, match="no such file"):
        read_world(tmp_path / "none.geojson")


N_DRAWS = 400


def test_draws_follow_the_laws_of_the_prior() -> None:
    """The mean number of walls, at a false-alarm rate of 1e-4, and so few draws more at a scale a fifth larger not."""
    rng, others = np.random.default_rng(2), np.random.default_rng(3)
    counts, larger = (
        np.array([len(draw_world(scale, WINDOW, r, lambda world: True).world.walls) for _ in range(N_DRAWS)])
        for scale, r in ((0.2, rng), (0.24, others))
    )
    law = expected_edges(0.2, WINDOW)
    z, control = ((c.mean() - law) / (c.std(ddof=1) / np.sqrt(N_DRAWS)) for c in (counts, larger))
    assert abs(z) < 3.9, f"z = {z:.2f} at seed 2"
    assert abs(control) > 3.9


def test_the_first_draw_that_can_be_used_is_taken() -> None:
    def has_room(world: World) -> bool:
        try:
            return roadmap(world, 0.25).area > 0.3 * WINDOW.area
        except InputError:
            return False

    n_redrawn = []
    for seed in range(12):
        drawn = draw_world(0.2, WINDOW, np.random.default_rng(seed), has_room)
        rng = np.random.default_rng(seed)
        stream = [World.from_coloring(exact_draws(0.2, WINDOW, 1, rng)[0]) for _ in range(drawn.n_redrawn + 1)]
        assert [has_room(world) for world in stream] == [False] * drawn.n_redrawn + [True]
        assert np.array_equal(stream[-1].walls, drawn.world.walls)
        n_redrawn.append(drawn.n_redrawn)
    assert max(n_redrawn) > 0


def test_what_cannot_be_drawn_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("prf.simulate.sources.MOST_DRAWS", 3)
    with pytest.raises(ConfigError, match="none of 3 draws"):
        draw_world(0.2, WINDOW, np.random.default_rng(1), lambda world: False)
