"""Worlds from GeoJSON of any program, and draws from the prior."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import shapely
from shapely import MultiPolygon, Polygon, box

from prf.model.arak import exact_draws, expected_edges
from prf.model.coloring import violations
from prf.model.window import Window
from prf.output.export.cells import Raster, rasterise
from prf.output.export.ros import ros_map
from prf.results.geojson import map_text, outline_of_cells
from prf.shell.errors import InputError
from prf.simulate import World, draw_world, office, read_world, roadmap
from prf.simulate.world import CellMap, _joined, read_cell_map, world_of_cells
from tests.output.export.map_server import load
from tests.reference.slow_coloring import edge_set

WINDOW = Window(-4.0, 2.0, 6.0, 10.0)


def test_maps_of_prf_are_read_exactly(tmp_path: Path) -> None:
    for coloring in exact_draws(0.3, WINDOW, 5, np.random.default_rng(1)):
        (tmp_path / "map.geojson").write_text(map_text(coloring, {}))
        world = read_world(tmp_path / "map.geojson")
        assert world.window == WINDOW
        assert edge_set(world.coloring()) == edge_set(coloring)


def test_polygons_of_another_program_get_a_window(tmp_path: Path) -> None:
    region = MultiPolygon([box(0.0, 0.0, 4.0, 0.2), box(0.0, 1.0, 4.0, 1.2)])
    (tmp_path / "map.json").write_text(json.dumps(shapely.geometry.mapping(region)))
    world = read_world(tmp_path / "map.json")
    assert world.window == pytest.approx((-1.0, -1.0, 5.0, 2.2))
    assert len(world.walls) == 8


def test_maps_without_inside_and_outside_are_refused(tmp_path: Path) -> None:
    touching = MultiPolygon([box(0.0, 0.0, 1.0, 1.0), box(1.0, 1.0, 2.0, 2.0)])
    for region, message in ((touching, "touch at a point"), (MultiPolygon(), "expected polygons of the occupied area")):
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
        np.array([len(draw_world(scale, WINDOW, r, lambda world: True)[0].walls) for _ in range(N_DRAWS)])
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
        drawn, n_thrown = draw_world(0.2, WINDOW, np.random.default_rng(seed), has_room)
        rng = np.random.default_rng(seed)
        stream = [World.from_coloring(exact_draws(0.2, WINDOW, 1, rng)[0]) for _ in range(n_thrown + 1)]
        assert [has_room(world) for world in stream] == [False] * n_thrown + [True]
        assert np.array_equal(stream[-1].walls, drawn.walls)
        n_redrawn.append(n_thrown)
    assert max(n_redrawn) > 0


def random_cells(rng: np.random.Generator) -> np.ndarray:
    return np.pad(rng.random((7, 9)) < rng.uniform(0.2, 0.8), 2, constant_values=bool(rng.integers(2)))


def test_contours_are_exact() -> None:
    rng = np.random.default_rng(1)
    for _ in range(100):
        taken = _joined(random_cells(rng))
        area = outline_of_cells(taken, np.zeros(2), 1.0)
        cells = [box(x, y, x + 1, y + 1) for y, x in np.argwhere(taken)]
        assert area.is_valid
        assert area.symmetric_difference(shapely.union_all(cells)).area == 0.0


def test_cells_that_touch_at_a_corner_are_joined_and_none_is_lost() -> None:
    rng = np.random.default_rng(2)
    for _ in range(100):
        taken = random_cells(rng)
        joined = _joined(taken)
        assert joined[taken].all()
        blocks = np.stack([joined[:-1, :-1], joined[:-1, 1:], joined[1:, 1:], joined[1:, :-1]])
        assert not ((blocks[0] == blocks[2]) & (blocks[1] == blocks[3]) & (blocks[0] != blocks[1])).any()
    square = np.zeros((6, 6), bool)
    square[2:4, 2:4] = True
    assert np.array_equal(_joined(square), square)


def test_maps_are_read_as_map_server_serves_them(tmp_path: Path) -> None:
    probability = np.random.default_rng(3).choice([0.0, 0.1, 0.9, 1.0, np.nan], (12, 17))
    yaml, image, _ = ros_map(Raster(probability, np.array([-3.0, 2.0]), 0.1), None, "map.pgm")
    (tmp_path / "map.yaml").write_text(yaml)
    (tmp_path / "map.pgm").write_bytes(image)
    cells, served = read_cell_map(tmp_path / "map.yaml"), load(tmp_path / "map.yaml")
    assert np.array_equal(cells.unknown, served.data == -1)
    assert np.array_equal(cells.occupied, served.data > 65)
    assert (cells.origin, cells.resolution) == ((-3.0, 2.0), 0.1)


def test_any_cells_make_a_valid_world() -> None:
    rng = np.random.default_rng(4)
    for _ in range(60):
        state = rng.integers(0, 3, (12, 15))
        world = world_of_cells(CellMap(state == 1, state == 2, (1.0, -2.0), 0.5))
        assert violations(world.coloring()) == []
        assert world.window == (0.0, -3.0, 9.5, 5.0)


def test_a_floor_is_recovered_from_its_raster(tmp_path: Path) -> None:
    """Walls within a cell of where they were; of the few dozen of a slanted room one wall each."""
    truth = office(14.0, 9.0, np.random.default_rng(5), furniture=False)
    cells = rasterise(truth.coloring(), 0.02, squares=False)
    yaml, image, _ = ros_map(cells, None, "map.pgm")
    (tmp_path / "map.yaml").write_text(yaml)
    (tmp_path / "map.pgm").write_bytes(image)
    world = read_world(tmp_path / "map.yaml")
    occupied = world.occupied.intersection(box(*truth.window).buffer(-0.1))  # all is occupied round the map
    assert occupied.symmetric_difference(truth.occupied).area < 0.02 * shapely.length(truth.occupied)
    assert shapely.hausdorff_distance(occupied.boundary, truth.occupied.boundary) < 0.05
    assert len(world.walls) < 1.5 * len(truth.walls)


def test_staircases_become_straight() -> None:
    window = Window(0.0, 0.0, 20.0, 20.0)
    slanted = World.from_polygons(Polygon([(3.0, 4.0), (16.0, 9.0), (13.0, 17.0), (4.0, 13.0)]), window)
    raster = rasterise(slanted.coloring(), 0.05, squares=False)
    cells = CellMap(raster.probability > 0.5, np.zeros(raster.probability.shape, bool), (0.0, 0.0), 0.05)
    world = world_of_cells(cells)
    occupied = world.occupied.intersection(box(*window).buffer(-0.1))
    assert 8 <= len(world.walls) <= 20
    assert shapely.hausdorff_distance(occupied, slanted.occupied) < 0.11


def test_a_map_that_a_robot_made(shared_data: Path) -> None:
    world = read_world(shared_data / "prf" / "ros1" / "meeting.yaml")
    assert 500 < len(world.walls) < 3000
    assert world.free_at([(15.0, 15.0), (28.0, 2.0)]).tolist() == [True, False]


YAML = "image: map.pgm\nresolution: 0.1\norigin: [0.0, 0.0, 0.0]\nnegate: 0\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a: [", "not the yaml file"),
        (YAML.replace("0.1", "-1"), "window"),
        (YAML.replace("0.1", "fine"), "could not convert"),
        (YAML.replace("[0.0, 0.0, 0.0]", "[0.0]"), "not enough values"),
        (YAML + "mode: raw\n", "mode trinary"),
        (YAML.replace("0.0]", "0.5]"), "not turned"),
        (YAML.replace("map.pgm", "none.pgm"), r"none\.pgm: no such file"),
        (YAML.replace("map.pgm", "map.yaml"), "not an image"),
    ],
)
def test_damaged_maps_are_refused(text: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "map.pgm").write_bytes(b"P5\n2 1\n255\n\xff\x00")
    (tmp_path / "map.yaml").write_text(text)
    with pytest.raises(InputError, match=message):
        read_cell_map(tmp_path / "map.yaml")


def test_negated_images_and_names_in_quotes(tmp_path: Path) -> None:
    (tmp_path / "map.pgm").write_bytes(b"P5\n2 1\n255\n\xff\x00")
    (tmp_path / "map.yaml").write_text(
        YAML.replace("negate: 0", "negate: 1  # white walls").replace("map.pgm", "'map.pgm'")
    )
    assert read_cell_map(tmp_path / "map.yaml").occupied.tolist() == [[True, False]]
